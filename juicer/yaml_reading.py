"""YAML as configurations use it: plain values, every key once, bounded in size, and where each value stands.

Numbers, ``true``, ``false`` and ``null`` are read as YAML 1.2 defines them; everything else is text, so that a name may
look like a date, ``no`` is a word and ``1:30`` no number.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from juicer.text import printable

MOST_BYTES = 500_000
MOST_VALUES = 20_000
"""Values of a document, those that an alias repeats included; more is no configuration."""
MOST_DEPTH = 40
MOST_DIGITS = 30
LONGEST_KEY = 200

Keys = tuple[str | int, ...]
"""Where a value stands: keys of mappings and positions in lists, outermost first."""

_CONSTANTS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
# A number with a leading zero means one thing in YAML 1.1 and another in 1.2: it stays text.
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*(_[0-9]+)*)")
_FLOAT = re.compile(r"[-+]?(([0-9]*\.[0-9]+|[0-9]+\.)([eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+)")
_NOT_FINITE = re.compile(r"(?P<sign>[-+]?)\.(?P<word>inf|Inf|INF|nan|NaN|NAN)")
_MERGE = "<<"


class UnreadableYaml(ValueError):
    """A text that is no YAML, or more than plain YAML; the message is a clause."""


@dataclass(frozen=True)
class Document:
    """A value, and the lines it was read from.

    Attributes:
        value: Mappings, lists, texts, numbers, truth values and nothing else.
        lines: By place, the line that a value stands in, counted from 1; ``()`` is the value as a whole.
    """

    value: Any
    lines: Mapping[Keys, int]


def read_yaml(content: bytes | str) -> Document:
    """Read a document; an empty one is ``None``.

    Raises:
        UnreadableYaml: If it is none, is too large, or uses what a configuration has no use for.
    """
    text = content if isinstance(content, str) else _decoded(content)
    if len(text) > MOST_BYTES:
        raise UnreadableYaml(f"it is longer than {MOST_BYTES:,} letters")
    try:
        return _Reader(text).read()
    except yaml.reader.ReaderError as error:
        raise UnreadableYaml(f"it holds the character U+{error.character:04X}") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        raise UnreadableYaml(where + _plain(error)) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        if isinstance(error, UnreadableYaml):
            raise
        raise UnreadableYaml(f"it is not valid YAML ({printable(error)})") from None


def check_plain(value: Any) -> None:
    """Refuse content that was not read here, from a form for instance, if it is larger or deeper than that may be.

    Raises:
        UnreadableYaml: If it is, or if a key is no text.
    """
    count, level = 0, [value]
    for _ in range(MOST_DEPTH):
        following: list[Any] = []
        for each in level:
            if isinstance(each, Mapping):
                for key in each:
                    _check_key(key, "")
                following += each.values()
            elif isinstance(each, list | tuple):
                following += each
        count += len(level)
        if count + len(following) > MOST_VALUES:
            raise UnreadableYaml(f"it holds more than {MOST_VALUES:,} values")
        if not following:
            return
        level = following
    raise UnreadableYaml(f"it is nested more than {MOST_DEPTH} deep")


def _decoded(content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UnreadableYaml("it is not UTF-8 text") from None


def _plain(error: yaml.MarkedYAMLError) -> str:
    problem = " ".join(str(error.problem or error.context or "it is not valid YAML").split())
    if r"'\t'" in problem:
        return "a tab where YAML takes only spaces"
    return printable(problem)


@dataclass
class _Node:
    """A value under construction.

    Attributes:
        value: The value.
        children: By key or position, the values in it, and the lines they stand in.
        size: Values it consists of.
    """

    value: Any
    children: dict[str | int, tuple[_Node, int]] = field(default_factory=dict)
    size: int = 1

    def put(self, key: str | int, child: _Node, line: int) -> None:
        """Take in a value that stands in ``line``."""
        self.children[key] = child, line
        self.size += child.size

    def lines(self, keys: Keys = ()) -> Iterator[tuple[Keys, int]]:
        """Lines of all that is in it."""
        for key, (child, line) in self.children.items():
            yield (*keys, key), line
            yield from child.lines((*keys, key))


@dataclass
class _Reader:
    """Builds values from PyYAML's events, which come one by one: nothing large is built before it is refused."""

    text: str
    anchors: dict[str, _Node | None] = field(default_factory=dict)
    count: int = 0

    def __post_init__(self) -> None:
        self._events: Iterator[yaml.Event] = yaml.parse(self.text, Loader=yaml.SafeLoader)

    def read(self) -> Document:
        next(self._events)  # the stream begins
        if isinstance(next(self._events), yaml.StreamEndEvent):
            return Document(None, {})
        first = next(self._events)
        node = self._node(first, 0)
        next(self._events)  # the document ends
        following = next(self._events)
        if not isinstance(following, yaml.StreamEndEvent):
            raise UnreadableYaml(f"line {_line(following)}: a second document begins; it must hold one")
        return Document(node.value, {(): _line(first), **dict(node.lines())})

    def _node(self, event: yaml.Event, depth: int) -> _Node:
        line = _line(event)
        if depth > MOST_DEPTH:
            raise UnreadableYaml(f"line {line}: it is nested more than {MOST_DEPTH} deep")
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, line)
        self._count(1)
        assert isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent)
        _refuse_tag(event)
        if event.anchor is not None:
            self.anchors[event.anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            node = _Node(_scalar(event))
        elif isinstance(event, yaml.SequenceStartEvent):
            node = self._list(depth)
        else:
            node = self._mapping(depth)
        if event.anchor is not None:
            self.anchors[event.anchor] = node
        return node

    def _alias(self, event: yaml.AliasEvent, line: int) -> _Node:
        name = printable(event.anchor)
        if event.anchor not in self.anchors:
            raise UnreadableYaml(f"line {line}: there is no anchor '&{name}' above it")
        node = self.anchors[event.anchor]
        if node is None:
            raise UnreadableYaml(f"line {line}: '*{name}' stands within itself")
        self._count(node.size)
        return node

    def _count(self, size: int) -> None:
        self.count += size
        if self.count > MOST_VALUES:
            raise UnreadableYaml(f"it holds more than {MOST_VALUES:,} values")

    def _list(self, depth: int) -> _Node:
        node = _Node([])
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            child = self._node(event, depth + 1)
            node.put(len(node.value), child, _line(event))
            node.value.append(child.value)
        return node

    def _mapping(self, depth: int) -> _Node:
        own: dict[str | int, tuple[_Node, int]] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            key, key_line = self._key(event), _line(event)
            if key in own:
                raise UnreadableYaml(
                    f"line {key_line}: the key '{printable(key)}' is there already, in line {own[key][1]}"
                )
            own[key] = self._node(next(self._events), depth + 1), key_line
        merged = own.pop(_MERGE, None)
        node = _Node({})
        entries = {**_merged(*merged), **own} if merged else own
        for name, (child, key_line) in entries.items():
            node.put(name, child, key_line)
            node.value[name] = child.value
        return node

    def _key(self, event: yaml.Event) -> str:
        where = f"line {_line(event)}: "
        if not isinstance(event, yaml.ScalarEvent):
            raise UnreadableYaml(f"{where}a key must be a word, not a list or a mapping")
        _refuse_tag(event)
        key = _scalar(event)
        _check_key(key, where)
        return str(key)


def _merged(node: _Node, line: int) -> dict[str | int, tuple[_Node, int]]:
    """Entries that ``<<`` brings; of several mappings, the first one counts."""
    if isinstance(node.value, dict):
        return node.children
    if not isinstance(node.value, list) or not all(isinstance(each, dict) for each in node.value):
        raise UnreadableYaml(f"line {line}: '<<' takes a mapping, or a list of mappings")
    found: dict[str | int, tuple[_Node, int]] = {}
    for child, _ in reversed(node.children.values()):
        found |= child.children
    return found


def _check_key(key: Any, where: str) -> None:
    if not isinstance(key, str):
        raise UnreadableYaml(f"{where}a key must be a word, got {printable(repr(key))}")
    if len(key) > LONGEST_KEY or printable(key) != key:
        raise UnreadableYaml(f"{where}'{printable(key, 40)}' cannot be a key: too long, or with control characters")


def _refuse_tag(event: yaml.ScalarEvent | yaml.CollectionStartEvent) -> None:
    if event.tag is not None:
        raise UnreadableYaml(f"line {_line(event)}: tags such as '{printable(event.tag)}' have no meaning here")


def _scalar(event: yaml.ScalarEvent) -> Any:
    text = event.value
    if not event.implicit[0]:  # quoted, or over several lines
        return text
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INTEGER.fullmatch(text):
        if len(text) > MOST_DIGITS:
            raise UnreadableYaml(f"line {_line(event)}: a number of {len(text)} digits")
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if found := _NOT_FINITE.fullmatch(text):
        return float(found["sign"] + found["word"])
    return text


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 1
