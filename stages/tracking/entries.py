"""What MLflow's pages say, put into MLflow's words: names, tables, texts, all of them computed from manifests."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mlflow.entities import Dataset, DatasetInput, InputTag

from juicer.artifacts.commit import UNKNOWN
from juicer.artifacts.manifest import OBSERVES, STATE, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.evaluation import ConditionResult
from juicer.pages.addresses import lineage_of
from juicer.storage.evaluations import EvaluationRow
from stages.tracking.destination import MODELS_VIEW, VIEW, runs_page
from stages.tracking.history import History
from stages.tracking.model import Model

MODEL = "model"
"""Folder of a run with its model."""

LOGGED_TABLE = json.dumps([{"path": "evaluation.json", "type": "table"}])
"""Value of the tag by which MLflow's pages find the table."""

LONGEST_VALUE = 500
"""Letters of a parameter that MLflow's pages can still show."""


COLOUR = "mlflow.runColor"
_COLOURS = (
    "#1f77b4",
    "#ff7f0e",
    "#2ca02c",
    "#d62728",
    "#9467bd",
    "#8c564b",
    "#e377c2",
    "#7f7f7f",
    "#bcbd22",
    "#17becf",
)
"""Of conditions, in the order in which they are first seen; told apart by most people, also side by side."""

_EACH_MODEL: dict[str, Any] = {
    "uuid": "juicer-models",
    "deleted": False,
    "isGenerated": False,
    "metricSectionId": "success",
    "type": "SCATTER",
    "xaxis": {"key": "condition", "type": "PARAM"},
    "yaxis": {"key": "success_rate", "type": "METRIC"},
    "runsCountToCompare": 1000,
}
"""A chart with a column of dots for each condition, which MLflow cannot draw of groups."""


def views() -> dict[str, str]:
    """Tags of an experiment with views on its runs, as MLflow's pages keep those that people share.

    A table with the success rates in front, the best first; charts of these, and of how the final models learned. One
    view groups the models by condition; the other shows each, in the colour of its condition.
    """
    conditions = json.loads(Path(__file__).with_name("view.json").read_text(encoding="utf-8"))
    charts = [_EACH_MODEL, *(each for each in conditions["compareRunCharts"] if each["type"] == "LINE")]
    models = conditions | {"groupBy": None, "searchFilter": "tags.seed != ''", "compareRunCharts": charts}
    return {
        f"mlflow.sharedViewState.{name}": json.dumps(state)
        for name, state in {VIEW: conditions, MODELS_VIEW: models}.items()
    }


def colour(condition: str, known: Mapping[str, str]) -> str:
    """Colour of a condition's runs, given those of the conditions that are shown already."""
    return known.get(condition) or _COLOURS[len(known) % len(_COLOURS)]


def outcome(evaluation: Manifest) -> dict[str, float]:
    """The final model's result, under names that are the same for every condition."""
    facts = {"success_rate": "success_rate", "interval_low": "success_rate_low", "interval_high": "success_rate_high"}
    facts["episodes"] = "episodes"
    return {name: evaluation.summary[key] for key, name in facts.items() if key in evaluation.summary}


def rates(result: ConditionResult) -> dict[str, float]:
    """The same for a condition, over its models."""
    low, high = result.interval
    return {
        "success_rate": result.average,
        "success_rate_best": result.best,
        "success_rate_low": low,
        "success_rate_high": high,
        # Models do not have these two, so that MLflow's average over a group is the interval of the condition.
        "condition_rate_low": low,
        "condition_rate_high": high,
        "episodes": result.num_episodes,
        "models": result.num_models,
        **{
            f"under_{shift}/{name}": value
            for shift, under in result.shifted.items()
            if under
            for name, value in rates(under).items()
        },
    }


def flat_numbers(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Numbers of a summary by name, those of tables within it as well."""
    for key, item in content.items():
        if isinstance(item, Mapping):
            yield from flat_numbers(item, f"{prefix}{key}/")
        elif isinstance(item, int | float) and "/" not in key:  # the others are the ends of curves
            name = "".join(letter if letter.isalnum() or letter in "/_-. " else "_" for letter in f"{prefix}{key}")
            yield name, float(item)


def value(item: object) -> str:
    """A parameter as MLflow takes it."""
    return str(item)[:LONGEST_VALUE]


def digest(text: str) -> str:
    """By which a text is known again."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def commit(manifest: Manifest) -> str:
    """Commit of the code that made an artifact; empty if it is unknown."""
    found = str(manifest.host.get("commit", UNKNOWN))
    return "" if found == UNKNOWN else found


def sight(model: Model, evaluation: Manifest) -> dict[str, str]:
    """Tags of a run that say what the policy sees.

    A run that was begun before that was known has a name which does not say so.
    """
    if not evaluation.observes:
        return {}
    named = {} if evaluation.observes == STATE else {"mlflow.runName": model.label}
    return {OBSERVES: evaluation.observes, **named}


def dataset(manifest: Manifest) -> DatasetInput:
    """An artifact as a dataset, whose digest is the artifact's id."""
    recipe = manifest.recipe
    story = {
        "made_by": f"stage {recipe.stage}",
        "made_from": ", ".join(map(str, recipe.parents)) or f"{len(recipe.files)} files",
        "lineage": f"juicer lineage {manifest.ref.id}",
    }
    entry = Dataset(
        name=f"{recipe.stage}: {manifest.ref.kind}",
        digest=manifest.ref.id,
        source_type="juicer",
        source=json.dumps({"artifact": str(manifest.ref)}),
        profile=json.dumps(story | dict(manifest.summary)),
    )
    return DatasetInput(entry, [InputTag("mlflow.data.context", recipe.stage)])


def table(rows: Sequence[EvaluationRow]) -> str:
    """Episodes of an evaluation as a table that MLflow's pages show."""
    columns = ["seed", "outcome", "parts_assembled", "steps", "milestones"]
    data = [[row.seed, row.outcome.value, row.parts_assembled, row.length, ", ".join(row.milestones)] for row in rows]
    return json.dumps({"columns": columns, "data": data})


def mlmodel(run: str, task: str) -> str:
    """File by which ``mlflow.pyfunc.load_model`` finds what loads a checkpoint; JSON is YAML."""
    flavor = {
        "loader_module": "juicer.policy.served",
        "config": {"task": task},
        "python_version": platform.python_version(),
    }
    content = {
        "artifact_path": MODEL,
        "flavors": {"python_function": flavor},
        "mlflow_version": version("mlflow"),
        "run_id": run,
    }
    return json.dumps(content, indent=1)


def loading(name: str, task: str, observes: str) -> str:
    """How to use a version of a registered model, in Markdown."""
    shown, said = '{"proprioception": ..., "part_poses": ...}', "(N, 16) and (N, 7 P) in"
    if observes != STATE:
        shown, said = '{"proprioception": ..., VIEW: ...}', "(N, 16), and images (N, h, w, 3) by names of views, in"
    return (
        f"A policy for `{task}` that MLflow loads wherever juicer is installed; nothing is unpickled.\n\n```python\n"
        f'policy = mlflow.pyfunc.load_model("models:/{name}@best")\n'
        f"# {said}, (N, T_a, 10) out\n"
        f"actions = policy.predict({shown})\n```\n"
    )


def version_tags(model: Model, history: History, checkpoint: ArtifactRef) -> dict[str, str]:
    """What tells a version of a registered model from others."""
    tags = {
        "study": model.study,
        "condition": model.condition,
        "seed": str(model.seed),
        "success_rate": f"{history.evaluation.summary['success_rate']:.4f}",
        "episodes": str(history.evaluation.summary["episodes"]),
        "artifact": str(checkpoint),
        "evaluation": str(history.evaluation.ref),
        OBSERVES: history.evaluation.observes,
    }
    return tags | ({"commit": found} if (found := commit(history.evaluation)) else {})


def story(experiment: str, run: str, history: History, finding: str, pages: str = "") -> str:
    """What stands above the facts of a model, in Markdown; links to juicer's pages if they have an address."""
    ref = history.evaluation.ref
    page = f"#/experiments/{experiment}/runs/{run}/artifacts/lineage.html"
    told = f"{history.evaluation.label} succeeded. [What it was made from]({page}); `juicer show {ref.id}`."
    told += f" [Lineage and episodes on juicer's pages]({lineage_of(str(ref), pages)})." if pages else ""
    return f"**{finding}**\n\n{told}\n" if finding else f"{told}\n"


def guide(results: Sequence[ConditionResult], comparison: str, report: str, experiment: str) -> str:
    """What stands above the runs of a study, of which one line is always seen: what came out, and what to look at."""
    rates = ", ".join(f"{row.title} {row.average:.0%}" for row in results)
    charts = [f"{runs_page('', experiment, view)[1:]}&compareRunsMode=CHART" for view in (VIEW, MODELS_VIEW)]
    return (
        f"**{rates}**; charts [by condition]({charts[0]}), [of each model]({charts[1]}). {report}\n\n{comparison}\n"
        "A run called after a condition is the average of its models, the runs below it. `success_rate` is that of the "
        "final model whatever the condition; the facts of models before it are below `round_1/`, `round_2/`. Charts by "
        "condition show averages, curves with the range over the models, and between `condition_rate_low` and "
        "`condition_rate_high` the 95 % interval over models and episodes.\n"
    )


def report_link(experiment: str, run: str) -> str:
    """Link to the report among the artifacts of a run, in Markdown."""
    return f"[The report](#/experiments/{experiment}/runs/{run}/artifacts/report/report.html) tells everything.\n"
