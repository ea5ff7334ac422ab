"""Facts about this machine, read from the environment.

Nothing here decides what is computed; what does belongs into a configuration file. The device may change last digits.
"""

from __future__ import annotations

import math
import os
import re
from functools import cached_property
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from pydantic import Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from flows.running.capacity import stages_at_a_time
from juicer.errors import ConfigError, did_you_mean
from juicer.policy.pretrained.files import DEFAULT_FOLDER, expanded
from juicer.problems import first_problem
from juicer.text import printable
from stages.runtime.machine import Machine

PREFIX = "JUICER_"
RUNNER_VARIABLE = f"{PREFIX}RUNNER"
RENAMED = {f"{PREFIX}SPREAD": f"; {RUNNER_VARIABLE} now says where stages run, e.g. dask or tcp://HOST:8786"}
LONGEST_PLACE = 4096
ACTING_ROWS = 16
"""As :data:`juicer.policy.acting.INFERENCE_ROWS`, which is not imported as torch takes long."""


class Settings(BaseSettings):
    """Where things lie and how much of the machine may be used; each field is ``JUICER_<FIELD>``.

    Attributes:
        data: Local folder for the databases, the services' addresses and notes of what MLflow shall show.
        store: Artifact store, a folder or an fsspec URL such as ``s3://bucket/juicer``; ``data`` if empty.
        tracking_uri: MLflow tracking address; a SQLite file in ``data`` if empty, ``none`` to track nothing.
        workers: Stages that run at the same time, and threads that step the environments of one; as many as there are
            processors and memory for if empty.
        runner: Where the stages of flows run: ``threads`` of this process; workers of ``dask`` or ``ray`` that are
            started on this machine for the run; or those of a cluster, by the address of Dask's scheduler
            (``tcp://HOST:8786``) or of Ray's head (``ray://HOST:10001``).
        num_envs: Simulated environments that a rollout steps side by side; if empty, as many as keep these threads
            busy, in the batches in which a policy computes its actions.
        device: Torch device that policies are trained on and act on: ``cpu``, ``cuda``, or ``cuda:1`` for the second;
            of several, ``cuda:0,cuda:1``, each takes a training of its own.
        train_processes: Processes that train one policy together, each on one of these devices.
        loaders: Processes that gather the batches of each of them ahead of time; if empty, four where a policy learns
            from images on a GPU, and none elsewhere.
        weights: Folder in which files of pretrained weights are looked for, by default below the user's
            home, or ``weights`` in ``data`` if there is none; see `juicer doctor --encoders`.
        allowed_hosts: Names, besides this machine's own, by which browsers and clients may reach servers that juicer
            runs, such as ``prefect.example.org`` or ``127.0.0.1:14200``; separated by commas.
        startup_seconds: How long a Prefect or MLflow server may take to answer after its start.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, frozen=True, extra="forbid", env_ignore_empty=True)

    data: Path = Path("data")
    store: str = ""
    tracking_uri: str = ""
    workers: int = Field(default_factory=stages_at_a_time, ge=1, le=1024)
    runner: str = "threads"
    num_envs: int | None = Field(default=None, ge=1, le=4096)
    device: str = "cpu"
    train_processes: int = Field(default=1, ge=1, le=64)
    loaders: int | None = Field(default=None, ge=0, le=64)
    weights: Path = DEFAULT_FOLDER
    allowed_hosts: str = ""
    startup_seconds: int = Field(default=120, ge=1, le=86_400)

    @field_validator("data", "store", "weights", "tracking_uri", "allowed_hosts")
    @classmethod
    def _is_plain_text(cls, value: Path | str) -> Path | str:
        if len(str(value)) > LONGEST_PLACE or printable(value, LONGEST_PLACE) != str(value):
            raise ValueError(f"must be at most {LONGEST_PLACE} letters and without control characters")
        return value

    @field_validator("runner")
    @classmethod
    def _is_a_runner(cls, value: str) -> str:
        try:
            is_address = bool(re.fullmatch(r"(tcp|tls|ray)://[^\s/]+", value) and urlsplit(value).port)
        except ValueError:
            is_address = False
        if not is_address and value not in ("threads", "dask", "ray"):
            raise ValueError("must be threads, dask, ray, or a cluster's address such as tcp://HOST:8786")
        return value

    @field_validator("device")
    @classmethod
    def _is_a_device(cls, value: str) -> str:
        if not re.fullmatch(r"cpu|cuda(:[0-9]{1,3})?(,cuda:[0-9]{1,3})*", value):
            raise ValueError("must be cpu, cuda, or cuda:0,cuda:1 and so on for several")
        return value

    @field_validator("data", "store", "weights")
    @classmethod
    def _has_a_home(cls, value: Path | str) -> Path | str:
        if value != DEFAULT_FOLDER and expanded(Path(value)) is None:
            raise ValueError(f"there is no user {Path(value).parts[0]}")
        return value

    @cached_property
    def folder(self) -> Path:
        """The data folder as an absolute path."""
        return self.data.expanduser().absolute()

    @property
    def store_url(self) -> str:
        """Address of the artifact store."""
        return self.store or str(self.folder)

    @property
    def devices(self) -> tuple[str, ...]:
        """The devices, each once: beside others, ``cuda`` is the first of them."""
        named = self.device.split(",")
        return tuple(dict.fromkeys("cuda:0" if each == "cuda" and len(named) > 1 else each for each in named))

    @property
    def machine(self) -> Machine:
        """How much of this machine a stage may use."""
        # A user of a container may have no home.
        weights = (expanded(self.weights) or self.folder / "weights").absolute()
        # Policies act in batches of as many rows, whether there are episodes to fill them or not.
        num_envs = self.num_envs or ACTING_ROWS * math.ceil(self.workers / ACTING_ROWS)
        return Machine(self.workers, num_envs, self.devices, self.train_processes, self.loaders, weights=weights)

    @property
    def runner_kind(self) -> Literal["threads", "dask", "ray"]:
        """Whose workers the stages run on."""
        scheme, separator, _ = self.runner.partition("://")
        return "ray" if scheme == "ray" else "dask" if separator or scheme == "dask" else "threads"

    @property
    def cluster(self) -> str:
        """Address of a cluster of several machines; empty if workers are this machine's."""
        return self.runner if "://" in self.runner else ""

    @property
    def tracks(self) -> bool:
        """Whether anything is recorded in MLflow."""
        return self.tracking_uri.lower() != "none"


def read_settings() -> Settings:
    """Settings of this process.

    Raises:
        ConfigError: If a variable with the prefix is unknown or its value is not valid.
    """
    known = {PREFIX + name.upper() for name in Settings.model_fields}
    for name in os.environ:
        if name.startswith(PREFIX) and name not in known:
            remedy = RENAMED.get(name) or did_you_mean(name, known)
            raise ConfigError(f"environment variable {printable(name)} is not known{remedy}")
    try:
        return Settings()
    except ValidationError as error:
        problem = first_problem(error, {})
        name, _, message = problem.sentence.partition(": ")
        raise ConfigError(f"environment variable {PREFIX}{name.upper()}: {message}") from None
