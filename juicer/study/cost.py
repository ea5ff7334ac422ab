"""Section on the computing time behind every number, and behind every stage."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from juicer.artifacts.manifest import Manifest
from juicer.reporting.lineage import cpu_seconds_of
from juicer.reporting.section import Section, Table
from juicer.study.material import TaskStudy

_COST = ("CPU-hours", "hours, one after another", "MB")


def cost_section(studies: Sequence[TaskStudy]) -> Section | None:
    """CPU time and wall time by condition and by stage."""
    of_conditions = tuple(row for study in studies for row in _by_condition(study))
    if not of_conditions:
        return None
    everything = list({manifest.ref: manifest for study in studies for manifest in study.behind}.values())
    together = ("together", str(len(everything)), *_cost(everything))
    return Section(
        "cost",
        "Cost",
        "What it cost to compute",
        "CPU time and wall time of everything that a number was made from, in this run or in an earlier one. An "
        "artifact whose CPU time was not measured counts with its wall time.",
        (
            Table(
                ("condition", "models", *_COST),
                of_conditions,
                "By condition",
                "What several conditions have in common counts for each of them, evaluations under shifts do not.",
            ),
            Table(("stage", "artifacts", *_COST), (*_by_stage(everything), together), "By stage, each artifact once"),
        ),
    )


def _by_condition(study: TaskStudy) -> Iterator[tuple[str, ...]]:
    for each in study.measured.values():
        usual = [manifest.ref for manifest in each.evaluations if not manifest.recipe.config.get("shift")]
        behind = study.sources.behind(usual)
        yield f"{study.task}: {each.result.title}", str(each.result.num_models), *_cost(behind)


def _by_stage(manifests: Sequence[Manifest]) -> Iterator[tuple[str, ...]]:
    for stage in dict.fromkeys(each.recipe.stage for each in manifests):
        own = [each for each in manifests if each.recipe.stage == stage]
        yield stage, str(len(own)), *_cost(own)


def _cost(manifests: Iterable[Manifest]) -> tuple[str, str, str]:
    cpu = wall = size = 0.0
    for each in manifests:
        cpu += cpu_seconds_of(each)
        wall += each.seconds
        size += sum(entry.bytes for entry in each.files)
    return _hours(cpu), _hours(wall), f"{size / 1e6:.1f}"


def _hours(seconds: float) -> str:
    hours = seconds / 3600
    return "< 0.001" if 0 < hours < 0.001 else f"{hours:.0f}" if hours >= 10 else f"{hours:.3g}"
