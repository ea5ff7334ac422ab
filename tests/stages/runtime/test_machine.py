"""A device belongs to one stage at a time, in whatever process that runs."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from juicer.errors import ServiceUnavailable
from stages.runtime import machine as machine_module
from stages.runtime.context import StageInterrupted
from stages.runtime.machine import Machine

LEASES_AND_SLEEPS = """
import pathlib, sys, time
from stages.runtime.machine import Machine
with Machine(devices=("cuda:0",), leases=pathlib.Path(sys.argv[1])).leased(lambda: None):
    print("leased", flush=True)
    time.sleep(600)
"""


class Waits(Exception):
    """All devices are taken."""


def give_up():
    raise Waits


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    monkeypatch.setattr(machine_module, "POLL_SECONDS", 0.02)


@pytest.fixture
def machine(tmp_path):
    (tmp_path / "leases").mkdir()
    return Machine(devices=("cuda:0", "cuda:1"), leases=tmp_path / "leases")


def test_each_lease_is_of_another_device_and_the_next_one_waits(machine):
    with machine.leased(give_up) as first, machine.leased(give_up) as second:
        assert (first.devices, second.devices) == (("cuda:0",), ("cuda:1",))
        with pytest.raises(Waits), machine.leased(give_up):
            pass
    with machine.leased(give_up) as again:
        assert again.device == "cuda:0"


def test_a_training_on_several_devices_leases_all_of_them_or_none(machine):
    three = replace(machine, devices=("cuda:0", "cuda:1", "cuda:2"))
    with three.leased(give_up, 2) as pair:
        assert pair.devices == ("cuda:0", "cuda:1")
        with pytest.raises(Waits), three.leased(give_up, 2):
            pass
        with three.leased(give_up) as single:
            assert single.devices == ("cuda:2",)
    with three.leased(give_up, 3) as all_of_them:
        assert len(all_of_them.devices) == 3


def test_one_device_by_two_names_is_one_device(machine):
    unnumbered, numbered = replace(machine, devices=("cuda",)), replace(machine, devices=("cuda:0",))
    with unnumbered.leased(give_up), pytest.raises(Waits), numbered.leased(give_up):
        pass


def test_a_device_is_known_by_what_this_process_is_shown(machine, monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3")
    with replace(machine, devices=("cuda:0",)).leased(give_up):
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "2,3")
        with machine.leased(give_up) as other:
            assert other.device == "cuda:0"
        with pytest.raises(Waits), replace(machine, devices=("cuda:1",)).leased(give_up):
            pass


def test_processors_are_not_leased(tmp_path):
    machine = Machine(leases=tmp_path / "never made")
    with machine.leased(give_up) as first, machine.leased(give_up):
        assert first is machine


def test_a_killed_owner_holds_nothing(machine):
    command = [sys.executable, "-c", LEASES_AND_SLEEPS, str(machine.leases)]
    owner = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert owner.stdout.readline() == "leased\n"
    only = replace(machine, devices=("cuda:0",))
    with pytest.raises(Waits), only.leased(give_up):
        pass
    owner.kill()
    owner.wait()
    with only.leased(give_up) as mine:
        assert mine.device == "cuda:0"


def test_a_folder_of_leases_that_somebody_has_put_there_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(machine_module.tempfile, "gettempdir", lambda: str(tmp_path))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / f"juicer-devices-{machine_module.os.getuid()}").symlink_to(tmp_path / "elsewhere")
    refused = pytest.raises(ServiceUnavailable, match="belongs to another user; remove it")
    with refused, Machine(devices=("cuda:0",)).leased(give_up):
        pass


def test_trainings_side_by_side_get_a_device_each_and_the_same_id(toys, session, store, machine):
    session = replace(session, machine=machine)
    with ThreadPoolExecutor() as pool:
        refs = list(pool.map(lambda words: toys.devote(session, config=toys.ToyConfig(words=words)), (1, 2)))
    assert {store.manifest(ref).summary["device"] for ref in refs} == {"cuda:0", "cuda:1"}
    assert toys.devote(replace(session, machine=Machine()), config=toys.ToyConfig(words=1)) == refs[0]


def test_an_interrupt_ends_the_wait_for_a_device(toys, session, machine, diary):
    session = replace(session, machine=replace(machine, devices=("cuda:0",)), display=diary)
    threading.Timer(0.3, session.stop.set).start()
    with machine.leased(give_up), pytest.raises(StageInterrupted):
        toys.devote(session, config=toys.ToyConfig(words=3))
    assert diary.progress[0] == (0, 0, {"waiting_for": "cuda:0"})


def test_a_training_needs_as_many_devices_as_processes():
    from stages.train import train

    assert train.facts.needs == "devices"
