"""Whether this machine has the device that its settings name: asked before anything starts, not after the recording."""

from __future__ import annotations

from collections.abc import Sequence

from flows.running.settings import PREFIX, Settings
from juicer.errors import ConfigError

REMEDY = "set it to cpu, or to a GPU of this machine, with a build of torch for it"


def check_device(settings: Settings) -> None:
    """Refuse a device that torch does not find; takes no memory on one that it finds.

    A machine whose stages run on a cluster needs no device of its own.

    Args:
        settings: Facts about this machine.

    Raises:
        ConfigError: Saying what torch finds instead, or that a training needs more of them than there are.
    """
    if settings.device == "cpu" or settings.cluster:
        return
    if settings.train_processes > len(settings.devices):
        raise ConfigError(
            f"environment variable {PREFIX}TRAIN_PROCESSES: {settings.train_processes} processes need a device each, "
            f"and {PREFIX}DEVICE names {len(settings.devices)}"
        )
    import torch  # takes seconds, and processors need no asking

    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if lack := lack_of(settings.devices, gpus, torch.version.cuda or torch.version.hip):
        raise ConfigError(f"{lack}; {REMEDY}")


def lack_of(devices: Sequence[str], gpus: int, toolkit: str | None) -> str:
    """That a device is not there, and what is instead; empty if all are there.

    Args:
        devices: As the settings name them.
        gpus: How many torch finds.
        toolkit: Version of CUDA or ROCm that torch was built for; none if it was built for processors.
    """
    absent = [each for each in devices if each != "cpu" and int(each.partition(":")[2] or 0) >= gpus]
    if not absent:
        return ""
    if toolkit is None:
        found = "torch is built for processors only"
    elif not gpus:
        found = "torch finds no GPU"
    else:
        found = f"torch finds {gpus} GPU{'s' if gpus > 1 else ''}, numbered from 0"
    return f"environment variable {PREFIX}DEVICE: there is no device '{absent[0]}' here, {found}"
