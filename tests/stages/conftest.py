"""Toy stages in a package of their own on the disk, so that identity, processes and failures can be tried out."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from juicer.artifacts.store import ArtifactStore
from stages.runtime.execution import perform_here
from stages.runtime.session import Session

TOYS = '''
"""Stages that do next to nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import StrictConfig
from juicer.errors import NothingLeft
from stages.runtime.context import StageContext
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.runtime.stage import stage


class ToyConfig(StrictConfig):
    words: int = 1


def open_store(url: str) -> Session:
    """What a worker of a cluster has."""
    return Session(ArtifactStore(url), perform_here, machine=Machine(num_envs=5))


@stage(kind="episodes", libraries=("numpy",))
def write(context: StageContext, *, config: ToyConfig) -> None:
    """Write some words."""
    text = "word " * config.words
    (context.draft.path / "words.txt").write_text(text)
    context.progress(config.words, config.words, mood="good")
    context.metrics.log({"length": float(len(text))}, 1)
    context.draft.summary["words"] = config.words
    context.draft.summary["process"] = os.getpid()
    context.draft.summary["tunables"] = os.environ.get("GLIBC_TUNABLES")


@stage(kind="annotations", inputs={"episodes": "episodes"})
def count(
    context: StageContext, *, episodes: tuple[ArtifactRef, ...], notes: tuple[Path, ...] = (), config: ToyConfig
) -> None:
    """Count the words."""
    total = sum(len((context.store.open(ref) / "words.txt").read_text().split()) for ref in episodes)
    (context.draft.path / "count.txt").write_text(str(total))
    context.draft.summary["total"] = total


@stage(kind="episodes", needs="device")
def devote(context: StageContext, *, config: ToyConfig) -> None:
    """Use a device long enough for another to need one too."""
    time.sleep(0.5)
    (context.draft.path / "words.txt").write_text("word " * config.words)
    context.draft.summary["device"] = context.machine.device


@stage(kind="episodes")
def fail(context: StageContext, *, config: ToyConfig) -> None:
    """Find nothing."""
    (context.draft.path / "half.txt").write_text("half")
    raise NothingLeft("there is nothing to work on")


@stage(kind="episodes")
def crash(context: StageContext, *, config: ToyConfig) -> None:
    """Raise what cannot be pickled."""
    error = ValueError("odd")
    error.handle = lambda: None
    raise error


@stage(kind="episodes")
def die(context: StageContext, *, config: ToyConfig) -> None:
    """End without a word."""
    os.kill(os.getpid(), signal.SIGKILL)


@stage(kind="episodes")
def dawdle(context: StageContext, *, config: ToyConfig) -> None:
    """Take very long."""
    (context.draft.scratch / "pid").write_text(str(os.getpid()))
    for done in range(600):
        time.sleep(0.1)
        context.progress(done, 600)


WORK = "import time\\nwhile time.process_time() < 0.5: pass"


@stage(kind="episodes")
def toil(context: StageContext, *, config: ToyConfig) -> None:
    """Keep one processor busy, and another one by a process beside this one."""
    work_until = time.process_time() + 0.5
    while time.process_time() < work_until:
        pass
    subprocess.run([sys.executable, "-c", WORK], check=True)
    (context.draft.path / "words.txt").write_text("done")


@stage(kind="episodes", needs="devices")
def toil_together(context: StageContext, *, config: ToyConfig) -> None:
    """Keep a processor busy in each of several processes."""
    work_until = time.process_time() + 2
    while time.process_time() < work_until:
        pass
    (context.draft.path / f"{os.getpid()}.txt").write_text("done")
'''


@pytest.fixture(scope="session")
def toys(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """Module with the toy stages."""
    folder = tmp_path_factory.mktemp("source")
    (folder / "toys").mkdir()
    (folder / "toys" / "__init__.py").write_text('"""Toys."""\n')
    (folder / "toys" / "simple.py").write_text(TOYS)
    sys.path.insert(0, str(folder))
    yield importlib.import_module("toys.simple")
    sys.path.remove(str(folder))


@pytest.fixture
def store(tmp_path: Path) -> ArtifactStore:
    """An empty store."""
    return ArtifactStore(tmp_path / "store")


@pytest.fixture
def session(store: ArtifactStore) -> Session:
    """A session that runs stages at once, in this process."""
    return Session(store, perform_here)


class Diary:
    """Display and record that remember what they were told."""

    def __init__(self):
        self.states, self.progress, self.curves = [], [], []

    def started(self, stage, label, artifact):
        return lambda done, total, **facts: self.progress.append((done, total, facts))

    def finished(self, stage, label, artifact, state, summary):
        self.states.append((stage, state))

    def settled(self, label):
        pass

    def metrics(self, stage):
        return self

    def log(self, metrics, step):
        self.curves.append((step, metrics))

    def for_round(self, turn):
        return self


@pytest.fixture
def diary() -> Diary:
    """A listener to everything a session tells."""
    return Diary()
