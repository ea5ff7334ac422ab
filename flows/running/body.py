"""The body that both flows share: everything a configuration asks for, as Prefect tasks of the flow run around it."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence

from prefect.artifacts import (
    create_image_artifact,
    create_link_artifact,
    create_markdown_artifact,
    create_table_artifact,
)
from prefect.runtime import flow_run

from flows.config import RunConfig
from flows.running.context import expect, open_run
from flows.running.execution import RunOutcome, comparison_title, execute
from flows.running.flow_runs import held
from flows.running.plan import plan, require_drawing, require_weights
from flows.running.runner import opener
from flows.running.services import find_pages
from flows.running.settings import read_settings
from juicer.artifacts.store import ArtifactStore
from juicer.pages.addresses import lineage_of
from juicer.reporting.comparison import robustness_table
from stages.report import VARIED
from stages.runtime.prefect_display import artifact_key, attempt
from stages.runtime.prefect_task import PrefectPerformer

_VARIED_IMAGES = "Images as policies see them when acting, and as they were varied in training"


def run(config: RunConfig) -> RunOutcome:
    """Run a configuration within a Prefect flow run."""
    settings = read_settings()
    with (
        held(settings.folder, flow_run.get_id()),
        open_run(settings, config, PrefectPerformer(opener(settings))) as run_context,
    ):
        store = run_context.session.store
        planned = plan(store, config)
        if not settings.cluster:  # whose machines have folders of their own
            require_weights(planned, settings.machine.weights)
            require_drawing(planned)
        expect(run_context, planned, settings.folder)
        outcome = execute(run_context.session, config, run_context.tracking)
        _show(outcome, config, store, find_pages(settings.folder))
        return outcome


def _show(outcome: RunOutcome, config: RunConfig, store: ArtifactStore, pages: str) -> None:
    """The comparison on the flow run's page, and a link to the lineage if pages are served at an address."""
    title = comparison_title(config)
    _show_table("comparison", outcome.comparison(store), title)
    _show_table("robustness", robustness_table(outcome.results(store)), f"{title} under shifts")
    for figure in sorted(store.open(outcome.report).glob("*.png")) if outcome.report else ():
        address = f"data:image/png;base64,{base64.b64encode(figure.read_bytes()).decode()}"
        key = artifact_key(figure.stem)
        caption = _VARIED_IMAGES if figure.stem.startswith(VARIED) else re.sub("[_.]", " ", figure.stem)
        attempt(create_image_artifact, image_url=address, key=key, description=caption)
    if pages and outcome.report:
        link = lineage_of(str(outcome.report), pages)
        attempt(
            create_link_artifact, link=link, link_text="Lineage", key="lineage", description="What all was made from"
        )
    if outcome.findings:
        lines = "\n".join(f"- {finding}" for finding in outcome.findings)
        told = "Models that learned from too little"
        attempt(create_markdown_artifact, markdown=lines, key="findings", description=told)


def _show_table(key: str, table: tuple[Sequence[str], Sequence[Sequence[str]]], description: str) -> None:
    columns, rows = table
    if columns:
        content = [dict(zip(columns, row, strict=True)) for row in rows]
        attempt(create_table_artifact, table=content, key=key, description=description)
