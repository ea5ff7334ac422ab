"""An analysis of any checkpoint in the store, and its figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flows.analysing import analyse
from flows.command.chosen import check_place
from flows.command.evaluate import only_task, run_on
from flows.loop_config import LoopConfig
from flows.reading import take_written
from flows.terminal.output import say, say_json
from flows.written import settled
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import parse_config
from juicer.errors import ArtifactNotFound, ConfigError
from juicer.reporting.analyses import shown_analysis
from juicer.reporting.lineage import read_lineage
from juicer.text import printable


def analyse_checkpoint(
    kind: str, text: str, task: str | None, overrides: Sequence[str], figure: Path | None, as_json: bool
) -> None:
    """``juicer analyse``.

    Raises:
        ConfigError: If the figure cannot be written, or an assignment is not valid or takes the analysis away.
    """
    if figure is not None:
        check_place(figure, "figure", (".png",))
    with run_on(text, "checkpoint") as (session, ref):
        store = session.store
        content = {"task": task or only_task(store, ref), "analyses": {kind: {"kind": kind}}}
        written = settled(take_written(content, "analyse", overrides))
        config = parse_config(written.values, LoopConfig, "analyse", written.place)
        if kind not in config.analyses:
            place = written.place(("analyses",))
            raise ConfigError(f"{place}: analyses must hold '{kind}', which is asked for; change only values below it")
        found = analyse(
            replace(session, label=ref.id),
            config,
            ref,
            config.analyses[kind],
            lambda: demonstrations_behind(store, ref, config.task),
        )
    shown = shown_analysis(store, found, kind)
    if figure is not None and shown.png:
        _write(figure, shown.png)
    if as_json:
        say_json({"analysis": str(found), **store.manifest(found).summary})
        return
    say(f"{shown.sentence} {found}")
    for row in (shown.columns, *shown.rows):
        say("  " + "".join(f"{cell:14}" for cell in row))
    if figure is not None:
        say(
            f"the figure is in '{printable(figure)}'"
            if shown.png
            else "no figure was written: the analysis found nothing to draw"
        )


def demonstrations_behind(store: ArtifactStore, checkpoint: ArtifactRef, task: str) -> ArtifactRef:
    """Those of a task that a checkpoint was trained on."""
    for ref, manifest in read_lineage(store, [checkpoint]).items():
        if manifest and manifest.recipe.stage == "ingest" and manifest.recipe.config.get("task") == task:
            return ref
    raise ArtifactNotFound(
        f"the demonstrations of {task} behind {checkpoint} are not in the store; "
        "samples are drawn at a step of one of them"
    )


def _write(path: Path, png: bytes) -> None:
    try:
        path.write_bytes(png)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it has an impossible name"
        raise ConfigError(f"the figure cannot be written to '{printable(path)}': {reason}") from None
