"""The episode in hand survives whatever ends the process that makes it."""

import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from juicer.errors import DraftNotWritten, UnusableDraft
from juicer.sim.env import AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder
from juicer.teleoperation.drafts import Beginning, Draft, left_in, read_draft
from juicer.teleoperation.drivers import Driver

BEGINNING = Beginning(task="one_leg", randomness="low", seed=3, began="2026-11-26T14:03:00+01:00", operator="Ada")

MAKER = """
import sys, time
from pathlib import Path
from tests.teleoperation.test_drafts import Episode

episode = Episode(Path(sys.argv[1]))
episode.go(30)
episode.take_back(10)
episode.go(5)
print("ready", flush=True)
time.sleep(600)
"""


class Episode:
    """An episode in hand: an environment, its recorder and its draft."""

    def __init__(self, folder: Path) -> None:
        self.env = AssemblyEnv("one_leg")
        self.env.reset(seed=3)
        self.states = [self.env.get_state()]
        self.idle: list[bool] = []
        self.draft = Draft(folder, BEGINNING, self.states[0])

    def go(self, steps: int) -> None:
        for _ in range(steps):
            # Each action leads on from where the arm is, so none can be left out.
            shown = self.env.observation()["proprioception"]
            action = np.append(shown[:9], -1.0)
            action[2] -= 0.004
            self.act(action.astype(np.float32), len(self.idle) % 7 == 3)

    def act(self, action: np.ndarray, idle: bool) -> None:
        self.env.step(action)
        self.draft.add(action, idle=idle, before=self.states[-1])
        self.states.append(self.env.get_state())
        self.idle.append(idle)

    def take_back(self, steps: int) -> None:
        del self.states[len(self.states) - steps :], self.idle[len(self.idle) - steps :]
        self.env.set_state(self.states[-1])
        self.draft.take_back(steps)


@pytest.fixture(scope="module")
def left_behind(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("left")
    with subprocess.Popen([sys.executable, "-c", MAKER, str(folder)], stdout=subprocess.PIPE) as maker:
        assert maker.stdout
        assert maker.stdout.readline() == b"ready\n"
        assert left_in(folder) == []
        maker.send_signal(signal.SIGKILL)
    return folder


@pytest.fixture
def killed(left_behind: Path, tmp_path: Path) -> Path:
    """A folder with the draft of a process that was killed in the middle of an episode."""
    return shutil.copytree(left_behind, tmp_path / "killed")


def test_a_killed_process_leaves_an_episode_that_goes_on_bit_for_bit(killed: Path, tmp_path: Path) -> None:
    (path,) = left_in(killed)
    left = read_draft(path)
    assert left.beginning == BEGINNING
    assert len(left.steps) == 25

    expected = Episode(tmp_path / "another")
    expected.go(30)
    expected.take_back(10)
    expected.go(5)
    env = AssemblyEnv("one_leg")
    env.reset(seed=3)
    np.testing.assert_array_equal(env.get_state(), left.state)
    recorder = EpisodeRecorder(env)
    idle: list[bool] = []
    assert left.resume(env, lambda action, is_idle: (recorder.step(action), idle.append(is_idle))[1]) == 25
    np.testing.assert_array_equal(env.get_state(), expected.states[-1])
    assert idle == expected.idle

    # Who takes it up goes on in the same file.
    draft = left.take_up(25)
    assert left_in(killed) == []
    draft.add(left.steps[0].action, idle=True, before=env.get_state())
    draft.close()
    assert len(read_draft(path).steps) == 26


def test_a_draft_is_removed_once_its_episode_is_saved_or_discarded(tmp_path: Path) -> None:
    episode = Episode(tmp_path)
    assert list(tmp_path.iterdir()) == []
    episode.go(1)
    assert len(list(tmp_path.iterdir())) == 1
    episode.draft.remove()
    assert list(tmp_path.iterdir()) == []
    episode.draft.remove()


def test_two_cannot_take_up_one_draft(killed: Path) -> None:
    (path,) = left_in(killed)
    left = read_draft(path)
    draft = left.take_up(25)
    with pytest.raises(UnusableDraft, match="was taken up or removed by somebody else"):
        left.take_up(25)
    draft.remove()
    with pytest.raises(UnusableDraft, match="was taken up or removed by somebody else"):
        left.take_up(25)


def test_steps_that_the_simulator_computes_otherwise_are_taken_back(killed: Path) -> None:
    (path,) = left_in(killed)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:11], lines[11].replace('"before":', '"before":1'), *lines[12:]]))
    left = read_draft(path)
    env = AssemblyEnv("one_leg")
    env.reset(seed=3)
    assert left.resume(env, lambda action, _: void(env.step(action))) == 10
    left.take_up(10).close()
    assert len(read_draft(path).steps) == 10


def test_who_drives_is_known_again_and_of_a_draft_of_an_earlier_version_who_began(tmp_path: Path) -> None:
    episode = Episode(tmp_path)
    episode.go(2)
    episode.draft.close()
    (path,) = left_in(tmp_path)
    assert read_draft(path).drivers == (Driver("Ada", "keyboard", "original", 1.0),)
    draft = read_draft(path).take_up(2)
    drivers = (Driver("Ben", "gamepad", "mine.toml", 0.25), Driver("Ben", "keyboard", "mine.toml", 1.0))
    for driver in drivers:
        draft.add_driver(driver)
        draft.add(np.zeros(10), idle=False, before=episode.states[-1])
    draft.close()
    assert read_draft(path).drivers == drivers
    assert len(read_draft(path).steps) == 4


def void(_: object) -> None:
    return None


@pytest.mark.parametrize(
    "end", [b"", b'{"action":[0.1,', b'{"action":[1,2],"idle":false,"before":3}\n', b"\xff\xfe\n", b"[]\n"]
)
def test_what_was_not_written_whole_is_cut_off(killed: Path, end: bytes) -> None:
    (path,) = left_in(killed)
    with path.open("ab") as file:
        file.write(end)
    left = read_draft(path)
    assert len(left.steps) == 25
    draft = left.take_up(25)
    draft.add(left.steps[0].action, idle=False, before=left.state)
    draft.close()
    assert len(read_draft(path).steps) == 26


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is damaged from its first line on"),
        (b"nonsense\n", "is damaged from its first line on"),
        (b"[" * 100_000, "is damaged from its first line on"),
        (b'{"format":"juicer-episode-in-hand-9"}\n', "is of another version of juicer"),
        (b'{"format":"juicer-episode-in-hand-1","state":[1.0]}\n', "is damaged from its first line on"),
    ],
)
def test_what_is_no_draft_is_said_in_a_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "a.draft"
    path.write_bytes(content)
    with pytest.raises(UnusableDraft, match=sentence):
        read_draft(path)


@contextmanager
def full_disk(largest: int) -> Iterator[None]:
    """No file may become larger than so many bytes."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limit[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


def test_a_full_disk_is_said_in_a_sentence_and_costs_no_step_once_there_is_room(tmp_path: Path) -> None:
    episode = Episode(tmp_path)
    episode.go(4)
    (path,) = tmp_path.iterdir()
    with full_disk(path.stat().st_size + 50):
        for _ in range(3):
            before = episode.states[-1]
            with pytest.raises(DraftNotWritten, match=r"is in memory only, as '.*' cannot be written: "):
                episode.draft.add(np.zeros(10), idle=True, before=before)
    episode.draft.close()
    assert len(read_draft(path).steps) == 7

    again = Episode(tmp_path / "again")
    with full_disk(100), pytest.raises(DraftNotWritten):
        again.go(1)
    again.draft.take_back(0)
    again.draft.add(np.zeros(10), idle=True, before=again.states[-1])
    again.draft.close()
    (path,) = (tmp_path / "again").iterdir()
    assert len(read_draft(path).steps) == 2


def test_a_folder_that_cannot_be_made_is_said_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DraftNotWritten, match=r"cannot be written: .* a file stands where a folder is needed"):
        Episode(tmp_path / "file").go(1)
