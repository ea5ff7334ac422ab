"""A Prefect server for one run, where none is running.

It is Prefect's own temporary server with these differences: it answers nobody but the run; an interrupt from the
keyboard reaches the run only, which then ends in order; and it ends with the run even if that is killed.
"""

from __future__ import annotations

import atexit

from flows.servers.addresses import LOOPBACK, listen_on
from flows.servers.environment import API_VARIABLE, PASSWORD_VARIABLE, auth_string
from flows.servers.process import ServerProcess, await_health
from flows.servers.program import PREFECT_PASSWORD
from flows.servers.secret import new_credentials


class TemporaryServer:
    """The server's process; starts at once, becomes ready while this process imports Prefect.

    Attributes:
        variables: What a process needs in its environment to be served; the password is known to this process only.
    """

    def __init__(self) -> None:
        """Start the process; it is stopped when this one exits."""
        password = auth_string(new_credentials())
        environment = {
            PREFECT_PASSWORD: password,
            "PREFECT_SERVER_UI_ENABLED": "false",
            # The blueprints of notifications and the like, which a run does not use.
            "PREFECT_SERVER_REGISTER_BLOCKS_ON_START": "false",
            "PREFECT__SERVER_EPHEMERAL": "1",
        }
        with listen_on(LOOPBACK, 0) as listener:
            self._process = ServerProcess("prefect", "/api/health", listener, environment)
        self.variables = {API_VARIABLE: f"{self._process.url}/api", PASSWORD_VARIABLE: password}
        # Registered before Prefect is imported, so that Prefect can say its last words before the server goes.
        atexit.register(self.stop)

    @property
    def has_ended(self) -> bool:
        """Whether its process is gone."""
        return self._process.has_ended

    def wait(self, seconds: float) -> None:
        """Wait until it answers.

        Raises:
            ServiceUnavailable: If it does not, or ends.
        """
        await_health([self._process], seconds)

    def stop(self) -> None:
        """End the process."""
        self._process.stop()
