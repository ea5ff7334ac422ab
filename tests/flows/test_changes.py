"""A condition may change the whole configuration for itself; curves are drawn over such conditions."""

from __future__ import annotations

import json
import re

import PIL.Image
import pytest
from pydantic import ValidationError

from flows.command.cli import call
from flows.command.run import _say_outcome
from flows.conditions import Condition
from flows.config import CollectInferConfig, StudyConfig
from flows.loop_config import LoopConfig
from flows.running.execution import RunOutcome, _facts, execute
from flows.running.plan import calls_of, evaluated_models, plan
from flows.runs import load_runs
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError
from juicer.shifts import parse_shift
from stages.report import PAGE
from stages.runtime.execution import perform_here
from stages.runtime.session import Session

SWEEP = """
base: smoke
flow: study
name: sweep
seeds: [0]
policies:
  diffusion: {training: {steps: 30, warmup_steps: 5, validation_fraction: 0.5, windows: {back_padding: 15}}}
record: {demonstrations: 2}
evaluate: {episodes: 2, max_steps: 20}
conditions:
  bc: {}
  same: {changes: {record: {demonstrations: 2}}}
  longer: {title: "BC, longer", changes: {policies: {diffusion: {training: {steps: 40}}}}}
  med: {title: "Replay, med", replay: true, changes: {randomness: med}}
curves:
  steps: {title: Success over steps, axis: steps, x: policies.diffusion.training.steps, conditions: [bc, longer]}
"""


def write(path, text):
    path.write_text(text)
    return path


@pytest.fixture
def sweep(tmp_path):
    return write(tmp_path / "sweep.yaml", SWEEP)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The sweep, really trained, evaluated and reported."""
    folder = tmp_path_factory.mktemp("sweep")
    (config,) = load_runs(write(folder / "sweep.yaml", SWEEP))
    store = ArtifactStore(folder / "data" / "store")
    return folder, store, config, execute(Session(store, performer=perform_here), config, None)


def test_a_condition_without_changes_has_the_loop_of_the_configuration(sweep):
    (config,) = load_runs(sweep)
    assert config.loop("bc") is config


def test_changes_that_change_nothing_make_the_same_artifacts(finished):
    _, _, _, outcome = finished
    bc, same, longer, _ = outcome.models
    assert (same.checkpoint, same.evaluation) == (bc.checkpoint, bc.evaluation)
    assert longer.checkpoint != bc.checkpoint


def test_stages_get_what_a_condition_changes_and_nobody_else(sweep, tmp_path):
    (config,) = load_runs(sweep)
    planned = plan(ArtifactStore(tmp_path / "data"), config)
    assert [each.call.recipe.config["training"]["steps"] for each in calls_of(planned, "train")] == [30, 40]
    assert [each.call.recipe.config["randomness"] for each in calls_of(planned, "record")] == ["low", "med"]
    assert [each.call.recipe.config["randomness"] for each in calls_of(planned, "evaluate")] == ["low", "low", "med"]


def test_a_section_of_another_kind_replaces_the_one_below(sweep):
    head = "conditions.longer.changes={policies: {diffusion: {policy: {head: {kind: mlp, width: 32}}}}}"
    (config,) = load_runs(sweep, [head, "curves={}"])
    assert config.loop("longer").policies["diffusion"].policy.head.kind == "mlp"
    assert config.policies["diffusion"].policy.head.kind == "diffusion"


def test_changes_of_a_model_for_several_tasks_reach_the_loops_of_all_of_them(tmp_path):
    text = """
        flow: study
        tasks: [one_leg, lamp]
        conditions: {multitask: {changes: {record: {demonstrations: 7}}}, bc: {changes: {rounds: 2}}}
    """
    for run in load_runs(write(tmp_path / "run.yaml", text)):
        assert [each.record.demonstrations for each in run.loop("multitask").mix.values()] == [7, 7]
        assert [each.record.demonstrations for each in run.mix.values()] == [50, 50]
        assert run.loop("multitask").task == run.task


OF_A_FLOW = {*CollectInferConfig.model_fields, *StudyConfig.model_fields} - LoopConfig.model_fields.keys()


@pytest.mark.parametrize("key", sorted(OF_A_FLOW))
def test_what_makes_a_run_of_a_loop_is_changed_by_no_condition(key):
    with pytest.raises(ValidationError, match=f"'{key}' is said once for the whole run"):
        Condition(title="Mine", changes={key: None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ("{record: {demonstratons: 3}}", "unknown key 'record.demonstratons'; did you mean 'demonstrations'?"),
        ("{record: {demonstrations: 0}}", "record.demonstrations: must be greater than 0, got 0"),
        ("{records: {}}", "unknown key 'records'; did you mean 'record'?"),
        ("{task: lamp}", "'task' is said once for the whole run; leave it out of a condition's changes"),
        ("{seeds: [1]}", "'seeds' is said once for the whole run"),
        ("{mix: {}}", "'mix' is said once"),
        ("{evaluate: {episodes: 4, stop: {every: 2}}}", "'evaluate.stop' is said once for the whole run"),
        ("[record]", "must hold keys and values, got ['record']"),
        ("{evaluate: {episodes: 1000000, first: 1}}", "initial states to evaluate on run out; lower evaluate.first"),
    ],
)
def test_a_mistake_in_changes_is_told_with_file_and_line(tmp_path, changes, message):
    text = f"flow: study\nseeds: [0]\nconditions:\n  bc: {{}}\n  few:\n    changes: {changes}\n"
    with pytest.raises(ConfigError, match=re.escape(message)) as raised:
        load_runs(write(tmp_path / "run.yaml", text))
    assert "conditions.few.changes: " in str(raised.value)
    if "run out" not in message:
        assert "run.yaml:6: " in str(raised.value)


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ("{few: {setting: few}}", "conditions.few: a setting is the name of what a condition changes: add changes"),
        (
            "{few: {setting: few, changes: {rounds: 2}}, more: {setting: few, changes: {rounds: 3}}}",
            "conditions: more: the setting 'few' is the name of other changes as well",
        ),
        ("{few: {setting: '<b>', changes: {rounds: 2}}}", "conditions.few.setting: must be letters, digits"),
    ],
)
def test_a_setting_is_the_name_of_one_set_of_changes(tmp_path, conditions, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_runs(write(tmp_path / "run.yaml", f"flow: study\nseeds: [0]\nconditions: {conditions}\n"))


def test_the_name_of_a_setting_shapes_no_result_and_is_a_heading(finished, tmp_path, monkeypatch):
    folder, store, config, _ = finished
    text = SWEEP.replace("replay: true, changes", "replay: true, setting: medium randomness, changes")
    named = write(tmp_path / "sweep.yaml", text)
    (run,) = load_runs(named)
    models, expected = (evaluated_models(store, each)[0] for each in (run, config))
    assert [model.evaluation for model in models] == [model.evaluation for model in expected]
    monkeypatch.setenv("JUICER_STORE", str(folder / "data" / "store"))
    assert call(["report", str(named), "--output", str(tmp_path / "study.md")]) == 0
    page = (tmp_path / "study.md").read_text()
    assert "### one\\_leg, medium randomness\n" in page
    assert "\nrandomness med\n" in page


def test_changes_are_set_from_the_command_line_and_mistakes_there_are_told_so(sweep):
    (config,) = load_runs(sweep, ["conditions.longer.changes.record.demonstrations=3"])
    assert config.loop("longer").record.demonstrations == 3
    assert config.loop("longer").policies["diffusion"].training.steps == 40
    with pytest.raises(ConfigError, match=r"^--set: conditions\.longer\.changes: record\.demonstrations: must be"):
        load_runs(sweep, ["conditions.longer.changes.record.demonstrations=x"])


def test_paths_in_changes_are_relative_to_their_file(tmp_path):
    text = "flow: study\nseeds: [0]\nconditions: {bc: {changes: {labels: mine.csv}}}\n"
    (config,) = load_runs(write(tmp_path / "run.yaml", text))
    assert config.loop("bc").labels == tmp_path / "mine.csv"


def test_a_configuration_that_is_printed_says_what_it_said(sweep, tmp_path, capsys):
    assert call(["config", str(sweep)]) == 0
    printed = write(tmp_path / "printed.yaml", capsys.readouterr().out)
    assert load_runs(printed) == load_runs(sweep)


def test_every_key_of_a_loop_but_those_of_the_run_can_be_changed(sweep):
    (config,) = load_runs(sweep)
    content = config.model_dump(mode="json", include=set(LoopConfig.model_fields) - {"name", "task", "mix"})
    whole = config.changed(content, "all", lambda keys: None)
    assert whole == LoopConfig.model_validate(config.model_dump(include=set(LoopConfig.model_fields)))


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        ("{title: T, axis: x, x: record.demonstration, conditions: [bc]}", "bc holds no number at x 'record.demonst"),
        ("{title: T, axis: x, x: randomness, conditions: [bc]}", "holds no number at x 'randomness'"),
        ("{title: T, axis: x, conditions: {bc: null}}", "or write bc: NUMBER under curves.c.conditions"),
        ("{title: T, axis: x, x: rounds, conditions: [bd]}", "curves.c: unknown condition 'bd'; valid: bc, longer"),
    ],
)
def test_a_curve_needs_conditions_of_the_study_and_a_number_of_each(sweep, curve, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_runs(sweep, [f"curves={{c: {curve}}}"])


def test_a_curve_has_the_points_of_the_conditions_that_are_run(sweep):
    (config,) = load_runs(sweep, ["curves.steps.conditions={bc: 0, longer: null}"])
    assert [dict(curve.points) for curve in config.drawn_curves] == [{"bc": 0.0, "longer": 40.0}]
    narrowed = config.narrowed(["longer"], ())
    assert [dict(curve.points) for curve in narrowed.drawn_curves] == [{"longer": 40.0}]
    assert config.narrowed(["same"], ()).drawn_curves == ()
    # Prefect validates what a flow is given once more.
    assert StudyConfig.model_validate(narrowed.model_dump(mode="json")) == narrowed


def test_the_report_draws_the_curve_and_tests_conditions_that_change_alike(finished):
    _, store, _, outcome = finished
    folder = store.open(outcome.report)
    page = (folder / PAGE).read_text()
    assert (folder / "one_leg_steps.png").read_bytes().startswith(b"\x89PNG")
    for anchor in ("curves", "effort", "learned", "cost"):
        assert f'<section id="{anchor}">' in page
        assert f'href="#{anchor}"' in page
    # What is told at all is told once.
    anchors = re.findall(r'<section id="([^"]+)"', page)
    assert len(anchors) == len(set(anchors))
    assert not {"data", "price"} & set(anchors)
    # Each of the others changes something, so nothing is left to be tested.
    assert '<section id="differences">' not in page


def test_a_number_costs_what_everything_behind_it_cost(finished):
    _, store, _, outcome = finished
    behind = {manifest.ref: manifest for manifest in store.list()}
    assert all(manifest.cpu_seconds is not None for manifest in behind.values())
    recorded = next(each for each in behind.values() if each.recipe.stage == "record")
    assert recorded.cpu_seconds > 0.1
    assert "CPU-hours" in (store.open(outcome.report) / PAGE).read_text()


def test_the_page_of_a_study_is_written_from_what_is_there(finished, tmp_path, capsys, monkeypatch):
    folder, store, config, _ = finished
    models, planned = evaluated_models(store, config)
    assert (len(models), planned) == (4, 4)
    monkeypatch.setenv("JUICER_DATA", str(folder / "data"))
    monkeypatch.setenv("JUICER_STORE", str(folder / "data" / "store"))
    page = tmp_path / "study.md"
    arguments = ["report", str(folder / "sweep.yaml"), "--set", "seeds=[0, 1]", "--output", str(page), "--json"]
    assert call(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["files"] == [str(page), str(tmp_path / "study" / "one_leg_steps.png")]
    assert (told["evaluated"], told["models"]) == (4, 7)
    text = page.read_text()
    assert "| models evaluated | 4 of 7 |" in text
    assert "## What it cost to compute" in text
    assert "![one\\_leg: Success over steps](study/one_leg_steps.png)" in text
    assert call(["report", str(folder / "sweep.yaml"), "--output", "/proc/study.md"]) == 1
    assert "cannot be written" in capsys.readouterr().err


def test_the_page_of_a_study_is_written_before_its_evaluations_under_shifts_are_there(finished):
    _, store, config, outcome = finished
    known, planned = evaluated_models(store, config.model_copy(update={"shifts": {"shoved": parse_shift("push")}}))
    assert ([model.evaluation for model in known], planned) == ([model.evaluation for model in outcome.models], 4)
    assert all(not model.shifted for model in known)
    assert [row.title for row in RunOutcome(tuple(known), None).results(store)][:2] == ["BC", "same"]


def test_the_page_of_a_study_shows_analyses_and_their_figures(finished, tmp_path, monkeypatch, capsys):
    folder, store, _, _ = finished
    sampling = "{kind: sampling, conditions: [bc], samples: 30, inference_steps: [1, 2]}"
    arguments = [str(folder / "sweep.yaml"), "--set", f"analyses.drawn={sampling}"]
    (config,) = load_runs(arguments[0], arguments[2:])
    execute(Session(store, performer=perform_here), config, None)
    monkeypatch.setenv("JUICER_STORE", str(folder / "data" / "store"))
    assert call(["report", *arguments, "--output", str(tmp_path / "study.md")]) == 0
    text = (tmp_path / "study.md").read_text()
    assert "![one\\_leg, drawn: BC, seed 0](study/one_leg_drawn.bc.0.png)" in text
    assert "| steps |" in text
    with PIL.Image.open(tmp_path / "study" / "one_leg_drawn.bc.0.png") as image:
        assert image.width > 300
    capsys.readouterr()
    alone = tmp_path / "alone"
    alone.mkdir()
    assert call(["report", *arguments, "--output", str(alone / "study.html"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == [str(alone / "study.html")] == [*map(str, alone.iterdir())]
    page = (alone / "study.html").read_text()
    assert '<img src="data:image/png;base64,' in page
    assert "--output study.html" in page
    titles = re.findall(r"^## (.+)$", text, re.M)
    assert re.findall(r"<section id=.*>\n<h2>(.+)</h2>", page) == titles


def test_several_configurations_share_a_page(finished, tmp_path, monkeypatch, capsys):
    folder, _, _, _ = finished
    monkeypatch.setenv("JUICER_STORE", str(folder / "data" / "store"))
    own = SWEEP.replace("  bc: {}", "  seen: {title: Another}").replace("[bc, longer]", "[seen, longer]")
    other = str(write(tmp_path / "other.yaml", own.replace("name: sweep", "name: other")))
    page = tmp_path / "study.md"
    arguments = ["report", str(folder / "sweep.yaml"), "--condition", "bc", "--with", other, "--output", str(page)]
    assert call([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["evaluated"] == 5
    text = page.read_text()
    chosen = f"{folder}/sweep.yaml --condition bc"
    commands = f"juicer run {chosen}; juicer run {other}; juicer report {chosen} --with {other} --output study.md"
    assert f"| made again by | {commands} |" in text.replace("\\_", "_")
    assert all(f"| {title} |" in text for title in ("BC", "Another", "BC, longer"))
    (config,) = load_runs(write(tmp_path / "other.yaml", SWEEP.replace("episodes: 2,", "episodes: 3,")))
    execute(
        Session(ArtifactStore(folder / "data" / "store"), performer=perform_here), config.narrowed(["bc"], []), None
    )
    assert call(arguments) == 1
    assert "condition bc of sweep is another one than that of sweep; write a page for each" in capsys.readouterr().err


def test_only_chosen_conditions_are_measured_under_shifts(sweep, tmp_path):
    (config,) = load_runs(sweep, ["shifts.shoved={kind: push}", "shifted=[bc]"])
    labels = [each.label for each in calls_of(plan(ArtifactStore(tmp_path / "data"), config), "evaluate")]
    assert [label for label in labels if "shoved" in label] == ["bc seed 0 under shoved"]
    own = "conditions.longer.changes={shifts: {dropped: {kind: friction}}}"
    (config,) = load_runs(sweep, ["shifts.shoved={kind: push}", "shifted=[bc]", own])
    assert list(config.shifts_of("longer")) == ["shoved", "dropped"]
    assert not config.shifts_of("same")
    with pytest.raises(ConfigError, match="shifted: there is no condition 'bcc'; did you mean 'bc'"):
        load_runs(sweep, ["shifted=[bcc]"])


def test_a_report_says_what_its_conditions_change_of_the_evaluation(finished, capsys):
    folder, store, config, outcome = finished
    facts = store.recipe(outcome.report).config["facts"]
    assert facts["Randomness"] == "low, med"
    (varied,) = load_runs(
        folder / "sweep.yaml",
        ["conditions.same.changes={evaluate: {episodes: 3}, shifts: {shoved: {kind: push}}}"],
    )
    facts = _facts(varied, outcome, store)
    assert facts["Evaluation episodes a model"] == "2 or 3"
    assert facts["Shifts"].startswith("shoved: ")
    _say_outcome(outcome, config, store, pages="")
    assert "one_leg, low and med randomness: success rates" in capsys.readouterr().out
