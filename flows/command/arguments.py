"""Arguments and options that several commands have, or that take many words to declare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flows.command.options import choice, complete_condition, complete_configuration
from flows.shipped import CONFIGS, names
from juicer.tasks.registry import TASK_NAMES
from stages.runtime.names import STAGES

_CONFIGURATION = f"File of a configuration, or the name of one that comes along: {', '.join(names(CONFIGS))}."
Configuration = Annotated[
    str, typer.Argument(metavar="CONFIG", help=_CONFIGURATION, autocompletion=complete_configuration)
]
ConfigFile = Annotated[
    str,
    typer.Option("--config", "-c", metavar="CONFIG", help=_CONFIGURATION, autocompletion=complete_configuration),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        "-s",
        metavar="KEY=VALUE",
        help="Change a value of the configuration, e.g. --set evaluate.episodes=200 or --set 'seeds=[0, 1]'; "
        "see `juicer config`. Repeatable.",
    ),
]
AnalysisOverrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        "-s",
        metavar="KEY=VALUE",
        help="Change a value of the analysis or of its rollouts, e.g. --set randomness=med or "
        "--set evaluate.episodes=50. Repeatable.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
Conditions = Annotated[
    list[str] | None,
    typer.Option(
        "--condition",
        metavar="NAME",
        help="Only this condition of a study, e.g. ta_ci; its configuration names them. Repeatable.",
        autocompletion=complete_condition,
    ),
]
Seeds = Annotated[list[int] | None, typer.Option("--seed", min=0, help="Only this seed of a study. Repeatable.")]
Tasks = Annotated[
    list[str] | None,
    typer.Option("--task", help="Only this of the configuration's tasks. Repeatable.", **choice(TASK_NAMES)),
]
StageName = Annotated[str, typer.Argument(help=f"Stage: {', '.join(STAGES)}.", **choice(STAGES, "NAME"))]
ArtifactId = Annotated[str, typer.Argument(metavar="ID", help="Id of an artifact, or its first letters.")]
CheckpointId = Annotated[str, typer.Argument(metavar="CHECKPOINT", help="Id of a checkpoint, or its first letters.")]
TaskOfCheckpoint = Annotated[
    str | None,
    typer.Option("--task", help="Task, if the checkpoint was trained for several.", **choice(TASK_NAMES)),
]
ShiftKind = Annotated[
    str | None,
    typer.Option(
        "--shift",
        metavar="KIND",
        help="In what the scenes differ from training: outside, push, friction, light or camera; or that with "
        "settings, e.g. '{kind: push, force_n: 5}'.",
    ),
]
Episodes = Annotated[
    str, typer.Argument(metavar="EPISODES", help="Id of episodes or of an evaluation, or its first letters.")
]
EpisodeName = Annotated[
    str,
    typer.Option("--episode", "-k", help="Which one: its number, counted from 0, its id, or the name of its log."),
]
LabelsFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="Labels file, CSV, JSON lines (.jsonl) or YAML by its ending.")
]
Numbered = Annotated[
    Path | None,
    typer.Option("--numbered", help="Labels file of an earlier juicer, whose numbers are those of the episodes."),
]
ImportAs = Annotated[
    str | None,
    typer.Option(
        "--import-as",
        metavar="NAME",
        help="Read the file instead: what it says of these episodes becomes what this person said.",
    ),
]
