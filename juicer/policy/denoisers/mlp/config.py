"""Sizes of the residual MLP that removes noise."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from juicer.policy.members import Blocks, DenoiserConfig, Size, rough_mlp


class MLPDenoiserConfig(DenoiserConfig):
    """Residual network on the flattened action chunk: the quick denoiser for CPUs."""

    network: ClassVar[str] = "juicer.policy.denoisers.mlp.network:MLPDenoiser"

    kind: Literal["mlp"] = "mlp"
    width: Size = 512
    blocks: Blocks = 4
    step_embedding: Size = Field(default=64, multiple_of=2)

    def rough_parameters(self, chunk_size: int, condition_size: int) -> int:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        return rough_mlp(self.width, self.blocks, condition_size + 2 * chunk_size + self.step_embedding)
