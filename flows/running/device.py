"""Whether this machine has the device that its settings name: asked before anything starts, not after the recording."""

from __future__ import annotations

from flows.running.settings import PREFIX, Settings
from juicer.errors import ConfigError

REMEDY = "set it to cpu, or to a GPU of this machine, with a build of torch for it"


def check_device(settings: Settings, *, computes_here: bool = True) -> None:
    """Refuse a device that torch does not find; takes no memory on one that it finds.

    Args:
        settings: Facts about this machine.
        computes_here: Whether stages run on it; one that has them run on others needs no device of its own.

    Raises:
        ConfigError: Saying what torch finds instead.
    """
    if settings.device == "cpu" or not computes_here:
        return
    import torch  # takes seconds, and processors need no asking

    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if lack := lack_of(settings.device, gpus, torch.version.cuda or torch.version.hip):
        raise ConfigError(f"{lack}; {REMEDY}")


def lack_of(device: str, gpus: int, toolkit: str | None) -> str:
    """That a device is not there, and what is instead; empty if it is there.

    Args:
        device: As the settings name it.
        gpus: How many torch finds.
        toolkit: Version of CUDA or ROCm that torch was built for; none if it was built for processors.
    """
    if device == "cpu" or int(device.partition(":")[2] or 0) < gpus:
        return ""
    if toolkit is None:
        found = "torch is built for processors only"
    elif not gpus:
        found = "torch finds no GPU"
    else:
        found = f"torch finds {gpus} GPU{'s' if gpus > 1 else ''}, numbered from 0"
    return f"environment variable {PREFIX}DEVICE: there is no device '{device}' here, {found}"
