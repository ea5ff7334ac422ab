"""A data folder that cannot be used is named, with the right that is missing, before anything starts."""

from __future__ import annotations

import os
import resource
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

from flows.running.data_folder import prepare_folder, sqlite_address, write_private
from flows.running.settings import Settings
from flows.servers.secret import credentials_of
from juicer.errors import ServiceUnavailable

NOBODY = 65534
SMOKE = Path(__file__).parents[3] / "configs" / "smoke.yaml"


def test_folder_is_made(tmp_path):
    prepare_folder(Settings(data=tmp_path / "a" / "b", store=str(tmp_path / "store")))
    assert (tmp_path / "a" / "b").is_dir()
    assert not list((tmp_path / "a" / "b").iterdir())
    assert (tmp_path / "store").is_dir()


def test_folder_below_a_file_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(
        ServiceUnavailable, match=r"data folder .* cannot be created \(Not a directory at .*JUICER_DATA"
    ):
        prepare_folder(Settings(data=tmp_path / "file" / "data"))


@contextmanager
def full_disk():
    """Files are made, and nothing can be written into them."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limit[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


def test_a_disk_that_takes_nothing_but_names_is_told_before_anything_starts(tmp_path):
    with full_disk(), pytest.raises(ServiceUnavailable, match=r"folder .* cannot be written: a file became larger"):
        prepare_folder(Settings(data=tmp_path))


@pytest.mark.parametrize("write", [partial(write_private, text="a"), lambda path: credentials_of(path.parent)])
def test_what_cannot_be_written_is_named_with_what_helps_and_leaves_nothing(tmp_path, write):
    with full_disk(), pytest.raises(ServiceUnavailable, match=r"cannot be written: .*choose another file system"):
        write(tmp_path / "file")
    assert list(tmp_path.iterdir()) == []


def as_nobody(*arguments, data, **variables):
    """Call ``juicer`` as a user who owns nothing; what is refused to us is refused to root only in this way."""
    if os.geteuid() != 0:
        pytest.skip("only root can become another user")
    environment = {**os.environ, "JUICER_DATA": str(data), "HOME": "/tmp", "PYTHONDONTWRITEBYTECODE": "1", **variables}
    return subprocess.run(
        [sys.executable, "-m", "flows.command.cli", *arguments],
        env=environment,
        user=NOBODY,
        group=NOBODY,
        extra_groups=[],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def elsewhere():
    """A folder that other users reach; pytest's own is closed to them."""
    with tempfile.TemporaryDirectory(prefix="juicer-rights-", dir="/tmp") as name:
        folder = Path(name)
        folder.chmod(0o755)
        yield folder


@pytest.fixture
def ours(elsewhere):
    data = elsewhere / "data"
    data.mkdir(mode=0o755)
    return data


@pytest.mark.parametrize(
    "arguments",
    [f"run {SMOKE}", f"stage record -c {SMOKE}", "ui", "serve", "evaluate ab", "repair ab"],
    ids=lambda arguments: arguments.split()[0],
)
@pytest.mark.usefixtures("python_of_nobody")
def test_commands_that_write_say_whose_folder_it_is(ours, arguments):
    done = as_nobody(*arguments.split(), data=ours)
    assert done.returncode == 1
    assert done.stderr == (
        f"juicer: the data folder '{ours}' cannot be written: you have no right to write in it, as it belongs to "
        "'root'; ask for that right, or set JUICER_DATA to a folder of your own\n"
    )
    assert not done.stdout
    assert not list(ours.iterdir())


@pytest.mark.usefixtures("python_of_nobody")
def test_commands_that_look_need_no_right_to_write(ours):
    assert as_nobody("ls", data=ours).returncode == 0


@pytest.mark.usefixtures("python_of_nobody")
def test_a_database_that_cannot_be_written_is_named(ours):
    (ours / "prefect.db").touch()
    ours.chmod(0o777)
    done = as_nobody("run", str(SMOKE), data=ours)
    assert f"you have no right to write the file '{ours / 'prefect.db'}', which belongs to 'root'" in done.stderr


@pytest.mark.usefixtures("python_of_nobody")
def test_a_store_of_somebody_else_is_named(ours, elsewhere):
    ours.chmod(0o777)
    store = elsewhere / "store"
    store.mkdir(mode=0o755)
    done = as_nobody("run", str(SMOKE), data=ours, JUICER_STORE=str(store))
    assert f"the artifact store '{store}' cannot be written" in done.stderr
    assert "JUICER_STORE" in done.stderr


@pytest.mark.parametrize(
    "name", ["plain", "with space", "50%", "a%41b", "what?", "x#y", "ü", "a+b&c=d;e", "'\"", "a@b:c"]
)
def test_a_database_lands_where_its_path_says(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    engine = create_engine(sqlite_address("sqlite", folder / "file.db"))
    with engine.begin() as connection:
        connection.execute(text("create table here (x)"))
    engine.dispose()
    with sqlite3.connect(folder / "file.db") as database:
        assert database.execute("select name from sqlite_master").fetchall() == [("here",)]
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_an_ordinary_path_stands_in_the_address_as_it_is(tmp_path):
    assert sqlite_address("sqlite", tmp_path / "a b.db") == f"sqlite:///{tmp_path}/a b.db"
