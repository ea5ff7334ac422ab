"""The paper's statements, as data, and the section that judges them one by one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from juicer.reporting.section import Section, Table
from juicer.reporting.setting import Setting
from juicer.study.material import TaskStudy, by_setting
from juicer.study.rules import (
    NEGLIGIBLE,
    AtMost,
    Best,
    BestWithin,
    Better,
    ModelsDiffer,
    Rule,
    Ruling,
    SampledAlike,
    Saturates,
    Untested,
    Verdict,
)
from juicer.tasks.registry import TASK_NAMES


@dataclass(frozen=True)
class Claim:
    """A statement of the paper.

    Attributes:
        sentence: What it says.
        source: Where.
        rule: How results judge it.
        tasks: Tasks that it is about.
    """

    sentence: str
    source: str
    rule: Rule
    tasks: tuple[str, ...] = TASK_NAMES


_ONE_LEG = ("one_leg",)
# Statements are of those tasks whose averages in the paper's own tables agree with them.
_ALL_BUT_ONE_LEG = ("round_table", "lamp", "square_table")
_OTHERS = ("bc", "state_noise", "ta", "ci", "mlp_chunked", "mlp_unchunked")

CLAIMS = (
    Claim("Corrective snippets help: TA beats BC.", "Table VI", Better("ta", "bc")),
    Claim("A policy's own successes help: CI beats BC.", "Table VI", Better("ci", "bc")),
    Claim("Both together help: TA+CI beats BC.", "Table VI", Better("ta_ci", "bc")),
    Claim("Each adds to the other: TA+CI beats TA.", "Table VI", Better("ta_ci", "ta")),
    Claim("Each adds to the other: TA+CI beats CI.", "Table VI", Better("ta_ci", "ci"), _ALL_BUT_ONE_LEG),
    Claim("TA+CI is the best of the conditions.", "Table VI", Best("ta_ci", _OTHERS), _ALL_BUT_ONE_LEG),
    Claim(
        "Snippets help more than noise on observed states does.",
        "Table VI",
        Better("ta", "state_noise"),
        ("round_table", "lamp"),
    ),
    Claim("Noise on observed states helps.", "Table VI", Better("state_noise", "bc"), ("one_leg", "square_table")),
    Claim("Without action chunks nothing is assembled.", "Table VI", AtMost("mlp_unchunked", 0.05)),
    Claim("Predicting chunks of actions helps.", "Table VI", Better("mlp_chunked", "mlp_unchunked")),
    Claim("Diffusion beats regression of the same chunks.", "Table VI", Better("bc", "mlp_chunked")),
    Claim("One policy for all tasks does worse than one for each.", "Table VI", Better("ta_ci", "multitask")),
    Claim("Models trained alike differ.", "Table VI", ModelsDiffer("bc")),
    Claim("More demonstrations help: 50 beat 10.", "Fig. 3", Better("bc", "bc_10", settings=True), _ONE_LEG),
    Claim("Success saturates by 500 demonstrations.", "Fig. 3", Saturates("demonstrations", 500), _ONE_LEG),
    Claim(
        "Success saturates by 500 demonstrations and own rollouts, as measured there.",
        "Fig. 3",
        Saturates("own_rollouts", 500),
        _ONE_LEG,
    ),
    Claim(
        "Snippets are best as 8 to 20 % of what is learned from.",
        "appendix on data",
        BestWithin("synthetic_share", 0.08, 0.2),
        _ONE_LEG,
    ),
    Claim(
        "From 10 demonstrations, snippets and own successes reach more than 50 demonstrations alone.",
        "bootstrapping",
        Better("ten_ta_ci_4", "med_bc", settings=True),
        _ONE_LEG,
    ),
    Claim(
        "Eight steps of the sampler do as well as a hundred.",
        "Fig. 4",
        SampledAlike(8, within=0.1),
        _ONE_LEG,
    ),
    Claim(
        "R3M's weights with plain BC beat the whole method with ImageNet's.",
        "Table VII",
        Untested("these weights are not at hand; table_vii compares the encoders that are"),
        _ONE_LEG,
    ),
    Claim(
        "Annotating takes a small part of the time of recording.",
        "Table IV",
        Untested("the operator is scripted and critical states are proposed: no person's time is measured"),
        _ONE_LEG,
    ),
)


def _beyond(sentence: str, better: str, than: str) -> Claim:
    """A statement that the paper does not make, of one condition of the study against another."""
    return Claim(sentence, "beyond the paper", Better(better, than, settings=True), _ONE_LEG)


OWN_CLAIMS = (
    *(
        _beyond(
            f"{number} snippets placed by coverage help more than {number} drawn uniformly.",
            f"ten_coverage_{number}",
            uniform,
        )
        for number, uniform in ((96, "ten_ta_96"), (192, "ten_ta_192"), (384, "ten_ta_384"), (768, "ten_ta"))
    ),
    _beyond("Snippets help more if some of them hold the part elsewhere.", "ten_ta", "ten_own_grasps"),
    _beyond("Four rounds of own successes help more than one.", "ten_ta_ci_4", "ten_ta_ci_1"),
    _beyond("Leaving out successes that took long helps.", "ten_ta_ci_4", "ten_ta_ci_all_4"),
    _beyond("Training anew in every round is better than training on.", "ten_ta_ci_4", "ten_ta_ci_on_4"),
    _beyond("The operator's corrections of failed rollouts add to own successes.", "ten_dagger_4", "ten_ta_ci_4"),
    _beyond("Diffusion beats flow matching.", "med_bc", "med_flow"),
)
"""Statements that the paper does not make."""


_Judged = Sequence[tuple[Claim, TaskStudy, Verdict]]


def _judged(claims: Sequence[Claim], studies: Sequence[TaskStudy]) -> _Judged:
    concerned = ((claim, study) for claim in claims for study in studies if study.task in claim.tasks)
    return [(claim, study, claim.rule.judge(study)) for claim, study in concerned]


def _rows(judged: _Judged) -> tuple[tuple[str, ...], ...]:
    """Those that were tested."""
    return tuple(
        (claim.sentence, claim.source, study.task, verdict.ruling.value, verdict.reason)
        for claim, study, verdict in judged
        if verdict.ruling is not Ruling.UNTESTED
    )


def _elsewhere(setting: Setting, study: TaskStudy) -> Iterator[tuple[str, ...]]:
    """Statements about methods, judged by conditions that change something else as well, all of them the same."""
    for claim in CLAIMS:
        verdict = claim.rule.judge(study) if study.task in claim.tasks else None
        if verdict and verdict.ruling is not Ruling.UNTESTED:
            yield claim.sentence, study.task, str(setting), verdict.ruling.value, verdict.reason


def claims_section(studies: Sequence[TaskStudy]) -> Section | None:
    """What results say of each statement, task by task; those that they say nothing of apart."""
    verdicts, own = (_judged(claims, studies) for claims in (CLAIMS, OWN_CLAIMS))
    elsewhere = [row for study in studies for setting, other in by_setting(study) for row in _elsewhere(setting, other)]
    counts = Counter(verdict.ruling for _, _, verdict in verdicts)
    judged = {"": _rows(verdicts), "Statements that the paper does not make": _rows(own)}
    if not any(judged.values()) and not elsewhere:
        return None
    columns = ("statement", "where", "task", "verdict", "by what")
    tables = [Table(columns, rows, title, words=5) for title, rows in judged.items() if rows]
    if elsewhere:
        columns = ("statement", "task", "where it was tested as well", "verdict", "by what")
        tables.append(Table(columns, tuple(elsewhere), "The same statements, where more is changed", words=5))
    untested = [
        (claim.sentence, claim.source, study.task, verdict.reason)
        for claim, study, verdict in verdicts
        if verdict.ruling is Ruling.UNTESTED
    ]
    if untested:
        tables.append(
            Table(
                ("statement", "where", "task", "why"),
                tuple(untested),
                f"{len(untested)} not tested",
                words=4,
                folded=True,
            )
        )
    tasks_of: dict[str, list[str]] = {}
    for study in studies:
        if base := study.base:
            tasks_of.setdefault(base, []).append(study.task)
    bases = "; ".join(f"{base} ({', '.join(tasks)})" for base, tasks in tasks_of.items())
    told = ", ".join(f"{ruling.value}: {counts[ruling]}" for ruling in Ruling if counts[ruling]).capitalize()
    return Section(
        "claims",
        "Claims",
        "The paper's statements, one by one",
        f"{told}. A statement about two conditions holds, or does not, if the paired test and the interval of the "
        "difference over models and initial states both say so, of two models of each at least (each statement tested "
        "by itself, at 5 %). It does not hold either if the interval leaves room for an advantage of "
        f"{100 * NEGLIGIBLE:.0f} points at most. Else it cannot be told. Models of a condition learned from the same "
        "demonstrations and snippets: verdicts say nothing of others. Statements are of the tasks on which "
        "the paper's averages agree with them. Intervals are 95 %. The paper's Table VI is of 50 "
        "demonstrations at low randomness" + (f"; what changes nothing here is of {bases}." if bases else "."),
        tuple(tables),
    )
