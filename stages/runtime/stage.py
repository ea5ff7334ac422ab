"""The ``@stage`` decorator: a function from artifacts to one artifact becomes a content-addressed Prefect task.

A stage body takes a :class:`StageContext` and keyword arguments, and fills ``context.draft``. It does not look
things up, cache, retry, name paths or talk to MLflow; that is done here, once for all stages. Its arguments are

* :class:`~juicer.artifacts.ref.ArtifactRef`, or tuples of them: the inputs, by role;
* one :class:`~juicer.config.StrictConfig` named ``config``;
* :class:`pathlib.Path`, or tuples of them: files from outside the store, identified by their content.

All of them, the code behind the body and the versions of the libraries it names make the recipe, whose hash is the
id of the artifact. If the store has that id, the body does not run.

Tasks and plug-ins are not code that a body imports: a call concerns those that its configuration names and those that
its inputs were made of, and no others.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Concatenate, Generic, ParamSpec, Protocol, get_origin, get_type_hints

from juicer.artifacts.code_version import home_of, library_versions, module_versions, version_of
from juicer.artifacts.junctions import is_plugin, plugins_in
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.errors import ForeignCode, WrongArtifactKind
from juicer.tasks.content import task_content
from juicer.tasks.task_name import tasks_in
from stages.runtime.context import StageContext
from stages.runtime.facts import Need, StageFacts
from stages.runtime.given_files import describe_files

P = ParamSpec("P")
CONFIG = "config"


class StageCall:
    """A stage with its arguments and the recipe they make. Not a dataclass, so that Prefect does not search it.

    Pickled, it is data only: where it arrives, the stage is imported when it is asked for.
    """

    def __init__(self, stage: Stage[Any], arguments: Mapping[str, Any], recipe: Recipe) -> None:
        """Bring the three together; use :meth:`Stage.prepare`."""
        self.stage = stage
        self.module = stage.body.__module__
        self.arguments = arguments
        self.recipe = recipe

    @cached_property
    def stage(self) -> Stage[Any]:
        """What is called."""
        stage: Stage[Any] = getattr(importlib.import_module(self.module), self.recipe.stage)
        return stage

    def __getstate__(self) -> dict[str, Any]:
        """All but the stage."""
        return {name: value for name, value in vars(self).items() if name != "stage"}


class Origins(Protocol):
    """Knows what artifacts are made of, also those that are not made yet."""

    def recipe(self, ref: ArtifactRef) -> Recipe:
        """What an artifact is made of."""
        ...


class Caller(Origins, Protocol):
    """Has stage calls made."""

    def perform(self, call: StageCall) -> ArtifactRef:
        """Make the artifact of a call, or find it in the store."""
        ...


class Stage(Generic[P]):
    """A stage: call it with who has it made and its inputs to get the reference of its artifact."""

    def __init__(
        self,
        body: Callable[Concatenate[StageContext, P], None],
        kind: str,
        inputs: Mapping[str, str],
        libraries: tuple[str, ...],
        facts: StageFacts,
    ) -> None:
        """Wrap a body; see :func:`stage`."""
        self.name = body.__name__
        self.kind = kind
        self.body = body
        self.description = (body.__doc__ or "").strip().partition("\n")[0]
        self.facts = facts
        self._inputs = dict(inputs)
        self._libraries = libraries

    def __call__(self, caller: Caller, *args: P.args, **kwargs: P.kwargs) -> ArtifactRef:
        """Make the artifact, or find it in the store.

        Raises:
            WrongArtifactKind: If an input is of another kind than the stage reads.
            ConfigError: If a file from outside the store cannot be read.
        """
        return caller.perform(self.prepare(caller, *args, **kwargs))

    def prepare(self, origins: Origins, *args: P.args, **kwargs: P.kwargs) -> StageCall:
        """Everything about a call except its execution.

        Args:
            origins: Who knows what the inputs are made of.
            args: None.
            kwargs: The body's arguments.

        Raises:
            WrongArtifactKind: If an input is of another kind than the stage reads.
            ConfigError: If a file from outside the store cannot be read.
        """
        if args:
            raise TypeError(f"stage '{self.name}' takes its inputs by keyword")
        return StageCall(self, dict(kwargs), self._recipe(origins, kwargs))

    @cached_property
    def config_model(self) -> type[StrictConfig]:
        """Class of the body's ``config``."""
        model: type[StrictConfig] = get_type_hints(self.body)[CONFIG]
        return model

    def takes_many(self, role: str) -> bool:
        """Whether a role of the body's arguments is a tuple."""
        return get_origin(get_type_hints(self.body)[role]) is tuple

    def _recipe(self, origins: Origins, arguments: Mapping[str, Any]) -> Recipe:
        inputs: dict[str, tuple[ArtifactRef, ...]] = {}
        for role, value in arguments.items():
            items = value if isinstance(value, tuple) else (value,)
            if role == CONFIG or value is None or not items:
                continue
            if all(isinstance(item, ArtifactRef) for item in items):
                self._check_kinds(role, items)
                inputs[role] = items
            elif not all(isinstance(item, Path) for item in items):
                raise TypeError(f"stage '{self.name}': '{role}' must be artifacts or paths, got {value!r}")
        config, module = arguments[CONFIG], self.body.__module__
        sources = [origins.recipe(ref) for refs in inputs.values() for ref in refs]
        own = plugins_in(config) - module_versions(module).keys()
        modules = module_versions(module, own.union(*(source.plugins for source in sources)))
        tasks = tasks_in(config).union(*(source.tasks for source in sources))
        return Recipe(
            stage=self.name,
            kind=self.kind,
            inputs=inputs,
            config=config.model_dump(mode="json"),
            code=version_of(modules),
            files=self.describe_files(arguments),
            libraries=library_versions(self._libraries),
            modules=modules,
            plugins=tuple(sorted(own)),
            tasks={name: task_content(name, modules) for name in sorted(tasks)},
        )

    def describe_files(self, arguments: Mapping[str, Any]) -> dict[str, str]:
        """Contents of the files among the arguments, as a recipe names them.

        Raises:
            ConfigError: If one cannot be read.
        """
        described: dict[str, str] = {}
        for role, value in arguments.items():
            items = value if isinstance(value, tuple) else (value,)
            if items and all(isinstance(item, Path) for item in items):
                described |= describe_files(role, items, one_of_many=isinstance(value, tuple))
        return described

    def _check_kinds(self, role: str, refs: tuple[ArtifactRef, ...]) -> None:
        expected = self._inputs[role]
        for ref in refs:
            if ref.kind != expected:
                raise WrongArtifactKind(
                    f"{ref} is of kind '{ref.kind}' but stage '{self.name}' needs '{expected}' for its {role}; "
                    f"see `juicer ls {expected}`"
                )


def unlike_recipe(module: str, recipe: Recipe) -> list[str]:
    """Modules and tasks that are other ones in this process than a recipe names.

    Args:
        module: Where the body of the recipe's stage is.
        recipe: What is to be made here.
    """
    plugins = [name for name in recipe.modules if is_plugin(name)]
    modules = module_versions(module, plugins)
    changed = sorted({name for name, _ in modules.items() ^ recipe.modules.items()})
    tasks = {name: task_content(name, modules) for name in recipe.tasks}
    return changed + [f"task {name}" for name, content in recipe.tasks.items() if tasks[name] != content]


def check_code(call: StageCall) -> None:
    """Refuse to make an artifact with other code, or other tasks, than those its recipe names.

    Raises:
        ForeignCode: Naming what differs.
    """
    changed = unlike_recipe(call.module, call.recipe)
    if changed:
        raise ForeignCode(
            f"stage '{call.recipe.stage}' would run other code than its artifact is to be known by ({changed[0]} in "
            f"'{home_of(call.module)}' differs): it was edited while the run started, or another copy of juicer stands "
            "before this one; run the command again, and see that PYTHONPATH names no other copy"
        )


def stage(
    *,
    kind: str,
    inputs: Mapping[str, str] | None = None,
    libraries: tuple[str, ...] = (),
    noun: str = "",
    counts: str = "",
    headline: tuple[str, ...] = (),
    needs: Need | None = None,
) -> Callable[[Callable[Concatenate[StageContext, P], None]], Stage[P]]:
    """Turn a function from artifacts to one artifact into a stage.

    Args:
        kind: Kind of the artifact that the body makes; it also decides what the artifact is in MLflow.
        inputs: Kind that each of its inputs must be of, by role.
        libraries: Distributions whose version shapes the result.
        noun: What its artifact holds, in the plural, e.g. ``rollouts``.
        counts: Fact of the summary that says how many.
        headline: Facts of the summary that are worth a place on one line, in this order.
        needs: What of the machine it must have to itself while it works.
    """
    facts = StageFacts(noun, counts, headline, needs)

    def decorate(body: Callable[Concatenate[StageContext, P], None]) -> Stage[P]:
        return Stage(body, kind, inputs or {}, libraries, facts)

    return decorate
