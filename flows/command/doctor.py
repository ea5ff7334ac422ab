"""The commands that examine the machine."""

from __future__ import annotations

from typing import Any

import typer

from flows.doctor.encoders import EncoderFile, FileState, examine_encoders
from flows.doctor.examination import examine
from flows.doctor.verdict import State
from flows.running.settings import read_settings
from flows.terminal.output import bytes_text, say, say_json, say_table
from juicer.policy.pretrained.known import KNOWN
from juicer.text import printable

LONGEST_LINE = 600


def examine_machine(as_json: bool) -> None:
    """``juicer doctor``; ends with status 1 if there is a problem."""
    found = examine()
    problems = [each for each in found if each.verdict.state is State.PROBLEM]
    warnings = [each for each in found if each.verdict.state is State.WARNING]
    if as_json:
        lines = [
            {
                "check": each.name,
                "state": each.verdict.state.value,
                "message": each.verdict.message,
                "remedy": each.verdict.remedy or None,
            }
            for each in found
        ]
        say_json({"problems": len(problems), "warnings": len(warnings), "checks": lines})
    else:
        for each in found:
            remedy = f"; {each.verdict.remedy}" if each.verdict.remedy else ""
            sentence = printable(f"{each.verdict.message}{remedy}", LONGEST_LINE)
            say(f"{each.verdict.state.value:8} {each.name:10} {sentence}")
        say(_conclusion(len(problems), len(warnings)))
    if problems:
        raise typer.Exit(1)


def show_encoders(as_json: bool) -> None:
    """``juicer doctor --encoders``; ends with status 1 if a file is another one than it should be."""
    folder = read_settings().machine.weights
    found = list(examine_encoders(folder))
    if as_json:
        say_json({"folder": str(folder), "encoders": [_as_json(each) for each in found]})
    else:
        say_table(["encoder", "weights", "size ", "licence", "state"], [_as_row(each) for each in found])
        for each in found:
            if each.remedy:
                say(f"{each.row.weights}: {printable(each.remedy, LONGEST_LINE)}")
        say(f"files are looked for in '{printable(folder, LONGEST_LINE)}' (JUICER_WEIGHTS); juicer downloads none")
    if any(each.state in (FileState.DIFFERS, FileState.UNREADABLE) for each in found):
        raise typer.Exit(1)


def _as_row(each: EncoderFile) -> list[str]:
    licence = KNOWN[each.row.weights].licence if each.row.weights else ""
    size = "" if each.size is None else bytes_text(each.size)
    return [each.row.title, each.row.weights, size, licence, each.state.value]


def _as_json(each: EncoderFile) -> dict[str, Any]:
    known = KNOWN.get(each.row.weights)
    return {
        "encoder": each.row.title,
        "is_in_paper": each.row.is_in_paper,
        "backbone": dict(each.row.backbone),
        "weights": each.row.weights or None,
        "state": each.state.value,
        "file": known.file if known else None,
        "url": known.url if known else None,
        "licence": known.licence if known else None,
        "path": str(each.path) if each.path else None,
        "size": each.size,
        "sha256": each.sha256 or None,
        "remedy": each.remedy or None,
    }


def _conclusion(problems: int, warnings: int) -> str:
    counts = [
        f"{count} {noun}{'s' if count > 1 else ''}"
        for count, noun in ((problems, "problem"), (warnings, "warning"))
        if count
    ]
    return " and ".join(counts) or "nothing stands in the way"
