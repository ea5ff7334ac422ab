"""Whether this machine has the device that its settings name: asked before anything starts, not after the recording."""

from __future__ import annotations

from flows.settings import PREFIX, Settings
from juicer.errors import ConfigError


def check_device(settings: Settings) -> None:
    """Refuse a device that torch does not find; takes no memory on one that it finds.

    A machine that has its stages run on others needs none of its own.

    Raises:
        ConfigError: Saying what torch finds instead.
    """
    if settings.device == "cpu" or settings.spread:
        return
    import torch  # takes seconds, and processors need no asking

    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if int(settings.device.partition(":")[2] or 0) < count:
        return
    if torch.version.cuda is None and torch.version.hip is None:
        found = f"this build of torch ({torch.__version__}) is for processors only"
    elif not count:
        found = "torch finds no GPU"
    else:
        found = f"torch finds {count} GPU{'s' if count > 1 else ''}, numbered from 0"
    raise ConfigError(
        f"environment variable {PREFIX}DEVICE: there is no device '{settings.device}' here, {found}; "
        "set it to cpu, or to a GPU of this machine, with a build of torch for it"
    )
