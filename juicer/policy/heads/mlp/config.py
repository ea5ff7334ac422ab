"""Sizes of the residual MLP that regresses actions."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from juicer.policy.members import Blocks, HeadConfig, Size, rough_mlp


class MLPHeadConfig(HeadConfig):
    """Regression baseline; the defaults are the paper's. Unchunked is ``horizons: {pred: 1, action: 1}``."""

    network: ClassVar[str] = "juicer.policy.heads.mlp.network:MLPHead"

    kind: Literal["mlp"] = "mlp"
    width: Size = 1024
    blocks: Blocks = 5
    dropout: float = Field(default=0.1, ge=0, lt=1)

    def rough_parameters(self, chunk_size: int, condition_size: int) -> int:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        return rough_mlp(self.width, self.blocks, condition_size + chunk_size)
