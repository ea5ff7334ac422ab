"""The doctor looks at everything, says what to do, and leaves the machine as it was."""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
from dataclasses import replace

import pytest
from filelock import FileLock

from flows.command.cli import call
from flows.doctor import program
from flows.doctor.drawing import check_drawing
from flows.doctor.examination import CHECKS, examine, usable_settings
from flows.doctor.libraries import check_libraries, check_torch
from flows.doctor.machine import check_cores, check_temporary_files
from flows.doctor.places import check_data_folder, check_leftovers, check_store
from flows.doctor.program import ProgramFailed, run_program
from flows.doctor.surroundings import check_prefect, check_proxies, check_tracking, check_variables
from flows.doctor.verdict import State, ok
from flows.running.settings import RENAMED, Settings
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError


@pytest.fixture
def settings(tmp_path, monkeypatch):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    return Settings()


def states(verdicts):
    return [verdict.state for verdict in verdicts]


def test_every_check_has_a_line_and_every_trouble_a_remedy(settings, capfd):
    found = examine()
    assert {each.name for each in found} == set(CHECKS)
    for each in found:
        assert each.verdict.message
        assert each.verdict.state is State.OK or each.verdict.remedy
    assert capfd.readouterr().err == ""


def test_nothing_is_left_behind(settings, tmp_path, monkeypatch):
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    examine()
    assert not settings.folder.exists()
    settings.folder.mkdir()
    examine()
    assert list(settings.folder.iterdir()) == []
    assert list(folder.iterdir()) == []


def test_command_ends_with_status_1_if_there_is_a_problem(settings, monkeypatch, capsys):
    monkeypatch.setenv("JUICER_WORKERS", "many")
    monkeypatch.setenv("JUICER_STOER", "x")
    assert call(["doctor", "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    troubles = {entry["check"]: entry for entry in content["checks"] if entry["state"] == "problem"}
    assert "JUICER_WORKERS" in troubles["settings"]["message"]
    assert "did you mean 'JUICER_STORE'?" in troubles["variables"]["message"]
    assert content["problems"] >= 2
    monkeypatch.delenv("JUICER_STOER")
    assert call(["doctor"]) == 1
    assert "problem  settings   JUICER_WORKERS: " in capsys.readouterr().out


def test_a_check_that_fails_or_hangs_is_a_finding_and_the_others_go_on(settings):
    hangs = threading.Event()

    def failing(settings):
        yield ok("so far")
        raise RuntimeError("odd\x1b[31m")

    def hanging(settings):
        hangs.wait()
        yield ok("never")

    def refusing(settings):
        raise ConfigError("the address is none; write another")
        yield

    found = examine(
        {"failing": failing, "refusing": refusing, "hanging": hanging, "fine": lambda settings: iter([ok("fine")])}, 0.2
    )
    hangs.set()
    told = {(each.name, each.verdict.state): each.verdict.message for each in found}
    assert told["failing", State.OK] == "so far"
    assert told["failing", State.PROBLEM] == r"this could not be found out (RuntimeError: odd\x1b[31m)"
    assert "not found out in time" in told["hanging", State.WARNING]
    assert told["fine", State.OK] == "fine"
    (refused,) = [each.verdict for each in found if each.name == "refusing"]
    assert (refused.message, refused.remedy) == ("the address is none", "write another")


def test_settings_that_are_not_valid_are_all_told_and_the_rest_is_used(settings, monkeypatch):
    monkeypatch.setenv("JUICER_WORKERS", "0")
    monkeypatch.setenv("JUICER_DEVICE", "gpu")
    found, wrong = usable_settings()
    assert (found.workers, found.device, found.data) == (2, "cpu", settings.data)
    assert [verdict.message.partition(":")[0] for verdict in wrong] == ["JUICER_WORKERS", "JUICER_DEVICE"]


def test_a_crash_in_a_program_is_told_by_its_signal(monkeypatch):
    with pytest.raises(ProgramFailed, match="was ended by SIGABRT"):
        run_program("import os; os.abort()")
    with pytest.raises(ProgramFailed, match="failed: ValueError: no"):
        run_program("raise ValueError('no')")
    monkeypatch.setattr(program, "PATIENCE_SECONDS", 0.2)
    with pytest.raises(ProgramFailed, match="did not end"):
        run_program("import time; time.sleep(60)")


def test_modules_in_the_working_directory_are_not_taken_for_libraries(settings, tmp_path, monkeypatch):
    (tmp_path / "torch.py").write_text("raise SystemExit('hostile')")
    monkeypatch.chdir(tmp_path)
    assert states(check_torch(settings))[-1] is not State.PROBLEM


def test_libraries_out_of_their_range_are_named_with_the_command_that_mends_it(settings, monkeypatch):
    wanted = ["numpy<2", "pytest", "no-such-library>=1", "absent; extra == 'dev'"]
    monkeypatch.setattr("importlib.metadata.requires", lambda name: wanted)
    first, second = check_libraries(settings)
    assert (first.state, first.remedy) == (State.PROBLEM, "pip install 'numpy<2'")
    assert second.message == "no-such-library is not installed"


def test_device_that_is_not_there_is_a_problem(settings):
    (verdict,) = check_torch(settings.model_copy(update={"device": "cuda:99"}))
    assert verdict.state is State.PROBLEM
    assert "there is no device 'cuda:99' here" in verdict.message


def test_drawing_names_its_platform(settings, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "directx")
    (verdict,) = check_drawing(settings)
    assert (verdict.state, verdict.message) == (State.PROBLEM, "MUJOCO_GL is 'directx', which MuJoCo does not know")


@pytest.mark.usefixtures("drawing")
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere MuJoCo chooses")
def test_drawing_is_tried_the_way_images_are_drawn(settings, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    (verdict,) = check_drawing(settings)
    assert (verdict.state, verdict.message) == (State.OK, "an image was drawn through egl")


def test_more_stages_than_processors_is_a_warning(settings):
    assert states(check_cores(settings.model_copy(update={"workers": 1}))) == [State.OK]
    (verdict,) = check_cores(settings.model_copy(update={"workers": 4096}))
    assert "set JUICER_WORKERS=" in verdict.remedy


def test_a_long_path_of_the_folder_for_temporary_files_is_no_problem(settings, tmp_path, monkeypatch):
    folder = tmp_path / ("x" * 80)
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    assert states(check_temporary_files(settings)) == [State.OK]


def test_data_folder_that_cannot_be_one_is_a_problem(settings, tmp_path):
    assert states(check_data_folder(settings)) == [State.OK]
    settings.folder.write_text("a file")
    assert states(check_data_folder(settings)) == [State.PROBLEM]


def test_data_folder_that_everybody_writes_to_is_a_warning(settings):
    settings.folder.mkdir()
    settings.folder.chmod(0o777)
    first, last = check_data_folder(settings)
    assert (first.state, first.remedy) == (State.WARNING, f"chmod o-w '{settings.folder}'")
    assert last.state is State.OK


@pytest.mark.skipif(os.geteuid() == 0, reason="everything lets root in")
def test_data_folder_without_rights_is_a_problem(settings):
    settings.folder.mkdir(mode=0o500)
    assert states(check_data_folder(settings)) == [State.PROBLEM]


def test_artifacts_that_cannot_be_read_are_counted(settings):
    store = ArtifactStore(settings.folder)
    for index in range(2):
        with store.create(Recipe("train", "checkpoint", config={"index": index})):
            pass
    assert states(check_store(settings)) == [State.OK]
    (store.open(store.refs()[0]) / "manifest.json").write_text("nonsense")
    verdict, _ = check_store(settings)
    assert verdict.message.startswith("1 of 2 artifacts")


def test_artifacts_that_come_and_go_meanwhile_are_not_taken_for_unreadable_ones(settings, monkeypatch):
    survey = ArtifactStore.survey

    def survey_late(store, kind=None, beginning=""):
        found = survey(store, kind, beginning)
        return replace(found, refs=(*found.refs, ArtifactRef("episodes", "0" * 16)))

    monkeypatch.setattr(ArtifactStore, "survey", survey_late)
    assert states(check_store(settings)) == [State.OK]


def test_leftovers_of_the_dead_are_told_apart_from_the_work_of_the_living(settings):
    work = settings.folder / ".work"
    for identity in ("dead", "alive"):
        (work / "drafts" / identity).mkdir(parents=True)
    (work / "scratch" / "training").mkdir(parents=True)
    (work / "locks").mkdir()
    with FileLock(work / "locks" / "alive.lock"):
        (work / "locks" / "dead.lock").touch()
        left, waiting = check_leftovers(settings)
    assert left.message.startswith("killed runs left 1 drafts and 1 locks")
    assert waiting.message.startswith("1 unfinished trainings")


def test_proxy_for_this_machines_own_servers_is_a_problem(settings, monkeypatch):
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("http_proxy", "http://user:secret@proxy:3128")
    (verdict,) = check_proxies(settings)
    assert verdict.state is State.PROBLEM
    assert "secret" not in verdict.message
    monkeypatch.setenv("no_proxy", "127.0.0.1,localhost")
    assert states(check_proxies(settings)) == [State.OK]


def test_prefect_server_that_does_not_answer_is_a_problem(settings, monkeypatch):
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    assert states(check_prefect(settings)) == [State.OK]
    assert states(check_prefect(settings.model_copy(update={"runner": "tcp://lab:8786"}))) == [State.PROBLEM]
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/api"
        monkeypatch.setenv("PREFECT_API_URL", address)
        assert states(check_prefect(settings)) == [State.OK]
    (verdict,) = check_prefect(settings)
    assert "does not answer" in verdict.message
    for nonsense in ("nowhere", "http://[::1", "http://127.0.0.1:99999/api"):
        monkeypatch.setenv("PREFECT_API_URL", nonsense)
        (verdict,) = check_prefect(settings)
        assert "is no address" in verdict.message


def test_database_of_records_that_is_none_is_a_problem(settings):
    assert states(check_tracking(settings)) == [State.OK]
    settings.folder.mkdir()
    database = settings.folder / "mlflow.db"
    database.write_bytes(b"this is no database" * 100)
    (verdict,) = check_tracking(settings)
    assert verdict.state is State.PROBLEM
    assert list(settings.folder.iterdir()) == [database]


def test_known_variables_are_listed(settings):
    (verdict,) = check_variables(settings)
    assert "JUICER_DATA" in verdict.message


def test_a_variable_that_was_renamed_is_told_as_every_command_tells_it(settings, monkeypatch):
    monkeypatch.setenv("JUICER_SPREAD", "1")
    (verdict,) = check_variables(settings)
    assert verdict.message == "environment variable JUICER_SPREAD is not known" + RENAMED["JUICER_SPREAD"]


def test_the_doctor_is_quick_to_describe_itself(capsys):
    assert call(["doctor", "--help"]) == 0
    assert "Examine this machine" in capsys.readouterr().out
