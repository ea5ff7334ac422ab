"""An estimator as files: weights in safetensors, what it is in JSON; nothing is ever unpickled."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from juicer.config import StrictConfig
from juicer.policy.config import FeatureSpec
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.encoders.estimated.estimator import Estimator, build_estimator
from juicer.policy.model_files import expected_weights, read_metadata, read_weights, write_weights

SCHEMA_VERSION = 1
ESTIMATOR_FILE, WEIGHTS_FILE = "estimator.json", "weights.safetensors"


class EstimatorMetadata(StrictConfig):
    """Content of ``estimator.json``.

    Attributes:
        schema_version: Layout of the folder.
        encoder: What it sees, what it is made of and how it has learned.
        task: The assembly task whose parts it finds.
        spec: The task's numbers.
    """

    schema_version: int = Field(default=SCHEMA_VERSION, ge=1, le=1000)
    encoder: EstimatedConfig
    task: Annotated[str, Field(pattern=r"^\w[\w.-]*$", max_length=100)]
    spec: FeatureSpec


def save_estimator(folder: Path, estimator: Estimator) -> None:
    """Write ``estimator.json`` and ``weights.safetensors``.

    Raises:
        OSError: If the system refuses a write.
    """
    metadata = EstimatorMetadata(encoder=estimator.config, task=estimator.task, spec=estimator.spec)
    (folder / ESTIMATOR_FILE).write_text(metadata.model_dump_json(indent=2) + "\n")
    # Where it has learned, its weights may lie in memory as is quickest there.
    weights = {name: value.cpu().contiguous() for name, value in estimator.state_dict().items()}
    write_weights(folder / WEIGHTS_FILE, weights, poses_taught=True)


def load_estimator(folder: Path) -> Estimator:
    """The estimator of a folder, which anybody may have written.

    Raises:
        InvalidCheckpoint: If a file is missing, damaged, of a schema this version cannot read, or not what the
            configuration says.
    """
    metadata = read_metadata(
        folder / ESTIMATOR_FILE, EstimatorMetadata, SCHEMA_VERSION, "an estimator", "make the estimator again"
    )

    def build() -> Estimator:
        return build_estimator(metadata.encoder, metadata.task, metadata.spec, seed=0)

    weights = read_weights(folder / WEIGHTS_FILE, expected_weights(build, "an estimator"))
    estimator = build()
    estimator.load_state_dict(weights)
    return estimator.eval().requires_grad_(False)
