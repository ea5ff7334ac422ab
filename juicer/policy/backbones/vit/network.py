"""Vision transformer as in timm, with its names."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.backbone import Backbone
from juicer.policy.backbones.vit.config import DEPTH, HEADS, PATCH, WIDTHS, ViTConfig

EPSILON = 1e-6
_OTHER_PURPOSES = ("head.", "fc_norm.", "decoder_", "mask_token")
"""Classifiers, and the half of MAE that paints what was masked."""


class PatchEmbedding(nn.Module):
    """Every patch as a token."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.proj = nn.Conv2d(3, width, PATCH, PATCH)

    def forward(self, images: Tensor) -> Tensor:
        """``(B, 3, H, W) -> (B, H W / 256, width)``."""
        tokens: Tensor = self.proj(images)
        return tokens.flatten(2).transpose(1, 2)


class Attention(nn.Module):
    """Self-attention."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width)
        self.proj = nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """Tokens ``(B, N, width)`` of the same shape."""
        query, key, value = self.qkv(x).unflatten(-1, (3, self.heads, -1)).permute(2, 0, 3, 1, 4)
        mixed = functional.scaled_dot_product_attention(query, key, value)
        tokens: Tensor = self.proj(mixed.transpose(1, 2).flatten(2))
        return tokens


class MLP(nn.Module):
    """Two layers on every token."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(width, 4 * width)
        self.fc2 = nn.Linear(4 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        """Tokens ``(B, N, width)`` of the same shape."""
        tokens: Tensor = self.fc2(functional.gelu(self.fc1(x)))
        return tokens


class Block(nn.Module):
    """Attention, then an MLP, each on normalised tokens and beside a skip."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(width, EPSILON)
        self.attn = Attention(width, heads)
        self.norm2 = nn.LayerNorm(width, EPSILON)
        self.mlp = MLP(width)

    def forward(self, x: Tensor) -> Tensor:
        """Tokens ``(B, N, width)`` of the same shape."""
        x = x + self.attn(self.norm1(x))
        return x + torch.as_tensor(self.mlp(self.norm2(x)))


class ViT(Backbone):
    """See :class:`ViTConfig`."""

    def __init__(self, config: ViTConfig, size: tuple[int, int]) -> None:
        super().__init__()
        width = WIDTHS[config.size]
        self.grid = (size[0] // PATCH, size[1] // PATCH)
        self.cls_token = nn.Parameter(torch.zeros(1, 1, width))
        self.pos_embed = nn.Parameter(torch.zeros(1, 1 + self.grid[0] * self.grid[1], width))
        self.patch_embed = PatchEmbedding(width)
        self.blocks = nn.Sequential(*(Block(width, HEADS[config.size]) for _ in range(DEPTH)))
        self.norm = nn.LayerNorm(width, EPSILON)
        _initialise(self)

    def forward(self, images: Tensor) -> Tensor:
        """See :class:`juicer.policy.backbone.Backbone`."""
        patches = self.patch_embed(images)
        tokens = torch.cat([self.cls_token.expand(len(images), -1, -1), patches], dim=1) + self.pos_embed
        # Of the last normalisation, which treats every token alone, only one is needed.
        features: Tensor = self.norm(self.blocks(tokens)[:, 0])
        return features

    def adapted(self, weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """State of this network by a file of timm, DINO or MAE, its places of patches stretched to this size."""
        state = {name: value for name, value in weights.items() if not name.startswith(_OTHER_PURPOSES)}
        if (places := state.get("pos_embed")) is not None:
            state["pos_embed"] = _stretched(places, self.grid)
        return state


def _stretched(places: Tensor, grid: tuple[int, int]) -> Tensor:
    """Places ``(1, 1 + n n, width)`` of a square grid for another one; what is none is returned as it is."""
    side = round((places.shape[1] - 1) ** 0.5) if places.ndim == 3 else 0
    if side < 1 or side**2 != places.shape[1] - 1 or (side, side) == grid:
        return places
    token, patches = places[:, :1], places[:, 1:].reshape(1, side, side, -1).permute(0, 3, 1, 2)
    patches = functional.interpolate(patches.float(), grid, mode="bicubic", align_corners=False)
    return torch.cat([token, patches.flatten(2).transpose(1, 2)], dim=1)


def _initialise(network: ViT) -> None:
    """Truncated normal weights, as timm trains from."""
    for module in network.modules():
        if isinstance(module, nn.Linear):
            nn.init.trunc_normal_(module.weight, std=0.02)
            nn.init.zeros_(module.bias)
    nn.init.trunc_normal_(network.pos_embed, std=0.02)
    nn.init.normal_(network.cls_token, std=EPSILON)
