"""Conditions of a study, as data: which parts of the method each uses. Those of the paper come along (Table VI)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from flows.shipped import CONFIGS
from juicer.config import StrictConfig, read_mapping
from juicer.errors import did_you_mean
from juicer.reporting.setting import Setting
from juicer.text import printable

MOST_ROUNDS = 100
MOST_DEFINITIONS = 100
OF_THE_RUN = (
    "base",
    "flow",
    "name",
    "task",
    "tasks",
    "mix",
    "condition",
    "conditions",
    "seed",
    "seeds",
    "curves",
    "analysed_seed",
    "left_out",
    "shifted",
    "evaluate.stop",
)
"""Keys that no condition changes for itself."""
WORDS = frozenset({"title", "setting"})
"""Keys of a condition that people read, and no result depends on."""


@cache
def defaults() -> Mapping[str, Mapping[str, Any]]:
    """The policies and conditions that come with juicer, by name, as a configuration would write them."""
    return read_mapping(CONFIGS / "defaults" / "conditions.yaml")


def of_one_task() -> dict[str, Any]:
    """The conditions that come with juicer and need one task only, by name."""
    return {name: own for name, own in defaults()["conditions"].items() if "joint_policy" not in own}


@cache
def shipped(name: str) -> Condition | None:
    """The condition of that name as it comes with juicer, or None."""
    own = defaults()["conditions"].get(name)
    return None if own is None else Condition(**own)


def _made_of(pattern: str, sentence: str) -> AfterValidator:
    def check(text: str) -> str:
        if not re.fullmatch(pattern, text):
            raise ValueError(sentence)
        return text

    return AfterValidator(check)


Name = Annotated[
    str,
    Field(max_length=40),
    _made_of(r"[A-Za-z][A-Za-z0-9_-]*", "a name must be letters, digits, '_' and '-', a letter first"),
]
"""What a configuration calls a policy or a condition."""
Title = Annotated[
    str,
    Field(max_length=60),
    _made_of(r"[\w .,:;+/()=%-]+", "must be letters, digits, spaces and . , : ; + / ( ) = % _ -"),
]
"""What people read instead."""


class Condition(StrictConfig):
    """What a condition is made of. Its name stands in no recipe: two that say the same share every artifact."""

    title: Title = Field(description="what people read; the name if left out")
    policy: Name = Field(default="diffusion", description="which of the policies it trains")
    joint_policy: Name | None = Field(
        default=None,
        description="which of the policies one model for all tasks is, trained on the data of them all; "
        "without, every task has models of its own",
    )
    augment: bool = Field(default=False, description="whether corrective episodes are added")
    collect: bool = Field(default=False, description="whether it retrains on its own successes")
    correct: bool = Field(
        default=False, description="whether an operator also finishes some of the rollouts that failed (DAgger)"
    )
    rounds: int | None = Field(
        default=None, gt=0, le=MOST_ROUNDS, description="how often it does; as the top level says if left out"
    )
    retraining_steps: int | None = Field(
        default=None,
        gt=0,
        le=10**9,
        description="steps in which a retraining goes on from the model before; it starts from nothing if left out",
    )
    state_noise: bool = Field(default=False, description="whether observed states are perturbed in training")
    replay: bool = Field(default=False, description="whether it plays demonstrations instead of learning from them")
    changes: dict[Annotated[str, Field(max_length=100)], Any] = Field(
        default={},
        max_length=MOST_DEFINITIONS,
        description="what differs for this condition, under the keys of a configuration's top level",
    )
    setting: Title | None = Field(
        default=None, description="what people read for its changes; the changes themselves if left out"
    )

    @property
    def setting_in_words(self) -> Setting:
        """What it changes, in words."""
        return Setting(changes=", ".join(_in_words(self.changes)), name=self.setting or "")

    @property
    def method(self) -> str:
        """Name of the condition that comes with juicer and has the same parts, however often; empty if none has."""
        parts = Condition.model_fields.keys() - WORDS - {"rounds", "changes"}
        return next(
            (
                name
                for name in defaults()["conditions"]
                if (own := shipped(name)) and all(getattr(own, part) == getattr(self, part) for part in parts)
            ),
            "",
        )

    @field_validator("changes")
    @classmethod
    def _are_of_a_condition(cls, changes: dict[str, Any]) -> dict[str, Any]:
        if said := next((key for key in OF_THE_RUN if _says(changes, key)), None):
            raise ValueError(f"'{said}' is said once for the whole run; leave it out of a condition's changes")
        return changes

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if self.replay and (self.augment or self.collect or self.state_noise or self.joint_policy):
            raise ValueError("what replays trains nothing: leave out augment, collect, state_noise and joint_policy")
        if self.correct and not self.collect:
            raise ValueError("what is corrected are rollouts: add collect: true, or leave out correct")
        if self.retraining_steps and (self.joint_policy or not self.collect):
            raise ValueError(
                "retraining_steps are those of a condition that collects, with models of its own for every task: add "
                "collect: true and leave out joint_policy, or leave them out"
            )
        if self.setting and not self.changes:
            raise ValueError("a setting is the name of what a condition changes: add changes, or leave it out")
        if self.rounds and not self.collect:
            raise ValueError("rounds are those of a condition that collects: add collect: true, or leave them out")
        return self


def _says(changes: Any, key: str) -> bool:
    first, _, rest = key.partition(".")
    return isinstance(changes, Mapping) and first in changes and (not rest or _says(changes[first], rest))


def _in_words(changes: Mapping[str, Any], outer: str = "") -> Iterator[str]:
    for key, value in changes.items():
        if isinstance(value, Mapping) and value:
            yield from _in_words(value, f"{outer}{key}.")
        else:
            yield f"{outer}{key} {printable(value)}"


def defined(given: Any) -> Any:
    """Whole definitions of conditions, by name.

    Args:
        given: A list of names that come with juicer; or, by name, what differs from the one that comes along, or what a
            condition of one's own is.

    Raises:
        ValueError: If nothing is known of a name, or it is there twice.
    """
    if isinstance(given, list | tuple) and all(isinstance(name, str) for name in given):
        if len(set(given)) < len(given):
            raise ValueError("each may be named only once")
        given = dict.fromkeys(given, None)
    if not isinstance(given, Mapping):
        raise ValueError("must be a list of conditions, or map their names to what they are")
    return {name: _definition(name, own) for name, own in given.items()}


def _definition(name: str, own: Any) -> Any:
    known = defaults()["conditions"]
    if own in (None, {}):
        # Else a slip of the keyboard would be a condition of its own.
        check_known(name, known)
        return known[name]
    return {**known.get(name, {"title": name}), **own} if isinstance(own, Mapping) else own


def check_known(name: str, known: Mapping[str, Any]) -> None:
    """Refuse a condition that nobody defined.

    Raises:
        ValueError: If it is none of ``known``.
    """
    if name not in known:
        raise ValueError(f"unknown condition '{printable(name)}'{did_you_mean(name, known)}")
