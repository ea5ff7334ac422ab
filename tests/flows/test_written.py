"""Where a configuration comes from: files, bases and names, and what each value was written in."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from flows.reading import read_written
from flows.runs import load_runs, parse_runs
from flows.shipped import CONFIGS, PRESETS, names
from juicer.errors import ConfigError
from juicer.tasks.registry import TASK_NAMES


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_paths_are_relative_to_the_file_they_are_written_in(tmp_path, monkeypatch):
    base = write(tmp_path / "team" / "base.yaml", "logs: recordings\nlabels: labels.csv\n")
    mine = write(tmp_path / "mine" / "run.yaml", "base: ../team/base.yaml\nlabels: own.csv\n")
    monkeypatch.chdir(tmp_path)
    for source in (mine, "mine/run.yaml"):
        (run,) = load_runs(source)
        assert run.logs.resolve() == base.parent / "recordings"
        assert run.labels == mine.parent / "own.csv"
    (run,) = load_runs(mine, ["logs=here"])
    assert run.logs == tmp_path / "here"


def test_home_is_understood_in_every_path(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    write(tmp_path / "base.yaml", "rounds: 3\n")
    path = write(tmp_path / "mine" / "run.yaml", "base: ~/base.yaml\nlogs: ~/logs\n")
    (run,) = load_runs("~/mine/run.yaml", ["labels=~/labels.csv"])
    assert (run.rounds, run.logs, run.labels) == (3, tmp_path / "logs", tmp_path / "labels.csv")
    assert load_runs(path)[0].rounds == 3


def test_paths_of_single_tasks_follow_the_same_rule(tmp_path):
    path = write(tmp_path / "run.yaml", "tasks: {one_leg: {logs: a}, lamp: {logs: /b, labels: c.csv}}\n")
    first, second = load_runs(path, ["tasks.one_leg.labels=d.csv"])
    assert (first.logs, first.labels) == (tmp_path / "a", Path.cwd() / "d.csv")
    assert (second.logs, second.labels) == (Path("/b"), tmp_path / "c.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("logs: ''\n", "logs must be the path of a file or folder"),
        ('logs: "a\\0b"\n', "logs must be the path of a file or folder"),
        ("logs: 3\n", "logs: must be the path of a file or folder, got 3"),
        ("logs: ~nobody-here/x\n", "there is no such user"),
        ("base: 3\n", "base must be the name of a preset"),
        ("base: [laptop]\n", "base must be the name of a preset"),
        ("base: ''\n", "base must be the name of a preset"),
        ("base: labtop\n", "no preset that comes with juicer is called 'labtop'; did you mean 'laptop'"),
        ("base: .\n", "no preset that comes with juicer is called '.'"),
        ("base: ./\n", "it is not a plain file"),
        ("base: /dev/zero\n", "it is not a plain file"),
        ("base: run.yaml\n", "base leads back to"),
    ],
)
def test_what_is_no_path_is_told(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        load_runs(write(tmp_path / "run.yaml", text))


@pytest.mark.parametrize("name", names(CONFIGS))
def test_configuration_that_comes_along_runs_by_its_name_from_anywhere(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_runs(name) == load_runs(CONFIGS / f"{name}.yaml")


@pytest.mark.parametrize("name", names(PRESETS))
def test_preset_is_a_base_by_its_name_from_anywhere(name, tmp_path):
    by_name = load_runs(write(tmp_path / "a.yaml", f"base: {name}\n"))
    assert by_name == load_runs(write(tmp_path / "b.yaml", f"base: presets/{name}.yaml\n"))
    assert by_name == load_runs(write(tmp_path / "c.yaml", f"base: {PRESETS / name}.yaml\n"))


def test_file_of_ones_own_goes_before_what_comes_along(tmp_path):
    write(tmp_path / "presets" / "laptop.yaml", "rounds: 7\n")
    (run,) = load_runs(write(tmp_path / "run.yaml", "base: presets/laptop.yaml\n"))
    assert run.rounds == 7


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            "dmeo",
            "no configuration that comes with juicer is called 'dmeo'; did you mean 'demo'; a file .*",
        ),
        ("", "no configuration"),
        ("elsewhere/demo.yaml", "elsewhere/demo.yaml' does not exist; the one that comes with juicer is run as demo"),
        ("~nobody-here/run.yaml", "there is no such user"),
        ("a\0b.yaml", "must be the path"),
        ("/dev/zero.yaml", "does not exist"),
    ],
)
def test_unknown_configuration_is_told_with_the_nearest(source, message):
    with pytest.raises(ConfigError, match=message):
        load_runs(source)


def test_every_value_knows_where_it_was_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "base.yaml", "rounds: 2\nrecord:\n  seed: 1\n  first: 5\nselect: {longest: 2.0}\n")
    path = write(tmp_path / "run.yaml", "base: base.yaml\nrecord:\n  seed: 2\n")
    written = read_written(path, ["evaluate.episodes=3"])
    assert written.place(("rounds",)) == "base.yaml:1"
    assert written.place(("record", "seed")) == f"{'run.yaml'}:3"
    assert written.place(("record", "first")) == "base.yaml:4"
    assert written.place(("select", "longest")) == "base.yaml:5"
    assert written.place(("evaluate", "episodes")) == "--set"
    assert written.place(("collect", "seed")) is None


def test_mistake_is_told_with_its_file_and_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "base.yaml", "rounds: 2\nrecord:\n  seed: -1\n")
    path = write(tmp_path / "run.yaml", "base: base.yaml\nname: mine\n")
    with pytest.raises(ConfigError, match=r"^base\.yaml:3: record\.seed: must be at least 0, got -1$"):
        load_runs(path)
    with pytest.raises(ConfigError, match=r"^--set: record\.seed: must be a whole number, got True$"):
        load_runs(path, ["record.seed=true"])


def test_an_override_changes_what_it_names_and_not_what_an_alias_repeats(tmp_path):
    text = "policies:\n  diffusion: {training: &t {steps: 700}}\n  mlp_chunked: {training: *t}\n"
    (run,) = load_runs(write(tmp_path / "run.yaml", text), ["policies.diffusion.training.steps=900"])
    assert run.policies["diffusion"].training.steps == 900
    assert run.policies["mlp_chunked"].training.steps == 700


def test_network_of_another_kind_replaces_that_of_the_base(tmp_path):
    text = "base: laptop\npolicies: {diffusion: {policy: {head: {denoiser: {kind: unet}}}}}\n"
    (run,) = load_runs(write(tmp_path / "run.yaml", text))
    head = run.policies["diffusion"].policy.head
    assert (head.denoiser.kind, head.prediction) == ("unet", "sample")


def test_task_is_said_once(tmp_path):
    for section in ("record", "ingest", "collect", "evaluate", "policies", "annotate"):
        path = write(tmp_path / "run.yaml", f"task: lamp\n{section}: {{task: one_leg}}\n")
        with pytest.raises(
            ConfigError, match=rf"{section}\.task: the task is said once, at the top of the configuration"
        ):
            load_runs(path)
    with pytest.raises(ConfigError, match=r"run\.yaml:1: task: unknown task 'lmap'; did you mean 'lamp'\?"):
        load_runs(write(tmp_path / "run.yaml", "task: lmap\n"))
    with pytest.raises(ConfigError, match=r"randomness: must be one of low, med, high, got 'lo'; did you mean 'low'\?"):
        load_runs(write(tmp_path / "run.yaml", "randomness: lo\n"))


def test_a_form_cannot_name_another_task_than_it_trains():
    (run,) = parse_runs({"task": "lamp", "base": "smoke"}, "the form")
    stages = (run.recording, run.ingestion, run.collection(0, 1), run.evaluation)
    assert {stage.task for stage in stages} == {"lamp"}


def test_text_pasted_into_a_form_is_read_like_a_file():
    (run,) = parse_runs("base: laptop\ntask: lamp\nseed: 3\n", "the form")
    assert (run.task, run.seed, run.policies["diffusion"].training.steps) == ("lamp", 3, 16000)
    with pytest.raises(ConfigError, match=r"^the form, line 2: seed: must be a whole number, got True$"):
        parse_runs("task: lamp\nseed: true\n", "the form")
    with pytest.raises(ConfigError, match="the form: line 2: the key 'seed' is there already, in line 1"):
        parse_runs("seed: 1\nseed: 2\n", "the form")
    with pytest.raises(ConfigError, match="the form: it must hold a mapping"):
        parse_runs("- 1\n", "the form")


def test_configuration_without_a_file_is_read_like_one():
    (run,) = parse_runs({"base": "laptop", "seed": 3, "logs": "/logs"}, "the form", ["seed=4"])
    assert (run.seed, run.logs) == (4, Path("/logs"))
    assert run.policies["diffusion"].training.steps == 8000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"logs": "recordings"}, "the form: logs must be an absolute path, as it stands in no file"),
        ({"base": "./mine.yaml"}, "base must be an absolute path"),
        ({"base": "lpatop"}, "did you mean 'laptop'"),
        ({"seeds": [1]}, "the form: unknown key 'seeds'; did you mean 'seed'"),
        ({"record": {"seed": True}}, "the form: record.seed: must be a whole number, got True"),
        ({1: 2}, "the form: a key must be a word, got 1"),
        ({"record": {"a" * 1000: 1}}, "cannot be a key"),
        ({"mix": {"lamp": {}}}, "mix.lamp must be the loop of lamp alone"),
        ({"mix": {}, "tasks": ["lamp"]}, "key 'mix' does not go with tasks"),
    ],
)
def test_mistake_in_a_form_is_told_in_a_sentence(content, message):
    with pytest.raises(ConfigError, match=message):
        parse_runs(content, "the form")


def test_a_base_can_be_assigned(tmp_path, monkeypatch):
    write(tmp_path / "own" / "small.yaml", "base: laptop\nrounds: 3\n")
    path = write(tmp_path / "run.yaml", "base: laptop\nrecord: {seed: 2}\n")
    (run,) = load_runs(path, ["base=laptop_image", "rounds=2"])
    assert run.policies["diffusion"].policy.observation["state"].kind == "estimated"
    assert (run.record.seed, run.rounds, run.name) == (2, 2, "juicer_laptop_image")
    monkeypatch.chdir(tmp_path / "own")
    (run,) = load_runs(path, ["base=small.yaml"])
    assert run.rounds == 3
    with pytest.raises(ConfigError, match="did you mean 'laptop_image'"):
        load_runs(path, ["base=laptop_imag"])
    with pytest.raises(ConfigError, match="--set: base must be the name of a preset"):
        load_runs(path, ["base=3"])


@pytest.mark.parametrize("base", ["./\\uD800", "./loop.yaml"])
def test_a_base_that_cannot_be_read_is_told_with_another_preset_too(tmp_path, base):
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    path = write(tmp_path / "run.yaml", f'base: "{base}"\n')
    with pytest.raises(ConfigError):
        load_runs(path, ["base=laptop"])


def test_names_in_a_list_pick_from_the_section_below(tmp_path):
    path = write(tmp_path / "run.yaml", "tasks: {lamp: {rounds: 3}, one_leg: {rounds: 2}}\n")
    (run,) = load_runs(path, ["tasks=[lamp]"])
    assert (run.task, run.rounds) == ("lamp", 3)
    written = read_written(path, ["tasks=[lamp]"])
    assert written.place(("tasks", "lamp", "rounds")).endswith("run.yaml:1")


BY_TASK = """
rounds: 2
by_task: {lamp: {rounds: 5, record: {demonstrations: 7}}}
"""


def test_what_is_said_by_task_counts_whichever_run_is_for_it(tmp_path):
    path = write(tmp_path / "run.yaml", BY_TASK)
    assert [run.rounds for run in load_runs(path)] == [2]
    assert [run.rounds for run in load_runs(path, ["task=lamp"])] == [5]
    for tasks in ("[one_leg, lamp]", "{one_leg: {}, lamp: {}}", "{one_leg: , lamp: }"):
        first, second = load_runs(path, [f"tasks={tasks}"])
        assert (first.rounds, second.rounds, second.record.demonstrations) == (2, 5, 7)
    written = read_written(path, ["tasks=[lamp]"])
    assert written.place(("tasks", "lamp", "rounds")).endswith("run.yaml:3")


def test_what_is_said_by_task_gives_way_to_what_is_said_above(tmp_path):
    write(tmp_path / "base.yaml", BY_TASK)
    above = write(tmp_path / "above.yaml", "base: base.yaml\nrounds: 3\n")
    (run,) = load_runs(above, ["task=lamp"])
    assert (run.rounds, run.record.demonstrations) == (3, 7)
    (run,) = load_runs(tmp_path / "base.yaml", ["task=lamp", "rounds=4"])
    assert (run.rounds, run.record.demonstrations) == (4, 7)
    (run,) = load_runs(tmp_path / "base.yaml", ["task=lamp", "record={demonstrations: 9}"])
    assert (run.rounds, run.record.demonstrations) == (5, 9)
    path = write(tmp_path / "own.yaml", "base: above.yaml\nby_task: {lamp: {rounds: 6}}\n")
    assert load_runs(path, ["task=lamp"])[0].rounds == 6
    (run,) = load_runs(above, ["tasks={lamp: {rounds: 8}}"])
    assert (run.rounds, run.record.demonstrations) == (8, 7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("by_task: [lamp]\n", r"run\.yaml:1: by_task must map tasks to what is said of each"),
        ("by_task: {lamp: 3}\n", "by_task must map tasks"),
        ("base: laptop\nby_task:\n  lamp: 3\n", r"run\.yaml:3: by_task must map tasks"),
        ("base: laptop\nby_task: 3\n", r"run\.yaml:2: by_task must map tasks"),
        ("base: laptop\npolicies: {diffusion: 3}\n", r"run\.yaml:2: policies\.diffusion: must hold keys and values"),
        ("base: laptop\ntasks: [lamp]\ntask: lamp\n", r"run\.yaml:2: 'tasks' must list tasks"),
        ("by_task: {lmap: {}}\n", "by_task: unknown task 'lmap'; did you mean 'lamp'"),
        ("by_task: {lamp: {name: a}}\n", r"by_task\.lamp must not have a 'name' of its own"),
        ("task: lamp\nby_task: {lamp: {roundz: 3}}\n", "did you mean 'rounds'"),
    ],
)
def test_what_cannot_be_said_by_task_is_refused(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        load_runs(write(tmp_path / "run.yaml", text))


def test_a_configuration_with_another_preset_is_a_study_of_its_own(tmp_path):
    path = write(tmp_path / "run.yaml", "base: laptop\nname: mine\n")
    assert load_runs(path)[0].name == "mine"
    assert load_runs(path, ["base=laptop_image"])[0].name == "mine_laptop_image"
    assert load_runs(path, ["base=laptop_image", "name=seen"])[0].name == "seen"
    path = write(tmp_path / "tasks.yaml", "base: laptop\ntasks: {lamp: {name: ours}, one_leg: {}}\n")
    assert [run.name for run in load_runs(path, ["base=laptop_image"])] == [
        "ours_laptop_image",
        "juicer_laptop_image_one_leg",
    ]
    for preset in (str(PRESETS / "laptop_image.yaml"), "presets/laptop_image.yaml"):
        assert load_runs(path, [f"base={preset}"])[0].name == "ours_laptop_image"
    assert load_runs(path, ["base=laptop"])[0].name == "ours"
    runs = load_runs("paper_study", ["base=laptop_image"])
    assert runs[0].name == "paper_study_laptop_image_one_leg"


ABOUT_IMAGES = {"image_ablation", "table_vii"}
"""Configurations whose own policies say how images are seen, which means nothing to those that see none."""


@pytest.mark.parametrize("preset", names(PRESETS))
@pytest.mark.parametrize("name", sorted({*names(CONFIGS)} - ABOUT_IMAGES))
def test_every_configuration_runs_with_every_preset(name, preset):
    """With its own tasks and conditions, and with the preset's lengths for all of them."""
    usual, runs = load_runs(name), load_runs(name, [f"base={preset}"])
    assert [(run.task, list(run.chosen), run.seeds) for run in runs] == [
        (run.task, list(run.chosen), run.seeds) for run in usual
    ]
    own = {run.task: run for task in TASK_NAMES for run in load_runs(preset, [f"task={task}"])}
    for run in runs:
        for policy in ("diffusion", "multitask"):
            lengths = {each.policies[policy].training.steps for each in (run, own[run.task])}
            assert len(lengths) == 1 or policy in said_of(name)


def said_of(name):
    """Policies of which a configuration says something itself."""
    return yaml.safe_load((CONFIGS / f"{name}.yaml").read_text()).get("policies", {})


def test_a_preset_is_replaced_however_its_path_is_written(tmp_path):
    (tmp_path / "link").symlink_to(PRESETS)
    path = write(tmp_path / "run.yaml", "base: link/laptop.yaml\nname: mine\n")
    (run,) = load_runs(path, ["base=paper"])
    assert (run.name, run.policies["diffusion"].training.steps) == ("mine_paper", 160000)


def test_names_in_a_list_pick_from_what_is_said_by_task_as_well(tmp_path):
    path = write(tmp_path / "run.yaml", "base: laptop\ntask: lamp\npolicies: [diffusion, multitask]\n")
    for (run,) in (load_runs(path), load_runs("demo", ["task=lamp", "policies=[diffusion, multitask]"])):
        assert list(run.policies) == ["diffusion", "multitask"]
        assert run.policies["diffusion"].training.steps == 16000


def test_names_that_a_task_picks_need_not_be_said_by_task_below(tmp_path):
    path = write(
        tmp_path / "run.yaml", "base: laptop\ntask: lamp\nby_task: {lamp: {policies: [diffusion, multitask]}}\n"
    )
    (run,) = load_runs(path)
    assert [run.policies[name].training.steps for name in ("diffusion", "multitask")] == [16000, 64000]


def test_what_is_said_by_task_can_be_left_out(tmp_path):
    for nothing in ("by_task=null", "by_task.lamp=null", "by_task={}"):
        (run,) = load_runs("demo", ["task=lamp", nothing])
        assert run.policies["diffusion"].training.steps == 8000
    for nothing in ("null", "{lamp: null}", "[round_table]"):
        (run,) = load_runs(write(tmp_path / "run.yaml", f"base: laptop\ntask: lamp\nby_task: {nothing}\n"))
        assert run.policies["diffusion"].training.steps == 8000


def test_what_is_said_above_counts_for_a_task_that_left_it_out(tmp_path):
    base = write(tmp_path / "base.yaml", "base: smoke\ntask: lamp\nby_task: {lamp: {augment_retraining: null}}\n")
    above = write(tmp_path / "above.yaml", "base: base.yaml\naugment_retraining: {seed: 4}\n")
    for (run,) in (load_runs(base, ["augment_retraining.seed=4"]), load_runs(above)):
        assert run.augment_retraining.seed == 4


def test_what_one_task_picks_stays_picked_when_a_value_is_said_above(tmp_path):
    base = write(
        tmp_path / "base.yaml", "base: smoke\ntask: lamp\nby_task: {lamp: {policies: [diffusion, multitask]}}\n"
    )
    above = write(tmp_path / "above.yaml", "base: base.yaml\npolicies: {diffusion: {training: {steps: 266}}}\n")
    for (run,) in (load_runs(base, ["policies.diffusion.training.steps=266"]), load_runs(above)):
        assert list(run.policies) == ["diffusion", "multitask"]
        assert run.policies["diffusion"].training.steps == 266


def test_a_value_is_not_said_to_stand_where_it_was_left_out(tmp_path):
    path = write(tmp_path / "run.yaml", "task: lamp\nrounds: 2\nby_task:\n  lamp:\n    rounds: 5\n  one_leg: {}\n")
    write(tmp_path / "above.yaml", "base: run.yaml\nby_task: [one_leg]\n")
    assert read_written(path).place(("rounds",)).endswith("run.yaml:5")
    for written in (read_written(path, ["by_task=[one_leg]"]), read_written(tmp_path / "above.yaml")):
        assert written.values["rounds"] == 2
        assert written.place(("rounds",)).endswith("run.yaml:2")
