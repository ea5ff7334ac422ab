"""The servers' password is made once and is its owner's alone."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from flows.running.data_folder import write_private
from flows.servers.secret import SECRET_FILE, credentials_of, new_credentials
from juicer.errors import ConfigError, ServiceUnavailable


def test_password_is_made_once_and_readable_by_its_owner_only(tmp_path):
    first = credentials_of(tmp_path)
    assert len(first.password) >= 32
    assert credentials_of(tmp_path) == first
    assert (tmp_path / SECRET_FILE).stat().st_mode & 0o777 == 0o600
    assert [path.name for path in tmp_path.iterdir()] == [SECRET_FILE]


def test_all_who_make_it_at_once_have_the_same(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        assert len({found.password for found in pool.map(credentials_of, [tmp_path] * 16)}) == 1


def test_no_two_passwords_are_alike():
    assert new_credentials() != new_credentials()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_password_that_others_can_read_is_refused(tmp_path, mode):
    credentials_of(tmp_path)
    (tmp_path / SECRET_FILE).chmod(mode)
    with pytest.raises(ConfigError, match=r"is not yours alone; delete that file"):
        credentials_of(tmp_path)


@pytest.mark.parametrize("content", [b"", b"\n", b"a b", b"\xff\x00", b"a:b"])
def test_nonsense_is_no_password(tmp_path, content):
    write_private(tmp_path / SECRET_FILE, "")
    (tmp_path / SECRET_FILE).write_bytes(content)
    with pytest.raises(ConfigError, match=r"is none; delete that file"):
        credentials_of(tmp_path)


def test_password_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / SECRET_FILE).mkdir()
    with pytest.raises(ServiceUnavailable, match=rf"{SECRET_FILE}' cannot be used \(it is not a plain file\)"):
        credentials_of(tmp_path)


def test_private_file_replaces_what_was_there(tmp_path):
    path = tmp_path / "file"
    path.write_text("old, and open to all")
    write_private(path, "new")
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o600
