"""Where records go: an MLflow server, or a database in the data folder that is made and moved with it."""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from filelock import FileLock

from juicer.errors import TrackingError
from stages.runtime.connection import connect

if TYPE_CHECKING:
    from mlflow import MlflowClient

CONNECT_SECONDS = 5.0
LOCK = "publishing.lock"
VIEW = "juicer"
"""Name of the view on a study's runs that opens at the addresses we print: grouped by condition."""
MODELS_VIEW = "juicer-models"
"""Name of the view that shows each model by itself."""

PLACES = (
    ("experiments", "artifact_location"),
    ("runs", "artifact_uri"),
    ("model_versions", "source"),
    ("model_versions", "storage_location"),
    ("logged_models", "artifact_location"),
)
"""Columns of MLflow's database that hold absolute addresses of files."""


@dataclass(frozen=True)
class Destination:
    """Where records go.

    Attributes:
        uri: MLflow tracking address.
        folder: What shall be recorded there is noted here; another destination must not get it.
        artifact_root: Where files of a database in the data folder are; a server decides itself.
    """

    uri: str
    folder: Path
    artifact_root: Path | None = None

    @classmethod
    def of(cls, uri: str, folder: Path) -> Destination:
        """A destination somewhere else, for notes below a folder."""
        return cls(uri, folder / hashlib.sha256(uri.encode()).hexdigest()[:8])

    @property
    def shown(self) -> str:
        """The address as people may see it."""
        return without_credentials(self.uri)

    @property
    def lock(self) -> FileLock:
        """Held by the one process of a data folder that publishes, or makes the database."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return FileLock(self.folder / LOCK)

    def connect(self) -> MlflowClient:
        """A client of MLflow that was answered once.

        Raises:
            Exception: Of whatever kind the libraries on the way raise, if it cannot be reached.
        """
        if urlsplit(self.uri).scheme in ("http", "https"):
            # Fails at once where MLflow would try for a minute.
            connect(self.uri, CONNECT_SECONDS)
        from mlflow import MlflowClient

        _create_database(self.uri, self.artifact_root)
        # Models go where the runs go, whatever MLFLOW_REGISTRY_URI says.
        client = MlflowClient(self.uri, registry_uri=self.uri)
        client.search_experiments(max_results=1)
        return client

    def initialise(self) -> MlflowClient:
        """Connect, one process at a time: several that make the tables of a database at once break it.

        Raises:
            TrackingError: If the destination cannot be used.
        """
        try:
            with self.lock:
                return self.connect()
        except Exception as error:
            raise TrackingError(f"MLflow at '{self.shown}' cannot be used: {reason(error)}") from None


def without_credentials(address: str) -> str:
    """An address without the user and the password that it may hold, to be shown."""
    scheme, separator, rest = address.rpartition("://")
    place, slash, path = rest.partition("/")
    return f"{scheme}{separator}{place.rpartition('@')[2]}{slash}{path}"


def reason(error: Exception) -> str:
    """What an error of a library says, on one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def newest_study(client: MlflowClient) -> str | None:
    """Id of the experiment that was shown last; none before there is any."""
    found = client.search_experiments(
        max_results=1, filter_string="name != 'Default'", order_by=["last_update_time DESC"]
    )
    return found[0].experiment_id if found else None


def runs_page(pages: str, experiment: str | None, view: str = VIEW) -> str:
    """Address of a study's runs in MLflow, success rates in front and the best first.

    Args:
        pages: Address of MLflow's pages.
        experiment: Id of the study's experiment; all experiments if None.
        view: Name of the view.
    """
    if experiment is None:
        return f"{pages.rstrip('/')}/#/experiments"
    return f"{pages.rstrip('/')}/#/experiments/{experiment}/runs?viewStateShareKey={view}"


def _create_database(uri: str, artifact_root: Path | None) -> None:
    """Create a missing SQLite database, and tell an existing one where its files are now.

    Its tables are made by dozens of migrations, which SQLite does not undo: a process that is killed among them would
    leave a database that no later one can use. It is made under another name first.
    """
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore
    from sqlalchemy.engine import make_url

    url = make_url(uri) if uri.startswith("sqlite") else None
    if not url or not url.database:
        return
    path = Path(url.database)
    # The experiment that is always there must not keep its files in the working directory.
    root = (artifact_root or path.parent / "mlflow-files").absolute().as_uri()
    if not path.exists():
        draft = path.with_name(f"{path.name}.draft")
        draft.unlink(missing_ok=True)
        address = url.set(database=str(draft)).render_as_string(hide_password=False)
        SqlAlchemyStore(address, root)  # type: ignore[no-untyped-call]  # MLflow's own
        draft.replace(path)
    elif artifact_root:
        _tell_new_place(path, root)


def _tell_new_place(database: Path, root: str) -> None:
    """Have a database that came along with a copied or moved data folder name the files that came along, too."""
    with closing(sqlite3.connect(database)) as connection, connection:
        row = connection.execute("select artifact_location from experiments where experiment_id = 0").fetchone()
        old = row[0].rpartition("/")[0] if row and row[0] else root
        if old == root:
            return
        for table, column in PLACES:
            connection.execute(
                f"update {table} set {column} = ? || substr({column}, ?) where substr({column}, 1, ?) = ?",
                (root, len(old) + 1, len(old) + 1, f"{old}/"),
            )
