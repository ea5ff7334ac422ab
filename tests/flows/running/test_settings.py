"""Facts about the machine come from the environment, and a misspelt variable is not ignored."""

from __future__ import annotations

import pytest

from flows.running import capacity
from flows.running.device import check_device
from flows.running.settings import ACTING_ROWS, read_settings
from juicer.errors import ConfigError
from juicer.policy.acting import INFERENCE_ROWS, ROWS_OF_IMAGES


def test_defaults_stay_in_the_data_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    settings = read_settings()
    assert settings.store_url == str(tmp_path / "data")
    assert settings.tracks


def test_store_and_tracking_can_be_elsewhere(monkeypatch):
    monkeypatch.setenv("JUICER_STORE", "s3://bucket/juicer")
    monkeypatch.setenv("JUICER_TRACKING_URI", "none")
    assert read_settings().store_url == "s3://bucket/juicer"
    assert not read_settings().tracks


@pytest.mark.parametrize("device", ["cpu", "cuda", "cuda:1"])
def test_device_may_be_a_gpu(monkeypatch, device):
    monkeypatch.setenv("JUICER_DEVICE", device)
    assert read_settings().device == device


def test_devices_are_counted_once_each(monkeypatch):
    monkeypatch.setenv("JUICER_DEVICE", "cuda:0,cuda:1,cuda:0")
    assert read_settings().machine.devices == ("cuda:0", "cuda:1")
    monkeypatch.setenv("JUICER_DEVICE", "cuda,cuda:0,cuda:1")
    assert read_settings().machine.devices == ("cuda:0", "cuda:1")
    monkeypatch.setenv("JUICER_DEVICE", "cuda")
    assert read_settings().machine.devices == ("cuda",)


def test_processes_of_a_training_are_a_fact_about_the_machine(monkeypatch):
    assert (read_settings().machine.processes, read_settings().machine.loaders) == (1, None)
    monkeypatch.setenv("JUICER_TRAIN_PROCESSES", "2")
    monkeypatch.setenv("JUICER_LOADERS", "0")
    assert (read_settings().machine.processes, read_settings().machine.loaders) == (2, 0)


def test_more_processes_than_devices_are_refused_before_anything_starts(monkeypatch):
    monkeypatch.setenv("JUICER_DEVICE", "cuda:0,cuda:1")
    monkeypatch.setenv("JUICER_TRAIN_PROCESSES", "3")
    with pytest.raises(ConfigError, match=r"JUICER_TRAIN_PROCESSES: 3 processes need a device each.* names 2$"):
        check_device(read_settings())


@pytest.mark.parametrize(
    ("runner", "kind", "cluster"),
    [
        ("threads", "threads", ""),
        ("dask", "dask", ""),
        ("tls://lab:8786", "dask", "tls://lab:8786"),
        ("ray", "ray", ""),
        ("ray://lab:10001", "ray", "ray://lab:10001"),
    ],
)
def test_an_address_says_whose_cluster_it_is(monkeypatch, runner, kind, cluster):
    monkeypatch.setenv("JUICER_RUNNER", runner)
    assert (read_settings().runner_kind, read_settings().cluster) == (kind, cluster)


@pytest.mark.parametrize(("cores", "memory", "workers"), [(2, 8e9, 2), (64, 128e9, 64), (64, 5.2e9, 5), (0.5, 1e8, 1)])
def test_as_many_stages_run_as_there_are_processors_and_memory_for(monkeypatch, cores, memory, workers):
    monkeypatch.setattr(capacity, "usable_cores", lambda: cores)
    monkeypatch.setattr(capacity, "available_memory", lambda: memory)
    monkeypatch.delenv("JUICER_WORKERS", raising=False)
    assert read_settings().workers == workers


def test_copies_of_files_do_not_use_up_the_memory_of_a_container(monkeypatch, tmp_path):
    monkeypatch.setattr(capacity, "_CGROUP", tmp_path)
    for name, text in (
        ("memory.max", "200000000"),
        ("memory.current", "190000000"),
        ("memory.stat", "anon 40000000\ninactive_file 120000000\nactive_file 30000000"),
    ):
        (tmp_path / name).write_text(f"{text}\n")
    assert capacity.available_memory() == 130_000_000


@pytest.mark.parametrize(("workers", "num_envs"), [("1", 16), ("16", 16), ("17", 32), ("64", 64)])
def test_environments_keep_every_thread_busy_in_whole_batches_of_a_policy(monkeypatch, workers, num_envs):
    monkeypatch.setenv("JUICER_WORKERS", workers)
    assert read_settings().machine.num_envs == num_envs
    assert ACTING_ROWS == INFERENCE_ROWS
    assert ACTING_ROWS % ROWS_OF_IMAGES == 0
    monkeypatch.setenv("JUICER_NUM_ENVS", "3")
    assert read_settings().machine.num_envs == 3


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("JUICER_STOER", "x", r"JUICER_STOER is not known; did you mean 'JUICER_STORE'\?"),
        ("JUICER_WORKERS", "many", r"JUICER_WORKERS: .*got 'many'"),
        ("JUICER_WORKERS", "0", r"JUICER_WORKERS: must be at least 1, got '0'"),
        ("JUICER_WORKERS", "1e9", r"JUICER_WORKERS: must be a whole number, got '1e9'"),
        ("JUICER_WORKERS", "9" * 5000, r"JUICER_WORKERS: must be .*, got"),
        ("JUICER_NUM_ENVS", "1000000000", r"JUICER_NUM_ENVS: must be at most 4096"),
        ("JUICER_TRAIN_PROCESSES", "0", r"JUICER_TRAIN_PROCESSES: must be at least 1, got '0'"),
        ("JUICER_LOADERS", "some", r"JUICER_LOADERS: .*got 'some'"),
        ("JUICER_SPREAD", "1", r"JUICER_SPREAD is not known; JUICER_RUNNER now says where stages run"),
        ("JUICER_RUNNER", "perhaps", r"JUICER_RUNNER: must be threads, dask, ray, or .*, got 'perhaps'"),
        ("JUICER_RUNNER", "tcp://lab", r"JUICER_RUNNER: .*got 'tcp://lab'"),
        ("JUICER_RUNNER", "tcp://lab:99999", r"JUICER_RUNNER: .*got 'tcp://lab:99999'"),
        ("JUICER_RUNNER", "tcp://[::1:8786", r"JUICER_RUNNER: .*got 'tcp://\[::1:8786'"),
        ("JUICER_DEVICE", "cuda:0,cpu", r"JUICER_DEVICE: .*got 'cuda:0,cpu'"),
        ("JUICER_DATA", "a\x1b[2Jb", r"JUICER_DATA: must be .* without control characters, got 'a\\+x1b\[2Jb'"),
        ("JUICER_STORE", "x" * 5000, r"JUICER_STORE: must be at most 4096 letters"),
        ("JUICER_W\x1bORKERS", "1", r"JUICER_W\\x1bORKERS is not known; did you mean 'JUICER_WORKERS'"),
        ("JUICER_DEVICE", "gpu", r"JUICER_DEVICE: must be cpu, cuda, or .*, got 'gpu'"),
        ("JUICER_DATA", "~nobody-here/data", r"JUICER_DATA: there is no user ~nobody-here"),
        ("JUICER_STORE", "~nobody-here", r"JUICER_STORE: there is no user ~nobody-here"),
        ("JUICER_DEVICE", "cuda:first", r"JUICER_DEVICE: .*got 'cuda:first'"),
    ],
)
def test_mistake_names_the_variable(monkeypatch, name, value, message):
    monkeypatch.setenv(name, value)
    with pytest.raises(ConfigError, match=message):
        read_settings()
