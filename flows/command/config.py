"""``juicer config``: a configuration in full, each value with the place that it comes from."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

from flows.command.choice import Choice
from flows.config import MIX_KEY, RunConfig
from flows.loop_config import LoopConfig
from flows.runs import FLOW_KEY
from flows.terminal.output import say, say_json
from flows.written import TASKS_KEY, Written
from juicer.config import parse_config
from juicer.text import printable
from juicer.yaml_reading import Keys, read_yaml

_PLAIN = re.compile(r"[A-Za-z/~][A-Za-z0-9_./~-]*")
_FIRST = (FLOW_KEY, "name", "task", "randomness")
"""What a reader looks for first; then come the keys that make a run of a loop, such as its conditions and seeds."""
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
    run, tasks = runs[0], written.values.get(TASKS_KEY)
    content = _of_all_tasks(written, type(run)) if tasks else run.model_dump(mode="json", exclude={MIX_KEY})
    own = [key for key in content if key not in LoopConfig.model_fields]
    content = {key: content[key] for key in (*_FIRST, *own) if key in content} | content
    # Values before sections: below a section's heading they would read as its own.
    values = {key: value for key, value in content.items() if not isinstance(value, dict)}
    return values | content | ({TASKS_KEY: tasks} if tasks else {})


def _of_all_tasks(written: Written, flow: type[RunConfig]) -> dict[str, Any]:
    """What is said of all tasks. No run can be made of it: it may name conditions that only a task defines."""
    of_loop = {key: value for key, value in written.values.items() if key in LoopConfig.model_fields}
    loop = parse_config(of_loop, LoopConfig, "the configuration", written.place)
    of_flow = flow().model_dump(mode="json", exclude=set(LoopConfig.model_fields))
    return {
        **loop.model_dump(mode="json", exclude={"task", MIX_KEY}),
        **{key: written.values.get(key, default) for key, default in of_flow.items()},
    }


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
    if isinstance(value, str):
        return yaml.safe_dump(value, default_style='"', allow_unicode=True, width=sys.maxsize).rstrip("\n")
    return json.dumps(value)
