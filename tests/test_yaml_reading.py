"""YAML is read as what it plainly says, or refused in a clause, quickly and within bounds."""

from __future__ import annotations

import math

import pytest

from juicer.yaml_reading import MOST_DEPTH, MOST_VALUES, UnreadableYaml, check_plain, read_yaml


def test_values_are_what_yaml_1_2_says():
    text = "{a: yes, b: on, c: 1:30, d: 007, e: 0x1F, f: 2024-13-45, g: True, h: ~, i: 1e-3, j: 1_000, k: -.5, l: .inf}"
    assert read_yaml(text).value == {
        "a": "yes",
        "b": "on",
        "c": "1:30",
        "d": "007",
        "e": "0x1F",
        "f": "2024-13-45",
        "g": True,
        "h": None,
        "i": 0.001,
        "j": 1000,
        "k": -0.5,
        "l": math.inf,
    }
    assert read_yaml("a: '1'\nb: \"true\"").value == {"a": "1", "b": "true"}


def test_anchors_and_merges_bring_values_with_their_own_lines():
    document = read_yaml("a: &a\n  x: 1\n  y: 2\nb:\n  <<: *a\n  y: 3\nc: [*a, {<<: [{x: 5}, *a]}]\n")
    assert document.value["b"] == {"x": 1, "y": 3}
    assert document.value["c"] == [{"x": 1, "y": 2}, {"x": 5, "y": 2}]
    assert document.lines[("b", "x")] == 2
    assert document.lines[("b", "y")] == 6
    assert document.lines[("c", 0)] == 7


def test_byte_order_mark_is_no_content():
    assert read_yaml(b"\xef\xbb\xbfa: 1").value == {"a": 1}


BOMB = "a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8, 9]\n" + "".join(
    f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]\n" for level in range(1, 12)
)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", "line 3: the key 'a' is there already, in line 1"),
        ("a: {b: 1,\n b: 2}", "line 2: the key 'b' is there already"),
        ("x: &x {}\na:\n  <<: *x\n  <<: *x\n", "line 4: the key '<<' is there already"),
        ("[" * 100_000, "nested more than"),
        ("{a: " * 100_000, "nested more than"),
        ("- " * 100_000, "nested more than"),
        (BOMB, f"more than {MOST_VALUES:,} values"),
        ("a: [" + "1," * 40_000 + "]", f"more than {MOST_VALUES:,} values"),
        ("a: " + "9" * 5000, "line 1: a number of 5000 digits"),
        ("a: " + "x" * 600_000, "longer than"),
        ("a: b\0", r"U\+0000"),
        ("a: \x1b[2J", r"U\+001B"),
        ("a:\n\tb: 1", "line 2: a tab where YAML takes only spaces"),
        ("a: !!python/object/apply:os.system ['x']", "line 1: tags such as"),
        ("a: !!str 5", "line 1: tags such as"),
        ("a: 1\n---\nb: 2\n", "line 2: a second document begins"),
        ("a: &x [*x]", r"line 1: '\*x' stands within itself"),
        ("a: *x", "there is no anchor '&x' above it"),
        ("1: 2", "a key must be a word, got 1"),
        ("true: 2", "a key must be a word, got True"),
        ("? [a]\n: 1", "a key must be a word, not a list"),
        ("? {a: b}\n: 1", "a key must be a word, not a list"),
        ('"a\\eb": 1', r"'a\\x1bb' cannot be a key"),
        ("k" * 500 + ": 1", "cannot be a key"),
        ("<<: 3", "'<<' takes a mapping"),
        ("a: [1", "line 1: expected"),
        ("a: b: c", "line 1: mapping values are not allowed here"),
        ('a: "\\UFFFFFFFF"', "not valid YAML"),
        ("%YAML 1." + "9" * 6000 + "\n---\na: 1", "not valid YAML"),
        ("a: 1".encode("utf-16"), "not UTF-8 text"),
        ("a: é".encode("latin-1"), "not UTF-8 text"),
    ],
)
def test_what_is_not_plain_yaml_is_refused_in_a_clause(content, message):
    with pytest.raises(UnreadableYaml, match=message) as caught:
        read_yaml(content)
    assert len(str(caught.value)) < 500


def nested(depth):
    value = 1
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (nested(MOST_DEPTH + 1), "nested more than"),
        (nested(100_000), "nested more than"),
        ({"a": [1] * (MOST_VALUES + 1)}, "more than"),
        ({1: 2}, "a key must be a word"),
        ({"a": {"\x1b": 1}}, "cannot be a key"),
    ],
)
def test_content_that_was_read_elsewhere_has_the_same_bounds(value, message):
    with pytest.raises(UnreadableYaml, match=message):
        check_plain(value)


def test_content_within_bounds_passes():
    check_plain({"a": [1, {"b": None}], "c": "x"})
    check_plain(nested(MOST_DEPTH - 1))
