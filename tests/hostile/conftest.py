"""Checkpoints as a stranger may put them into a shared store."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

Damage = Callable[[Path], object]


def _at(content: Any, keys: tuple[str | int, ...], value: Any) -> Any:
    """The same JSON with one value replaced."""
    if not keys:
        return value
    copied = list(content) if isinstance(content, list) else {keys[0]: {}, **content}
    copied[keys[0]] = _at(copied[keys[0]], keys[1:], value)
    return copied


def policy(value: Any, *keys: str | int) -> Damage:
    def damage(folder: Path) -> None:
        path = folder / "policy.json"
        path.write_text(json.dumps(_at(json.loads(path.read_text()), keys, value)))

    return damage


def raw(content: bytes, name: str = "policy.json") -> Damage:
    return lambda folder: (folder / name).write_bytes(content)


def tensors(change: Callable[[dict[str, Any]], object], name: str = "weights.safetensors", task: str = "") -> Damage:
    def damage(folder: Path) -> None:
        content = load_file(folder / name)
        change(content)
        save_file(content, folder / name, {"task": task} if task else None)

    return damage


def header(content: bytes, payload: bytes = b"", length: int | None = None) -> Damage:
    declared = struct.pack("<Q", len(content) if length is None else length)
    return raw(declared + content + payload, "weights.safetensors")


def link(name: str, target: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).symlink_to(target)

    return damage


def _grown(folder: Path) -> None:
    """A file whose size on paper is 200 GB; on disk it takes nothing."""
    with (folder / "weights.safetensors").open("r+b") as file:
        file.truncate(200_000_000_000)


def _first(content: dict[str, Any]) -> str:
    return next(name for name in content if name.startswith("head"))


def _nan(content: dict[str, Any]) -> None:
    content[_first(content)].flat[0] = np.nan


def _shape(content: dict[str, Any]) -> None:
    name = _first(content)
    content[name] = np.ascontiguousarray(content[name].reshape(-1)[:-1])


HEAD = ("policy", "head")
PAIR = ("tasks", "toy", "pairs", 0)
DEEP = b"[" * 100_000 + b"]" * 100_000
MANY_TASKS = {f"t{index}": {"num_parts": 1, "pairs": [], "mounted_m": 1, "mounted_cosine": 0} for index in range(9_000)}
BIG_UNET = {"kind": "diffusion", "denoiser": {"kind": "unet", "channels": [16384, 16384, 16384]}}

CHECKPOINTS: dict[str, Damage] = {
    "a billion blocks": policy(10**9, *HEAD, "denoiser", "blocks"),
    "a billion wide": policy(10**9, *HEAD, "denoiser", "width"),
    "as wide and deep as each may be": policy(
        {"kind": "mlp", "width": 16_384, "blocks": 64, "step_embedding": 64}, *HEAD, "denoiser"
    ),
    "the widest U-Net": policy(BIG_UNET, *HEAD),
    "no blocks": policy(0, *HEAD, "denoiser", "blocks"),
    "ten million inference steps": policy(10**7, *HEAD, "inference_steps"),
    "as many noise levels": policy({"kind": "diffusion", "train_timesteps": 10**9, "inference_steps": 10**9}, *HEAD),
    "huge embedding": policy(10**12, *HEAD, "denoiser", "step_embedding"),
    "endless horizon": policy({"obs": 1, "pred": 10**9, "action": 10**9}, "policy", "horizons"),
    "endless past": policy({"obs": 10**9, "pred": 2 * 10**9, "action": 1}, "policy", "horizons"),
    "thousands of tasks": policy(MANY_TASKS, "tasks"),
    "thirty tasks": policy({f"t{index}": MANY_TASKS["t0"] for index in range(30)}, "tasks"),
    "no tasks": policy({}, "tasks"),
    "tasks as a list": policy([], "tasks"),
    "a task without a name": policy({"": MANY_TASKS["t0"]}, "tasks"),
    "a task with an escape sequence for a name": policy({"\x1b[2J": MANY_TASKS["t0"]}, "tasks"),
    "a task with an endless name": policy({"a" * 100_000: MANY_TASKS["t0"]}, "tasks"),
    "no pairs": policy([], "tasks", "toy", "pairs"),
    "pairs as a number": policy(3, "tasks", "toy", "pairs"),
    "a billion parts": policy(10**9, "tasks", "toy", "num_parts"),
    "minus one part": policy(-1, "tasks", "toy", "num_parts"),
    "a pair beyond the parts": policy(50, *PAIR, "second"),
    "a part number that is true": policy(True, *PAIR, "second"),
    "a target that is too short": policy([0.0, 0.0], *PAIR, "target"),
    "a target far away": policy([1e300] * 7, *PAIR, "target"),
    "an infinite target": policy([float("inf")] * 7, *PAIR, "target"),
    "a target that is no number": policy([float("nan")] * 7, *PAIR, "target"),
    "thousands of targets": policy([[0.0] * 7] * 10_000, *PAIR, "also_at"),
    "thousands of scales": policy([0.1] * 10_000, "policy", "observation", "state", "fine_scales_m"),
    "a scale of zero": policy([0.0], "policy", "observation", "state", "fine_scales_m"),
    "a text for a number": policy("16", *HEAD, "denoiser", "width"),
    "an unknown encoder": policy({"state": {"kind": "pickle"}}, "policy", "observation"),
    "no encoder": policy({}, "policy", "observation"),
    "thousands of encoders": policy(
        {f"e{index}": {"kind": "features"} for index in range(999)}, "policy", "observation"
    ),
    "an encoder called like the task": policy({"task": {"kind": "features"}}, "policy", "observation"),
    "an encoder with an escape sequence for a name": policy({"\x1b[2J": {"kind": "features"}}, "policy", "observation"),
    "an encoder that is a module": policy({"state": {"kind": "os:system"}}, "policy", "observation"),
    "an encoder of the first layout": policy({"pairs": "all"}, "policy", "observation"),
    "a network of its own": policy("os:system", *HEAD, "network"),
    "an unknown head": policy({"kind": "pickle"}, *HEAD),
    "an unknown key": policy("os.system", "policy", "__reduce__"),
    "another schema": policy(6, "schema_version"),
    "a schema that is true": policy(True, "schema_version"),
    "a schema of lists": policy([[[]]], "schema_version"),
    "unknown acting weights": policy("../../secret", "acting_weights"),
    "steps before the first": policy(-1, "step"),
    "a policy that is a list": raw(b"[]"),
    "nothing": raw(b""),
    "zero bytes": raw(b"\0" * 1000),
    "another encoding": raw("{}".encode("utf-16")),
    "nested deep": raw(b'{"schema_version": 5, "policy": ' + DEEP + b"}"),
    "nested deep as a whole": raw(DEEP),
    "thousands of digits": raw(b'{"schema_version": ' + b"4" * 5000 + b"}"),
    "the same key twice": raw(b'{"schema_version": 5, "schema_version": 5}'),
    "two megabytes of metadata": raw(b" " * 2_000_000 + b"{}"),
    "metadata of the device zero": link("policy.json", "/dev/zero"),
    "metadata of somebody else": link("policy.json", "/etc/hostname"),
    "weights of the device zero": link("weights.safetensors", "/dev/zero"),
    "weights that lead nowhere": link("ema.safetensors", "/nowhere"),
    "no weights": lambda folder: (folder / "weights.safetensors").unlink(),
    "a folder for weights": lambda folder: (
        (folder / "weights.safetensors").unlink(),
        (folder / "weights.safetensors").mkdir(),
    ),
    "a pickle": raw(b"\x80\x04\x95" + b"\x00" * 100, "weights.safetensors"),
    "an archive": raw(b"PK\x03\x04" + b"\x00" * 1000, "weights.safetensors"),
    "a header of exabytes": header(b"{}", length=2**63),
    "a header of a gigabyte": header(b"{}", length=10**9),
    "a header that is no JSON": header(b"\xff" * 100),
    "a header nested deep": header(DEEP),
    "a tensor of exabytes": header(
        json.dumps({"a": {"dtype": "F32", "shape": [2**40, 2**20], "data_offsets": [0, 4]}}).encode(), b"\0" * 4
    ),
    "a tensor outside the file": header(
        json.dumps({"a": {"dtype": "F32", "shape": [1], "data_offsets": [0, 2**60]}}).encode(), b"\0" * 4
    ),
    "a negative shape": header(
        json.dumps({"a": {"dtype": "F32", "shape": [-1], "data_offsets": [0, 4]}}).encode(), b"\0" * 4
    ),
    "no tensors": header(b"{}"),
    "two hundred gigabytes": _grown,
    "cut short": lambda folder: (folder / "weights.safetensors").write_bytes(
        (folder / "weights.safetensors").read_bytes()[:-8]
    ),
    "a weight that is no number": tensors(_nan),
    "a weight of another shape": tensors(_shape),
    "a weight too few": tensors(lambda content: content.pop(_first(content))),
    "a weight too many": tensors(lambda content: content.update(extra=np.zeros(1, np.float32))),
    "a weight with an escape sequence for a name": tensors(lambda content: content.update({"\x1b[2J": np.zeros(1)})),
    "weights in half precision": tensors(
        lambda content: content.update({name: array.astype(np.float16) for name, array in content.items()})
    ),
    "weights in double precision": tensors(
        lambda content: content.update({name: array.astype(np.float64) for name, array in content.items()})
    ),
}


def replayed(change: Callable[[dict[str, Any]], object], task: str = "toy") -> Damage:
    return tensors(change, "replay.safetensors", task)


def put(name: str, array: Any) -> Damage:
    return replayed(lambda content: content.update({name: np.array(array)}))


REPLAYS: dict[str, Damage] = {
    "another task": replayed(lambda content: None, "lamp"),
    "a task with an escape sequence": replayed(lambda content: None, "\x1b[2J"),
    "no actions": replayed(lambda content: content.pop("actions")),
    "actions of another length": put("actions", np.zeros((5, 10), np.float32)),
    "actions of another size": put("actions", np.zeros((9, 3), np.float32)),
    "actions in one row": put("actions", np.zeros(90, np.float32)),
    "whole numbers for actions": put("actions", np.zeros((9, 10), np.int64)),
    "actions that are no numbers": put("actions", np.full((9, 10), np.nan, np.float32)),
    "ends that go back": put("ends", [5, 2, 9]),
    "the same end twice": put("ends", [2, 2, 9]),
    "ends beyond the actions": put("ends", [2, 5, 10**12]),
    "ends below zero": put("ends", [-5, 5, 9]),
    "ends that overflow": put("ends", [2**63 - 1, -(2**63) + 4, 9]),
    "no ends": put("ends", np.zeros(0, np.int64)),
    "an end too few": put("ends", [2, 9]),
    "ends as fractions": put("ends", [2.0, 5.0, 9.0]),
    "a part beyond all": put("parts", [7]),
    "a part below zero": put("parts", [-1]),
    "no part": put("parts", np.zeros(0, np.int64)),
    "the same part twice": put("parts", [0, 0]),
    "first poses of half a part": put("first_poses", np.zeros((3, 10), np.float32)),
    "first poses of no part": put("first_poses", np.zeros((3, 0), np.float32)),
    "first poses of a thousand parts": put("first_poses", np.zeros((3, 7000), np.float32)),
    "first poses in one row": put("first_poses", np.zeros(42, np.float32)),
    "first poses that are infinite": put("first_poses", np.full((3, 14), np.inf, np.float32)),
    "a trillion steps": put("steps", 10**12),
    "no step": put("steps", 0),
    "steps below zero": put("steps", -5),
    "several steps": put("steps", [5, 5]),
    "another device": lambda folder: link("replay.safetensors", "/dev/zero")(folder),
    "a link to nothing": lambda folder: link("replay.safetensors", "/nowhere")(folder),
    "not a file of tensors": raw(b"\x80\x04" * 500, "replay.safetensors"),
}


@pytest.fixture(scope="session")
def checkpoint_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small, valid checkpoint."""
    from juicer.policy.checkpoint import Checkpoint, CheckpointMetadata, save_checkpoint
    from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
    from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
    from juicer.policy.heads.diffusion.config import DiffusionConfig
    from juicer.policy.network import build_policy

    pair = PairSpec(first=0, second=1, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
    tasks = {"toy": FeatureSpec(num_parts=2, pairs=(pair,), mounted_m=0.005, mounted_cosine=0.94)}
    config = PolicyConfig(head=DiffusionConfig(denoiser=MLPDenoiserConfig(width=16, blocks=1), prediction="sample"))
    state = build_policy(config, tasks, 0).state_dict()
    folder = tmp_path_factory.mktemp("checkpoint")
    metadata = CheckpointMetadata(policy=config, tasks=tasks, acting_weights="ema", step=10)
    save_checkpoint(folder, Checkpoint(metadata, weights=state, ema=state))
    return folder


@pytest.fixture(scope="session")
def replay_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three demonstrations to replay."""
    from juicer.policy.replay import ReplayPolicy

    folder = tmp_path_factory.mktemp("replay")
    actions = [np.zeros((length, 10), np.float32) for length in (2, 3, 4)]
    ReplayPolicy(np.ones((3, 14), np.float32), actions, parts=[0], steps=5).save(folder, "toy")
    return folder


@pytest.fixture
def damaged(tmp_path: Path) -> Callable[[Path, Damage], Path]:
    """Copies of a checkpoint, each damaged in its way."""
    made = iter(range(1000))

    def make(folder: Path, damage: Damage) -> Path:
        copy = tmp_path / str(next(made))
        shutil.copytree(folder, copy)
        damage(copy)
        return copy

    return make
