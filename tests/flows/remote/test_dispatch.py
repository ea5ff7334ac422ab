"""Stages on other machines are told all that shapes how they are made."""

from __future__ import annotations

from dataclasses import replace

import pytest
from prefect.exceptions import ObjectNotFound

from flows.remote.dispatch import send
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ServiceUnavailable
from stages.record import RecordConfig, record
from stages.runtime.execution import perform_here
from stages.runtime.session import Session


@pytest.mark.parametrize("forced", [True, False])
def test_a_stage_that_is_forced_here_is_forced_there(monkeypatch, tmp_path, forced):
    asked = []

    def run_deployment(name, parameters, **options):
        asked.append(parameters["force"])
        raise ObjectNotFound(Exception("nobody serves"))

    monkeypatch.setattr("flows.remote.dispatch.run_deployment", run_deployment)
    session = replace(Session(ArtifactStore(tmp_path), perform_here), forced=frozenset({"record"} if forced else ()))
    with pytest.raises(ServiceUnavailable):
        send(record.prepare(session, config=RecordConfig(task="one_leg", randomness="low")), session)
    assert asked == [forced]
