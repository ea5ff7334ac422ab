"""What can be told to be wrong with a task that somebody else wrote, before physics is built of it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache

import numpy as np
from pydantic import TypeAdapter, ValidationError

from juicer.config import canonical_json
from juicer.tasks import handling, specification
from juicer.tasks.specification import AssemblyPair, AssemblyTask, Grasp, PartSpec

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def check_task(task: object, name: str) -> str:
    """What is wrong with a task that is announced under a name, as a clause; empty if nothing is.

    Types, finite numbers, names, and that every index and layout points at a part or pair that is there.
    """
    if not isinstance(task, AssemblyTask):
        return f"it is not an AssemblyTask but of type {type(task).__name__}"
    try:
        canonical_json(asdict(task))
        if _schema().validate_python(asdict(task)) != task:
            return "it holds a text in the place of a number, or the like"
    except ValidationError as error:
        first = error.errors()[0]
        return f"its {'.'.join(map(str, first['loc']))}: {first['msg']}"
    except (TypeError, ValueError) as error:
        return f"it may hold finite numbers, texts and tuples only: {error}"
    return next(_contradictions(task, name), "")


def _contradictions(task: AssemblyTask, name: str) -> Iterator[str]:
    if task.name != name or not _NAME.fullmatch(name):
        yield f"it calls itself '{task.name}'; both names must be the same lower-case words, joined by underscores"
    yield from _naming_contradictions(task)
    for place, pair in enumerate(task.pairs):
        yield from _pair_contradictions(pair, place, range(len(task.parts)))
    if {len(layout) for layout in task.high_layouts} - {len(task.parts)}:
        yield "each of its layouts must hold a pose a part"
    for state in task.critical_states:
        known, index = (task.parts, state.part) if isinstance(state, Grasp) else (task.pairs, state.pair)
        if index not in range(len(known)):
            yield f"its critical state {state} is of nothing that is there"
    if min(task.max_steps, task.gripper_width_m, *(part.mass for part in task.parts)) <= 0:
        yield "step limit, gripper width and masses must be positive"
    for part in task.parts:
        yield from _handling_contradictions(part)


def _naming_contradictions(task: AssemblyTask) -> Iterator[str]:
    if not task.parts or not task.pairs:
        yield "it has no parts or no pairs"
    if len({part.name for part in task.parts}) < len(task.parts):
        yield "two of its parts have one name"
    if len({pair.label for pair in task.pairs}) < len(task.pairs):
        yield "two of its pairs have one label"


def _pair_contradictions(pair: AssemblyPair, place: int, parts: range) -> Iterator[str]:
    if pair.first not in parts or pair.second not in parts or pair.first == pair.second:
        yield f"pair '{pair.label}' joins parts {pair.first} and {pair.second} of {len(parts)}"
    if pair.operator_target not in range(len(pair.targets)):
        yield f"pair '{pair.label}' has no target {pair.operator_target}"
    if not set(pair.after) <= set(range(place)):
        yield f"pair '{pair.label}' waits for a pair that does not come before it"


def _handling_contradictions(part: PartSpec) -> Iterator[str]:
    how, every_rad = part.handling, 2 * math.pi
    if isinstance(how, handling.Handling):
        every_rad = how.flat_every_rad
    elif isinstance(how, handling.BaseHandling):
        every_rad, straight = how.symmetry_rad, np.array(how.straight)
        if not (np.allclose(straight @ straight.T, np.eye(3), atol=1e-6) and np.linalg.det(straight) > 0):
            yield f"the handling of part '{part.name}' has a 'straight' that is not a rotation: it mirrors or distorts"
    if not 0 < every_rad <= 2 * math.pi:
        yield (
            f"the handling of part '{part.name}' must have a symmetry_rad or flat_every_rad above 0 and of a full turn "
            "at most"
        )


@cache
def _schema() -> TypeAdapter[AssemblyTask]:
    schema = TypeAdapter(AssemblyTask)
    # The specification names the operator's types for type checkers only.
    schema.rebuild(force=True, _types_namespace={**vars(specification), **vars(handling)})
    return schema
