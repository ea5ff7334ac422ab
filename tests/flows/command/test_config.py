"""``juicer config`` shows all of a configuration, where each value comes from, and can be run again from its output."""

from __future__ import annotations

import json

import pytest

from flows.command.choice import Choice
from flows.command.cli import call
from flows.runs import load_runs
from flows.shipped import CONFIGS, names


def printed(capsys, *arguments):
    assert call(["config", *arguments]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo"],
        ["smoke", "--set", "record.seed=3", "--set", "policies.diffusion.policy.head={kind: diffusion}"],
        ["paper", "--condition", "bc", "--condition", "ta"],
        ["study_one_leg", "--seed", "0", "--condition", "replay"],
        ["compare_heads"],
        ["compare_heads", "--condition", "unet"],
        ["laptop", "--set", "conditions.mine.augment=true", "--set", "condition=mine"],
        ["table_vi"],
        ["table_vi", "--task", "lamp", "--condition", "ta_ci", "--seed", "0"],
        ["table_vi", "--set", "tasks.lamp.state_noise={kind: original}"],
        ["paper_study", "--seed", "0"],
        ["paper_study", "--condition", "ta_ci", "--condition", "med_bc"],
        ["paper_study", "--condition", "bc", "--condition", "ta", "--task", "lamp", "--task", "one_leg", "--seed", "1"],
        ["paper_study", "--condition", "ten_bc", "--task", "one_leg"],
        ["laptop", "--seed", "4", "--condition", "ci"],
        ["demo", "--set", 'logs="/tmp/🦾 \\x85 logs"'],
        ["demo", "--set", "name=true-", "--set", "logs='/tmp/a b: c#'", "--set", "labels=~/x.csv"],
    ],
)
def test_output_is_the_same_configuration(capsys, tmp_path, arguments):
    path = tmp_path / "again.yaml"
    path.write_text(printed(capsys, *arguments))
    chosen = {name: [] for name in ("--set", "--task", "--condition", "--seed")}
    for name, value in zip(arguments[1::2], arguments[2::2], strict=True):
        chosen[name].append(int(value) if name == "--seed" else value)
    expected = Choice.of(arguments[0], *chosen.values()).runs()
    assert list(load_runs(path)) == expected
    again = printed(capsys, str(path))
    strip = [line.partition("  # ")[0].rstrip() for line in path.read_text().splitlines()]
    assert [line.partition("  # ")[0].rstrip() for line in again.splitlines()] == strip


def test_a_model_for_several_tasks_keeps_them_all(capsys, tmp_path):
    output = printed(capsys, "table_vi", "--task", "lamp", "--condition", "multitask")
    assert "# Its model for several tasks needs all of them: run it with --task lamp" in output
    path = tmp_path / "again.yaml"
    path.write_text(output)
    assert (
        Choice.of(str(path), None, ["lamp"], None, None).runs()
        == Choice.of("table_vi", None, ["lamp"], ["multitask"], None).runs()
    )


def test_a_part_of_a_study_leaves_out_what_only_the_rest_of_it_says(capsys, tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "base: smoke\nflow: study\ncurves:\n"
        "  data: {title: Data, axis: n, conditions: {bc: 1, ta: 2}}\n"
        "  rounds: {title: Rounds, axis: n, conditions: {ci: 1}}\n"
        "tasks:\n  one_leg:\n  lamp: {seeds: [3, 0]}\n"
    )
    arguments = [str(tmp_path / "mine.yaml"), "--condition", "ta", "--seed", "3"]
    told = json.loads(printed(capsys, *arguments, "--json"))
    content, origins = told["configuration"], told["from"]
    assert (content["conditions"], content["seeds"], content["analysed_seed"]) == (["ta"], [3], 0)
    assert not content["tasks"]["one_leg"]
    assert [content["tasks"]["lamp"][key] for key in ("seeds", "analysed_seed")] == [[3], 3]
    assert {name: curve["conditions"] for name, curve in content["curves"].items()} == {"data": {"ta": 2}}
    assert origins["curves.data.title"].endswith("mine.yaml:4")
    assert (origins["conditions"], origins["tasks.lamp.seeds"]) == ("--condition", "--seed")
    told = json.loads(printed(capsys, arguments[0], "--set", "analysed_seed=0", "--condition", "ta", "--json"))
    assert (told["from"]["analysed_seed"], told["from"]["left_out"]) == ("--set", "--condition")


def test_a_chosen_model_goes_before_that_of_each_task(capsys, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("base: laptop\ncondition: bc\ntasks: {one_leg: {}, lamp: {condition: ci, seed: 3}}\n")
    arguments = [str(path), "--condition", "ta", "--seed", "5"]
    again = tmp_path / "again.yaml"
    again.write_text(printed(capsys, *arguments))
    assert list(load_runs(again)) == Choice.of(str(path), None, None, ["ta"], [5]).runs()
    assert {run.models for run in load_runs(again)} == {(("ta", 5),)}


def test_of_several_tasks_what_is_left_open_for_all_is_printed_too(capsys, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("base: smoke\nby_task: {lamp: {rounds: 2}}\ntasks: [lamp, one_leg]\n")
    told = json.loads(printed(capsys, str(path), "--json"))
    assert (told["configuration"]["condition"], told["configuration"]["seed"]) == ("ta_ci", 0)
    assert told["from"]["tasks.one_leg"].endswith("mine.yaml:3")
    told = json.loads(printed(capsys, str(path), "--set", "flow=study", "--json"))
    assert told["configuration"]["seeds"] == [0, 1, 2, 3, 4]
    assert told["configuration"]["conditions"][:2] == ["replay", "bc"]


def test_values_say_where_they_come_from(capsys):
    lines = {
        line.partition(":")[0].strip(): line.partition("  # ")[2].strip()
        for line in printed(capsys, "demo", "--set", "rounds=2", "--seed", "0").splitlines()
    }
    assert lines["name"] == "<- demo.yaml:4"
    assert lines["conditions"] == "<- demo.yaml:5"
    assert lines["seeds"] == "<- --seed"
    assert lines["rounds"] == "<- --set"
    assert lines["randomness"] == "default"
    assert lines["spacing"] == "<- presets/laptop.yaml:15"


def test_for_machines_it_is_json(capsys):
    content = json.loads(printed(capsys, "demo", "--json"))
    assert content["configuration"]["policies"]["diffusion"]["training"]["steps"] == 8000
    assert content["from"]["policies.diffusion.training.steps"] == "presets/laptop.yaml:17"
    assert content["from"]["rounds"] == "default"


@pytest.mark.parametrize("name", names(CONFIGS))
def test_every_configuration_is_the_same_again_when_it_is_run_from_its_own_output(name, capsys, tmp_path):
    path = tmp_path / "again.yaml"
    path.write_text(printed(capsys, name))
    assert load_runs(path) == load_runs(name)


def test_a_choice_says_the_words_that_make_it_again():
    choice = Choice("my table.yaml", ("seeds=[0, 1]",), ("one_leg",), ("bc", "ta"), (3,))
    said = "'my table.yaml' --set 'seeds=[0, 1]' --task one_leg --condition bc --condition ta --seed 3"
    assert choice.as_arguments() == said
