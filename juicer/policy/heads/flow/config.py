"""In how many steps noise becomes an action chunk, and by which network."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from juicer.policy.denoising import DenoisingConfig


class FlowConfig(DenoisingConfig):
    """Flow matching over action chunks, made for a single step."""

    network: ClassVar[str] = "juicer.policy.heads.flow.network:FlowHead"

    kind: Literal["flow"] = "flow"
    inference_steps: int = Field(default=1, gt=0, le=1000)
