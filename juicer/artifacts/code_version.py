"""Version of the code behind a stage: the source it runs, followed through its imports, without the words about it."""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.metadata
import importlib.util
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType

from juicer.errors import ArtifactError

FIRST_PARTY = ("juicer", "stages")
"""Packages whose source counts; all else counts by its version, see :func:`library_versions`."""

PLUMBING = ("juicer.artifacts", "juicer.errors", "juicer.progress", "stages.stage", "stages.tracking")
"""Modules and packages that carry results without shaping them: a change there must not invalidate hours of work."""


def code_version(entry: ModuleType | str) -> str:
    """Hash of a module and of every first-party module it imports, directly or not.

    Comments, docstrings, layout and imports for type checking do not count; imports within functions do.
    The code is read once a process, so the answer stays that of the code which runs.

    Args:
        entry: The module, or its dotted name.

    Raises:
        ArtifactError: If the source or an asset that a module declares is not found.
    """
    modules = module_versions(entry)
    return _digest("\n".join(f"{name} {version}" for name, version in modules.items()).encode())


def module_versions(entry: ModuleType | str) -> Mapping[str, str]:
    """Hash of each module behind :func:`code_version`, by dotted name, sorted.

    A module that assigns a literal tuple of file patterns to ``ASSETS`` is hashed together with those files,
    which lie beside it.

    Raises:
        ArtifactError: If the source or an asset that a module declares is not found.
    """
    found: dict[str, str] = {}
    waiting = [entry if isinstance(entry, str) else entry.__name__]
    while waiting:
        name = waiting.pop()
        if name not in found and not _is_plumbing(name):
            source = _read(name)
            if source is None:
                raise ArtifactError(f"module '{name}' has no source to compute a code version from")
            found[name], imports = source
            waiting += imports
    return dict(sorted(found.items()))


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """Installed version of each distribution.

    Raises:
        ArtifactError: If one is not installed.
    """
    try:
        return {name: importlib.metadata.version(name) for name in sorted(names)}
    except importlib.metadata.PackageNotFoundError as error:
        raise ArtifactError(f"library '{error.name}' is not installed; install juicer's dependencies") from None


def _is_plumbing(name: str) -> bool:
    return any(name == part or name.startswith(f"{part}.") for part in PLUMBING)


@functools.cache
def _read(name: str) -> tuple[str, tuple[str, ...]] | None:
    """Version of one module and the first-party modules it imports; none if there is no such module."""
    path = _source_path(name)
    if path is None:
        return None
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    tree = ast.parse(path.read_bytes(), filename=str(path))
    scan = _Scan(package)
    scan.visit(tree)
    assets = [asset for pattern in scan.assets for asset in _assets(path, pattern)]
    payload = ast.dump(tree) + "".join(f"\n{asset.name} {_digest(asset.read_bytes())}" for asset in assets)
    return _digest(payload.encode()), tuple(sorted(scan.imports))


@functools.cache
def _source_path(name: str) -> Path | None:
    root, *parts = name.split(".")
    if root not in FIRST_PARTY:
        return None
    spec = importlib.util.find_spec(root)
    for folder in (spec.submodule_search_locations or []) if spec else []:
        place = Path(folder, *parts)
        for candidate in (place.with_suffix(".py") if parts else place / "__init__.py", place / "__init__.py"):
            if candidate.is_file():
                return candidate
    return None


def _assets(module: Path, pattern: str) -> list[Path]:
    found = sorted(path for path in module.parent.glob(pattern) if path.is_file())
    if not found:
        raise ArtifactError(f"asset '{pattern}' declared in '{module}' does not exist")
    return found


class _Scan(ast.NodeVisitor):
    """Strips a tree of its docstrings and type-checking blocks, and collects its imports and assets."""

    def __init__(self, package: str) -> None:
        self.imports: set[str] = set()
        self.assets: tuple[str, ...] = ()
        self._package = package

    def generic_visit(self, node: ast.AST) -> None:
        for block in ("body", "orelse", "finalbody"):
            statements = getattr(node, block, None)
            if isinstance(statements, list):
                setattr(node, block, list(_without_words(statements)))
        super().generic_visit(node)

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            self._add(alias.name)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        parents = self._package.split(".")[: len(self._package.split(".")) - node.level + 1] if node.level else []
        base = ".".join([*parents, *([node.module] if node.module else [])])
        self._add(base)
        for alias in node.names:
            if _source_path(f"{base}.{alias.name}"):
                self._add(f"{base}.{alias.name}")

    def visit_Assign(self, node: ast.Assign) -> None:
        if any(isinstance(target, ast.Name) and target.id == "ASSETS" for target in node.targets):
            self.assets = tuple(ast.literal_eval(node.value))
        self.generic_visit(node)

    def _add(self, name: str) -> None:
        # Importing a module runs the packages around it; only the outermost is left out: it holds the release number.
        parts = name.split(".")
        names = (".".join(parts[:count]) for count in range(2, len(parts) + 1))
        self.imports.update(name for name in names if _source_path(name))


def _without_words(statements: list[ast.stmt]) -> Iterator[ast.stmt]:
    for statement in statements:
        if (
            isinstance(statement, ast.Expr)
            and isinstance(statement.value, ast.Constant)
            and isinstance(statement.value.value, str)
        ):
            continue
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.dump(statement.test):
            yield from _without_words(statement.orelse)
            continue
        yield statement


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
