"""What an evaluation found, and how two of them compare."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from juicer.errors import ArtifactError, ConfigError

if TYPE_CHECKING:
    import pandas as pd

    from juicer.artifacts.ref import ArtifactRef
    from juicer.artifacts.store import ArtifactStore
    from juicer.evaluation import PairedComparison
    from juicer.shifts import Shift
    from juicer.storage.evaluations import EvaluationRow

UNKNOWN = "what it saw is not known"


@dataclass(frozen=True)
class Evaluation:
    """How a policy did.

    Attributes:
        name: Whose evaluation it is: the name of a policy's class or function, or what a stored one was
            called when it was loaded.
        task: Assembly task.
        randomness: Level of the initial states.
        max_steps: Steps after which an episode ended; the task's own limit if None.
        rows: How each episode ended, in the order of the initial states.
        anytime: Whether their number depended on what was found, so that only what holds at any time may be said of it.
        shift: In what the scenes differed from training; nothing if None.
        observes: What the policy saw, and what it was taught with beside; empty if that is not known.
    """

    name: str
    task: str
    randomness: str
    max_steps: int | None
    rows: tuple[EvaluationRow, ...]
    anytime: bool = False
    shift: Shift | None = None
    observes: str = ""

    @classmethod
    def load(cls, store: ArtifactStore, ref: ArtifactRef, name: str) -> Self:
        """A stored one, under the name by which it was asked for.

        Raises:
            ArtifactError: If it is damaged, or another version of juicer wrote it.
            ConfigError: If this version does not know its shift.
        """
        from juicer.shifts import parse_shift
        from juicer.sim.arguments import is_whole
        from juicer.storage.evaluations import read_evaluation

        rows = tuple(read_evaluation(store.open(ref)))
        manifest = store.manifest(ref)
        config = manifest.recipe.config
        if not rows or not {"task", "randomness"} <= set(config):
            raise ArtifactError(f"{ref} does not say which task was evaluated; another version of juicer wrote it")
        limit = config.get("max_steps")
        steps = int(limit) if is_whole(limit) else None
        return cls(
            name,
            str(config["task"]),
            str(config["randomness"]),
            steps,
            rows,
            anytime=config.get("anytime") is True,
            shift=parse_shift(config.get("shift")),
            observes=manifest.observes,
        )

    @property
    def successes(self) -> int:
        """Episodes in which everything was assembled."""
        return self.outcomes.get("success", 0)

    @property
    def rate(self) -> float:
        """Share of successes."""
        return self.successes / len(self.rows)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the rate: Wilson's, or one that holds at any time."""
        from juicer.evaluation import anytime_interval, wilson_interval

        return (anytime_interval if self.anytime else wilson_interval)(self.successes, len(self.rows))

    @property
    def outcomes(self) -> dict[str, int]:
        """Episodes by how they ended."""
        return dict(Counter(row.outcome.value for row in self.rows))

    @property
    def table(self) -> pd.DataFrame:
        """A row an episode, and a column for the step at which each milestone was reached."""
        from juicer.library.tables import episode_table
        from juicer.storage.evaluations import EvaluationRow

        return episode_table(self.rows, EvaluationRow).set_index("episode")

    def __str__(self) -> str:
        """The rate in a sentence, with all that belongs to it."""
        from juicer.artifacts.manifest import STATE

        low, high = self.interval
        share = f"{self.successes} of {len(self.rows)} episodes of {self.task} ({self.randomness}) succeeded"
        share += f" {self.shift.phrase}" if self.shift else ""
        seen = f", from {self.observes}" if self.observes not in ("", STATE) else ""
        return f"{share}: {self.rate:.1%} (95 % interval {low:.1%} to {high:.1%}){seen}"


def compare(first: Evaluation, second: Evaluation) -> PairedComparison:
    """Pair the episodes of two evaluations that start from the same initial state.

    Of policies that saw different things, the comparison says beside their names what each saw.

    Raises:
        ConfigError: If one is not an evaluation, if they are not of the same task, randomness, shift and length of an
            episode, or if they have no initial state in common.
    """
    from juicer.evaluation import PairedComparison, anytime_p_value, mcnemar_p_value
    from juicer.tasks.registry import get_task

    for one in (first, second):
        if not isinstance(one, Evaluation):
            raise ConfigError(f"two evaluations are compared, such as evaluate() gives, not a {type(one).__name__}")
    for what in ("task", "randomness"):
        if getattr(first, what) != getattr(second, what):
            raise ConfigError(
                f"only evaluations of one {what} can be compared, got '{getattr(first, what)}' and "
                f"'{getattr(second, what)}'"
            )
    if first.shift != second.shift:
        raise ConfigError("only evaluations under one and the same shift can be compared, and these are not")
    limits = {one.max_steps or get_task(one.task).max_steps for one in (first, second)}
    if len(limits) > 1:
        raise ConfigError(f"evaluations with max_steps of {min(limits)} and {max(limits)} cannot be compared")
    succeeded = [{row.seed: row.outcome == "success" for row in one.rows} for one in (first, second)]
    pairs = [(succeeded[0][seed], succeeded[1][seed]) for seed in succeeded[0] if seed in succeeded[1]]
    if not pairs:
        raise ConfigError(f"'{first.name}' and '{second.name}' were evaluated on different initial states")
    first_only, second_only = pairs.count((True, False)), pairs.count((False, True))
    anytime = first.anytime or second.anytime
    p_value = (anytime_p_value if anytime else mcnemar_p_value)(first_only, second_only)
    are_alike = first.observes == second.observes
    names = [each.name if are_alike else f"{each.name} ({each.observes or UNKNOWN})" for each in (first, second)]
    return PairedComparison(names[0], names[1], first_only, second_only, len(pairs), p_value, anytime)
