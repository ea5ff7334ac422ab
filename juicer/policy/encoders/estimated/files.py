"""An estimator as files: weights in safetensors, what it is in JSON; nothing is ever unpickled."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from juicer.config import StrictConfig
from juicer.errors import InvalidCheckpoint
from juicer.policy.config import FeatureSpec
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.encoders.estimated.estimator import Estimator
from juicer.policy.tensor_files import read_metadata, read_weights, write_weights

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
