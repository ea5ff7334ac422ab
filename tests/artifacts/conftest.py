"""Small recipes, and a store to keep their artifacts."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

Make = Callable[..., ArtifactRef]
Fail = Callable[..., None]
Litter = Callable[[ArtifactStore], list[str]]
AsNobody = Callable[[Callable[[], Any]], Any]

NOBODY = 65534

PAYLOAD = {"a.bin": b"0123456789", "deep/er/b.bin": bytes(range(256)), "empty": b""}


@pytest.fixture
def store(tmp_path: Path) -> ArtifactStore:
    return ArtifactStore(tmp_path / "store")


@pytest.fixture
def recipe() -> Recipe:
    return Recipe(
        stage="ingest",
        kind="episodes",
        config={"seed": 3, "limits": {"low": 0.5}},
        code="c0de",
        files={"log": "ab" * 32},
        libraries={"numpy": "2.4.6"},
    )


@pytest.fixture
def payload() -> dict[str, bytes]:
    """Files of the artifacts that ``make`` makes."""
    return dict(PAYLOAD)


@pytest.fixture
def make() -> Make:
    """Commits an artifact: ``make(store, recipe)``, ``make(store, recipe, {"a.bin": b"..."})``."""

    def commit(
        store: ArtifactStore,
        recipe: Recipe,
        payload: Mapping[str, bytes] = PAYLOAD,
        *,
        replacing: bool = False,
        **summary: Any,
    ) -> ArtifactRef:
        with store.create(recipe, replacing=replacing) as draft:
            assert not draft.adopted
            draft.summary.update(summary)
            for name, content in payload.items():
                path = draft.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
        return draft.ref

    return commit


@pytest.fixture
def fail() -> Fail:
    """Begins an artifact, leaves something in its scratch, and raises: ``fail(store, recipe, ZeroDivisionError())``."""

    def begin(store: ArtifactStore, recipe: Recipe, error: BaseException, *, replacing: bool = False) -> None:
        with store.create(recipe, replacing=replacing) as draft:
            (draft.path / "half").write_bytes(b"1")
            (draft.scratch / "step-100").write_bytes(b"resume from here")
            raise error

    return begin


@pytest.fixture
def litter() -> Litter:
    """Everything in the hidden work folder of a store but its fixed folders."""

    def find(store: ArtifactStore) -> list[str]:
        work = store.cache / ".work"
        paths = [path.relative_to(work).as_posix() for path in work.rglob("*")]
        return sorted(path for path in paths if "/" in path)

    return find


@pytest.fixture
def open_place() -> Iterator[Path]:
    """A folder that every user may enter; pytest's own are closed to others."""
    place = Path(tempfile.mkdtemp(prefix="juicer-test-"))
    place.chmod(0o755)
    yield place
    for folder in (place, *(path for path in place.rglob("*") if path.is_dir() and not path.is_symlink())):
        folder.chmod(0o755)
    shutil.rmtree(place)


@pytest.fixture
def as_nobody() -> AsNobody:
    """Calls a function in a process without any special rights: ``as_nobody(lambda: store.verify(ref))``.

    Gives what the function gives, or raises what it raises.
    """

    def call(function: Callable[[], Any]) -> Any:
        context = multiprocessing.get_context("fork")
        receiving, sending = context.Pipe(duplex=False)

        def work() -> None:
            if os.geteuid() == 0:
                os.setgroups([])
                os.setgid(NOBODY)
                os.setuid(NOBODY)
            try:
                sending.send((function(), None))
            except BaseException as error:
                sending.send((None, error))

        process = context.Process(target=work)
        process.start()
        sending.close()
        result, error = receiving.recv()
        process.join()
        if error is not None:
            raise error
        return result

    return call


@pytest.fixture(scope="session")
def every_kind(tmp_path_factory: pytest.TempPathFactory) -> ArtifactStore:
    """A small artifact of every kind, written by what writes the real ones. Tests work on copies."""
    return _write_every_kind(ArtifactStore(tmp_path_factory.mktemp("every kind") / "store"))


def _write_every_kind(store: ArtifactStore) -> ArtifactStore:
    # Imported here: most tests of this folder need none of it.
    import numpy as np

    from juicer.demonstration.log import OperatorLog, write_log
    from juicer.episode import SIMULATOR, ArraySpec, Episode, EpisodeRecord, Outcome, Role, Source
    from juicer.imaging.video import write_video
    from juicer.policy.checkpoint import Checkpoint, CheckpointMetadata, save_checkpoint
    from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
    from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
    from juicer.policy.heads.diffusion.config import DiffusionConfig
    from juicer.policy.network import build_policy
    from juicer.progress import NullMetricSink
    from juicer.reporting.content import ReportData
    from juicer.reporting.page import write_page
    from juicer.storage.annotations import Annotation, write_annotations
    from juicer.storage.columns import write_columns
    from juicer.storage.curves import CurveWriter
    from juicer.storage.dataset import DatasetRow, write_dataset
    from juicer.storage.episodes import write_episodes
    from juicer.storage.evaluations import EvaluationRow, write_evaluation
    from juicer.storage.selections import SelectionRow, write_selection

    rng = np.random.default_rng(0)
    sizes = {"part_poses": (14,), "sim_state": (12,)}
    steps = {
        spec.name: rng.normal(size=(6, *sizes.get(spec.name, spec.shape))).astype(spec.dtype) for spec in SIMULATOR
    }
    final = {name: steps[name][-1] for name in SIMULATOR.ends}
    facts = {"source": Source.TELEOP, "task": "one_leg", "randomness": "low", "seed": 1, "parts_assembled": 1}
    episode = Episode(EpisodeRecord(**facts, outcome=Outcome.SUCCESS), steps, final)
    pair = PairSpec(first=0, second=1, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
    tasks = {"toy": FeatureSpec(num_parts=2, pairs=(pair,), mounted_m=0.005, mounted_cosine=0.94)}
    config = PolicyConfig(head=DiffusionConfig(denoiser=MLPDenoiserConfig(width=8, blocks=1), prediction="sample"))
    metadata = CheckpointMetadata(policy=config, tasks=tasks, acting_weights="ema", step=1)
    weights = build_policy(config, tasks, 0).state_dict()

    def log(folder: Path, scratch: Path) -> None:
        known = {name: facts[name] for name in ("task", "randomness", "seed", "parts_assembled")}
        times = {"timestamp_s": np.arange(6) * 0.1, "idle": np.zeros(6, bool)}
        marks = {"device": "hand", "success": True, "outcome": "success"}
        for name in ("0.npz", "1.npz"):
            write_log(folder / name, OperatorLog(**known, **marks, **times, steps=steps, final=final))

    def checkpoint(folder: Path, scratch: Path) -> None:
        save_checkpoint(folder, Checkpoint(metadata, weights, weights))
        curves = CurveWriter(scratch, NullMetricSink())
        curves.log({"train/loss": 0.5}, 1)
        curves.finish(folder)

    def evaluation(folder: Path, scratch: Path) -> None:
        (folder / "examples").mkdir()
        write_episodes(folder / "examples", [episode], {"source": "rollout"})
        write_evaluation(folder, [EvaluationRow(0, 1, Outcome.SUCCESS, 1, 6, {"inserted": 3})])

    def report(folder: Path, scratch: Path) -> None:
        write_page(ReportData(title="Nothing yet", created=datetime(2026, 1, 1)), folder / "report.html")
        write_video(folder / "success.mp4", [np.full((48, 64, 3), shade, np.uint8) for shade in range(5)])

    def columns(folder: Path, scratch: Path) -> None:
        speed = ArraySpec("speed", (1,), "float32", Role.DERIVED)
        values = {"speed": rng.normal(size=(6, 1)).astype(np.float32)}
        write_columns(folder, [speed], [values], artifact="0123456789abcdef", episode_ends=np.array([6]))

    row = DatasetRow("0123456789abcdef", episode.record.episode_id, Source.TELEOP, "one_leg", "0/0")

    makers: dict[str, Callable[[Path, Path], object]] = {
        "logs": log,
        "episodes": lambda folder, scratch: write_episodes(folder, [episode], {"source": "teleop"}),
        "columns": columns,
        "annotations": lambda folder, scratch: write_annotations(
            folder, [Annotation(episode.record.episode_id, 3, 0, "human", 1.0)]
        ),
        "selection": lambda folder, scratch: write_selection(
            folder, [SelectionRow(episode.record.episode_id, True, "success")]
        ),
        "dataset": lambda folder, scratch: write_dataset(folder, [row]),
        "checkpoint": checkpoint,
        "evaluation": evaluation,
        "report": report,
    }
    for kind, maker in makers.items():
        with store.create(Recipe(f"make {kind}", kind, config={"number": 1})) as draft:
            maker(draft.path, draft.scratch)
            draft.summary |= {"episodes": 1, "reason": "made for a test"}
    return store
