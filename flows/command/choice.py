"""Which configuration a command is about, and which part of it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from juicer.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from flows.config import RunConfig
    from flows.written import Written


@dataclass(frozen=True)
class Choice:
    """A configuration, and which part of it is meant: all of it where nothing is said.

    Attributes:
        source: A file, or the name of a configuration that comes with juicer.
        overrides: Values that go first, as ``dotted.key=value``.
        tasks: Some of its tasks.
        conditions: Some of its conditions.
        seeds: Some of its seeds.
    """

    source: str
    overrides: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()

    @classmethod
    def of(
        cls,
        source: str,
        overrides: Sequence[str] | None,
        tasks: Sequence[str] | None,
        conditions: Sequence[str] | None,
        seeds: Sequence[int] | None,
    ) -> Choice:
        """From the options of a command.

        Raises:
            ConfigError: If something is chosen twice.
        """
        for name, words in {"--task": tasks, "--condition": conditions, "--seed": seeds}.items():
            if words and len(set(words)) < len(words):
                raise ConfigError(f"{name}: each may be given only once, got {', '.join(map(str, words))}")
        return cls(source, tuple(overrides or ()), tuple(tasks or ()), tuple(conditions or ()), tuple(seeds or ()))

    def as_arguments(self) -> str:
        """What a command line must say to choose the same again."""
        chosen = {"--set": self.overrides, "--task": self.tasks, "--condition": self.conditions, "--seed": self.seeds}
        options = [word for option, values in chosen.items() for value in values for word in (option, str(value))]
        return shlex.join([self.source, *options])

    @cached_property
    def _whole(self) -> tuple[Written, tuple[RunConfig, ...]]:
        """What was written, and the runs that it describes."""
        from flows.reading import read_written
        from flows.runs import runs_of

        written = read_written(self.source, self.overrides)
        return written, runs_of(written, str(self.source))

    def written(self) -> Written:
        """What was written of the chosen part.

        A model for several tasks needs all of them, whichever it is evaluated on: they stay in it then.

        Raises:
            ConfigError: As :meth:`runs` does.
        """
        from flows.command.narrowing import with_conditions, with_model, with_seeds, with_tasks
        from flows.config import StudyConfig
        from flows.written import TASKS_KEY, settled

        part = self.runs()
        written, whole = self._whole
        if self.tasks and written.values.get(TASKS_KEY) and not any(run.is_joint for run in part):
            written = with_tasks(written, self.tasks)
            whole = tuple(run for run in whole if run.task in self.tasks)
        studies = [run for run in whole if isinstance(run, StudyConfig)]
        if not studies:
            return settled(with_model(written, self.conditions, self.seeds))
        if self.conditions:
            written = with_conditions(written, studies, self.conditions)
        if self.seeds:
            written = with_seeds(written, studies, self.seeds)
        return settled(written)

    def runs(self) -> list[RunConfig]:
        """The chosen part, one run a task.

        Raises:
            ConfigError: If the configuration is not valid, or has no such part.
        """
        from flows.config import StudyConfig
        from flows.written import TASKS_KEY

        written, whole = self._whole
        known = [run.task for run in whole]
        for task in self.tasks:
            if task not in known:
                is_of_one = not written.values.get(TASKS_KEY)
                remedy = f"; --set task={task} makes it one of that task" if is_of_one else did_you_mean(task, known)
                raise ConfigError(f"the configuration has no task '{task}'{remedy}")
        chosen = [run for run in whole if not self.tasks or run.task in self.tasks]
        studies = [run for run in chosen if isinstance(run, StudyConfig)]
        for name in self.conditions:
            having = [run.task for run in studies if name in run.conditions]
            without = [run.task for run in studies if run.task not in having]
            if having and without:
                options = " ".join(f"--task {task}" for task in having)
                raise ConfigError(f"task {without[0]} has no condition '{name}'; add {options}, which has it")
        return [run.narrowed(self.conditions, self.seeds) for run in chosen]
