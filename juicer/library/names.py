"""Artifacts by the names of models: every report in a store says which evaluation belongs to which model."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from juicer.artifacts.catalog import Entry, catalog_of
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import KINDS, ArtifactRef, is_id, require_kind
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactNotFound, ConfigError, WrongArtifactKind
from juicer.sim.arguments import shown
from juicer.text import printable

MANY = 6
"""Names that a message lists."""


@dataclass(frozen=True)
class Model:
    """A trained model of a study.

    Attributes:
        study: Name of the study, which is the title of its report.
        task: Assembly task.
        condition: Name of the condition, e.g. ``ta_ci``.
        seed: Root seed of the training.
        report: The report that names the model.
        evaluation: What it achieved.
        checkpoint: Its weights; None if the evaluation is no longer there.
    """

    study: str
    task: str
    condition: str
    seed: int
    report: ArtifactRef
    evaluation: ArtifactRef
    checkpoint: ArtifactRef | None

    @property
    def name(self) -> str:
        """E.g. ``smoke/one_leg/ta_ci/seed-0``."""
        return "/".join(self.words)

    @property
    def words(self) -> tuple[str, ...]:
        """Study, task, condition and seed as they are compared."""
        return _word(self.study), _word(self.task), _word(self.condition), f"seed-{self.seed}"

    def artifact(self, kinds: Sequence[str]) -> ArtifactRef | None:
        """Its artifact of the first of the kinds that it has; its evaluation if no kind is asked for."""
        own = {"evaluation": self.evaluation, "checkpoint": self.checkpoint, "report": self.report}
        return next((own[kind] for kind in kinds or own if own.get(kind)), None)


def read_models(store: ArtifactStore) -> list[Model]:
    """Every model that a report names, by age of the reports; of two with one name, that of the newer report.

    Raises:
        ConfigError: If it is not a store.
    """
    _require_store(store)
    reports = store.list("report")
    evaluations = {ref for report in reports for ref in report.recipe.inputs.get("evaluations", ())}
    known = catalog_of(store, store.cache).of(evaluations)
    models: dict[str, Model] = {}
    for report in reports:
        for model in _models_of(report, known):
            models.pop(model.name, None)
            models[model.name] = model
    return list(models.values())


def find(store: ArtifactStore, text: str, *kinds: str) -> ArtifactRef:
    """The one artifact meant by the name of a model, an id, the beginning of an id, or ``kind/id``.

    A name is ``study/task/condition/seed-0``, of which every part may be left out that is not needed to tell the
    models apart. If a text is both, the name counts.

    Args:
        store: Where to look.
        text: What is meant.
        kinds: Kinds that will do; every kind if there is none.

    Raises:
        ArtifactNotFound: If nothing or several things answer to the text.
        WrongArtifactKind: If it is of another kind.
        ConfigError: If it is not a text, there is no such kind, or it is not a store.
    """
    _require_store(store)
    if not isinstance(text, str):
        raise ConfigError(f"an artifact is named by a text, its id or a model's name, not by {shown(text)}")
    for kind in kinds:
        require_kind(kind)
    models = [] if is_id(text.strip().rpartition("/")[2]) else read_models(store)
    matches = [model for model in models if _answers(model.words, text)]
    if matches:
        return _only(matches, printable(text), kinds)
    try:
        ref = store.resolve(text, kinds[0] if len(kinds) == 1 else None)
    except ArtifactNotFound:
        if _is_like_an_id(text):
            raise
        names = [model.name for model in models]
        raise ArtifactNotFound(f"no model is called '{printable(text)}' in '{store.url}'{_hint(text, names)}") from None
    if kinds and ref.kind not in kinds:
        raise WrongArtifactKind(f"{ref} is of kind '{ref.kind}' but '{' or '.join(kinds)}' is needed here")
    return ref


def _require_store(store: object) -> None:
    if not isinstance(store, ArtifactStore):
        raise ConfigError(f"a store is needed, such as open_store() gives, not {shown(store)}")


def _only(matches: Sequence[Model], text: str, kinds: Sequence[str]) -> ArtifactRef:
    refs = {ref for model in matches if (ref := model.artifact(kinds))}
    names = [model.name for model in matches]
    if len(refs) == 1:
        return refs.pop()
    if refs:
        raise ArtifactNotFound(f"'{text}' may be any of {_some(names)}; say more of the name")
    needed = " or ".join(kinds)
    raise WrongArtifactKind(f"'{names[0]}' is a model, which has an evaluation and a checkpoint but no '{needed}'")


def _models_of(report: Manifest, known: Mapping[ArtifactRef, Entry]) -> Iterator[Model]:
    """Models of a report, with their evaluations without a shift; in a shared store, anybody may have written it."""
    config, evaluations = report.recipe.config, report.recipe.inputs.get("evaluations", ())
    rows = config.get("rows")
    if not isinstance(rows, list) or len(rows) != len(evaluations):
        return
    study, task = str(config.get("title")), str(config.get("task"))
    for row, evaluation in zip(rows, evaluations, strict=True):
        if _is_row(row) and not row.get("shift"):
            inputs = known[evaluation].inputs if evaluation in known else {}
            checkpoint = next(iter(inputs.get("checkpoint", ())), None)
            yield Model(study, task, row["condition"], row["seed"], report.ref, evaluation, checkpoint)


def _is_row(row: Any) -> bool:
    return isinstance(row, Mapping) and isinstance(row.get("condition"), str) and isinstance(row.get("seed"), int)


def _word(text: str) -> str:
    """A part of a name: ``TA+CI`` and ``ta_ci`` are one word."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def _answers(words: Sequence[str], text: str) -> bool:
    """Whether the parts of a text are parts of a name, in their order."""
    rest = iter(map(_word, words))
    return all(_word(part) in rest for part in text.strip().split("/"))


def _is_like_an_id(text: str) -> bool:
    kind, separator, prefix = text.strip().rpartition("/")
    return (not separator or kind in KINDS) and re.fullmatch("[0-9a-f]*", prefix) is not None


def _hint(text: str, names: Sequence[str]) -> str:
    """The nearest name, or part of one, or all of them."""
    parts = {"/".join(name.split("/")[start:]) for name in names for start in range(4)}
    if not names:
        return "; no report in it names any"
    nearest = get_close_matches(text[:100], parts, n=1)
    return f"; did you mean '{nearest[0]}'?" if nearest else f"; there are {_some(names)}"


def _some(names: Sequence[str]) -> str:
    rest = len(names) - MANY
    return ", ".join(names[:MANY]) + (f" and {rest} more" if rest > 0 else "")
