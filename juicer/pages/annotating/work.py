"""What is to be judged: demonstrations and their critical states, in the form that the page gets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from juicer.annotation.measures import Measures


@dataclass(frozen=True)
class Proposed:
    """Where a critical state is proposed.

    Attributes:
        step: Step of the episode.
        confidence: How sure that is, from 0 to 1.
    """

    step: int
    confidence: float


@dataclass(frozen=True)
class Opinion:
    """What an annotator said last.

    Attributes:
        author: Name of the annotator.
        step: Step of the episode; None if that ends before it.
        version: Number of the version that says so.
    """

    author: str
    step: int | None
    version: int


@dataclass(frozen=True)
class Judgement:
    """What is proposed and said of one critical state of a demonstration.

    Attributes:
        episode: Id of the demonstration.
        critical_state: Index of the critical state.
        expected: Whether the demonstration should have it: of a correction, if it lies ahead or was found.
        proposal: Where it is proposed; None if nothing was found.
        newest: Number of the newest version about it, 0 if there is none.
        opinions: What stands of all that was said, the newest last.
        agreed: Step of the episode on which all agree; None if they do not, or nothing was said.
        disputed: Whether annotators disagree.
    """

    episode: str
    critical_state: int
    expected: bool
    proposal: Proposed | None
    newest: int
    opinions: Sequence[Opinion]
    agreed: int | None
    disputed: bool


@dataclass(frozen=True)
class Demonstration:
    """A demonstration.

    Attributes:
        id: Id of the episode.
        log: Name of its recording, or if it has none, its id.
        steps: How many it has.
        marks: Its critical states, in order.
    """

    id: str
    log: str
    steps: int
    marks: Sequence[Judgement]

    @property
    def confidence(self) -> float:
        """The lowest of its critical states that are expected; of one that was not found, none."""
        expected = [mark.proposal for mark in self.marks if mark.expected]
        return min((proposal.confidence if proposal else 0.0 for proposal in expected), default=1.0)


@dataclass(frozen=True)
class Work:
    """All that is to be judged of an artifact.

    Attributes:
        ready: Whether all were searched for critical states.
        proposed: How many were.
        of: How many there are.
        episodes: The demonstrations, those first that are most in doubt; none before all were searched.
        measures: What judging took so far.
    """

    ready: bool
    proposed: int
    of: int
    episodes: Sequence[Demonstration]
    measures: Measures
