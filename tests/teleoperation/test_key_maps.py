import re
from pathlib import Path

import pytest

from juicer.errors import ConfigError
from juicer.teleoperation.key_maps import DESCRIPTIONS, PRESETS, Action, KeyMap, Motion, find_key_map

DOCUMENTED = (Path(__file__).parents[2] / "docs" / "teleoperation.md").read_text()


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return str(path)


def keys_of(key_map: KeyMap, meaning: Motion | Action) -> set[str]:
    return {key for key, bound in key_map.keys.items() if bound is meaning}


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_has_a_key_for_everything(name: str) -> None:
    assert set(PRESETS[name].keys.values()) == set(DESCRIPTIONS)


@pytest.mark.parametrize("name", PRESETS)
def test_space_is_a_key_of_the_gripper_and_shift_is_slow_in_every_preset(name: str) -> None:
    keys = PRESETS[name].keys
    assert keys["Space"] is Action.GRIPPER
    assert keys["ShiftLeft"] is Motion.SLOW


def test_names_of_keys_buttons_and_actions_do_not_overlap() -> None:
    key_map = PRESETS["original"]
    assert len(key_map.bindings) == len(key_map.keys) + len(key_map.buttons) + 2 + len(DESCRIPTIONS)


def test_a_file_changes_what_it_names_and_leaves_the_rest(tmp_path: Path) -> None:
    key_map = find_key_map(
        written(
            tmp_path,
            """
            base = "isaaclab"
            [keys]
            gripper = ["Space", "KeyF"]
            undo = "Delete"
            [gamepad]
            reset = "Guide"
            [speeds]
            keyboard_rad_s = 1.0
            slow_stays = true
            """,
        )
    )
    assert key_map.name == "mine.toml"
    assert keys_of(key_map, Action.GRIPPER) == {"Space", "KeyF"}
    assert keys_of(key_map, Action.UNDO) == {"Delete"}
    assert keys_of(key_map, Motion.X_PLUS) == {"KeyW"}
    assert key_map.buttons["Guide"] is Action.RESET
    assert key_map.speeds.keyboard_rad_s == 1.0
    assert key_map.speeds.keyboard_m_s == 0.1


def test_the_documented_key_map_is_one(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", DOCUMENTED, re.DOTALL)
    key_map = find_key_map(written(tmp_path, example))
    assert keys_of(key_map, Action.UNDO_MORE) == {"KeyB"}
    assert key_map.speeds.slow_stays


@pytest.mark.parametrize(("column", "name"), list(enumerate(PRESETS, start=2)))
def test_the_documented_keys_are_those_of_the_presets(column: int, name: str) -> None:
    """Each cell has the keys of the one or two meanings of its row, by the letters that are printed on them."""
    signs = {"↑": "ArrowUp", "↓": "ArrowDown", "←": "ArrowLeft", "→": "ArrowRight", ".": "Period", ";": "Semicolon"}
    rows = [row.split("|") for row in DOCUMENTED.split("## Keys")[1].split("\n\n")[1].splitlines()[2:]]
    keys = [key for row in rows for key in re.split(r"[, ]+", row[column].strip())]
    named = [signs.get(key, f"Key{key}" if len(key) == 1 else f"{key}Left" if key == "Shift" else key) for key in keys]
    gripper = [key for key, meaning in PRESETS[name].keys.items() if meaning is Action.GRIPPER]
    order = [*list(Motion)[:12], *[Action.GRIPPER] * len(gripper), Motion.SLOW, *list(Action)[1:]]
    assert [PRESETS[name].keys[key] for key in named] == order


def test_an_empty_list_leaves_an_action_without_a_key(tmp_path: Path) -> None:
    assert keys_of(find_key_map(written(tmp_path, "[keys]\nreset = []")), Action.RESET) == set()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[keys]\ngriper = 'KeyG'", r"\[keys\]: unknown action 'griper'; did you mean 'gripper'\?"),
        ("[keys]\ngripper = 'KeyB'", "'KeyB' is bound to both 'undo' and 'gripper'; give one of them another"),
        ("[keys]\nundo = ['KeyF', 'KeyF']", "'KeyF' is bound to both 'undo' and 'undo'"),
        ("[keys]\ngripper = 'g'", r"'g' of 'gripper' is no KeyboardEvent.code; did you mean 'KeyG'\?"),
        ("[keys]\ngripper = 'Spacebar'", r"'Spacebar' of 'gripper' is no .*; did you mean 'Space'\?"),
        ("[keys]\ngripper = '\x1b[2J'", "is not valid TOML"),
        ('[keys]\ngripper = "\\u001b[2J"', r"'\\x1b\[2J' of 'gripper' is no KeyboardEvent.code; they are named like"),
        ("[keys]\ngripper = 'Tab'", "'Tab' cannot mean 'gripper', for it moves the focus"),
        (
            "[keys]\nslow = 'ControlLeft'",
            "'ControlLeft' cannot mean 'slow', for browsers make their own shortcuts",
        ),
        ("[keys]\nslow = ['AltRight']", "'AltRight' cannot mean 'slow', for browsers make their own shortcuts"),
        ("[keys]\ngripper = 7", r"keys.gripper: must be a list, e.g. \[7\]"),
        ("[keys]\nx_plus = []\nx_plus = []", "is not valid TOML"),
        ("[gamepad]\ngripper = 'KeyG'", "'KeyG' of 'gripper' is no button of a gamepad"),
        ("[gamepad]\ngripper = 'B'", "'B' is bound to both 'discard' and 'gripper'"),
        ("[speed]\nslow = 0.1", r"unknown key 'speed'; did you mean 'speeds'\?"),
        ("[speeds]\nslow = 0", "speeds.slow: must be greater than 0"),
        ("[speeds]\nkeyboard_m_s = 3.0", "speeds.keyboard_m_s: must be at most 0.25"),
        ("[speeds]\nslow = nan", "speeds.slow: must be a finite number"),
        ("base = 'isaac'", r"unknown base 'isaac'; did you mean 'isaaclab'\?"),
        ("keys = 3", "keys: must hold keys and values"),
        ("x = " + "[" * 20_000, "nested too deeply|no valid TOML"),
        ("#" * 70_000, "it is larger than 65,536 bytes"),
    ],
)
def test_a_mistake_in_a_file_is_said_in_a_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence) as raised:
        find_key_map(written(tmp_path, text))
    assert "mine.toml" in str(raised.value)
    assert str(raised.value).isprintable()


def test_what_is_no_file_is_said_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        find_key_map(str(tmp_path / "none.toml"))
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(ConfigError, match="it is not a plain file"):
        find_key_map(str(tmp_path / "folder.toml"))
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="it is not UTF-8 text"):
        find_key_map(str(tmp_path / "binary.toml"))
    with pytest.raises(ConfigError, match=r"there is no key map 'robosuit', .*; did you mean 'robosuite'"):
        find_key_map("robosuit")
