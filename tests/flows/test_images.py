"""A study of policies that look, in small and for real: from a configuration to a page that says what they saw."""

from __future__ import annotations

import base64
from collections import Counter

import PIL.Image
import pytest

from flows.running.execution import execute
from flows.running.plan import plan
from flows.runs import parse_runs
from juicer.artifacts.store import ArtifactStore
from stages.report import PAGE, VARIED
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session

LOOKING = {
    "base": "smoke",
    "flow": "study",
    "name": "looking",
    "conditions": {"bc": None, "seeing": {"title": "Seeing", "policy": "seeing"}},
    "seeds": [0, 1],
    "record": {"demonstrations": 2},
    "policies": {
        "diffusion": {"training": {"steps": 20, "warmup_steps": 5, "validation_fraction": 0.5}},
        "seeing": {
            "base": "diffusion",
            "policy": {
                "observation": {
                    "body": {"kind": "proprioception"},
                    "eyes": {
                        "kind": "images",
                        "views": {
                            "front": {"camera": "front", "width": 32, "height": 32},
                            "wrist": {"camera": "wrist", "width": 32, "height": 32},
                        },
                        "augmentation": {},
                        "backbone": {"kind": "patch_cnn", "quarter": 8, "eighth": 8},
                        "projection": 16,
                    },
                }
            },
        },
    },
    "evaluate": {"episodes": 2, "max_steps": 20},
}


@pytest.fixture(scope="module")
def study():
    (study,) = parse_runs(LOOKING, "here")
    return study


def test_images_are_drawn_once_for_all_who_look_and_for_nobody_else(study, tmp_path):
    planned = plan(ArtifactStore(tmp_path), study)
    counts = Counter(entry.stage for entry in planned)
    assert (counts["render"], counts["dataset"], counts["train"]) == (2, 2, 4)
    of_states, of_images = (entry.call.recipe.inputs for entry in planned if entry.stage == "dataset")
    assert "columns" not in of_states
    assert of_images["columns"] == tuple(entry.ref for entry in planned if entry.stage == "render")


@pytest.mark.parametrize(("preset", "views"), [("laptop_image_e2e", 3), ("paper_image", 2)])
@pytest.mark.parametrize("condition", ["ta_ci", "state_noise", "mlp_chunked", "mlp_unchunked"])
def test_every_condition_runs_on_images_by_naming_a_preset(tmp_path, preset, views, condition):
    (run,) = parse_runs({"base": preset, "condition": condition}, "here")
    planned = plan(ArtifactStore(tmp_path), run)
    counts = Counter(entry.stage for entry in planned)
    learned = [entry.call.recipe.inputs["episodes"] for entry in planned if entry.stage == "dataset"]
    episodes = {ref for refs in learned for ref in refs}
    turns = 2 if condition == "ta_ci" else 1
    kept = {entry.ref for entry in planned if entry.stage == "select"}
    drawn_of = {
        ref for entry in planned if entry.stage == "render" for ref in entry.call.recipe.inputs.get("selections", ())
    }
    assert drawn_of == kept
    assert (counts["render"], counts["train"], counts["evaluate"]) == (views * len(episodes), turns, 1)


@pytest.mark.parametrize("condition", ["ta_ci", "state_noise", "mlp_chunked", "mlp_unchunked"])
def test_every_condition_learns_from_what_one_estimator_sees_in_all_of_its_episodes(tmp_path, condition):
    (run,) = parse_runs({"base": "laptop_image", "condition": condition}, "here")
    planned = plan(ArtifactStore(tmp_path), run)
    (estimator,) = {entry.ref for entry in planned if entry.stage == "estimate"}
    inputs = [entry.call.recipe.inputs for entry in planned if entry.stage == "encode"]
    assert all(each["estimators"] == (estimator,) for each in inputs)
    learned = [entry.call.recipe.inputs for entry in planned if entry.stage == "dataset"]
    assert {ref for each in inputs for ref in each["episodes"]} == {ref for each in learned for ref in each["episodes"]}
    assert {ref for each in inputs for ref in each.get("selections", ())} == {
        ref for each in learned for ref in each.get("selections", ())
    }
    assert all(len(each["columns"]) == len(each["episodes"]) for each in learned)
    assert all(entry.call.recipe.inputs["estimators"] == (estimator,) for entry in planned if entry.stage == "train")
    assert not [entry for entry in planned if entry.stage == "render"]


def test_one_model_for_several_tasks_learns_from_what_the_estimator_of_each_sees(tmp_path):
    runs = parse_runs({"base": "laptop_image", "tasks": ["one_leg", "lamp"], "condition": "multitask"}, "here")
    planned = plan(ArtifactStore(tmp_path), runs[0])
    made = {entry.ref: entry.call.recipe for entry in planned}
    joint = [recipe for recipe in made.values() if recipe.stage == "train"][-1]
    assert len(joint.inputs["estimators"]) == 2
    read = [made[ref] for ref in made[joint.inputs["dataset"][0]].inputs["columns"]]
    tasks = {ref: made[ref].inputs["episodes"] for ref in joint.inputs["estimators"]}
    assert {ref for recipe in read for ref in recipe.inputs["estimators"]} == set(tasks)
    for estimator, demonstrations in tasks.items():
        own = [recipe for recipe in read if recipe.inputs["estimators"] == (estimator,)]
        assert demonstrations in [recipe.inputs["episodes"] for recipe in own]
        assert not set(demonstrations) & {
            ref for recipe in read if recipe not in own for ref in recipe.inputs["episodes"]
        }


def test_one_model_for_several_tasks_learns_from_the_images_of_all(tmp_path):
    runs = parse_runs({"base": "laptop_image_e2e", "tasks": ["one_leg", "lamp"], "condition": "multitask"}, "here")
    planned = plan(ArtifactStore(tmp_path), runs[0])
    joint = [entry.call.recipe.inputs for entry in planned if entry.stage == "dataset"][-1]
    assert len(joint["columns"]) == 3 * len(joint["episodes"])


def test_a_study_says_of_every_result_what_its_policy_saw(drawing, study, tmp_path):
    session = Session(ArtifactStore(tmp_path), perform_here, machine=Machine(num_envs=2))
    outcome = execute(session, study, None)
    assert [row.title for row in outcome.results(session.store)] == ["BC", "Seeing (images)"]
    assert [model.observes for model in outcome.models] == ["state", "images", "state", "images"]
    page = (session.store.open(outcome.report) / PAGE).read_text()
    assert "Seeing (images)" in page
    assert "no images; or images of cameras" in page
    figure = session.store.open(outcome.report) / f"{VARIED}.png"
    embedded = base64.b64encode(figure.read_bytes()).decode()
    assert f'<img src="data:image/png;base64,{embedded}"' in page.split('<section id="images">')[1]
    with PIL.Image.open(figure) as image:
        assert image.height > 4 * 160
    assert all(entry.exists for entry in plan(session.store, study))
