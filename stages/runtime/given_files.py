"""Files from outside the store that a stage is given: their names and contents are part of its recipe."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from juicer.errors import ConfigError
from juicer.reading import UnsuitableFile, open_plain
from juicer.text import printable

MOST_BYTES = 2**30
"""Largest file that a stage may be given."""

UNREADABLE = "unreadable: "
"""What stands in a recipe in place of a content that cannot be had, followed by the reason."""

_LONGEST_NAME = 255


def describe_files(role: str, paths: tuple[Path, ...], *, one_of_many: bool) -> dict[str, str]:
    """SHA-256 of each file by its label in the recipe.

    Where a stage takes many files of a role, one that is there but cannot be read is for the stage to judge: it goes
    into the recipe with the reason in place of its content.

    Args:
        role: Argument of the stage.
        paths: The files.
        one_of_many: Whether the stage takes many of them.

    Raises:
        ConfigError: If two have one name, or one is missing, or cannot be read and is not one of many.
    """
    labels = [f"{role}/{printable(path.name, _LONGEST_NAME)}" for path in paths]
    label, count = Counter(labels).most_common(1)[0]
    if count > 1:
        name = label.removeprefix(f"{role}/")
        raise ConfigError(f"two of the {role} are named '{name}'; give each its own name")
    return {label: _describe(path, one_of_many) for label, path in zip(labels, paths, strict=True)}


def check_unchanged(before: Mapping[str, str], after: Mapping[str, str]) -> None:
    """Refuse a result if a file changed while the stage was at work: it would not be the recipe's.

    Raises:
        ConfigError: Naming the first file that did.
    """
    for label, digest in before.items():
        if after.get(label) != digest:
            raise ConfigError(f"file '{label.partition('/')[2]}' changed while it was read; run it again")


def _describe(path: Path, one_of_many: bool) -> str:
    try:
        with open_plain(path) as file:
            if os.fstat(file.fileno()).st_size > MOST_BYTES:
                raise UnsuitableFile(path, f"it is larger than {MOST_BYTES:,} bytes")
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        if isinstance(error, FileNotFoundError) and not path.is_symlink():
            raise ConfigError(f"file '{printable(path)}' does not exist") from None
        reason = error.strerror or type(error).__name__
        if one_of_many:
            return UNREADABLE + reason
        raise ConfigError(f"file '{printable(path)}' cannot be read: {reason}") from None
