"""What becomes of an operator's wishes, control step by control step, in the real simulator."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path

import numpy as np
import pytest

from juicer.artifacts.integrity import sync
from juicer.demonstration.ingestion import Ingestion, IngestionConfig, steps_to_keep
from juicer.demonstration.log import read_log
from juicer.episode import Outcome
from juicer.errors import UnusableDraft
from juicer.seed_ranges import Purpose, check_seeds
from juicer.teleoperation.controls import Intent
from juicer.teleoperation.drafts import DRAFTS, left_in, read_draft
from juicer.teleoperation.key_maps import Action
from juicer.teleoperation.status import Phase
from juicer.teleoperation.work import IDLE_STEPS, STANDING_STEPS, Ending
from tests.teleoperation.conftest import assemble

LEFT = Intent(twist=(0.0, -0.1, 0.0, 0.0, 0.0, 0.0))
STILL = Intent()


def move(work, steps, intent=LEFT, **facts):
    return [work.step(intent, **{"present": True, "source": "keyboard", **facts}) for _ in range(steps)]


def test_nothing_is_recorded_before_the_operator_moves(work):
    assert move(work, 5, STILL) == [False] * 5
    assert len(work.take) == 0
    assert work.phase is Phase.IDLE


def test_a_held_key_moves_the_arm_and_is_recorded(work):
    before = work.take.observation["proprioception"][1]
    move(work, 10)
    assert work.phase is Phase.RECORDING
    assert work.take.idle == [False] * 10
    assert work.take.observation["proprioception"][1] < before - 0.02


def test_a_step_without_a_wish_is_recorded_as_idle_and_the_arm_comes_to_rest(work):
    move(work, 10)
    move(work, 10, STILL)
    assert work.phase is Phase.IDLE
    assert work.take.idle == [False] * 10 + [True] * 10
    assert np.linalg.norm(work.take.observation["proprioception"][9:12]) < 0.002


def test_the_world_stands_still_when_nothing_was_wished_for_long(work):
    move(work, 1)
    moved = move(work, IDLE_STEPS + 20, STILL)
    assert moved.count(True) == IDLE_STEPS
    assert move(work, 1) == [True]


def test_undo_restores_the_simulator_bit_for_bit_and_the_steps_leave_the_recording(work):
    move(work, 15)
    kept = work.take.state
    move(work, 10)
    work.obey([Action.UNDO])
    assert work.take.state.tobytes() == kept.tobytes()
    assert len(work.take) == len(work.take.idle) == 15
    move(work, 3)
    work.logs.close()
    (draft,) = left_in(work.logs.folder / DRAFTS)
    assert len(read_draft(draft).steps) == 18


def test_the_longer_undo_takes_back_seconds(work):
    work.undo_s = 2.0
    move(work, 30)
    work.obey([Action.UNDO_MORE])
    assert len(work.take) == 10


def test_undo_of_more_than_there_is_leads_to_the_beginning(work):
    start = work.take.state
    move(work, 4)
    work.obey([Action.UNDO])
    assert work.take.state.tobytes() == start.tobytes()
    work.obey([Action.UNDO])
    assert "nothing to take back" in work.sentence


def test_a_gripper_toggle_counts_twelve_steps_even_if_the_operator_is_idle(work):
    work.obey([Action.GRIPPER])
    assert work.gripper_closes
    move(work, 1, STILL)
    work.obey([Action.GRIPPER])
    assert work.gripper_closes, "it is blocked until the fingers had their time"
    move(work, 20, STILL)
    keep = steps_to_keep(work.take.actions, np.array(work.take.idle), 12)
    assert np.flatnonzero(keep).tolist() == list(range(13))
    work.obey([Action.GRIPPER])
    assert not work.gripper_closes


def test_undo_of_a_toggle_is_a_toggle_back(work):
    move(work, 5)
    work.obey([Action.GRIPPER])
    move(work, 5)
    work.obey([Action.UNDO])
    assert not work.gripper_closes


def test_a_pause_stops_the_world_until_the_operator_continues(work):
    move(work, 10)
    work.obey([Action.PAUSE])
    assert move(work, 10).count(True) == STANDING_STEPS
    assert work.phase is Phase.PAUSED
    assert work.take.idle[-STANDING_STEPS:] == [True] * STANDING_STEPS
    work.obey([Action.PROCEED])
    assert move(work, 1) == [True]


def test_the_arm_comes_to_rest_within_two_steps_when_the_operator_is_gone(work):
    move(work, 10)
    assert move(work, 10, STILL, present=False).count(True) == STANDING_STEPS
    assert STANDING_STEPS * 0.1 <= 0.25
    assert np.linalg.norm(work.take.observation["proprioception"][9:12]) < 0.02
    assert work.phase is Phase.PAUSED
    assert "nothing is heard" in work.sentence


def test_a_success_that_is_none_yet_is_not_saved(work):
    move(work, 10)
    work.obey([Action.SUCCESS])
    assert "0 of 1 pairs" in work.sentence
    assert work.logs.kept == ()


def test_discard_begins_another_initial_state_and_leaves_nothing_behind_once_that_has_steps(work):
    seed = work.take.seed
    move(work, 10)
    work.obey([Action.DISCARD])
    assert work.take.seed != seed
    assert len(work.take) == 0
    move(work, 1, STILL)
    move(work, 3)
    work.obey([Action.UNDO])
    assert len(work.take) == 0
    work.obey([Action.UNDO])
    assert len(work.take) == 0, "what was discarded before that is gone"
    work.obey([Action.DISCARD])
    work.close()
    assert left_in(work.logs.folder / DRAFTS) == []


@pytest.mark.parametrize("slip", [Action.DISCARD, Action.RESET])
def test_undo_brings_back_what_was_discarded_by_a_slip_bit_for_bit(work, slip):
    move(work, 10)
    work.obey([Action.GRIPPER])
    move(work, 20)
    seed, state = work.take.seed, work.take.state
    work.obey([slip])
    work.obey([slip])
    assert "Undo brings back" in work.sentence
    move(work, 5, STILL)
    work.obey([Action.UNDO])
    assert (work.take.seed, len(work.take), work.gripper_closes) == (seed, 30, True)
    assert work.take.state.tobytes() == state.tobytes()
    assert "back, with its 30 steps" in work.sentence
    work.obey([Action.UNDO])
    assert len(work.take) == 20
    move(work, 5)
    work.logs.close()
    (draft,) = left_in(work.logs.folder / DRAFTS)
    assert len(read_draft(draft).steps) == 25


def test_what_was_discarded_last_is_offered_after_the_end(work):
    move(work, 10)
    seed = work.take.seed
    work.obey([Action.DISCARD])
    work.close()
    (draft,) = left_in(work.logs.folder / DRAFTS)
    assert (read_draft(draft).beginning.seed, len(read_draft(draft).steps)) == (seed, 10)


def test_a_failure_that_was_discarded_is_still_one_when_it_is_back(work, monkeypatch):
    move(work, 10)
    monkeypatch.setattr(work.take, "done", True)
    monkeypatch.setitem(work.take.info, "outcome", Outcome.PART_LOST)
    work.obey([Action.DISCARD])
    assert move(work, 1, STILL) == [False]
    work.obey([Action.UNDO])
    assert work.ending is Ending.FAILED
    assert len(work.take) == 10


def test_reset_begins_the_same_initial_state_anew(work):
    seed, start = work.take.seed, work.take.state
    move(work, 10)
    work.obey([Action.RESET])
    assert work.take.seed == seed
    assert work.take.state.tobytes() == start.tobytes()


def test_no_two_episodes_of_people_begin_alike_whoever_records_them(make_work):
    first, second = make_work(), make_work()
    seeds = [first.take.seed, second.take.seed]
    for work in (first, second, make_work()):
        work.obey([Action.DISCARD])
        seeds.append(work.take.seed)
    assert len(set(seeds)) == len(seeds)
    check_seeds(Purpose.DEMONSTRATIONS, seeds)


def test_recordings_that_came_without_their_marks_keep_their_initial_states_for_themselves(make_work, tmp_path):
    first = make_work()
    move(first, 1)
    first.close()
    interrupted = first.take.seed
    (tmp_path / f"{interrupted + 4:08d}.npz").write_bytes(b"restored from a backup")
    (tmp_path / "demo_1.npz").touch()
    shutil.rmtree(tmp_path / "seeds")
    assert make_work().take.seed == interrupted + 5
    (tmp_path / f"{interrupted + 4:08d}.npz").unlink()
    shutil.rmtree(tmp_path / "seeds")
    assert make_work().take.seed == interrupted + 1


@pytest.mark.parametrize("has_links", [True, False])
def test_a_demonstration_is_never_written_in_place_of_another(make_work, tmp_path, monkeypatch, has_links):
    def refuse(path, other):
        raise PermissionError(errno.EPERM, "Operation not permitted", str(path))

    if not has_links:  # as on exFAT
        monkeypatch.setattr(Path, "hardlink_to", refuse)
    work = make_work()
    saved = tmp_path / f"{work.take.seed:08d}.npz"
    saved.write_bytes(b"copied here meanwhile")
    assemble(work, seed=1)
    assert work.ending is Ending.NOT_WRITTEN
    assert "is not replaced; move it elsewhere" in work.sentence
    assert saved.read_bytes() == b"copied here meanwhile"
    assert list((tmp_path / DRAFTS).glob("*.npz")) == []
    saved.rename(tmp_path / "elsewhere.npz")
    work.obey([Action.SUCCESS])
    assert work.ending is Ending.KEPT
    assert len(read_log(saved)) == len(work.take)


def test_an_assembled_episode_is_written_whole_and_ingested_as_it_is(assembled):
    assert assembled.ending is Ending.KEPT
    assert assembled.phase is Phase.OVER
    (path,) = assembled.logs.folder.glob("*.npz")
    log = read_log(path)
    assert (log.operator, log.device) == ("Anna", "keyboard, keys original, time scale 1")
    began, ended = log.recorded_at.split("/")
    assert began <= ended
    demonstration = Ingestion(IngestionConfig(task="one_leg")).ingest_log(log, path.name)
    assert demonstration.episode.record.operator == "Anna"
    assert left_in(assembled.logs.folder / DRAFTS) == []


def test_the_next_episode_begins_after_a_success(assembled):
    seed = assembled.take.seed
    assembled.obey([Action.DISCARD])
    assert assembled.take.seed == seed, "what is kept cannot be discarded"
    assembled.go_on()
    assert assembled.take.seed != seed
    assert assembled.ending is None


def test_what_the_disk_refuses_stays_in_hand_until_it_is_written(make_work, tmp_path):
    work = make_work()
    obstacle = tmp_path / f"{work.take.seed:08d}.npz"
    obstacle.mkdir()
    assemble(work, seed=1)
    assert work.ending is Ending.NOT_WRITTEN
    assert "cannot be written" in work.sentence
    work.go_on()
    assert work.ending is Ending.NOT_WRITTEN
    obstacle.rmdir()
    work.go_on()
    assert work.ending is Ending.KEPT
    assert len(read_log(obstacle)) == len(work.take)


def test_what_the_disk_refuses_once_the_log_has_its_name_is_tried_again_and_the_episode_counts_once(
    make_work, tmp_path, monkeypatch
):
    refused = []

    def sync_later(path):
        if path == tmp_path and not refused:
            refused.append(path)
            raise OSError(errno.EIO, "Input/output error")
        sync(path)

    monkeypatch.setattr("juicer.teleoperation.logs.sync", sync_later)
    work = make_work()
    assemble(work, seed=1)
    assert work.ending is Ending.NOT_WRITTEN
    work.go_on()
    assert work.ending is Ending.KEPT
    (log,) = tmp_path.glob("*.npz")
    assert len(read_log(log)) == len(work.take)
    assert left_in(tmp_path / DRAFTS) == []


def test_a_log_counts_as_written_whose_second_name_the_disk_does_not_let_go(make_work, tmp_path, monkeypatch):
    unlink = Path.unlink

    def refuse(path, missing_ok=False):
        if path.parent.name == DRAFTS and path.suffix == ".npz" and not path.name.startswith("."):
            raise OSError(errno.EROFS, "Read-only file system", str(path))
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    work = make_work()
    assemble(work, seed=1)
    assert work.ending is Ending.KEPT
    assert len(list(tmp_path.glob("*.npz"))) == 1


@pytest.mark.parametrize("slip", [Action.DISCARD, Action.RESET])
def test_a_key_that_is_held_when_an_episode_is_dropped_does_not_begin_the_next_one(work, slip):
    move(work, 20)
    state = work.take.state
    work.obey([slip])
    assert move(work, 20) == [False] * 20
    work.obey([Action.GRIPPER])
    assert move(work, 1) == [False]
    work.obey([Action.UNDO])
    assert len(work.take) == 20
    assert work.take.state.tobytes() == state.tobytes()
    work.obey([slip])
    move(work, 1, STILL)
    assert move(work, 5) == [True] * 5


def test_an_interrupted_episode_goes_on_where_it_was(make_work):
    first = make_work()
    move(first, 8)
    first.obey([Action.GRIPPER])
    move(first, 20)
    state, steps = first.take.state, len(first.take)
    first.close()
    second = make_work()
    (path,) = left_in(second.logs.folder / DRAFTS)
    second.resume(read_draft(path))
    assert second.take.state.tobytes() == state.tobytes()
    assert len(second.take) == steps
    assert second.gripper_closes
    assert move(second, 1) == [True]


def test_a_success_that_could_not_be_written_before_the_end_is_written_when_it_is_resumed(make_work, tmp_path):
    first = make_work()
    obstacle = tmp_path / f"{first.take.seed:08d}.npz"
    obstacle.mkdir()
    assemble(first, seed=1)
    assert first.ending is Ending.NOT_WRITTEN
    first.close()
    obstacle.rmdir()
    second = make_work()
    (path,) = left_in(tmp_path / DRAFTS)
    second.resume(read_draft(path))
    assert second.ending is Ending.KEPT
    assert len(read_log(obstacle)) == len(second.take)


def test_an_initial_state_that_the_disk_refuses_is_said_and_given_once_there_is_room(assembled):
    logs, assembled.ending = assembled.logs, Ending.KEPT
    seeds = logs.folder / "seeds"
    seeds.rename(logs.folder / "aside")
    seeds.touch()
    assembled.go_on()
    assert assembled.ending is Ending.KEPT
    assert "The episode is saved, but no other can begin: log " in assembled.sentence
    seeds.unlink()
    (logs.folder / "aside").rename(seeds)
    assembled.go_on()
    assert assembled.ending is None


def test_a_log_says_all_who_drove_with_what_and_how_fast_also_after_an_interruption(make_work):
    first = make_work()
    first.time_scale = 0.25
    move(first, 3, source="gamepad")
    first.operator = "Ben"
    first.time_scale = 1.0
    move(first, 3)
    first.close()
    second = make_work(operator="Cleo", keys="isaaclab")
    (path,) = left_in(second.logs.folder / DRAFTS)
    second.resume(read_draft(path))
    move(second, 3, STILL)
    log = second.take.log("ended")
    assert (log.operator, log.device) == ("Anna and Ben", "gamepad and keyboard, keys original, time scale 0.25 and 1")
    move(second, 3)
    log = second.take.log("ended")
    assert log.operator == "Anna and Ben and Cleo"
    assert log.device == "gamepad and keyboard, keys original and isaaclab, time scale 0.25 and 1"


def test_an_episode_begins_with_its_first_step(work, monkeypatch):
    times = iter(("prepared", "first step", "second step"))
    monkeypatch.setattr("juicer.teleoperation.work._now", lambda: next(times))
    assert next(times) == "prepared"
    move(work, 5, STILL)
    move(work, 2)
    assert work.take.log("ended").recorded_at == "first step/ended"
    work.logs.close()
    (path,) = left_in(work.logs.folder / DRAFTS)
    assert read_draft(path).beginning.began == "first step"


def test_an_interrupted_episode_of_another_task_is_refused(make_work):
    first = make_work()
    move(first, 8)
    first.close()
    other = make_work(randomness="med")
    (path,) = left_in(other.logs.folder / DRAFTS)
    with pytest.raises(UnusableDraft, match="is of one_leg at low randomness"):
        other.resume(read_draft(path))
