"""Global switches of torch that change speed and last digits, set for a while and put back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock
from typing import Literal

import torch

from juicer.errors import ConfigError

Precision = Literal["fp32", "bf16", "auto"]
MatmulPrecision = Literal["highest", "high", "medium"]
_SWITCHES = RLock()
"""Held by the thread whose settings are on: torch has one precision for all threads of a process."""


@contextmanager
def compute_settings(threads: int, matmul_precision: MatmulPrecision) -> Iterator[None]:
    """Run with this many threads and this single-precision matrix product.

    ``highest`` computes in single precision everywhere. ``medium`` may use bfloat16 (it does on CPUs with AMX:
    relative error 2e-3; elsewhere on x86 it stays exact and merely takes a faster library). Meanwhile, other threads
    that ask for settings wait.
    """
    with _SWITCHES:
        threads_before, precision_before = torch.get_num_threads(), torch.get_float32_matmul_precision()
        torch.set_num_threads(threads)
        torch.set_float32_matmul_precision(matmul_precision)
        try:
            yield
        finally:
            torch.set_num_threads(threads_before)
            torch.set_float32_matmul_precision(precision_before)


def usable_device(name: str) -> torch.device:
    """The device of a name, e.g. ``cpu`` or ``cuda``.

    Raises:
        ConfigError: If this machine, or this build of torch, does not have it.
    """
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError) as error:  # builds of torch for CPUs assert
        reason = str(error).partition("\n")[0].rstrip(".")
        raise ConfigError(
            f"torch cannot use the device '{name}' ({reason}); set JUICER_DEVICE to cpu, or to a GPU of this machine "
            "and install a build of torch for it"
        ) from None
    return torch.device(name)


def chosen_precision(precision: Precision, device: torch.device) -> Literal["fp32", "bf16"]:
    """The arithmetic of a network; the processor chooses it if the setting leaves it open."""
    if precision == "auto":
        return "bf16" if device.type != "cpu" or has_fast_bfloat16() else "fp32"
    return precision


def has_fast_bfloat16() -> bool:
    """Whether this CPU multiplies bfloat16 matrices in hardware; emulation is slower than single precision."""
    return bool(torch.ops.mkldnn._is_mkldnn_bf16_supported()) and (
        torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
    )
