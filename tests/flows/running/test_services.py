"""Running servers are found; those that do not answer are named."""

from __future__ import annotations

import errno
import os
import platform
import re
import socket
import subprocess
import sys

import pytest

from flows.running.services import SERVICES_FILE, Pages, Services, announce, find_pages, find_services, only_one
from flows.running.settings import Settings
from flows.servers.addresses import check_reachable, is_answering, listen, port_of
from flows.servers.environment import API_VARIABLE, DATABASE_VARIABLE, PASSWORD_VARIABLE, prepare_environment
from juicer.errors import ConfigError, ServiceUnavailable

SERVICES = Services(prefect="http://127.0.0.1:9", mlflow="http://127.0.0.1:10")
KILLED = """
import os, pathlib, signal, sys
from flows.running.services import Services, announce, only_one
folder = pathlib.Path(sys.argv[1])
with only_one(folder), announce(folder, Services("http://127.0.0.1:9", "http://127.0.0.1:10")):
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def taken_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


@pytest.fixture
def bare_environment(monkeypatch):
    monkeypatch.setattr("os.environ", {"PATH": "/usr/bin"})


def test_servers_are_announced_for_as_long_as_they_run(tmp_path):
    with only_one(tmp_path) as is_free, announce(tmp_path, SERVICES):
        assert is_free
        assert find_services(tmp_path) == SERVICES
        assert (tmp_path / SERVICES_FILE).stat().st_mode & 0o777 == 0o600
    assert find_services(tmp_path) is None


def test_pages_are_announced_beside_the_servers(tmp_path):
    with only_one(tmp_path, Pages) as is_free, only_one(tmp_path), announce(tmp_path, SERVICES):
        assert is_free
        assert find_pages(tmp_path) == ""
        with announce(tmp_path, Pages("http://127.0.0.1:11")):
            assert find_pages(tmp_path) == "http://127.0.0.1:11"
            assert find_services(tmp_path) == SERVICES
    assert find_pages(tmp_path) == ""


def test_a_file_system_without_locks_is_not_taken_for_somebody_else(tmp_path, monkeypatch):
    def refuse(descriptor, kind):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    with pytest.raises(ServiceUnavailable, match="its file system offers no locks; choose another place"):
        only_one(tmp_path).__enter__()
    assert find_services(tmp_path) is None


def test_a_lock_that_cannot_be_opened_is_named(tmp_path):
    (tmp_path / ".pages.lock").mkdir()
    with pytest.raises(ServiceUnavailable, match=r"\.pages\.lock' cannot be written: .*a folder stands where a file"):
        only_one(tmp_path, Pages).__enter__()


def test_two_do_not_serve_the_same_folder(tmp_path):
    with only_one(tmp_path) as first, only_one(tmp_path) as second:
        assert first
        assert not second
    with only_one(tmp_path) as third:
        assert third


def test_announcement_of_a_killed_process_is_void(tmp_path):
    # Whoever has taken over the port must not be sent a password.
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert (tmp_path / SERVICES_FILE).exists()
    assert find_services(tmp_path) is None


def test_what_a_killed_process_announced_does_not_count_while_the_next_one_starts(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    with only_one(tmp_path) as is_free:
        assert is_free
        assert find_services(tmp_path) is None
        with announce(tmp_path, SERVICES), only_one(tmp_path) as again:
            assert not again
            assert find_services(tmp_path) == SERVICES


def test_announcement_of_another_machine_is_void(tmp_path):
    elsewhere = Services(SERVICES.prefect, SERVICES.mlflow, machine=f"not-{platform.node()}")
    with only_one(tmp_path), announce(tmp_path, elsewhere):
        assert find_services(tmp_path) is None


@pytest.mark.parametrize("content", ["", '{"prefect": ', "[]", "null", '{"prefect": 1, "mlflow": 2}', "x" * 20_000])
def test_nonsense_counts_as_no_announcement(tmp_path, content):
    with only_one(tmp_path):
        (tmp_path / SERVICES_FILE).write_text(content)
        assert find_services(tmp_path) is None


def test_announcement_that_is_a_pipe_is_not_waited_for(tmp_path):
    with only_one(tmp_path):
        os.mkfifo(tmp_path / SERVICES_FILE)
        assert find_services(tmp_path) is None


def test_server_that_is_gone_does_not_answer():
    assert not is_answering(f"{SERVICES.prefect_api}/health")


def test_wanted_port_in_use_is_an_error_and_a_preferred_one_is_not(taken_port):
    with pytest.raises(ServiceUnavailable, match=rf"port {taken_port} for MLflow is in use; choose"):
        listen(taken_port, 5000, "MLflow")
    with listen(None, taken_port, "MLflow") as listener:
        assert port_of(listener) != taken_port


def test_configured_server_that_does_not_answer_is_named(taken_port):
    check_reachable("Prefect server", f"http://127.0.0.1:{taken_port}/api", "start it")
    with pytest.raises(ServiceUnavailable, match=r"'http://127\.0\.0\.1:9/api' does not answer \(.*\); start it"):
        check_reachable("Prefect server", "http://127.0.0.1:9/api", "start it")


@pytest.mark.parametrize(
    "address",
    ["myhost:4200/api", "myhost/api", "http://myhost:42OO/api", "http://myhost:99999/api", "http:///api", "[::1"],
)
def test_address_that_names_no_server_is_told_with_its_variable(tmp_path, bare_environment, address):
    os.environ[API_VARIABLE] = address
    with pytest.raises(
        ConfigError, match=rf"PREFECT_API_URL: '{re.escape(address)}' is no address; write it as http://"
    ):
        prepare_environment(Settings(data=tmp_path))


def test_without_a_server_prefect_keeps_its_records_in_the_data_folder(tmp_path, bare_environment):
    assert not prepare_environment(Settings(data=tmp_path))
    assert str(tmp_path) in os.environ[DATABASE_VARIABLE]
    assert os.environ["PREFECT_SERVER_ANALYTICS_ENABLED"] == "false"
    assert not {API_VARIABLE, PASSWORD_VARIABLE} & set(os.environ)


def test_announced_server_that_is_gone_is_passed_over(tmp_path, bare_environment):
    with only_one(tmp_path), announce(tmp_path, SERVICES):
        assert not prepare_environment(Settings(data=tmp_path))
