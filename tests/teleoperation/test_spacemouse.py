"""A SpaceMouse as hidapi shows it: reports as such devices send them, and every way in which it cannot be had."""

import struct
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from types import ModuleType
from typing import Any

import pytest

from juicer.errors import DeviceUnavailable
from juicer.teleoperation.controls import ControllerState, Controls
from juicer.teleoperation.spacemouse import SpaceMouse, is_spacemouse, open_spacemouse

# Bytes as a SpaceNavigator (two reports of 7 bytes) and a SpaceMouse Wireless (one of 13) send them.
PUSHED_AWAY = bytes([1, 0, 0, 0xA2, 0xFE, 0, 0])  # y = -350
TURNED = bytes([2, 0, 0, 0, 0, 0x5E, 0x01])  # about z, 350
PUSHED_DOWN_AND_TURNED = bytes([1, 0, 0, 0, 0, 0xFA, 0, 0, 0, 0, 0, 0x06, 0xFF])  # z = 250, about z = -250
LEFT_BUTTON, BOTH_BUTTONS, NO_BUTTON = bytes([3, 1, 0]), bytes([3, 3, 0, 0, 0, 0, 0]), bytes([3, 0, 0])
BATTERY = bytes([0x17, 80, 0])
LET_GO = bytes(13).replace(b"\0", b"\1", 1)


class SimulatedDevice:
    """Sends what it is told to send, and is unplugged when it is told None."""

    def __init__(self, *reports: bytes | None) -> None:
        self.reports: SimpleQueue[bytes | None] = SimpleQueue()
        self.is_closed = False
        for report in reports:
            self.reports.put(report)

    def read(self, max_length: int, timeout_ms: int) -> Sequence[int]:
        try:
            report = self.reports.get(timeout=timeout_ms / 1000)
        except Empty:
            return []
        if report is None:
            raise OSError("read error")
        return list(report[:max_length])

    def close(self) -> None:
        self.is_closed = True


def shown(*reports: bytes) -> ControllerState:
    device = SimulatedDevice(*reports)
    mouse = SpaceMouse([device])
    until(device.reports.empty)
    mouse.close()
    return mouse.read()


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


def test_reports_of_old_and_new_models_are_read() -> None:
    assert shown(PUSHED_AWAY, TURNED).twist == pytest.approx((0, -0.7, 0, 0, 0, 0.7))
    assert shown(PUSHED_DOWN_AND_TURNED).twist == pytest.approx((0, 0, 0.5, 0, 0, -0.5))
    assert shown(PUSHED_AWAY, TURNED, LET_GO).twist == (0.0,) * 6


def test_a_cap_that_is_pushed_away_moves_the_robot_away_from_the_operator() -> None:
    assert Controls().intent(shown(PUSHED_AWAY)).twist == pytest.approx((-0.25, 0, 0, 0, 0, 0))


def test_a_deflection_beyond_the_full_one_counts_as_full() -> None:
    assert shown(struct.pack("<b6h", 1, 30000, -30000, 0, 0, 0, 0)).twist == (1.0, -1.0, 0.0, 0.0, 0.0, 0.0)


def test_presses_of_buttons_are_counted_and_reports_without_meaning_are_passed_over() -> None:
    state = shown(LEFT_BUTTON, BATTERY, LEFT_BUTTON, BOTH_BUTTONS, NO_BUTTON, LEFT_BUTTON, b"\x01\x02", b"\x03")
    assert state.edges == {"Button0": 2, "Button1": 1}
    assert state.held == {"Button0"}
    assert state.twist == (0.0,) * 6


def test_states_are_numbered_in_their_order() -> None:
    mouse = SpaceMouse([SimulatedDevice()])
    assert mouse.read().sequence < mouse.read().sequence
    mouse.close()


def test_an_unplugged_device_is_said_in_a_sentence_and_moves_nothing_more() -> None:
    device = SimulatedDevice(PUSHED_AWAY, None)
    mouse = SpaceMouse([device])
    until(lambda: device.is_closed)
    with pytest.raises(DeviceUnavailable, match="the SpaceMouse was unplugged"):
        mouse.read()
    mouse.close()


def interface(path: bytes = b"/dev/hidraw9", **changes: int) -> dict[str, Any]:
    return {"vendor_id": 0x256F, "product_id": 0xC635, "usage_page": 1, "usage": 8, "path": path, **changes}


def test_interfaces_are_known_by_numbers_and_use() -> None:
    assert is_spacemouse(interface())
    assert is_spacemouse(interface(vendor_id=0x046D, product_id=0xC626))
    assert not is_spacemouse(interface(vendor_id=0x046D, product_id=0xC52B))
    assert not is_spacemouse(interface(usage=6))
    assert not is_spacemouse(interface(vendor_id=0x1234))


def plugged(monkeypatch: pytest.MonkeyPatch, path: Path, error: OSError | None = None) -> None:
    """A library that lists one device, and cannot open it, or can."""

    class Device(SimulatedDevice):
        def open_path(self, path: bytes) -> None:
            if error:
                raise error

    library = ModuleType("hidraw")
    library.enumerate = lambda: [interface(bytes(path))]  # type: ignore[attr-defined]
    library.device = Device  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "hidraw", library)


def test_a_device_that_is_plugged_in_is_opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    plugged(monkeypatch, tmp_path)
    mouse = open_spacemouse()
    assert mouse.read().source == "spacemouse"
    mouse.close()


def test_a_missing_library_is_said_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hidraw", None)
    with pytest.raises(DeviceUnavailable, match=r"hidapi, which is not installed; .*\[spacemouse\]"):
        open_spacemouse()


def test_a_machine_without_such_a_device_is_said_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    library = ModuleType("hidraw")
    library.enumerate = lambda: [interface(usage=6)]  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "hidraw", library)
    with pytest.raises(DeviceUnavailable, match="no SpaceMouse is plugged into the machine that runs juicer"):
        open_spacemouse()


def test_missing_rights_are_said_with_the_udev_rule(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "hidraw9"
    path.touch()
    plugged(monkeypatch, path, OSError("open failed"))
    monkeypatch.setattr("os.access", lambda *_: False)  # root may read everything
    with pytest.raises(DeviceUnavailable, match=r"may not be read by this user; docs/teleoperation.md has the udev"):
        open_spacemouse()


def test_a_device_that_another_program_holds_is_said_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    plugged(monkeypatch, tmp_path / "gone", OSError("open failed"))
    with pytest.raises(DeviceUnavailable, match=r"cannot be opened \(open failed\); stop spacenavd if it runs"):
        open_spacemouse()
