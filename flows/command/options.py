"""What options of the command line may be: one of a few words, and given once unless they may be repeated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand

from flows.shipped import CONFIGS, SUFFIXES, names
from juicer.errors import did_you_mean

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def choice(words: Iterable[str], metavar: str = "") -> dict[str, Any]:
    """Settings of an option or argument that is one of some words: told in help, completed by shells, checked.

    Args:
        words: The words.
        metavar: What help calls it; the words themselves if left out.
    """
    known = list(words)

    def parse(text: str) -> str:
        if text not in known:
            near = did_you_mean(text, known)
            raise typer.BadParameter(f"'{text}' is none of {', '.join(known)}{near if 'mean' in near else ''}")
        return text

    def complete(incomplete: str) -> list[str]:
        return [word for word in known if word.startswith(incomplete)]

    return {"parser": parse, "metavar": metavar or f"[{'|'.join(known)}]", "autocompletion": complete}


def complete_configuration(incomplete: str) -> list[str]:
    """Configurations that come with juicer, and files and folders below the working directory."""
    found = [name for name in names(CONFIGS) if name.startswith(incomplete)]
    outer, slash, start = incomplete.rpartition("/")
    folder = Path(outer + slash)
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name.startswith(start) and (path.is_dir() or path.suffix in SUFFIXES):
            found.append(f"{outer}{slash}{path.name}{'/' if path.is_dir() else ''}")
    return found


def complete_condition(incomplete: str) -> list[str]:
    """Conditions that come with juicer; a configuration may have others."""
    from flows.conditions import defaults  # takes a moment to import

    return [name for name in defaults()["conditions"] if name.startswith(incomplete)]


class OnceCommand(TyperCommand):
    """A command that refuses an option which is given twice and counts once."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line.

        Raises:
            UsageError: If a single-valued option is there twice.
        """
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        for param, times in Counter(order).items():
            if times > 1 and not getattr(param, "multiple", False) and not getattr(param, "is_flag", False):
                ctx.fail(f"Option '{param.opts[0]}' is given {times} times and counts once.")
        return super().parse_args(ctx, args)


class CommandLine(typer.Typer):
    """An application of such commands."""

    def command(self, name: str | None = None, **settings: Any) -> Callable[[FunctionT], FunctionT]:
        """See :meth:`typer.Typer.command`."""
        return super().command(name, cls=OnceCommand, **settings)
