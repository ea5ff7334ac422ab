"""Tasks that a configuration names, wherever in it."""

from __future__ import annotations

import pytest
from pydantic import Field, ValidationError

from juicer.config import StrictConfig
from juicer.tasks.task_name import TaskName, tasks_in


class Inner(StrictConfig):
    task: TaskName
    note: str = "lamp"


class Outer(StrictConfig):
    inner: tuple[Inner, ...] = ()
    several: tuple[TaskName, ...] = ()
    weights: dict[TaskName, float] = Field(default={})
    maybe: TaskName | None = None


def test_tasks_are_found_in_nested_configurations_lists_and_keys() -> None:
    outer = Outer(inner=(Inner(task="one_leg"),), several=("round_table",), weights={"square_table": 0.5})
    assert tasks_in(outer) == {"one_leg", "round_table", "square_table"}


def test_a_text_that_only_looks_like_a_task_is_none() -> None:
    assert tasks_in(Outer(inner=(Inner(task="one_leg", note="lamp"),))) == {"one_leg"}
    assert tasks_in(Outer()) == set()


def test_an_unknown_task_is_refused() -> None:
    with pytest.raises(ValidationError, match="unknown task 'lam'; did you mean 'lamp'"):
        Outer(maybe="lam")
