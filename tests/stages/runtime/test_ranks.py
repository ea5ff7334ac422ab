"""One training in several processes: the same as in one, and nothing is left behind, however it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError, StageDied
from juicer.policy.checkpoint import load_checkpoint
from juicer.storage.columns import write_columns
from juicer.storage.curves import read_curves
from juicer.storage.dataset import DatasetRow, write_dataset
from juicer.storage.episodes import write_episodes
from juicer.training import trainer
from juicer.training.config import TrainingConfig
from stages.runtime.context import StageInterrupted
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.train import TrainConfig, train

POLICY = {
    "horizons": {"obs": 1, "pred": 8, "action": 4},
    "action_frame": "relative",
    "head": {"kind": "diffusion", "denoiser": {"kind": "mlp", "width": 32, "blocks": 1, "step_embedding": 8}},
}
SEEING = {
    **POLICY,
    "observation": {
        "body": {"kind": "proprioception"},
        "eyes": {
            "kind": "images",
            "views": {camera: {"camera": camera, "width": 16, "height": 16} for camera in ("front", "wrist")},
            "crops": {"front": {"width": 8, "height": 8}},
            "augmentation": {},
            "backbone": {"kind": "patch_cnn", "quarter": 8, "eighth": 8},
            "projection": 8,
        },
    },
}
TRAINING = TrainingConfig(
    steps=24,
    batch_size=15,
    warmup_steps=2,
    learning_rate=1e-3,
    ema_decay=0.9,
    validation_fraction=0.3,
    validate_every=12,
    report_every=1,
    save_every=5,
)
CONFIG = TrainConfig(policy=POLICY, training=TRAINING)
LONG = CONFIG.model_copy(update={"training": TRAINING.model_copy(update={"steps": 400, "validate_every": 400})})
TWO = Machine(processes=2)


@pytest.fixture
def single_precision(monkeypatch):
    """Processors with matrix instructions round factors to bfloat16 in training, so that last digits grow."""
    settings = trainer.compute_settings
    monkeypatch.setattr(trainer, "compute_settings", lambda threads, _: settings(threads, "highest"))
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX512_CORE")  # what processes that join in obey


class Watcher:
    """Display that does something at a step."""

    def __init__(self, step, act):
        self.step, self.act = step, act

    def started(self, stage, label, artifact):
        def listen(done, total, **facts):
            if done >= self.step and self.act:
                act, self.act = self.act, None
                act(done)

        return listen

    def finished(self, stage, label, artifact, state, summary):
        pass

    def settled(self, label):
        pass


@pytest.fixture
def learn(tmp_path, episode_factory):
    """Trains in a store of its own, so that nothing is reused."""

    def run(machine=TWO, config=CONFIG, name="store", **changes):
        session = Session(ArtifactStore(tmp_path / name), perform_here, machine=machine, **changes)
        episodes = [episode_factory(30 + seed, seed=seed) for seed in range(5)]
        with session.store.create(Recipe("by hand", "episodes")) as draft:
            if not draft.adopted:
                write_episodes(draft.path, episodes, {})
        source = draft.ref
        columns = tuple(drawn(session.store, source, view, episodes) for view in config.policy.learned_views)
        rows = [
            DatasetRow(source.id, each.record.episode_id, each.record.source, "one_leg", str(place), 1.0, columns)
            for place, each in enumerate(episodes)
        ]
        with session.store.create(Recipe("by hand", "dataset")) as draft:
            if not draft.adopted:
                write_dataset(draft.path, rows)
        ref = train(session, dataset=draft.ref, config=config)
        folder = session.store.open(ref)
        return load_checkpoint(folder), read_curves(folder), session.store.manifest(ref).summary

    return run


def drawn(store, episodes, view, each):
    """Columns of images that show nothing."""
    lengths = [len(episode) for episode in each]
    images = np.random.default_rng(len(view.camera)).integers(0, 256, (sum(lengths), 16, 16, 3), dtype=np.uint8)
    ends = np.cumsum(lengths)
    with store.create(Recipe("by hand", "columns", config={"view": view.name})) as draft:
        parts = ({view.name: part} for part in np.split(images, ends[:-1]))
        write_columns(draft.path, [view.column], parts, artifact=episodes.id, episode_ends=ends)
    return draft.ref.id


def ranks():
    """Processes that share the work of a stage, below this one."""
    return {pid for pid in descendants() if b"spawn_main" in read(pid, "cmdline")}


def descendants():
    found, waiting = set(), [os.getpid()]
    while waiting:
        pid = waiting.pop()
        children = [
            int(child)
            for task in Path(f"/proc/{pid}/task").glob("*")
            for child in read(pid, f"task/{task.name}/children").split()
        ]
        found.update(children)
        waiting += children
    return found


def read(pid, name):
    try:
        return Path(f"/proc/{pid}/{name}").read_bytes()
    except OSError:
        return b""


def lives(pid):
    status = read(pid, "status")
    return status and b"State:\tZ" not in status


def listening(pids):
    """Addresses, in the kernel's hexadecimal form, at which processes wait for others."""
    sockets = set()
    for pid in pids:
        for file in Path(f"/proc/{pid}/fd").glob("*"):
            with contextlib.suppress(OSError):
                sockets.add(str(file.readlink()).removeprefix("socket:[").rstrip("]"))
    lines = [
        line.split() for table in ("tcp", "tcp6") for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]
    ]
    return {line[1].partition(":")[0] for line in lines if line[3] == "0A" and line[9] in sockets}


def assert_close_weights(first, second):
    for one, other in ((first.weights, second.weights), (first.ema, second.ema)):
        for name, values in one.items():
            if name.endswith("maps.bias"):
                continue  # a softmax follows, so its gradient is nothing but rounding, of which Adam takes whole steps
            assert torch.allclose(values, other[name], rtol=1e-3, atol=1e-5), name


def test_two_processes_learn_what_one_does_and_listen_to_this_machine_only(learn, single_precision):
    addresses = []
    look = Watcher(3, lambda done: addresses.append(listening(descendants() | {os.getpid()})))
    alone, alone_curves, _ = learn(Machine(), name="alone")
    checkpoint, curves, summary = learn(name="together", display=look)
    assert curves.keys() == alone_curves.keys()
    assert len(curves["train/loss"][1]) == TRAINING.steps
    for name, (steps, values) in alone_curves.items():
        assert curves[name][0] == steps
        assert curves[name][1] == pytest.approx(values, rel=1e-4), name
    assert_close_weights(alone, checkpoint)
    assert summary["steps"] == TRAINING.steps
    assert addresses[0] <= {"0100007F", "00000000000000000000000001000000"}


def test_two_processes_learn_from_varied_images_what_one_does(learn, single_precision):
    config = TrainConfig(policy=SEEING, training=TRAINING.model_copy(update={"steps": 6, "validate_every": 3}))
    alone, alone_curves, _ = learn(Machine(), config=config, name="alone")
    checkpoint, curves, summary = learn(config=config, name="together")
    for name, (_, values) in alone_curves.items():
        assert curves[name][1] == pytest.approx(values, rel=1e-4), name
    assert_close_weights(alone, checkpoint)
    assert summary["observes"] == "images"


def test_a_training_of_which_a_process_is_killed_says_so_and_goes_on_later(learn):
    # Which of the two the launcher sees end first is chance.
    ended = (
        r"one of the processes of stage 'train' (was ended by SIGKILL|ended before its work was done).* run it again"
    )
    with pytest.raises(StageDied, match=ended):
        learn(config=LONG, display=Watcher(30, lambda done: os.kill(max(ranks()), signal.SIGKILL)))
    assert not ranks()
    reports = []
    _, curves, _ = learn(config=LONG, display=Watcher(1, reports.append))
    assert reports[0] > 30
    assert curves["train/loss"][0] == tuple(range(1, LONG.training.steps + 1))
    _, alone, _ = learn(Machine(), config=LONG, name="alone")
    assert curves["train/loss"][1][:60] == pytest.approx(alone["train/loss"][1][:60], rel=1e-3)


def kill_the_parent(stop):
    parent = read(min(ranks()), "stat").split()[3]
    os.kill(int(parent), signal.SIGKILL)


@pytest.mark.parametrize(
    ("end", "error"), [(threading.Event.set, StageInterrupted), (kill_the_parent, StageDied)], ids=["stop", "kill"]
)
def test_the_end_of_a_stage_process_ends_all_that_share_its_work(learn, end, error):
    stop, begun = threading.Event(), set()

    def act(done):
        begun.update(ranks())
        end(stop)

    with pytest.raises(error):
        learn(config=LONG, display=Watcher(3, act), isolate=True, stop=stop)
    assert len(begun) == 2
    deadline = time.monotonic() + 30
    while any(map(lives, begun)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(lives, begun))


def test_a_mistake_is_told_in_the_sentence_that_one_process_would_use(learn):
    config = CONFIG.model_copy(update={"training": TRAINING.model_copy(update={"batch_size": 1})})
    with pytest.raises(ConfigError, match=r"^a batch of 1 .* cannot be shared by 2 processes; raise it"):
        learn(config=config)
