from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from juicer.annotation.annotate import annotate
from juicer.annotation.labels import Label
from juicer.annotation.propose import AnnotationConfig, critical_states, propose
from juicer.demonstration.ingestion import Ingestion, IngestionConfig
from juicer.demonstration.log import OperatorLog
from juicer.episode import STATE_KEY, Episode, Outcome
from juicer.errors import InvalidLabels
from juicer.geometry import quat_to_matrix, relative_pose
from juicer.gripper import next_gripper_change
from juicer.sim.env import AssemblyEnv
from juicer.storage.annotations import Annotation
from tests.reader import Reader

CONFIG = AnnotationConfig()


@pytest.fixture(scope="module")
def env() -> AssemblyEnv:
    return AssemblyEnv("one_leg")


def held(env: AssemblyEnv, state: np.ndarray) -> set[str]:
    env.set_state(state)
    return {name for pair in env.contact_pairs() if "gripper" in pair for name in pair}


def test_the_critical_state_lies_just_before_the_leg_enters_its_hole(env: AssemblyEnv, insertions: list[Episode]):
    for demonstration in insertions:
        (proposal,) = propose(env, demonstration, CONFIG)
        assert proposal.critical_state == 0
        assert proposal.confidence > 0.9
        poses = demonstration.steps["part_poses"][proposal.step].astype(np.float64).reshape(-1, 7)
        offset = relative_pose(poses[0], poses[4])[:3] - env.task.pairs[0].targets[0][:3]
        # The tip of the peg enters the hole 25 mm above the leg's assembled height.
        assert 0.030 < offset[1] < 0.038
        assert np.hypot(offset[0], offset[2]) < 0.003
        assert quat_to_matrix(poses[4, 3:])[2, 1] > 0.99
        assert "square_table_leg4" in held(env, demonstration.steps[STATE_KEY][proposal.step])


def test_a_leg_that_never_comes_near_its_hole_has_no_critical_state(env: AssemblyEnv, insertions: list[Episode]):
    demonstration = insertions[0]
    cut = Episode(
        demonstration.record,
        {name: values[:5] for name, values in demonstration.steps.items()},
        {name: demonstration.steps[name][5] for name in demonstration.final},
    )
    assert propose(env, cut, CONFIG) == []


def test_the_grasp_of_every_part_can_count_as_a_critical_state(env: AssemblyEnv, recording: OperatorLog):
    demonstration = Ingestion(IngestionConfig(task="one_leg")).ingest_log(recording).episode
    config = AnnotationConfig(critical_states="grasps")
    states = critical_states(env.task, config)
    found = {env.task.name_of(states[each.critical_state]): each.step for each in propose(env, demonstration, config)}
    assert list(found) == ["insert leg", "grasp top", "grasp leg"]
    assert found["grasp top"] < found["grasp leg"] < found["insert leg"]
    for name, part in (("grasp top", "square_table_top"), ("grasp leg", "square_table_leg4")):
        assert part not in held(env, demonstration.state(found[name]))
        change = next_gripper_change(demonstration.steps["action"], found[name])
        assert change is not None
        assert part in held(env, demonstration.state(change + 6))
    # What the task itself has keeps its number.
    assert propose(env, demonstration, CONFIG) == propose(env, demonstration, config)[:1]


def test_the_placing_of_the_first_part_can_count_as_a_critical_state(env: AssemblyEnv, recording: OperatorLog):
    demonstration = Ingestion(IngestionConfig(task="one_leg")).ingest_log(recording).episode
    config = AnnotationConfig(critical_states="all")
    *others, found = propose(env, demonstration, config)
    assert others == propose(env, demonstration, AnnotationConfig(critical_states="grasps"))
    assert env.task.name_of(critical_states(env.task, config)[found.critical_state]) == "place top"
    assert "square_table_top" in held(env, demonstration.state(found.step))
    release = next_gripper_change(demonstration.steps["action"], found.step)
    assert release is not None
    assert found.step < demonstration.record.milestones["top_placed"] < release
    top = np.array([demonstration.steps["part_poses"][step][:3] for step in range(found.step, release + 1)])
    assert np.linalg.norm(top[0] - top[-1]) > config.approach_m >= np.linalg.norm(top[1] - top[-1])


def test_a_first_part_that_is_never_pushed_home_has_no_placing(env: AssemblyEnv, recording: OperatorLog):
    demonstration = Ingestion(IngestionConfig(task="one_leg")).ingest_log(recording).episode
    aside = {name: values.copy() for name, values in demonstration.steps.items()}
    aside["part_poses"][:, 1] -= 0.03
    config = AnnotationConfig(critical_states="all")
    grasps = propose(env, demonstration, AnnotationConfig(critical_states="grasps"))
    assert propose(env, replace(demonstration, steps=aside), config) == grasps


def test_annotations_do_not_depend_on_the_number_of_workers(insertions: list[Episode]):
    more = [replace(each, record=replace(each.record, episode_id=f"more {each.record.seed}")) for each in insertions]
    demonstrations = Reader([*insertions, *more])
    alone = list(annotate(demonstrations, CONFIG, num_workers=1))
    assert alone == list(annotate(demonstrations, CONFIG, num_workers=3))
    assert [row.episode_id for row in alone] == [record.episode_id for record in demonstrations.records]
    assert {row.author for row in alone} == {"proposed"}


def test_nothing_is_proposed_for_a_failure(insertions: list[Episode]):
    failed = replace(insertions[0], record=replace(insertions[0].record, outcome=Outcome.TIMEOUT))
    (row,) = annotate(Reader([failed, insertions[1]]), CONFIG)
    assert row.episode_id == insertions[1].record.episode_id


def test_a_human_label_replaces_the_proposal(insertions: list[Episode]):
    name = insertions[1].record.episode_id
    first, second = annotate(Reader(insertions), CONFIG, [Label(name[:8], 7, 0, "labels.csv, line 2")])
    assert second == Annotation(episode_id=name, step=7, critical_state=0, author="human", confidence=1.0)
    assert first.author == "proposed"


def named(episode: Episode, log: str) -> Episode:
    return replace(episode, record=replace(episode.record, log=log))


@pytest.mark.parametrize(
    ("label", "message"),
    [
        (
            Label("demo_3.npz", 7, 0, "here"),
            "here: there is no demonstration of a recording 'demo_3.npz'; did you mean",
        ),
        (Label("0", 7, 0, "here"), "here: there is no demonstration of a recording '0'; valid: demo_0.npz, demo_1.npz"),
        (Label("demo_0.npz", 400, 0, "here"), "here: recording demo_0.npz has no step 400 in which something was done"),
        (Label("demo_0.npz", 7, 1, "here"), "here: there is no critical state 1; the task has 1"),
    ],
)
def test_a_label_for_what_is_not_there_is_refused(insertions: list[Episode], label: Label, message: str):
    reader = Reader([named(episode, f"demo_{number}.npz") for number, episode in enumerate(insertions)])
    with pytest.raises(InvalidLabels) as refusal:
        list(annotate(reader, CONFIG, [label]))
    assert message in str(refusal.value)


def test_a_label_that_several_recordings_answer_to_is_refused(insertions: list[Episode]):
    reader = Reader([named(episode, "demo.npz") for episode in insertions])
    with pytest.raises(InvalidLabels, match=r"'demo\.npz' names 2 recordings, \w{16}, \w{16}; write the whole id"):
        list(annotate(reader, CONFIG, [Label("demo.npz", 7, 0, "here")]))


def test_one_critical_state_cannot_be_labelled_under_two_names_of_its_recording(insertions: list[Episode]):
    labels = [Label("demo_0.npz", 7, 0, "here"), Label(insertions[0].record.episode_id, 9, 0, "there")]
    with pytest.raises(InvalidLabels, match=r"there: critical state 0 .* was already labelled at here"):
        list(annotate(Reader([named(insertions[0], "demo_0.npz")]), CONFIG, labels))


def test_no_demonstrations_have_no_annotations():
    assert list(annotate(Reader([]), CONFIG)) == []
