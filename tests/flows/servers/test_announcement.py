"""Running servers are found; those that do not answer are named."""

from __future__ import annotations

import re
import socket

import pytest

from flows.environment import API_VARIABLE, DATABASE_VARIABLE, prepare_environment
from flows.servers.addresses import check_reachable
from flows.servers.announcement import Services, announced, find_services
from flows.settings import Settings
from juicer.errors import ConfigError, ServiceUnavailable

SERVICES = Services(prefect="http://127.0.0.1:9", mlflow="http://127.0.0.1:10")


@pytest.fixture
def taken_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


@pytest.fixture
def bare_environment(monkeypatch):
    monkeypatch.setattr("os.environ", {"PATH": "/usr/bin"})


def test_servers_are_announced_for_as_long_as_they_run(tmp_path):
    with announced(tmp_path, SERVICES):
        assert find_services(tmp_path) == SERVICES
    assert find_services(tmp_path) is None


def test_half_written_announcement_counts_as_none(tmp_path):
    (tmp_path / ".services.json").write_text('{"prefect": ')
    assert find_services(tmp_path) is None


def test_server_that_is_gone_is_not_healthy():
    assert not is_prefect_healthy(SERVICES)


def test_wanted_port_in_use_is_an_error_and_a_preferred_one_is_not(taken_port):
    with pytest.raises(ServiceUnavailable, match=rf"port {taken_port} for MLflow is in use"):
        choose_port(taken_port, 5000, "MLflow")
    assert choose_port(None, taken_port, "MLflow") != taken_port


def test_configured_server_that_does_not_answer_is_named(taken_port):
    check_reachable("Prefect server", f"http://127.0.0.1:{taken_port}/api", "start it")
    with pytest.raises(ServiceUnavailable, match=r"'http://127\.0\.0\.1:9/api' does not answer \(.*\); start it"):
        check_reachable("Prefect server", "http://127.0.0.1:9/api", "start it")


@pytest.mark.parametrize(
    "address",
    ["myhost:4200/api", "myhost/api", "http://myhost:42OO/api", "http://myhost:99999/api", "http:///api", "[::1"],
)
def test_address_that_names_no_server_is_told_with_its_variable(tmp_path, bare_environment, address):
    import os

    os.environ[API_VARIABLE] = address
    with pytest.raises(
        ConfigError, match=rf"PREFECT_API_URL: '{re.escape(address)}' is no address; write it as http://"
    ):
        prepare_environment(Settings(data=tmp_path))


def test_without_a_server_prefect_keeps_its_records_in_the_data_folder(tmp_path, bare_environment):
    import os

    assert not prepare_environment(Settings(data=tmp_path))
    assert str(tmp_path) in os.environ[DATABASE_VARIABLE]
    assert os.environ["PREFECT_SERVER_ANALYTICS_ENABLED"] == "false"
    assert API_VARIABLE not in os.environ


def test_announced_server_that_is_gone_is_passed_over(tmp_path, bare_environment):
    with announced(tmp_path, SERVICES):
        assert not prepare_environment(Settings(data=tmp_path))


def test_data_folder_that_cannot_be_created_is_named(tmp_path, bare_environment):
    (tmp_path / "file").touch()
    with pytest.raises(ServiceUnavailable, match=r"data folder .* cannot be created .*JUICER_DATA"):
        prepare_environment(Settings(data=tmp_path / "file" / "data"))
