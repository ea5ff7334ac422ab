"""``juicer config``: a configuration in full, each value with the place that it comes from."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from flows.command.choice import Choice
from flows.config import RunConfig
from flows.loop_config import LoopConfig
from flows.runs import DEFAULT_FLOW, FLOW_KEY
from flows.terminal.output import say, say_json
from flows.written import TASKS_KEY, Written
from juicer.config import parse_config
from juicer.text import printable
from juicer.yaml_reading import Keys, read_yaml

_PLAIN = re.compile(r"[A-Za-z/~][A-Za-z0-9_./~-]*")
_WIDEST = 72
"""Letters after which a comment no longer moves all others to the right."""


def print_configuration(choice: Choice, as_json: bool) -> None:
    """Print the chosen part of a configuration; it can be run again from its own output."""
    runs = choice.runs()
    written = choice.written()
    content = full_content(written, runs)
    if as_json:
        origins = {".".join(map(str, keys)): _origin(written, keys) or "default" for keys, _ in _leaves(content)}
        say_json({"configuration": content, "from": origins})
        return
    say("# '<-' marks what was said, and where; all else is a default. This is a configuration itself.")
    if len(runs) < len(written.values.get(TASKS_KEY) or runs):
        say(f"# Its model for several tasks needs all of them: run it with --task {' --task '.join(choice.tasks)}")
    lines = [(line, None if keys is None else _origin(written, keys) or "") for line, keys in _lines(content)]
    column = max((len(line) for line, origin in lines if origin is not None and len(line) <= _WIDEST), default=0)
    for line, origin in lines:
        comment = "" if origin is None else f"  # <- {printable(origin)}" if origin else "  #    default"
        say((line.ljust(column) if comment else line) + comment)


def full_content(written: Written, runs: list[RunConfig]) -> dict[str, Any]:
    """What was written with all that was left open; of several tasks, only what each says for itself."""
    first = runs[0]
    content: dict[str, Any] = {FLOW_KEY: written.values.get(FLOW_KEY, DEFAULT_FLOW)}
    of_one = ("conditions", "condition", "seed", "shifted")
    of_study = ("conditions", "left_out", "seeds", "curves", "analysed_seed", "shifted")
    own = of_study if content[FLOW_KEY] == "study" else of_one
    tasks = written.values.get(TASKS_KEY)
    of_flow = {**_defaults(first, own), **written.values} if tasks else first.model_dump(mode="json", include=set(own))
    common = {key: value for key, value in written.values.items() if key in LoopConfig.model_fields}
    loop = parse_config(common, LoopConfig, "the configuration", written.place).model_dump(mode="json", exclude={"mix"})
    if tasks:
        loop = {key: value for key, value in loop.items() if key != "task"}
    content |= {key: loop.pop(key) for key in ("name", "task", "randomness") if key in loop}
    loop = {key: of_flow[key] for key in own if of_flow.get(key) not in ({}, [], (), None)} | loop
    content |= {key: value for key, value in loop.items() if not isinstance(value, dict)}
    return content | loop | ({TASKS_KEY: tasks} if tasks else {})


def _defaults(run: RunConfig, keys: Iterable[str]) -> dict[str, Any]:
    found = {key: type(run).model_fields[key].get_default(call_default_factory=True) for key in keys}
    return {key: list(value) if key in ("conditions", "seeds") else value for key, value in found.items()}


def _origin(written: Written, keys: Keys) -> str | None:
    """Where a value was said; a default stands in no section that was replaced as a whole."""
    return written.place(keys) if written.holds(keys) else None


def _leaves(content: Mapping[str, Any], outer: Keys = ()) -> Iterator[tuple[Keys, Any]]:
    for key, value in content.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, (*outer, key))
        else:
            yield (*outer, key), value


def _lines(content: Mapping[str, Any], outer: Keys = ()) -> Iterator[tuple[str, Keys | None]]:
    """Lines of YAML, each with the keys of its value; a section's heading has none."""
    indent = "  " * len(outer)
    for key, value in content.items():
        keys = (*outer, key)
        if isinstance(value, Mapping) and value:
            if not outer:
                yield "", None
            yield f"{indent}{_text(key)}:", None
            yield from _lines(value, keys)
        else:
            yield f"{indent}{_text(key)}: {_text(value)}", keys


def _text(value: Any) -> str:
    """A value in YAML, on one line."""
    if isinstance(value, str) and _PLAIN.fullmatch(value) and read_yaml(value).value == value:
        return value
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return json.dumps(value)
