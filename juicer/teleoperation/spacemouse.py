"""A SpaceMouse that is plugged into the machine where the simulator runs.

Reports are read through the library hidapi, by a thread, so that none is lost while the simulator is busy: of a report
that says that the cap was let go, nothing may be lost. Devices are known by their numbers, never by their names, which
are empty for a user without rights.
"""

from __future__ import annotations

import importlib
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, cast

import numpy as np

from juicer.errors import DeviceUnavailable
from juicer.teleoperation.controls import ControllerState
from juicer.teleoperation.key_codes import SPACEMOUSE_BUTTONS
from juicer.text import adding_extra, printable

FULL_DEFLECTION = 500
"""The original's; most models reach 350."""

_3DCONNEXION, _LOGITECH = 0x256F, 0x046D
_MODELS_OF_LOGITECH = frozenset({0xC623, 0xC625, 0xC626, 0xC627, 0xC628, 0xC629, 0xC62B})
"""Those that were sold before 3Dconnexion had a number of its own."""
_MULTI_AXIS_CONTROLLER = (0x01, 0x08)
"""Usage page and usage of the interface that moves; a receiver has others, for instance one that types."""

_MOTION, _ROTATION, _BUTTONS = 1, 2, 3
_MOST_REPORT_BYTES = 64
_WAIT_MS = 200


class HidDevice(Protocol):
    """An open device, as hidapi's ``hidraw.device`` is."""

    def read(self, max_length: int, timeout_ms: int) -> Sequence[int]:
        """The next report, whose first byte is its kind; empty if none came in time.

        Raises:
            OSError: If the device is gone.
        """
        ...

    def close(self) -> None:
        """Let it go."""
        ...


class SpaceMouse:
    """Reads a SpaceMouse until it is closed or unplugged."""

    def __init__(self, devices: Sequence[HidDevice]) -> None:
        """Begin to listen.

        Args:
            devices: Open interfaces of it. A receiver has one for every SpaceMouse that it may serve.
        """
        self._axes: tuple[float, ...] = (0.0,) * 6
        self._pressed = 0
        self._edges = dict.fromkeys(SPACEMOUSE_BUTTONS, 0)
        self._sequence = 0
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._lost = False
        self._threads = [
            threading.Thread(target=self._listen, args=(device,), name="spacemouse", daemon=True) for device in devices
        ]
        for thread in self._threads:
            thread.start()

    def read(self) -> ControllerState:
        """What it shows now.

        Raises:
            DeviceUnavailable: If it was unplugged.
        """
        with self._lock:
            if self._lost:
                raise DeviceUnavailable("the SpaceMouse was unplugged; plug it in and choose it again")
            self._sequence += 1
            held = frozenset(name for bit, name in enumerate(SPACEMOUSE_BUTTONS) if self._pressed >> bit & 1)
            return ControllerState(
                source="spacemouse", sequence=self._sequence, twist=self._axes, held=held, edges=dict(self._edges)
            )

    def close(self) -> None:
        """Let it go."""
        self._closed.set()
        for thread in self._threads:
            thread.join()

    def _listen(self, device: HidDevice) -> None:
        try:
            while not self._closed.is_set():
                if report := device.read(_MOST_REPORT_BYTES, _WAIT_MS):
                    self._take(bytes(report))
        except (OSError, ValueError):
            with self._lock:
                self._lost = True
        finally:
            device.close()

    def _take(self, report: bytes) -> None:
        kind, content = report[0], report[1:]
        with self._lock:
            if kind == _MOTION and len(content) >= 12:
                self._axes = _deflections(content[:12])
            elif kind == _MOTION and len(content) >= 6:
                self._axes = (*_deflections(content[:6]), *self._axes[3:])
            elif kind == _ROTATION and len(content) >= 6:
                self._axes = (*self._axes[:3], *_deflections(content[:6]))
            elif kind == _BUTTONS and content:
                pressed = int.from_bytes(content[:4], "little")
                for bit, name in enumerate(SPACEMOUSE_BUTTONS):
                    self._edges[name] += pressed >> bit & ~self._pressed >> bit & 1
                self._pressed = pressed


def open_spacemouse() -> SpaceMouse:
    """Open the SpaceMouse that is plugged in.

    Raises:
        DeviceUnavailable: If there is none, it may not be read, or the library for it is missing; one sentence says so.
    """
    library = _library()
    interfaces = [each for each in library.enumerate() if is_spacemouse(each)]
    if not interfaces:
        raise DeviceUnavailable(
            "no SpaceMouse is plugged into the machine that runs juicer; over SSH that is not the one you sit at"
        )
    return SpaceMouse([_opened(library.device, each["path"]) for each in interfaces])


def is_spacemouse(interface: Mapping[str, Any]) -> bool:
    """Whether an entry of hidapi's list is the interface of a SpaceMouse that moves."""
    vendor, product = interface["vendor_id"], interface["product_id"]
    is_known = vendor == _3DCONNEXION or (vendor == _LOGITECH and product in _MODELS_OF_LOGITECH)
    return is_known and (interface["usage_page"], interface["usage"]) == _MULTI_AXIS_CONTROLLER


def _library() -> Any:
    try:
        return importlib.import_module("hidraw")
    except ImportError:
        raise DeviceUnavailable(
            f"a SpaceMouse is read through the library hidapi, which is not installed; {adding_extra('spacemouse')}"
        ) from None


def _opened(make: Callable[[], Any], path: bytes) -> HidDevice:
    device = make()
    try:
        device.open_path(path)
    except OSError as error:
        name = printable(os.fsdecode(path))
        if os.path.exists(path) and not os.access(path, os.R_OK | os.W_OK):  # noqa: PTH110 (a path of bytes)
            raise DeviceUnavailable(
                f"the SpaceMouse '{name}' may not be read by this user; docs/teleoperation.md has the udev rule for it"
            ) from None
        raise DeviceUnavailable(
            f"the SpaceMouse '{name}' cannot be opened ({printable(error)}); stop spacenavd if it runs, or replug it"
        ) from None
    return cast(HidDevice, device)


def _deflections(content: bytes) -> tuple[float, ...]:
    values = np.frombuffer(content, "<i2") / FULL_DEFLECTION
    return tuple(np.clip(values, -1.0, 1.0).tolist())
