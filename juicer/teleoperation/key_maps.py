"""What keys and buttons mean: the original's map, two that others know, and anybody's own from a TOML file.

Keys are named by ``KeyboardEvent.code``, which is a place on the keyboard, whatever letter is printed there.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from juicer.config import StrictConfig, parse_config
from juicer.errors import ConfigError, did_you_mean
from juicer.reading import read_bounded
from juicer.teleoperation.key_codes import GAMEPAD_BUTTONS, KEY_CODES, KEYS_OF_THE_PAGE, SPACEMOUSE_BUTTONS
from juicer.text import printable

MOST_BYTES = 65_536
"""Largest file with a key map."""


class Action(StrEnum):
    """What a press asks for, once."""

    GRIPPER = "gripper"
    UNDO = "undo"
    UNDO_MORE = "undo_more"
    SUCCESS = "success"
    DISCARD = "discard"
    PAUSE = "pause"
    PROCEED = "proceed"
    RESET = "reset"


class Motion(StrEnum):
    """What lasts as long as a key is held: along and about the axes of the robot base frame, and slow mode.

    The operator faces the robot: x comes nearer, y goes to the right, z up.
    """

    X_MINUS = "x_minus"
    X_PLUS = "x_plus"
    Y_MINUS = "y_minus"
    Y_PLUS = "y_plus"
    Z_MINUS = "z_minus"
    Z_PLUS = "z_plus"
    ROLL_MINUS = "roll_minus"
    ROLL_PLUS = "roll_plus"
    PITCH_MINUS = "pitch_minus"
    PITCH_PLUS = "pitch_plus"
    YAW_MINUS = "yaw_minus"
    YAW_PLUS = "yaw_plus"
    SLOW = "slow"

    @property
    def component(self) -> tuple[int, float]:
        """Which of the six components of a twist it drives, and in which direction; slow mode drives none."""
        axis, _, direction = self.value.partition("_")
        return ("x", "y", "z", "roll", "pitch", "yaw").index(axis), 1.0 if direction == "plus" else -1.0


Meaning = Action | Motion
Bindings = Mapping[str, Meaning]
"""By key or button, what it means."""

DESCRIPTIONS: Mapping[Meaning, str] = {
    Motion.X_MINUS: "away from you",
    Motion.X_PLUS: "towards you",
    Motion.Y_MINUS: "left",
    Motion.Y_PLUS: "right",
    Motion.Z_MINUS: "down",
    Motion.Z_PLUS: "up",
    Motion.ROLL_MINUS: "lean right",
    Motion.ROLL_PLUS: "lean left",
    Motion.PITCH_MINUS: "lean away from you",
    Motion.PITCH_PLUS: "lean towards you",
    Motion.YAW_MINUS: "turn clockwise",
    Motion.YAW_PLUS: "turn counterclockwise",
    Motion.SLOW: "slow",
    Action.GRIPPER: "close or open the gripper",
    Action.UNDO: "undo 10 steps",
    Action.UNDO_MORE: "undo some seconds",
    Action.SUCCESS: "end as a success",
    Action.DISCARD: "discard the episode",
    Action.PAUSE: "pause",
    Action.PROCEED: "continue",
    Action.RESET: "start anew",
}
"""What each meaning is called where an operator reads it."""

_MEANINGS: Mapping[str, Meaning] = {meaning.value: meaning for meaning in DESCRIPTIONS}


class Speeds(StrictConfig):
    """How fast the end effector goes while a key is held, or at full deflection; the original's where it has one."""

    keyboard_m_s: float = Field(default=0.1, gt=0, le=0.25, description="while a key is held")
    keyboard_rad_s: float = Field(default=2.0, gt=0, le=3.5, description="while a key is held")
    gamepad_m_s: float = Field(default=0.25, gt=0, le=1, description="at full deflection of a stick or trigger")
    gamepad_rad_s: float = Field(default=2.0, gt=0, le=5, description="at full deflection of a stick")
    spacemouse_m_s: float = Field(default=0.8, gt=0, le=2, description="at full deflection, before the limits")
    spacemouse_rad_s: float = Field(default=4.0, gt=0, le=10, description="at full deflection, before the limits")
    slow: float = Field(default=0.25, gt=0, le=1, description="share of it in slow mode")
    slow_stays: bool = Field(default=False, description="whether a press turns slow mode on until the next one")


@dataclass(frozen=True)
class KeyMap:
    """What every key and button means.

    Attributes:
        name: Name of the preset or of the file, fit to be shown.
        keys: By ``KeyboardEvent.code``.
        buttons: By name of a gamepad's button, see :data:`~juicer.teleoperation.key_codes.GAMEPAD_BUTTONS`.
        speeds: How fast things go.
    """

    name: str
    keys: Bindings
    buttons: Bindings
    speeds: Speeds = field(default_factory=Speeds)

    @cached_property
    def bindings(self) -> Bindings:
        """Keys, buttons of a gamepad and of a SpaceMouse, and what a pose device says: no two have one name."""
        return {**self.keys, **self.buttons, **dict.fromkeys(SPACEMOUSE_BUTTONS, Action.GRIPPER), **_MEANINGS}


_COMMON_KEYS: Bindings = {"Space": Action.GRIPPER, "ShiftLeft": Motion.SLOW, "ShiftRight": Motion.SLOW}
"""Of every preset: a large key for the gripper, and slow mode, for what people miss at an insertion is fine motion."""

_GAMEPAD: Bindings = {
    "A": Action.GRIPPER,
    "B": Action.DISCARD,
    "X": Action.UNDO,
    "Y": Action.SUCCESS,
    "LB": Motion.YAW_PLUS,
    "RB": Motion.YAW_MINUS,
    "Back": Action.PROCEED,
    "Start": Action.PAUSE,
    "LS": Motion.SLOW,
    "RS": Motion.SLOW,
    "Left": Action.UNDO_MORE,
}

_PRESETS: Mapping[str, Bindings] = {
    "original": {
        "KeyW": Motion.X_MINUS, "KeyS": Motion.X_PLUS, "KeyA": Motion.Y_MINUS, "KeyD": Motion.Y_PLUS,
        "KeyQ": Motion.Z_MINUS, "KeyE": Motion.Z_PLUS, "KeyL": Motion.ROLL_MINUS, "KeyJ": Motion.ROLL_PLUS,
        "KeyI": Motion.PITCH_MINUS, "KeyK": Motion.PITCH_PLUS, "KeyO": Motion.YAW_MINUS, "KeyU": Motion.YAW_PLUS,
        "KeyZ": Action.GRIPPER, "KeyB": Action.UNDO, "KeyV": Action.UNDO_MORE, "KeyT": Action.SUCCESS,
        "KeyN": Action.DISCARD, "KeyP": Action.PAUSE, "KeyC": Action.PROCEED, "KeyR": Action.RESET,
    },
    "isaaclab": {
        "KeyS": Motion.X_MINUS, "KeyW": Motion.X_PLUS, "KeyD": Motion.Y_MINUS, "KeyA": Motion.Y_PLUS,
        "KeyE": Motion.Z_MINUS, "KeyQ": Motion.Z_PLUS, "KeyX": Motion.ROLL_MINUS, "KeyZ": Motion.ROLL_PLUS,
        "KeyG": Motion.PITCH_MINUS, "KeyT": Motion.PITCH_PLUS, "KeyV": Motion.YAW_MINUS, "KeyC": Motion.YAW_PLUS,
        "KeyK": Action.GRIPPER, "KeyB": Action.UNDO, "Backspace": Action.UNDO_MORE, "Enter": Action.SUCCESS,
        "KeyN": Action.DISCARD, "KeyP": Action.PAUSE, "KeyO": Action.PROCEED, "KeyR": Action.RESET,
    },
    "robosuite": {
        "ArrowUp": Motion.X_MINUS, "ArrowDown": Motion.X_PLUS, "ArrowLeft": Motion.Y_MINUS, "ArrowRight": Motion.Y_PLUS,
        "Period": Motion.Z_MINUS, "Semicolon": Motion.Z_PLUS, "KeyR": Motion.ROLL_MINUS, "KeyE": Motion.ROLL_PLUS,
        "KeyH": Motion.PITCH_MINUS, "KeyY": Motion.PITCH_PLUS, "KeyO": Motion.YAW_MINUS, "KeyP": Motion.YAW_PLUS,
        "KeyB": Action.UNDO, "Backspace": Action.UNDO_MORE, "Enter": Action.SUCCESS, "KeyN": Action.DISCARD,
        "KeyK": Action.PAUSE, "KeyC": Action.PROCEED, "KeyQ": Action.RESET,
    },
}  # fmt: skip

PRESETS: Mapping[str, KeyMap] = {
    name: KeyMap(name, {**keys, **_COMMON_KEYS}, _GAMEPAD) for name, keys in _PRESETS.items()
}
"""The original's map first, which is the default."""
DEFAULT = PRESETS["original"]


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


_Names = Annotated[list[Annotated[str, Field(max_length=200)]], BeforeValidator(_listed), Field(max_length=20)]


class _File(StrictConfig):
    """Content of a file with a key map."""

    base: str = Field(default="original", max_length=200)
    keys: dict[str, _Names] = Field(default_factory=dict, max_length=100)
    gamepad: dict[str, _Names] = Field(default_factory=dict, max_length=100)
    speeds: Speeds = Speeds()


def find_key_map(name: str) -> KeyMap:
    """A key map by the name of a preset, or by the path of a TOML file.

    Raises:
        ConfigError: If there is neither, or the file makes no key map; one sentence says why.
    """
    if name in PRESETS:
        return PRESETS[name]
    if not name.endswith(".toml"):
        raise ConfigError(
            f"there is no key map '{printable(name)}', and it is no path of a file that ends in .toml"
            f"{did_you_mean(name, PRESETS)}"
        )
    return read_key_map(Path(name))


def read_key_map(path: Path) -> KeyMap:
    """A key map from a TOML file; what it does not name stays as in the preset that it is based on.

    Raises:
        ConfigError: With one sentence, if the file cannot be read or makes no key map.
    """
    where = f"key map '{printable(path)}'"
    try:
        content = tomllib.loads(read_bounded(path, MOST_BYTES).decode())
    except FileNotFoundError:
        raise ConfigError(f"{where} does not exist") from None
    except OSError as error:
        raise ConfigError(f"{where} cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{where} cannot be read: it is not UTF-8 text") from None
    except RecursionError:
        raise ConfigError(f"{where} cannot be read: it is nested too deeply") from None
    except ValueError as error:
        raise ConfigError(f"{where} is not valid TOML: {printable(error)}") from None
    return _made(content, where, printable(path.name))


def _made(content: dict[str, Any], where: str, name: str) -> KeyMap:
    file = parse_config(content, _File, where)
    if file.base not in PRESETS:
        raise ConfigError(f"{where}: unknown base '{printable(file.base)}'{did_you_mean(file.base, PRESETS)}")
    base = PRESETS[file.base]
    keys = _rebound(base.keys, file.keys, KEY_CODES, f"{where}, [keys]", "KeyboardEvent.code")
    buttons = _rebound(base.buttons, file.gamepad, GAMEPAD_BUTTONS, f"{where}, [gamepad]", "button of a gamepad")
    return KeyMap(name, keys, buttons, file.speeds)


def _rebound(
    base: Bindings, given: Mapping[str, Iterable[str]], known: Collection[str], where: str, kind: str
) -> Bindings:
    """Bindings of which some meanings got other keys."""
    changed: dict[Meaning, list[str]] = {}
    for name, keys in given.items():
        if name not in _MEANINGS:
            raise ConfigError(f"{where}: unknown action '{printable(name)}'{did_you_mean(name, _MEANINGS)}")
        changed[_MEANINGS[name]] = list(keys)
    bound: dict[str, Meaning] = {key: meaning for key, meaning in base.items() if meaning not in changed}
    for meaning, keys in changed.items():
        for key in keys:
            if key in KEYS_OF_THE_PAGE:
                raise ConfigError(f"{where}: '{key}' cannot mean '{meaning}', for {KEYS_OF_THE_PAGE[key]}")
            if key not in known:
                raise ConfigError(f"{where}: '{printable(key)}' of '{meaning}' is no {kind}{_nearest(key, known)}")
            if key in bound:
                raise ConfigError(
                    f"{where}: '{key}' is bound to both '{bound[key]}' and '{meaning}'; give one of them another"
                )
            bound[key] = meaning
    return bound


def _nearest(key: str, known: Collection[str]) -> str:
    meant = f"Key{key.upper()}"
    if meant in known:
        return f"; did you mean '{meant}'?"
    nearest = did_you_mean(key, known)
    return nearest if "mean" in nearest else f"; they are named like '{min(known)}' and '{max(known)}'"
