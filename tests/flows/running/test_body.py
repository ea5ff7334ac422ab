"""What a flow run's page in Prefect leads to."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest
from prefect import flow, get_client
from prefect.client.schemas.filters import ArtifactFilter, ArtifactFilterFlowRunId
from prefect.context import FlowRunContext
from prefect.testing.utilities import prefect_test_harness

from flows.config import CollectInferConfig
from flows.running.body import _show
from flows.running.execution import RunOutcome
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.pages.addresses import lineage_of


@pytest.fixture(scope="module", autouse=True)
def prefect_server() -> Iterator[None]:
    with prefect_test_harness(server_startup_timeout=120):
        yield


@pytest.fixture
def store(tmp_path) -> ArtifactStore:
    return ArtifactStore(tmp_path)


@pytest.fixture
def report(store: ArtifactStore) -> ArtifactRef:
    with store.create(Recipe("report", "report")) as draft:
        (draft.path / "report.html").write_text("")
    return draft.ref


def shown(outcome: RunOutcome, store: ArtifactStore, pages: str) -> dict[str, str]:
    """What Prefect's API tells of a flow run's artifacts, by their keys."""

    @flow(persist_result=False)
    def run() -> object:
        _show(outcome, CollectInferConfig(), store, pages)
        context = FlowRunContext.get()
        assert context is not None
        assert context.flow_run is not None
        return context.flow_run.id

    async def read(flow_run_id) -> dict[str, str]:
        of_run = ArtifactFilter(flow_run_id=ArtifactFilterFlowRunId(any_=[flow_run_id]))
        async with get_client() as client:
            return {str(each.key): str(each.data) for each in await client.read_artifacts(artifact_filter=of_run)}

    return asyncio.run(read(run()))


def test_a_flow_run_links_to_the_lineage_where_pages_are_served(store, report):
    told = shown(RunOutcome((), report), store, "http://127.0.0.1:8000")
    assert told["lineage"] == f"[Lineage]({lineage_of(str(report), 'http://127.0.0.1:8000')})"


def test_a_table_that_prefect_does_not_take_costs_no_finished_run(store, report, monkeypatch):
    def refuse(**arguments):
        raise RuntimeError("the server is away")

    monkeypatch.setattr("flows.running.body.create_table_artifact", refuse)
    monkeypatch.setattr("flows.running.body.create_markdown_artifact", refuse)
    monkeypatch.setattr(RunOutcome, "findings", ("TA, seed 0: no successful rollout",))
    assert set(shown(RunOutcome((), report), store, "http://127.0.0.1:8000")) == {"lineage"}


@pytest.mark.parametrize("pages", ["", "http://127.0.0.1:8000"])
def test_a_flow_run_links_to_no_page_that_is_not_there(store, report, pages):
    outcome = RunOutcome((), None if pages else report)
    assert set(shown(outcome, store, pages)) == {"comparison"}
