"""The command that examines the machine."""

from __future__ import annotations

import typer

from flows.doctor.examination import examine
from flows.doctor.verdict import State
from flows.terminal.output import say, say_json
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
            told = printable(f"{each.verdict.message}{remedy}", LONGEST_LINE)
            say(f"{each.verdict.state.value:8} {each.name:10} {told}")
        say(_conclusion(len(problems), len(warnings)))
    if problems:
        raise typer.Exit(1)


def _conclusion(problems: int, warnings: int) -> str:
    counts = [
        f"{count} {noun}{'s' if count > 1 else ''}"
        for count, noun in ((problems, "problem"), (warnings, "warning"))
        if count
    ]
    return " and ".join(counts) or "nothing stands in the way"
