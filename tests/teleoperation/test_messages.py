import json
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from juicer.errors import RefusedMessage
from juicer.teleoperation.controls import ControllerState
from juicer.teleoperation.messages import MOST_BYTES, MessageReader, parse_state

DOCUMENTED = (Path(__file__).parents[2] / "docs" / "teleoperation.md").read_text()


def message(**entries: Any) -> bytes:
    return json.dumps({"source": "keyboard", "sequence": 1, **entries}).encode()


def test_a_message_becomes_the_state_it_tells_of() -> None:
    state = parse_state(message(held=["KeyW", "LB"], edges={"KeyZ": 2}, axes=[0, 0.5, 0, 0, 0, 1], sequence=7))
    assert state == ControllerState(
        source="keyboard",
        sequence=7,
        held=frozenset({"KeyW", "LB"}),
        edges={"KeyZ": 2},
        axes=(0.0, 0.5, 0.0, 0.0, 0.0, 1.0),
    )


def test_a_pose_device_sends_its_motion_and_its_clutch() -> None:
    state = parse_state(
        message(source="pose", pose_delta=[0.1, 0, 0, 0, 0, 0.5], clutch=True, edges={"clutch": 1, "gripper": 3})
    )
    assert state.clutch
    assert state.pose_delta == (0.1, 0.0, 0.0, 0.0, 0.0, 0.5)


def test_the_documented_message_is_one() -> None:
    (example,) = re.findall(r"```json\n(.*?)```", DOCUMENTED, re.DOTALL)
    assert parse_state(example).edges == {"clutch": 1, "gripper": 3}


@pytest.mark.parametrize(
    ("given_message", "sentence"),
    [
        (b"", "a message is one JSON object"),
        (b"\xff\xfe", "a message is one JSON object"),
        (b"[1, 2]", "a message is one JSON object"),
        (b"[" * 5000, "a message is one JSON object"),
        (b'"' + b"x" * MOST_BYTES + b'"', "a message has at most 8,192 bytes"),
        (b'{"source": "keyboard", "source": "pose"}', "says one name twice"),
        (b'{"source": "keyboard", "sequence": NaN}', "holds finite numbers, this one holds NaN"),
        (b'{"source": "keyboard", "sequence": ' + b"9" * 4000 + b"}", "a message is one JSON object"),
        (message(hold=[]), "a message has no entry 'hold'; it has source"),
        (message(**{"\x1b[2J": 1}), r"no entry '\\x1b\[2J'"),
        (message(source="mouse"), "'source' must be one of keyboard, gamepad, spacemouse, pose, got 'mouse'"),
        (message(source=["keyboard"]), "'source' must be one of"),
        (message(sequence=None), "'sequence' must be a whole number from 0"),
        (message(sequence=True), "'sequence' must be a whole number from 0"),
        (message(sequence=-1), "'sequence' must be a whole number from 0"),
        (message(sequence=1.5), "'sequence' must be a whole number from 0"),
        (message(held="KeyW"), "'held' must be a list of at most 32"),
        (message(held=["KeyW"] * 33), "'held' must be a list of at most 32"),
        (message(held=["w"]), "'held' names a key or button that there is not: 'w'"),
        (message(held=[["KeyW"]]), "'held' names a key or button that there is not"),
        (message(edges=["KeyW"]), "'edges' must be an object of counts"),
        (message(edges={"KeyW": -1}), "'edges.KeyW' must be a whole number"),
        (message(edges={"KeyW": 2**40}), "'edges.KeyW' must be a whole number"),
        (message(axes=[0, 0]), "'axes' must be a list of 6 numbers"),
        (message(axes=[0, 0, 0, 0, 0, 1.5]), "'axes' must hold numbers from -1 to 1, got 1.5"),
        (message(axes=[0, 0, 0, 0, 0, "1"]), "'axes' must hold numbers from -1 to 1, got '1'"),
        (message(twist=[0, 0, 0, 0, 0, True]), "'twist' must hold numbers from -1 to 1, got True"),
        (
            message(twist=[0, 0, 0, 0, 0, 1]).replace(b"1]", b"1e999]"),
            "'twist' must hold .* got inf",
        ),
        (message(pose_delta=[11, 0, 0, 0, 0, 0]), "'pose_delta' must hold numbers from -10 to 10"),
        (message(pose_delta=[0, 0, 0, 5, 5, 5]), "more than one turn"),
        (message(clutch=1), "'clutch' must be true or false"),
    ],
)
def test_what_is_no_message_is_refused_in_a_sentence(given_message: bytes, sentence: str) -> None:
    with pytest.raises(RefusedMessage, match=sentence) as raised:
        parse_state(given_message)
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) < 400


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200)))
def test_whatever_bytes_come_the_answer_is_a_state_or_a_sentence(content: bytes | str) -> None:
    with pytest.raises(RefusedMessage):
        parse_state(content)


JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(st.lists(inner, max_size=7), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
    max_leaves=10,
)


@given(st.sampled_from(["source", "sequence", "held", "edges", "axes", "twist", "pose_delta", "clutch"]), JSON)
def test_whatever_an_entry_holds_the_answer_is_a_state_or_a_sentence(name: str, value: Any) -> None:
    try:
        state = parse_state(message(**{name: value}))
    except RefusedMessage:
        return
    assert all(abs(each) <= 10 for each in (*state.axes, *(state.twist or ()), *(state.pose_delta or ())))


def test_a_message_that_was_repeated_or_overtaken_is_refused_and_the_next_is_read() -> None:
    reader = MessageReader()
    reader.read(message(sequence=4))
    for late in (4, 3, 0):
        with pytest.raises(RefusedMessage, match=f"message {late} comes after message 4: it was repeated or overtaken"):
            reader.read(message(sequence=late))
    assert reader.read(message(sequence=9)).sequence == 9


def test_counts_of_presses_grow_and_not_by_more_than_fingers_can_press() -> None:
    reader = MessageReader()
    reader.read(message(sequence=1, edges={"KeyB": 3}))
    for count in (2, 500):
        with pytest.raises(RefusedMessage, match=f"'KeyB' cannot have been pressed {count} times after 3 times"):
            reader.read(message(sequence=2, edges={"KeyB": count}))
    with pytest.raises(RefusedMessage, match="'KeyB' cannot have been pressed 0 times after 3 times"):
        reader.read(message(sequence=2))
    assert reader.read(message(sequence=2, edges={"KeyB": 4})).edges == {"KeyB": 4}
