"""A person finishes a rollout by hand, from a recorded state of it, and what comes of that is learned from."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from juicer.annotation.annotate import annotate
from juicer.annotation.propose import AnnotationConfig
from juicer.demonstration.ingestion import Demonstration, Ingestion, IngestionConfig, UnusableLog
from juicer.demonstration.log import PARENT_ACTION, OperatorLog, read_log, write_log
from juicer.episode import ID_DIGITS, Episode, Outcome, Source
from juicer.errors import EvaluationOnly, InvalidEpisode, NotCorrectable, RejectedLog, StateMissing, UnusableDraft
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.sim.env import AssemblyEnv
from juicer.teleoperation.choice import Choice
from juicer.teleoperation.controls import Intent
from juicer.teleoperation.drafts import DRAFTS, left_in, read_draft
from juicer.teleoperation.key_maps import Action
from juicer.teleoperation.logs import Logs
from juicer.teleoperation.origin import Origin, origin_of
from juicer.teleoperation.verification import Verdict, Verifier, verify
from juicer.teleoperation.work import Ending, Work
from tests.reader import Reader
from tests.teleoperation.conftest import assemble
from tests.teleoperation.rollouts import STUCK_FOR, corrected_from

LEFT = Intent(twist=(0.0, -0.1, 0.0, 0.0, 0.0, 0.0))

MakeCorrection = Callable[..., Work]


@pytest.fixture(scope="module")
def origin(stuck: Episode) -> Origin:
    return origin_of(stuck, len(stuck) - STUCK_FOR // 2)


@pytest.fixture
def begin(tmp_path: Path, verifier: Verifier, origin: Origin) -> Iterator[MakeCorrection]:
    made = []

    def make(origin: Origin = origin) -> Work:
        work = Work(Choice(task="one_leg", operator="Anna"), Logs(tmp_path, "one_leg", verifier), origin)
        made.append(work)
        return work

    yield make
    for work in made:
        work.close()


@pytest.fixture(scope="module")
def corrected(tmp_path_factory: pytest.TempPathFactory, origin: Origin) -> Path:
    """Log of a rollout that was finished by keys."""
    verifier = Verifier()
    folder = tmp_path_factory.mktemp("corrections")
    work = Work(Choice(task="one_leg", operator="Anna"), Logs(folder, "one_leg", verifier), origin)
    for seed in range(5):
        assemble(work, seed)
        if work.ending is Ending.KEPT:
            break
        work.obey([Action.DISCARD])
    work.close()
    verifier.close()
    (path,) = folder.glob("*.npz")
    return path


@pytest.fixture(scope="module")
def log(corrected: Path) -> OperatorLog:
    return read_log(corrected)


@pytest.fixture(scope="module")
def demonstration(log: OperatorLog) -> Demonstration:
    return Ingestion(IngestionConfig(task="one_leg")).ingest_log(log, "a.npz")


def test_it_begins_in_exactly_the_recorded_state_with_what_the_gripper_holds(begin, origin, stuck):
    work = begin()
    assert work.take.state.tobytes() == stuck.state(origin.step).tobytes()
    assert work.gripper_closes
    for _ in range(5):
        work.step(LEFT, present=True)
    work.obey([Action.UNDO])
    assert work.take.state.tobytes() == origin.state.tobytes()
    assert work.gripper_closes


@pytest.mark.parametrize("action", [Action.DISCARD, Action.RESET])
def test_another_try_goes_from_the_same_step(begin, origin, action):
    work = begin()
    work.step(LEFT, present=True)
    work.obey([action])
    assert len(work.take) == 0
    assert work.take.state.tobytes() == origin.state.tobytes()
    assert "same step" in work.sentence


def test_it_takes_no_initial_state_from_demonstrations(begin, tmp_path):
    begin().obey([Action.DISCARD])
    assert not (tmp_path / "seeds").exists()


def test_an_interrupted_correction_is_gone_on_with_and_still_knows_its_rollout(begin, tmp_path, origin):
    first = begin()
    for _ in range(8):
        first.step(LEFT, present=True)
    state = first.take.state
    first.close()
    (path,) = left_in(tmp_path / DRAFTS)
    left = read_draft(path)
    assert left.origin is not None
    assert (left.origin.parent, left.origin.step, left.origin.seed) == (origin.parent, origin.step, origin.seed)
    second = begin(left.origin)
    second.resume(left)
    assert second.take.state.tobytes() == state.tobytes()
    second.obey([Action.RESET])
    assert second.take.state.tobytes() == origin.state.tobytes()


def test_its_log_says_from_which_step_of_which_rollout_it_goes(log, origin, stuck):
    assert (log.parent, log.parent_step, log.seed) == (stuck.record.episode_id, origin.step, stuck.record.seed)
    assert log.steps["sim_state"][0].tobytes() == stuck.state(origin.step).tobytes()
    assert "leg_lifted" not in log.milestones
    assert 0 < log.milestones["leg_inserted"] <= log.milestones["leg_screwed"] <= len(log)


def test_the_same_rollout_is_corrected_twice_and_neither_log_replaces_the_other(corrected, begin, tmp_path, log):
    names = set()
    for _ in range(2):
        work = begin()
        work.step(LEFT, present=True)
        names.add(work.logs.keep(log))
    assert len(names) == 2
    assert {path.name for path in tmp_path.glob("*.npz")} == names


def test_its_log_is_verified_by_a_replay_from_that_state(corrected):
    verification = verify(corrected, "one_leg")
    assert verification.verdict is Verdict.VERIFIED, verification.sentence


def test_it_is_ingested_as_a_correction_that_says_from_what_it_was_grown(demonstration, log):
    record = demonstration.episode.record
    assert (record.source, record.outcome) == (Source.CORRECTION, Outcome.SUCCESS)
    assert (record.parent, record.parent_step) == (log.parent, log.parent_step)
    assert record.operator == "Anna"


def test_critical_states_before_its_beginning_are_not_demanded_of_it(demonstration):
    reader = Reader([demonstration.episode])
    with_grasps = AnnotationConfig(critical_states="grasps")
    assert [row.critical_state for row in annotate(reader, AnnotationConfig(), num_workers=1)] == [0]
    assert [row.critical_state for row in annotate(reader, with_grasps, num_workers=1)] == [0]


def test_a_short_one_counts_too(log):
    Ingestion(IngestionConfig(task="one_leg", min_steps=len(log) + 1)).ingest_log(log)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"seed": 7}, "must not be used for collection"),
        ({"seed": SEED_RANGES[Purpose.EVALUATION][0]}, "must not be used for collection"),
        ({"parent": None, "parent_step": None}, "must not be used for demonstrations"),
        ({"parent": None, "parent_step": None, "seed": 7}, "is not of the moment of its step"),
        ({"parent_step": 3}, "must have the shape"),
    ],
)
def test_a_log_that_lies_about_its_beginning_is_rejected(log, changes, reason):
    with pytest.raises(RejectedLog, match=reason):
        Ingestion(IngestionConfig(task="one_leg")).ingest_log(replace(log, **changes))


def test_a_whole_episode_from_another_seed_does_not_pass_for_a_correction(one_leg_log):
    told = replace(one_leg_log, seed=SEED_RANGES[Purpose.COLLECTION][5], parent="0" * ID_DIGITS, parent_step=0)
    with pytest.raises(RejectedLog, match="reset"):
        Ingestion(IngestionConfig(task="one_leg")).ingest_log(told)


def test_a_log_that_begins_in_a_state_that_is_held_out_for_evaluations_is_rejected(stuck):
    env = AssemblyEnv("one_leg")
    env.reset(seed=SEED_RANGES[Purpose.EVALUATION][0])
    actions = stuck.steps["action"][:3]
    for action in actions:
        env.step(action)
    log = corrected_from(Origin(stuck.record.episode_id, 3, stuck.record.seed, env.get_state(), actions))
    assert log.success
    with pytest.raises(RejectedLog, match="do not lead from a reset to seed"):
        Ingestion(IngestionConfig(task="one_leg")).ingest_log(log)


@pytest.mark.parametrize("where", [slice(None), -1])
def test_a_log_whose_rollout_did_something_else_is_rejected(log, where):
    actions = log.parent_actions.copy()
    actions[where, 0] += 0.01
    with pytest.raises(RejectedLog, match="do not lead from a reset to seed"):
        Ingestion(IngestionConfig(task="one_leg")).ingest_log(replace(log, parent_actions=actions))


def test_a_log_from_another_collected_initial_state_is_rejected(log):
    with pytest.raises(RejectedLog, match=f"do not lead from a reset to seed {log.seed + 1}"):
        Ingestion(IngestionConfig(task="one_leg")).ingest_log(replace(log, seed=log.seed + 1))


def test_a_log_without_its_rollout_s_actions_is_of_an_earlier_version(corrected, tmp_path):
    with np.load(corrected) as entries:
        np.savez(tmp_path / "a.npz", **{name: entries[name] for name in entries if name != PARENT_ACTION})
    with pytest.raises(RejectedLog, match="a correction of an earlier version of juicer"):
        read_log(tmp_path / "a.npz")


def test_a_log_with_more_or_fewer_actions_of_its_rollout_is_not_written(log, tmp_path):
    with pytest.raises(RejectedLog, match="'parent_action' must have the shape"):
        write_log(tmp_path / "a.npz", replace(log, parent_actions=log.parent_actions[1:]))


def test_its_log_holds_what_leads_to_its_beginning(log, stuck, origin):
    np.testing.assert_array_equal(log.parent_actions, stuck.steps["action"][: origin.step])


def test_a_closed_gripper_at_its_beginning_is_no_reason_to_keep_idle_steps(log):
    idle = np.arange(len(log)) < 5
    made = Ingestion(IngestionConfig(task="one_leg")).ingest_log(replace(log, idle=idle | log.idle))
    assert made.kept[0] >= 5


def test_a_rollout_of_another_version_is_refused_before_anybody_works_at_it(begin, origin):
    actions = origin.actions.copy()
    actions[:, 0] += 0.01
    with pytest.raises(NotCorrectable, match="no longer lead to its state"):
        begin(replace(origin, actions=actions))


def test_an_interrupted_correction_of_an_earlier_version_is_a_sentence(begin, tmp_path):
    work = begin()
    work.step(LEFT, present=True)
    work.close()
    (path,) = left_in(tmp_path / DRAFTS)
    first, *rest = path.read_bytes().splitlines(keepends=True)
    content = json.loads(first)
    del content["parent_actions"]
    path.write_bytes(b"".join([json.dumps(content).encode() + b"\n", *rest]))
    with pytest.raises(UnusableDraft, match="a correction of an earlier version of juicer"):
        read_draft(path)


def test_corrections_count_apart_from_demonstrations(tmp_path, verifier, log, one_leg_log):
    for number in range(3):
        write_log(tmp_path / f"{number}.npz", log if number else one_leg_log)
    (tmp_path / "broken.npz").write_bytes(b"nothing")
    logs = Logs(tmp_path, "one_leg", verifier)
    end = time.monotonic() + 120
    while logs.checking:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert (logs.demonstrations, logs.corrections) == (1, 2)


def test_the_limit_of_steps_counts_those_of_the_rollout_and_says_so(begin, origin):
    work = begin()
    work.env.max_steps = origin.step + 2
    for _ in range(2):
        work.step(LEFT, present=True)
    assert f"20,000 steps after its reset, the {origin.step} of the rollout among them" in work.sentence


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"parent": None}, "both 'parent' and 'parent_step', or neither"),
        ({"parent_step": None}, "both 'parent' and 'parent_step', or neither"),
        ({"parent": "../x"}, "must be the id of an episode"),
        ({"parent_step": -1}, "must be the number of a step"),
        ({"parent_step": True}, "wrong type"),
    ],
)
def test_a_header_with_half_a_parent_is_not_written(log, tmp_path, changes, reason):
    with pytest.raises(RejectedLog, match=reason):
        write_log(tmp_path / "a.npz", replace(log, **changes))


def test_a_log_in_which_everything_was_assembled_before_is_rejected(log):
    judged = replace(log, steps={**log.steps, "reward": np.zeros(len(log), np.float32)})
    with pytest.raises(RejectedLog, match="its rewards add up to 0"):
        Ingestion(IngestionConfig(task="one_leg")).ingest_log(judged)


def test_a_copy_of_a_correction_is_known(log, tmp_path):
    ingestion = Ingestion(IngestionConfig(task="one_leg"))
    for name in ("a.npz", "b.npz"):
        write_log(tmp_path / name, log)
    first, second = (ingestion.judge(tmp_path / name, name) for name in ("a.npz", "b.npz"))
    assert isinstance(first, Demonstration)
    assert isinstance(second, UnusableLog)
    assert "same recording as 'a.npz'" in second.reason


@pytest.mark.parametrize(
    ("changes", "error", "reason"),
    [
        ({"source": Source.TELEOP}, NotCorrectable, "only rollouts are finished by hand"),
        ({"seed": SEED_RANGES[Purpose.EVALUATION][5]}, EvaluationOnly, "was not collected"),
        ({"shift": '{"kind":"push"}'}, EvaluationOnly, "made under a shift"),
    ],
)
def test_what_no_correction_may_be_grown_from_is_refused(stuck, changes, error, reason):
    with pytest.raises(error, match=reason):
        origin_of(replace(stuck, record=replace(stuck.record, **changes)), 0)


def test_a_step_that_there_is_not_is_refused(stuck):
    with pytest.raises(StateMissing, match=f"has steps 0 to {len(stuck) - 1} and the end"):
        origin_of(stuck, len(stuck) + 1)


def test_a_step_at_which_the_rollout_has_ended_is_refused_unless_it_was_time_that_ended_it(stuck):
    lost = replace(stuck, record=replace(stuck.record, outcome=Outcome.PART_LOST))
    with pytest.raises(NotCorrectable, match=r"has ended at step \d+ \(part_lost\); choose an earlier step"):
        origin_of(lost, len(lost))
    assert origin_of(stuck, len(stuck)).step == len(stuck)


def test_a_state_of_another_scene_is_refused(begin, origin):
    with pytest.raises(InvalidEpisode, match="a simulator state of this scene has"):
        begin(replace(origin, state=origin.state[:-1]))
