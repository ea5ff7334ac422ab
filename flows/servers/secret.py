"""The password between juicer and its servers: made once for a data folder, readable by its owner only."""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

from flows.running.data_folder import private_draft
from flows.servers.guard import Credentials
from juicer.errors import ConfigError, ServiceUnavailable
from juicer.reading import read_bounded

SECRET_FILE = ".servers-password"
USER = "juicer"
_BYTES = 24
_MOST_BYTES = 1000


def new_credentials() -> Credentials:
    """A password that nobody else knows."""
    return Credentials(USER, secrets.token_urlsafe(_BYTES))


def credentials_of(folder: Path) -> Credentials:
    """The password of a data folder, made if there is none.

    It stays the same, so that browsers ask for it once.

    Raises:
        ConfigError: If others can read it, or it is none.
        ServiceUnavailable: If it cannot be written or read.
    """
    path = folder / SECRET_FILE
    try:
        if not path.exists():
            _create(path, new_credentials().password)
        status = path.stat()
        password = read_bounded(path, _MOST_BYTES).decode("ascii", "replace").strip()
    except OSError as error:
        raise ServiceUnavailable(f"the servers' password in '{path}' cannot be used ({error.strerror})") from None
    if status.st_mode & 0o077 or status.st_uid != os.geteuid():
        raise ConfigError(
            f"the servers' password in '{path}' is not yours alone; delete that file, a new one is made then"
        )
    if not password or not all(letter.isalnum() or letter in "-_" for letter in password):
        raise ConfigError(f"the servers' password in '{path}' is none; delete that file, a new one is made then")
    return Credentials(USER, password)


def _create(path: Path, password: str) -> None:
    """Make the file unless another process has; whichever comes first, all read the same."""
    with private_draft(path, password + "\n") as draft, suppress(FileExistsError):
        path.hardlink_to(draft)
