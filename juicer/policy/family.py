"""Families of interchangeable networks: what a configuration calls by its ``kind``, ours or an installed package's."""

from __future__ import annotations

import importlib
import logging
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar, Union

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from juicer.announced import announced, origin_of
from juicer.config import StrictConfig
from juicer.text import printable

logger = logging.getLogger(__name__)


class MemberConfig(StrictConfig):
    """Configuration of a member of a family.

    Attributes:
        kind: Name within the family: a literal with itself as default.
        network: What is built of it, as ``module:class``. It is imported when the network is built, so that reading a
            configuration needs no torch.
    """

    kind: str
    network: ClassVar[str]

    def network_class(self) -> Any:
        """The class behind :attr:`network`."""
        return pkgutil.resolve_name(self.network)


MemberT = TypeVar("MemberT", bound=MemberConfig)


@dataclass(frozen=True)
class Family(Generic[MemberT]):
    """Configurations that can stand in one place and are told apart by their ``kind``.

    A member of ours is a folder of the package with a ``config.py``. Anybody else's is named by an entry point: the
    group is the family's, the value ``module:ConfigClass``. Neither is listed anywhere.

    Attributes:
        base: Class of their configurations.
        package: Where ours are.
        group: Entry points of those that other packages install.
    """

    base: type[MemberT]
    package: str
    group: str

    @cached_property
    def members(self) -> dict[str, type[MemberT]]:
        """Class of every configuration by its kind; ours first, which nobody can replace."""
        found: dict[str, type[MemberT]] = {}
        for origin, config in [*self._own(), *self._installed()]:
            kind = config.model_fields["kind"].default
            if found.setdefault(kind, config) is not config:
                logger.warning("%s is left out: there is another '%s' in %s", origin, printable(kind), self.package)
        return found

    def choice(self) -> Any:
        """Annotation of a field that holds one of them, chosen by ``kind``."""
        return Union[tuple(self.members.values())]  # noqa: UP007 (of a tuple that is known when the program runs)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """A union told apart by ``kind``, which must be said even while there is only one member."""
        choices = {kind: handler.generate_schema(config) for kind, config in self.members.items()}
        return core_schema.tagged_union_schema(choices, discriminator="kind")

    def _own(self) -> Iterator[tuple[str, type[MemberT]]]:
        package = importlib.import_module(self.package)
        for found in sorted(pkgutil.iter_modules(package.__path__), key=lambda found: found.name):
            name = f"{self.package}.{found.name}.config"
            for value in vars(importlib.import_module(name)).values():
                if isinstance(value, type) and issubclass(value, self.base) and value.__module__ == name:
                    yield name, value

    def _installed(self) -> Iterator[tuple[str, type[MemberT]]]:
        for entry in announced(self.group).values():
            origin = f"{self.group}: {origin_of(entry)}"
            try:
                config = entry.load()
            except Exception as error:  # whatever a stranger's module may raise
                logger.warning("%s is left out: %s: %s", origin, type(error).__name__, printable(error))
                continue
            if isinstance(config, type) and issubclass(config, self.base) and config is not self.base:
                yield origin, config
            else:
                logger.warning("%s is left out: it is not a subclass of %s", origin, self.base.__name__)
