"""Fingerprints of Python source that ignore its words, and the imports that tie modules together."""

from __future__ import annotations

import ast
import hashlib
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from juicer.errors import ArtifactError

ASSETS = "ASSETS"
"""Name of the tuple in which a module lists the files beside it that it reads."""

_INIT = "__init__.py"
_NOTHING = ["Module", ")"]
"""What the syntax tree of a file without code says."""


@dataclass(frozen=True)
class SourceTree:
    """Source of some packages, read once: the answers stay those of the code that this process runs.

    Attributes:
        packages: Folder of each package, by name; of a single module, its file without the ending.
        plumbing: Modules and packages that imports are not followed into.
        junctions: Packages whose folders are members: what imports all of them, to know them by name, depends on none.
        sources: What has been read of files; trees that share it answer with the same state of them.
    """

    packages: Mapping[str, Path]
    plumbing: Collection[str] = ()
    junctions: Collection[str] = ()
    sources: dict[Path, Source] = field(default_factory=dict, repr=False)
    _modules: dict[str, _Module] = field(default_factory=dict, repr=False)
    _versions: dict[tuple[str, frozenset[str]], dict[str, str]] = field(default_factory=dict, repr=False)
    # Models side by side ask at the same time, and Python 3.11 cannot parse in two threads at once.
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    def versions(self, entry: str, plugins: Iterable[str] = ()) -> dict[str, str]:
        """Fingerprint of a module and of all that it imports from the packages, by dotted name, sorted.

        A package that only says what it is has nothing to count.

        Args:
            entry: The module.
            plugins: What it works with beside, without importing it by name: members of junctions, each with all that
                lies in its folder, and single modules. Members of a junction that nothing reaches are left out.

        Raises:
            ArtifactError: If the source of a module, or a file that one lists in ``ASSETS``, is not found.
        """
        key = (entry, frozenset(plugins))
        if key not in self._versions:
            self._versions[key] = self._follow(*key)
        return dict(self._versions[key])

    def _follow(self, entry: str, plugins: frozenset[str]) -> dict[str, str]:
        found: dict[str, str] = {}
        waiting = {entry, *self._resolve(_Import(entry), entry)}
        while waiting:
            name = waiting.pop()
            with self._lock:
                module = self._read(name)
            found[name] = module.version
            waiting |= {each for each in module.imports if self._is_followed(each, name)} - found.keys()
            if not waiting:
                chosen = {plugin for plugin in plugins if self._is_reached(plugin, found)}
                plugins -= chosen
                waiting = {name for plugin in chosen for name in self._modules_of(plugin)} - found.keys()
        return {name: version for name, version in sorted(found.items()) if version}

    def junction_modules(self) -> list[str]:
        """Every module of every member of the junctions, sorted."""
        inside = [module for junction in self.junctions for module in self._inside(junction)]
        return sorted(module for module in inside if self._member(module))

    def _member(self, name: str) -> str | None:
        """The member that a module belongs to."""
        for junction in self.junctions:
            if name.startswith(f"{junction}."):
                member = ".".join(name.split(".")[: junction.count(".") + 2])
                path = self._locate(member)
                return member if path and path.name == _INIT else None
        return None

    def _is_followed(self, name: str, importer: str) -> bool:
        """Whether an import leads on: not if it only makes the members of a junction known."""
        homes = {junction.partition(".")[0] for junction in self.junctions}
        names_them = importer.partition(".")[0] in homes and not self._member(importer)
        return not (names_them and self._member(name))

    def _is_reached(self, plugin: str, found: Collection[str]) -> bool:
        """Whether a plug-in can be met: a member only where the package around its junction is in use."""
        member = self._member(plugin)
        around = member.rsplit(".", 2)[0] if member else ""
        return "." not in around or any(name.startswith(f"{around}.") for name in found)

    def _modules_of(self, plugin: str) -> Iterator[str]:
        yield from self._resolve(_Import(plugin), plugin)
        yield from self._inside(plugin) if self._member(plugin) == plugin else (plugin,)

    def _inside(self, package: str) -> Iterator[str]:
        place = self._place(package)
        if place is None:
            return
        for path in place.rglob("*.py"):
            parts = path.relative_to(place).with_suffix("").parts
            yield ".".join([package, *(part for part in parts if part != "__init__")])

    def _read(self, name: str) -> _Module:
        if name not in self._modules:
            path = self._locate(name)
            if path is None:
                raise ArtifactError(f"module '{name}' has no source to compute a code version from")
            if path not in self.sources:
                self.sources[path] = Source.read(path)
            source = self.sources[path]
            package = name if path.name == _INIT else name.rpartition(".")[0]
            imports = {module for imported in source.imports for module in self._resolve(imported, package)}
            self._modules[name] = _Module(source.version, tuple(sorted(imports)))
        return self._modules[name]

    def _resolve(self, imported: _Import, package: str) -> Iterator[str]:
        """Modules that an import statement runs: the one it names, the packages around it, and submodules."""
        name = imported.module
        if imported.level:
            parents = package.split(".")[: package.count(".") + 2 - imported.level]
            name = ".".join([*parents, name] if name else parents)
        for candidate in (name, *(f"{name}.{part}" for part in imported.names)):
            if self._is_plumbing(candidate):
                continue
            parts = candidate.split(".")
            # The outermost package is left out: it holds the release number.
            for count in range(2, len(parts) + 1):
                module = ".".join(parts[:count])
                if self._locate(module):
                    yield module

    def _is_plumbing(self, name: str) -> bool:
        return any(name == part or name.startswith(f"{part}.") for part in self.plumbing)

    def _locate(self, name: str) -> Path | None:
        place = self._place(name)
        if place is None:
            return None
        candidates = (place / _INIT, place.with_suffix(".py"))
        return next((path for path in candidates if path.is_file()), None)

    def _place(self, name: str) -> Path | None:
        root, *parts = name.split(".")
        return self.packages[root].joinpath(*parts) if root in self.packages else None


@dataclass(frozen=True)
class Source:
    """What counts of a file.

    Attributes:
        version: Its fingerprint; empty if it holds no code.
        imports: Its import statements.
    """

    version: str
    imports: tuple[_Import, ...]

    @classmethod
    def read(cls, path: Path) -> Source:
        """Read a file.

        Raises:
            ArtifactError: If a file that it lists in ``ASSETS`` is not there.
        """
        walk = _Walk()
        walk.visit(ast.parse(path.read_bytes(), filename=str(path)))
        content = [*walk.tokens, *_asset_lines(path, walk.assets)]
        version = "" if content == _NOTHING else digest("\n".join(content).encode())
        return cls(version, tuple(walk.imports))


@dataclass(frozen=True)
class _Module:
    version: str
    imports: tuple[str, ...]


@dataclass(frozen=True)
class _Import:
    module: str
    names: tuple[str, ...] = ()
    level: int = 0


@dataclass
class _Walk:
    """One pass over a syntax tree; written out because :func:`ast.dump` takes three times as long.

    Attributes:
        tokens: What the tree says, whatever the Python version: without position, comment or docstring.
        imports: Import statements that are executed, wherever they stand.
        assets: File patterns listed in ``ASSETS``.
    """

    tokens: list[str] = field(default_factory=list)
    imports: list[_Import] = field(default_factory=list)
    assets: tuple[str, ...] = ()

    def visit(self, node: ast.AST) -> None:
        """Take in a node and all below it."""
        if isinstance(node, ast.If) and _is_type_checking(node.test):
            self._visit_all(node.orelse)
            return
        self._note(node)
        self.tokens.append(type(node).__name__)
        for name in node._fields:
            value = getattr(node, name, None)
            if isinstance(value, list):
                value = [item for item in value if not _is_idle(item)]
            # Fields that are absent leave no trace, so that a field which a newer Python adds does not count.
            if value is None or value == [] or name == "ctx":
                continue
            self.tokens.append(name)
            if isinstance(value, ast.AST):
                self.visit(value)
            elif isinstance(value, list):
                self._visit_all(value)
            else:
                self.tokens.append(repr(value))
        self.tokens.append(")")

    def _visit_all(self, items: Sequence[ast.AST | str | None]) -> None:
        for item in items:
            if isinstance(item, ast.AST):
                self.visit(item)
            else:
                self.tokens.append(repr(item))

    def _note(self, node: ast.AST) -> None:
        if isinstance(node, ast.Import):
            self.imports += [_Import(alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = tuple(alias.name for alias in node.names)
            self.imports.append(_Import(node.module or "", names, node.level))
        elif isinstance(node, ast.Assign) and any(_is_name(target, ASSETS) for target in node.targets):
            self.assets = tuple(ast.literal_eval(node.value))


def digest(content: bytes) -> str:
    """16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:16]


def _asset_lines(module: Path, patterns: tuple[str, ...]) -> Iterator[str]:
    for pattern in patterns:
        paths = sorted(path for path in module.parent.glob(pattern) if path.is_file())
        if not paths:
            raise ArtifactError(f"asset '{pattern}' declared in '{module}' does not exist")
        for path in paths:
            yield f"{path.relative_to(module.parent).as_posix()} {digest(path.read_bytes())}"


def _is_idle(node: object) -> bool:
    """Whether an item of a block does nothing: a docstring, or ``pass`` in its place."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return isinstance(node, ast.Pass)


def _is_type_checking(test: ast.expr) -> bool:
    return _is_name(test, "TYPE_CHECKING") or (isinstance(test, ast.Attribute) and test.attr == "TYPE_CHECKING")


def _is_name(node: ast.expr, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name
