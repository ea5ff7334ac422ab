"""Strict configurations: no conversions, nothing unbounded, and a plain sentence for every mistake."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from flows.config import CollectInferConfig, StudyConfig
from juicer.config import StrictConfig, parse_config
from juicer.errors import ConfigError
from juicer.policy.checkpoint import CheckpointMetadata
from juicer.tasks.registry import TASK_NAMES
from stages.collect import CollectConfig
from stages.evaluate import EvaluateConfig
from stages.ingest import IngestionConfig
from stages.record import RecordConfig


class Inner(StrictConfig):
    kind: Literal["inner"] = "inner"
    ratio: float = Field(default=0.5, ge=0, lt=1)


class Other(StrictConfig):
    kind: Literal["other"] = "other"


class Sample(StrictConfig):
    count: int = Field(default=1, gt=0, le=10)
    even: int = Field(default=2, multiple_of=2)
    yes: bool = False
    word: str = Field(default="a", max_length=5)
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = Field(default=(0,), min_length=1, max_length=3)
    pairs: tuple[tuple[float, ...], ...] = ()
    by_name: Mapping[str, Inner] = Field(default_factory=dict)
    choice: Literal["left", "right"] = "left"
    inner: Annotated[Inner | Other, Field(discriminator="kind")] = Inner()
    maybe: int | None = None


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"count": True}, "count: must be a whole number, got True"),
        ({"count": "3"}, "count: must be a whole number, got '3'"),
        ({"count": 3.0}, "count: must be a whole number, got 3.0"),
        ({"count": 0}, "count: must be greater than 0, got 0"),
        ({"count": 11}, "count: must be at most 10, got 11"),
        ({"even": 3}, "even: must be a multiple of 2, got 3"),
        ({"yes": 1}, "yes: must be true or false, got 1"),
        ({"yes": "yes"}, "yes: must be true or false, got 'yes'"),
        ({"word": 5}, "word: must be text, got 5"),
        ({"word": "abcdefg"}, "word: must be at most 5 letters long, got 'abcdefg'"),
        ({"seeds": 1}, "seeds: must be a list, e.g. [1], got 1"),
        ({"seeds": [True]}, "seeds.0: must be a whole number, got True"),
        ({"seeds": [-1]}, "seeds.0: must be at least 0, got -1"),
        ({"seeds": []}, "seeds: must have at least 1 of them, got []"),
        ({"seeds": [1, 2, 3, 4]}, "seeds: must have at most 3 of them, got [1, 2, 3, 4]"),
        ({"pairs": [[1.0, True]]}, "pairs.0.1: must be a number, got True"),
        ({"pairs": [[float("inf")]]}, "pairs.0.0: must be a finite number, got inf"),
        ({"by_name": {"a": {"ratio": float("nan")}}}, "by_name.a.ratio: must be a finite number, got nan"),
        ({"by_name": 3}, "by_name: must hold keys and values, got 3"),
        ({"inner": {"kind": "inner", "ratio": 1}}, "inner.ratio: must be less than 1, got 1"),
        ({"inner": {"kind": "iner"}}, "inner: kind must be one of inner, other, got {'kind': 'iner'}; did you mean"),
        ({"inner": {"ratio": 0.1}}, "inner: must say its 'kind', got {'ratio': 0.1}"),
        ({"inner": {"kind": "inner", "ratoi": 0.1}}, "unknown key 'inner.ratoi'; did you mean 'ratio'?"),
        ({"choice": "rigt"}, "choice: must be one of left, right, got 'rigt'; did you mean 'right'?"),
        ({"maybe": False}, "maybe: must be a whole number, got False"),
        ({"cuont": 1}, "unknown key 'cuont'; did you mean 'count'?"),
        ({"count": "\x1b[2J" * 10_000}, r"count: must be a whole number, got '\x1b[2J"),
        ({"count": {"a": [[[[1] * 9] * 9] * 9]}}, "count: must be a whole number, got {'a': [[...]]}"),
    ],
)
def test_mistake_is_told_in_plain_words(content, sentence):
    with pytest.raises(ConfigError) as caught:
        parse_config(content, Sample, origin="it")
    assert str(caught.value).startswith(f"it: {sentence}")
    assert len(str(caught.value)) < 300


def test_whole_numbers_will_do_for_numbers():
    assert parse_config({"inner": {"kind": "inner", "ratio": 0}}, Sample, origin="it").inner == Inner(ratio=0.0)


def described(schema: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every part of a core schema that describes a value, with its place."""
    if isinstance(schema, dict):
        if isinstance(schema.get("type"), str):
            yield path, schema
        for key, value in schema.items():
            if key not in ("default", "metadata", "serialization", "json_schema"):
                yield from described(value, f"{path}.{key}")
    elif isinstance(schema, list):
        for index, each in enumerate(schema):
            yield from described(each, f"{path}.{index}")


@pytest.mark.parametrize(
    "model", [CollectInferConfig, StudyConfig, CheckpointMetadata], ids=lambda model: model.__name__
)
def test_every_number_list_and_text_has_bounds_and_converts_nothing(model):
    seen = 0
    for path, schema in described(model.__pydantic_core_schema__):
        kind, where = schema["type"], f"{path}: {schema}"
        if kind in ("int", "float", "bool"):
            seen += 1
            assert schema["strict"], where
        if kind in ("int", "float"):
            assert {"le", "lt"} & schema.keys(), where
            assert {"ge", "gt"} & schema.keys(), where
        if kind == "dict" or (kind == "tuple" and "variadic_item_index" in schema):
            assert "max_length" in schema, where
        if kind == "str" and not {"logs", "labels"} & set(path.split(".")):  # paths have a check of their own
            assert "max_length" in schema, where
    assert seen > 30


@pytest.mark.parametrize("model", [RecordConfig, IngestionConfig, CollectConfig, EvaluateConfig])
def test_a_stage_is_told_its_task_and_has_none_of_its_own(model):
    assert model.model_fields["task"].is_required()
    assert model.model_json_schema()["properties"]["task"]["enum"] == list(TASK_NAMES)
    if "randomness" in model.model_fields:
        assert model.model_fields["randomness"].is_required()


def test_in_a_form_the_task_is_a_choice_and_stands_at_the_top_only():
    schema = CollectInferConfig.model_json_schema()
    assert schema["properties"]["task"]["enum"] == list(TASK_NAMES)
    for name in ("RecordSection", "IngestionSection", "CollectSection", "StoppableSection"):
        assert "task" not in schema["$defs"][name]["properties"]
