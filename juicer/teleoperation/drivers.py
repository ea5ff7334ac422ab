"""Who drove an episode, with what, by which keys and how fast: more than one of each, if it changed on the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from juicer.text import printable


@dataclass(frozen=True)
class Driver:
    """Who drove for a part of an episode, and how.

    Attributes:
        operator: Name of the operator; empty if nobody gave one.
        source: Kind of device.
        keys: Name of the key map.
        time_scale: Simulated seconds a second.
    """

    operator: str
    source: str
    keys: str
    time_scale: float


def operators_of(drivers: Sequence[Driver]) -> str:
    """Names of all who drove, in their order, fit for a log; empty if nobody gave one."""
    return printable(_each(drivers, lambda driver: driver.operator))


def devices_of(drivers: Sequence[Driver]) -> str:
    """All devices, key maps and time scales in their order, fit for a log."""
    sources = _each(drivers, lambda driver: driver.source)
    keys = _each(drivers, lambda driver: driver.keys)
    time_scales = _each(drivers, lambda driver: f"{driver.time_scale:g}")
    return printable(f"{sources}, keys {keys}, time scale {time_scales}")


def _each(drivers: Sequence[Driver], fact: Callable[[Driver], str]) -> str:
    return " and ".join(dict.fromkeys(filter(None, map(fact, drivers))))
