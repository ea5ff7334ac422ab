"""Image augmentation of a batch in two passes: a matrix on the colours of each sample, and a blur of its own.

All jitters are affine in the colour of a pixel, so they are one matrix; hue is turned in the plane of the colours of
one luminance (YIQ), which needs no conversion to angles and back. What is drawn comes from torch's random state on the
processor, so that it is the same on every device.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from juicer.policy import draws
from juicer.policy.backbone import FULL_BRIGHTNESS
from juicer.policy.image_augmentation.config import ImageAugmentation

_RGB_TO_YIQ = ((0.299, 0.587, 0.114), (0.596, -0.274, -0.322), (0.211, -0.523, 0.312))


def augmented(images: Tensor, config: ImageAugmentation) -> Tensor:
    """Brightness ``(B, T, 3, h, w)`` from 0 to 1 of images ``(B, T, h, w, 3)`` uint8, varied alike in all T steps."""
    samples, steps, height, width, _ = images.shape
    # Planes of one colour, since both passes are several times faster on them than on pixels side by side.
    planes = images.permute(0, 4, 1, 2, 3).to(torch.float32, memory_format=torch.contiguous_format).flatten(2)
    with torch.autocast(images.device.type, enabled=False):
        matrix, share_of_grey = _colours(samples, config, images.device)
        profile = _blur(samples, config, images.device)
        grey = (planes.mean(dim=-1) * planes.new_tensor(_RGB_TO_YIQ[0])).sum(dim=-1) / FULL_BRIGHTNESS
        offset = (share_of_grey * grey).view(-1, 1, 1)
        coloured = torch.baddbmm(offset, matrix / FULL_BRIGHTNESS, planes).clamp_(0, 1)
        coloured = coloured.reshape(samples, 3 * steps, height, width)
        blurred = coloured if profile is None else _blurred(coloured, profile)
    return blurred.reshape(samples, 3, steps, height, width).transpose(1, 2)


def random_crop(images: Tensor, size: tuple[int, int]) -> Tensor:
    """A part ``(B, T, *size, 3)`` of images ``(B, T, h, w, 3)``, in another place of every sample."""
    room = [whole - part for whole, part in zip(images.shape[2:4], size, strict=True)]
    first = [draws.randint(most + 1, (len(images), 1)).to(images.device) for most in room]
    rows, columns = (low + torch.arange(part, device=images.device) for low, part in zip(first, size, strict=True))
    samples = torch.arange(len(images), device=images.device)[:, None, None]
    # Indexed dimensions come first, in front of the steps.
    return images[samples, :, rows[:, :, None], columns[:, None, :]].permute(0, 3, 1, 2, 4)


def centre_crop(images: Tensor, size: tuple[int, int]) -> Tensor:
    """The middle ``(B, T, *size, 3)`` of images ``(B, T, h, w, 3)``."""
    top, left = ((whole - part) // 2 for whole, part in zip(images.shape[2:4], size, strict=True))
    return images[:, :, top : top + size[0], left : left + size[1]]


def _colours(samples: int, config: ImageAugmentation, device: torch.device) -> tuple[Tensor, Tensor]:
    """Matrices ``(B, 3, 3)`` of all jitters, and how much ``(B,)`` of a sample's mean grey comes in addition."""
    jitters = torch.tensor([config.brightness, config.contrast, config.saturation])
    brightness, contrast, saturation = (1 + jitters * (2 * draws.rand((samples, 3)) - 1)).unbind(dim=1)
    angle = 2 * math.pi * config.hue * (2 * draws.rand((samples,)) - 1)
    to_yiq = torch.tensor(_RGB_TO_YIQ)
    turn = torch.zeros(samples, 3, 3)
    turn[:, 0, 0] = 1
    turn[:, 1, 1] = turn[:, 2, 2] = angle.cos()
    turn[:, 1, 2], turn[:, 2, 1] = -angle.sin(), angle.sin()
    # Less saturated is nearer to grey: smaller distances in the plane that hue turns.
    turn[:, 1:, 1:] *= saturation.view(-1, 1, 1)
    matrix = (brightness * contrast).view(-1, 1, 1) * (torch.linalg.inv(to_yiq) @ turn @ to_yiq)
    return matrix.to(device), (brightness * (1 - contrast)).to(device)


def _blur(samples: int, config: ImageAugmentation, device: torch.device) -> Tensor | None:
    """Profiles ``(B, k)`` of Gaussians."""
    if config.blur_kernel == 1:
        return None
    least, most = config.blur_sigma
    sigma = least + (most - least) * draws.rand((samples, 1))
    reach = config.blur_kernel // 2
    profile = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / sigma) ** 2)
    return (profile / profile.sum(dim=-1, keepdim=True)).to(device)


def _blurred(planes: Tensor, profile: Tensor) -> Tensor:
    """Planes ``(B, P, h, w)``, each sample by its own profile, along rows and then along columns."""
    height, width = planes.shape[-2:]
    reach = profile.shape[-1] // 2
    shares = profile.view(*profile.shape, 1, 1, 1).unbind(dim=1)
    padded = functional.pad(planes, (reach, reach, reach, reach), mode="reflect")
    # Shifted sums take a third of the time of a convolution with a kernel a sample, once batches leave the cache.
    rows = shares[0] * padded[..., :width]
    for shift, share in enumerate(shares[1:], start=1):
        rows.addcmul_(padded[..., shift : shift + width], share)
    blurred = shares[0] * rows[..., :height, :]
    for shift, share in enumerate(shares[1:], start=1):
        blurred.addcmul_(rows[..., shift : shift + height, :], share)
    return blurred
