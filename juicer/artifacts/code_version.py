"""Version of the code behind a stage: the source it runs, followed through its imports, without the words about it."""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType

from juicer.artifacts.junctions import JUNCTIONS, OURS
from juicer.artifacts.source_tree import Source, SourceTree, digest
from juicer.errors import ArtifactError

PLUMBING = (
    "juicer.announced",
    "juicer.artifacts",
    "juicer.config",
    "juicer.errors",
    "juicer.policy.pretrained.files",
    "juicer.policy.pretrained.known",
    "juicer.problems",
    "juicer.progress",
    "juicer.reading",
    "juicer.tasks.checks",
    "juicer.tasks.content",
    "juicer.tasks.discovery",
    "juicer.tasks.task_name",
    "juicer.text",
    "juicer.yaml_reading",
    "stages.runtime",
    "stages.tracking",
)
"""Modules that carry results, or what recipes hold anyway (configuration, the content of tasks), without shaping them.

A change there must not invalidate hours of work.
"""


def code_version(entry: ModuleType | str, plugins: Iterable[str] = ()) -> str:
    """Hash of a module and of every first-party module it imports, directly or not.

    Comments, docstrings, layout and imports for type checking do not count; imports within functions do.
    The source is read once a process, so that the answer stays that of the code which runs.

    Args:
        entry: The module, or its dotted name.
        plugins: What it works with beside, see :func:`juicer.artifacts.junctions.plugins_in`.

    Raises:
        ArtifactError: If the source, or a file that a module lists in ``ASSETS``, is not found.
    """
    return version_of(module_versions(entry, plugins))


def version_of(modules: Mapping[str, str]) -> str:
    """Hash of the versions of modules, by name, as one."""
    return digest("\n".join(f"{name} {version}" for name, version in sorted(modules.items())).encode())


def module_versions(entry: ModuleType | str, plugins: Iterable[str] = ()) -> dict[str, str]:
    """Hash of each module behind :func:`code_version`, by dotted name, sorted.

    A module that assigns a literal tuple of file patterns to ``ASSETS`` is hashed together with those files,
    which lie beside it.

    Raises:
        ArtifactError: If the source, or a file that a module lists in ``ASSETS``, is not found.
    """
    name = entry if isinstance(entry, str) else entry.__name__
    plugins = frozenset(plugins)
    packages = {_package_of(each) for each in (name, *plugins)}
    return _source_tree(frozenset(packages)).versions(name, plugins)


def junction_modules() -> list[str]:
    """Every module of every member of the junctions, sorted."""
    return _source_tree(frozenset()).junction_modules()


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
    return _source_tree(frozenset({package})).packages[package]


def _package_of(module: str) -> str:
    return module.partition(".")[0]


_SOURCES: dict[Path, Source] = {}
"""Every file is read once a process."""


@functools.cache
def _source_tree(packages: frozenset[str]) -> SourceTree:
    """Source of some packages and of ours."""
    places = {name: place for name in {*OURS, *packages} if (place := _place_of(name))}
    return SourceTree(places, PLUMBING, JUNCTIONS, _SOURCES)


@functools.cache
def _place_of(package: str) -> Path | None:
    """Folder of a package; of a single module, its file without the ending."""
    spec = importlib.util.find_spec(package)
    if spec is not None and spec.submodule_search_locations:
        return Path(spec.submodule_search_locations[0])
    return Path(spec.origin).with_suffix("") if spec is not None and spec.origin else None
