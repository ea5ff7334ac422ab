"""An operator's work with the real simulator, and logs in a folder of the test's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.page.hands import GRIPPER, Hands
from juicer.demonstration.log import OperatorLog
from juicer.demonstration.recording import recordings
from juicer.episode import Episode
from juicer.expert.operator import scripted_operators
from juicer.teleoperation.choice import Choice
from juicer.teleoperation.controls import ControllerState, Controls
from juicer.teleoperation.logs import Logs
from juicer.teleoperation.verification import Verifier
from juicer.teleoperation.work import Work
from tests.teleoperation.rollouts import stuck_rollout

MakeWork = Callable[..., Work]


def assemble(work: Work, seed: int, most_steps: int = 1200) -> None:
    """Drive an episode to its end without a page in between."""
    hands, controls, toggles = Hands(work.choice.task, seed), Controls(), 0
    for sequence in range(most_steps):
        keys = hands.look(work.take.observation, work.gripper_closes)
        toggles += keys.toggles
        state = ControllerState(source="keyboard", sequence=sequence, held=keys.held, edges={GRIPPER: toggles})
        intent = controls.intent(state)
        work.obey(intent.presses)
        work.step(intent, present=True, source=state.source)
        if work.ending:
            return


@pytest.fixture
def verifier() -> Iterator[Verifier]:
    verifier = Verifier()
    yield verifier
    verifier.close()


@pytest.fixture
def make_work(tmp_path: Path, verifier: Verifier) -> Iterator[MakeWork]:
    made = []

    def make(folder: Path = tmp_path, **choice: object) -> Work:
        work = Work(Choice(**{"task": "one_leg", "operator": "Anna", **choice}), Logs(folder, "one_leg", verifier))
        made.append(work)
        return work

    yield make
    for work in made:
        work.close()


@pytest.fixture
def work(make_work: MakeWork) -> Work:
    return make_work()


@pytest.fixture(scope="module")
def assembled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Work]:
    """Work whose first episode was driven to a success, by keys."""
    verifier = Verifier()
    folder = tmp_path_factory.mktemp("logs")
    work = Work(Choice(task="one_leg", operator="Anna"), Logs(folder, "one_leg", verifier))
    assemble(work, seed=1)
    yield work
    work.close()
    verifier.close()


@pytest.fixture(scope="session")
def one_leg_log() -> OperatorLog:
    """A success of the scripted operator."""
    return next(log for log in recordings("one_leg", "low", range(20), scripted_operators()) if log.success)


@pytest.fixture(scope="session")
def stuck() -> Episode:
    """A rollout that failed with the leg in its gripper."""
    return stuck_rollout()
