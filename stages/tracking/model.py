"""Models that MLflow shall show: a small note each in the data folder, of what no artifact says."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.errors import ArtifactNotFound
from juicer.reading import read_bounded

SUFFIX = ".model.json"
MOST_BYTES = 2**20
_WORD = r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$"


class Model(StrictConfig):
    """A trained and evaluated model, and which part of which study it is.

    Attributes:
        study: Name of the study; MLflow's experiment is called so.
        identity: What the models of a condition share: a hash of its configuration and of the code behind it.
        condition: Key of its condition.
        title: Condition as people write it.
        seed: Its seed.
        task: Assembly task.
        params: Configuration, flat.
        evaluation: ``kind/id`` of its evaluation; empty while it is made.
        shifted: The same of its evaluations under shifts, by name of the shift.
        unnoticed: Names of the shifts that it cannot notice.
        report: The same of the page about all models of the run.
        finding: Why it learned from less than it should, as a sentence.
        noted: When it was noted last, in seconds of the Unix clock.
    """

    study: str = Field(pattern=_WORD, max_length=100)
    identity: str = Field(pattern=r"^[0-9a-f]{16}$")
    condition: str = Field(pattern=_WORD, max_length=100)
    title: str = Field(max_length=200)
    seed: int = Field(ge=0)
    task: str
    params: dict[str, Any]
    evaluation: str = ""
    shifted: dict[str, str] = Field(default={})
    unnoticed: tuple[str, ...] = ()
    report: str = ""
    finding: str = ""
    noted: float = Field(default=0.0, ge=0)

    @property
    def evaluations(self) -> dict[str, str]:
        """All of its evaluations by name of the shift; the usual one has no name."""
        return {"": self.evaluation, **self.shifted}

    @property
    def label(self) -> str:
        """Name of its run in MLflow."""
        return f"{self.title}, seed {self.seed}"

    @property
    def parent_key(self) -> str:
        """What the models of a condition share."""
        return f"{self.identity}-{self.condition}"

    @property
    def key(self) -> str:
        """What it is found by, in the data folder and in MLflow."""
        return f"{self.parent_key}-{self.seed}"

    def note(self, folder: Path) -> None:
        """Have it published from now on, by this process or a later one; a report that it is in stays with it."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.key}{SUFFIX}"
        before = _read(path)
        kept = before.report if before and before.evaluations == self.evaluations else ""
        noted = self.model_copy(update={"report": self.report or kept, "noted": time.time()})
        draft = path.with_suffix(".draft")
        draft.write_text(noted.model_dump_json(), encoding="utf-8")
        draft.replace(path)


def noted(folder: Path) -> list[Model]:
    """Every model that shall be published, oldest first; a file that is something else is overlooked."""
    models = [model for path in sorted(folder.glob(f"*{SUFFIX}")) if (model := _read(path)) and model.evaluation]
    return sorted(models, key=lambda model: model.noted)


def _read(path: Path) -> Model | None:
    try:
        model = Model.model_validate_json(read_bounded(path, MOST_BYTES))
        for ref in (model.evaluation, *model.shifted.values(), model.report):
            if ref:
                ArtifactRef.parse(ref)
    except (OSError, ValidationError, RecursionError, ArtifactNotFound):
        return None
    return model
