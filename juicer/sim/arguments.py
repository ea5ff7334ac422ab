"""What callers hand to environments, checked as Gymnasium does but answered with a sentence."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from juicer.errors import ConfigError, did_you_mean
from juicer.text import printable

RESET_MASK = "reset_mask"


def checked_count(name: str, value: object, least: int = 1) -> int:
    """A whole number from ``least`` on.

    Raises:
        ConfigError: Naming the argument, if it is none.
    """
    if not is_whole(value) or int(value) < least:
        raise ConfigError(f"{name} must be a whole number of at least {least}, got {shown(value)}")
    return int(value)


def checked_seed(seed: object) -> int | None:
    """A seed as Python's integer, however large; None stays None.

    Raises:
        ConfigError: If it is a truth value, a fraction, negative, or no number.
    """
    if seed is None:
        return None
    if isinstance(seed, np.ndarray) and seed.ndim == 0:
        seed = seed[()]
    if not is_whole(seed) or int(seed) < 0:
        raise ConfigError(f"a seed must be a whole number, zero or positive, or None, got {shown(seed)}")
    return int(seed)


def checked_seeds(seed: object, num_envs: int) -> list[int | None]:
    """A seed for every environment: from a sequence of them, or counted up from one.

    Raises:
        ConfigError: If there are more or fewer than environments, or one is no seed.
    """
    if isinstance(seed, np.ndarray) and seed.ndim > 0:
        seed = list(seed)
    if isinstance(seed, Sequence) and not isinstance(seed, str | bytes):
        if len(seed) != num_envs:
            raise ConfigError(f"a list of seeds needs one for each of the {num_envs} environments, got {len(seed)}")
        return [checked_seed(item) for item in seed]
    first = checked_seed(seed)
    return [None if first is None else first + index for index in range(num_envs)]


def checked_options(options: object, known: Collection[str]) -> Mapping[str, Any]:
    """Options of a reset.

    Raises:
        ConfigError: If they are no mapping, or one is not known.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ConfigError(f"the options of a reset must be a dictionary or None, got {shown(options)}")
    for name in options:
        if name not in known:
            hint = did_you_mean(str(name), known) if known else "; it has none"
            raise ConfigError(f"a reset has no option {shown(name)}{hint}")
    return options


def checked_mask(options: object, num_envs: int) -> NDArray[np.bool_]:
    """Which of the environments to reset ``(num_envs,)``: all of them, or those of ``options["reset_mask"]``.

    Raises:
        ConfigError: If it is no boolean array of that length with at least one environment in it.
    """
    mask = checked_options(options, known=(RESET_MASK,)).get(RESET_MASK)
    if mask is None:
        return np.ones(num_envs, dtype=np.bool_)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (num_envs,):
        got = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else shown(mask)
        raise ConfigError(f"options['{RESET_MASK}'] must be a boolean numpy array of shape ({num_envs},), got {got}")
    if not mask.any():
        raise ConfigError(f"options['{RESET_MASK}'] must name at least one environment to reset, got none")
    return mask.copy()


def is_whole(value: object) -> TypeGuard[int | np.integer]:
    """Whether a value is an integer of Python's or numpy's, and no truth value."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def shown(value: object) -> str:
    """What a message shows of a foreign value."""
    try:
        return printable(repr(value))
    except Exception:  # an integer of thousands of digits, or somebody's own __repr__
        return f"a {printable(type(value).__name__)}"
