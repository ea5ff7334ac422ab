"""What annotating cost, and how far it can be trusted, measured in what people did."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import fmean, median

from juicer.annotation.standing import SAME_STEPS, standing
from juicer.annotation.versions import Key, Version

PEOPLE = "people"
"""Fact of an annotation's summary that holds its measures."""


@dataclass(frozen=True)
class Measures:
    """Measures of versions; a mean or share of nothing is None.

    What annotating took is known of the page alone. Two people who judge the same demonstration there have judged two.

    Attributes:
        demonstrations: Of how many something stands.
        marks: Critical states about which something stands.
        disputed: Of these, those on which annotators disagree.
        elsewhere: Of these, those of which nothing that stands was said on the page.
        annotators: How many people said something.
        judged: Demonstrations judged on the page, counted for each annotator.
        keys: Keys and clicks for a demonstration judged on the page.
        seconds: Seconds for the same.
        minutes: Minutes in total on the page.
        undone: Marks that were taken back.
        agreement: Share of marks that had a proposal and say the same as it does, see :data:`SAME_STEPS`.
        steps_from_proposal: Mean distance of marks from their proposals.
        steps_between_annotators: Median distance of what two people said about the same critical state before it was
            settled.
        compared: Number of these distances.
    """

    demonstrations: int
    marks: int
    disputed: int
    elsewhere: int
    annotators: int
    judged: int
    keys: float | None
    seconds: float | None
    minutes: float
    undone: int
    agreement: float | None
    steps_from_proposal: float | None
    steps_between_annotators: float | None
    compared: int


def measure(versions: Sequence[Version]) -> Measures:
    """Measure versions, e.g. those about the episodes of one artifact."""
    stands = {key: each for key, each in standing(versions).items() if each.opinions}
    on_page = [version for version in versions if version.is_from_page]
    undone = {version.undoes for version in versions}
    judged = {
        (version.author, version.episode)
        for version in on_page
        if version.undoes is None and version.version not in undone
    }
    seconds = sum(version.seconds for version in on_page)
    off = [
        abs(version.step - version.proposal)
        for each in stands.values()
        for version in each.opinions
        if version.step is not None and version.proposal is not None
    ]
    apart = list(_distances(versions))
    return Measures(
        demonstrations=len({episode for episode, _ in stands}),
        marks=len(stands),
        disputed=sum(each.is_disputed for each in stands.values()),
        elsewhere=sum(not any(version.is_from_page for version in each.opinions) for each in stands.values()),
        annotators=len({version.author for version in versions}),
        judged=len(judged),
        keys=sum(version.keys for version in on_page) / len(judged) if judged else None,
        seconds=seconds / len(judged) if judged else None,
        minutes=seconds / 60,
        undone=sum(version.undoes is not None for version in versions),
        agreement=fmean(steps <= SAME_STEPS for steps in off) if off else None,
        steps_from_proposal=fmean(off) if off else None,
        steps_between_annotators=median(apart) if apart else None,
        compared=len(apart),
    )


def _distances(versions: Iterable[Version]) -> Iterable[int]:
    """Steps between what each two people said last by themselves: what settles a dispute is one of both."""
    undone = {version.undoes for version in versions}
    said: dict[Key, dict[str, int]] = {}
    for version in versions:
        if version.step is not None and not version.settles and version.version not in undone:
            said.setdefault(version.key, {})[version.author] = version.step
    for steps in said.values():
        for one, other in combinations(steps.values(), 2):
            yield abs(one - other)
