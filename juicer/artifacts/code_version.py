"""Version of the code behind a stage: the source it runs, followed through its imports, without the words about it."""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

from juicer.artifacts.source_tree import SourceTree, digest
from juicer.errors import ArtifactError

FIRST_PARTY = ("juicer", "stages")
"""Packages whose source counts, beside the one that a stage itself is in; all else counts by its version, see
:func:`library_versions`."""

PLUMBING = (
    "juicer.artifacts",
    "juicer.config",
    "juicer.errors",
    "juicer.problems",
    "juicer.progress",
    "juicer.reading",
    "juicer.text",
    "juicer.yaml_reading",
    "stages.runtime.context",
    "stages.runtime.execution",
    "stages.runtime.facts",
    "stages.runtime.given_files",
    "stages.runtime.isolation",
    "stages.runtime.loaded_code",
    "stages.runtime.machine",
    "stages.runtime.session",
    "stages.runtime.socket_folder",
    "stages.runtime.stage",
    "stages.tracking",
)
"""Modules that carry results, or configuration that recipes hold anyway, without shaping them.

A change there must not invalidate hours of work.
"""


def code_version(entry: ModuleType | str) -> str:
    """Hash of a module and of every first-party module it imports, directly or not.

    Comments, docstrings, layout and imports for type checking do not count; imports within functions do.
    The source is read once a process, so that the answer stays that of the code which runs.

    Args:
        entry: The module, or its dotted name.

    Raises:
        ArtifactError: If the source, or a file that a module lists in ``ASSETS``, is not found.
    """
    return digest("\n".join(f"{name} {version}" for name, version in module_versions(entry).items()).encode())


def module_versions(entry: ModuleType | str) -> dict[str, str]:
    """Hash of each module behind :func:`code_version`, by dotted name, sorted.

    A module that assigns a literal tuple of file patterns to ``ASSETS`` is hashed together with those files,
    which lie beside it.

    Raises:
        ArtifactError: If the source, or a file that a module lists in ``ASSETS``, is not found.
    """
    name = entry if isinstance(entry, str) else entry.__name__
    return _source_tree(_package_of(name)).versions(name)


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """Installed version of each distribution.

    Raises:
        ArtifactError: If one is not installed.
    """
    return {name: _library_version(name) for name in sorted(names)}


@functools.cache
def _library_version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        raise ArtifactError(f"library '{name}' is not installed; install juicer with its dependencies") from None


def home_of(module: str) -> Path:
    """Folder of the package that a module is in."""
    package = _package_of(module)
    return _source_tree(package).packages[package]


def _package_of(module: str) -> str:
    return module.partition(".")[0]


@functools.cache
def _source_tree(package: str) -> SourceTree:
    """Source of a package and of ours."""
    specs = {name: importlib.util.find_spec(name) for name in {*FIRST_PARTY, package}}
    folders = {
        name: Path(spec.submodule_search_locations[0])
        for name, spec in specs.items()
        if spec is not None and spec.submodule_search_locations
    }
    return SourceTree(folders, PLUMBING)
