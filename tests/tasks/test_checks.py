"""What is wrong with a task from outside is said before physics is built of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from juicer.tasks.checks import check_task
from juicer.tasks.handling import Y_DOWN
from juicer.tasks.registry import TASK_NAMES, get_task
from juicer.tasks.specification import Grasp, Insertion, PartSpec

LAMP = get_task("lamp")
BASE, BULB, HOOD = LAMP.parts


def handled(**changes: object) -> PartSpec:
    """The base, handled in another way."""
    return replace(BASE, handling=replace(BASE.handling, **changes))


@pytest.mark.parametrize("name", TASK_NAMES)
def test_nothing_is_wrong_with_ours(name: str) -> None:
    assert check_task(get_task(name), name) == ""


@pytest.mark.parametrize(
    ("changes", "clause"),
    [
        ({"name": "Lamp"}, "it calls itself 'Lamp'"),
        ({"parts": ()}, "it has no parts or no pairs"),
        ({"parts": (BASE, BASE, HOOD)}, "two of its parts have one name"),
        ({"pairs": (LAMP.pairs[0], LAMP.pairs[0])}, "two of its pairs have one label"),
        ({"pairs": (replace(LAMP.pairs[0], first=1),)}, "pair 'bulb' joins parts 1 and 1 of 3"),
        ({"pairs": (replace(LAMP.pairs[0], operator_target=4),)}, "pair 'bulb' has no target 4"),
        ({"pairs": (replace(LAMP.pairs[0], after=(0,)),)}, "pair 'bulb' waits for a pair that does not come before it"),
        ({"high_layouts": (LAMP.high_layouts[0][:2],)}, "each of its layouts must hold a pose a part"),
        ({"critical_states": (Grasp(3),)}, "its critical state Grasp(part=3) is of nothing that is there"),
        ({"critical_states": (Insertion(2),)}, "its critical state Insertion(pair=2) is of nothing that is there"),
        ({"max_steps": 0}, "step limit, gripper width and masses must be positive"),
        ({"max_steps": "5"}, "it holds a text in the place of a number"),
        ({"max_steps": "many"}, "its max_steps: Input should be a valid integer"),
        ({"parts": (replace(BASE, mass=math.nan), BULB, HOOD)}, "it may hold finite numbers"),
        (
            {"parts": (replace(BASE, start=np.zeros(7)), BULB, HOOD)},
            "it may hold finite numbers",
        ),
        ({"parts": (replace(BASE, handling="firmly"), BULB, HOOD)}, "its parts.0.handling"),
        (
            {"parts": (handled(straight=((0.0, 0.0, 1.0), *Y_DOWN[1:])), BULB, HOOD)},
            "the handling of part 'lamp_base' has a 'straight' that is not a rotation: it mirrors",
        ),
        (
            {"parts": (handled(symmetry_rad=0.0), BULB, HOOD)},
            "the handling of part 'lamp_base' must have a symmetry_rad",
        ),
        (
            {"parts": (BASE, replace(BULB, handling=replace(BULB.handling, flat_every_rad=0.0)), HOOD)},
            "the handling of part 'lamp_bulb' must have a symmetry_rad or flat_every_rad",
        ),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, object], clause: str) -> None:
    assert check_task(replace(LAMP, **changes), "lamp").startswith(clause)


def test_what_is_no_task_is_named() -> None:
    assert check_task({"name": "lamp"}, "lamp") == "it is not an AssemblyTask but of type dict"
