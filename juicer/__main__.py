"""Starts the ``juicer`` command so that it runs its own code, wherever and from whatever environment it is started.

``flows`` and ``stages`` are names that other projects use too. In a repository they lie beside this package; in a
wheel they lie below it, where nobody else's imports find them. Either way their folder is put in front of all others,
here and in every process that this one starts, and the working directory is not searched for modules at all.
"""

from __future__ import annotations

import importlib
import os
import sys
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("flows", "stages")
"""What only the command needs; whoever imports ``juicer`` as a library does not."""

_BUNDLE = "bundle"


def main() -> None:
    """Entry point of the command; see :func:`flows.command.cli.main` for its exit status."""
    _open_standard_streams()
    try:
        Path.cwd()
    except FileNotFoundError:
        sys.exit("juicer: the working directory no longer exists; change to one that does")
    home = home_of_packages()
    _search_first(home)
    if problem := _intruder(home):
        sys.exit(f"juicer: {problem}")
    # By name: this package knows nothing of the command but where it is.
    importlib.import_module("flows.command.cli").main()


def home_of_packages() -> Path:
    """Folder that holds the packages ``flows`` and ``stages``, and the configurations that come with juicer."""
    package = Path(__file__).resolve().parent
    bundle = package / _BUNDLE
    return bundle if bundle.is_dir() else package.parent


def _search_first(home: Path) -> None:
    """Let imports find what is in ``home`` before anything else, in this process and in those that it starts."""
    entries = sys.path[1:] if _begins_with_working_directory() else sys.path
    others = [entry for entry in entries if entry and entry != str(home)]
    sys.path[:] = [str(home), *others]
    inherited = [str(Path(entry).absolute()) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    os.environ["PYTHONPATH"] = os.pathsep.join([str(home), *(entry for entry in inherited if entry != str(home))])
    # `python -m` and `python -c`, by which servers and workers start, search the working directory first otherwise.
    os.environ["PYTHONSAFEPATH"] = "1"


def _begins_with_working_directory() -> bool:
    return not sys.flags.safe_path and bool(sys.path) and sys.path[0] in ("", str(Path.cwd()))


def _intruder(home: Path) -> str | None:
    """Sentence about a package that stands before one of ours in spite of all, if there is one."""
    for name in PACKAGES:
        spec = find_spec(name)
        found = Path(spec.origin).parent if spec is not None and spec.origin else None
        if found is None or found.resolve() != (home / name).resolve():
            where = f"'{found}' is found in its place" if found else "it is not there"
            return (
                f"its package '{name}' should be in '{home}', but {where}; "
                "take that out of PYTHONPATH or of this environment, or install juicer again"
            )
    return None


def _open_standard_streams() -> None:
    """Open what the caller has closed, lest the next file that is opened be taken for standard output."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is taken, which is this one.
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115 (open as long as the process)


if __name__ == "__main__":
    main()
