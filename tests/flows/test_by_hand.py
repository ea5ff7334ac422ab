"""From somebody's keys to a checkpoint: driven, saved, annotated and trained on, by the real pages and commands."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks.page.chromium import CHROMIUM, Chromium
from benchmarks.page.driving import begin, drive
from benchmarks.page.hands import Hands
from benchmarks.page.marking import READY
from benchmarks.page.marking import begin as begin_marking
from benchmarks.page.server import Server, serving
from juicer.api import load_episodes, load_policy, open_store
from juicer.storage.annotations import read_annotations

ATTEMPTS, SECONDS = 6, 300
# One demonstration is enough, if none has to be held out.
CONFIGURATION = """
base: smoke
name: by_hand
logs: data/teleoperation/one_leg
condition: ta
augment: {num_snippets: 2}
policies: {diffusion: {training: {steps: 20, warmup_steps: 5, validation_fraction: 0, report_every: 5}}}
evaluate: {episodes: 2, max_steps: 20}
"""
VERSIONS = "data/labels/one_leg.versions.jsonl"
BACK = 3
"""Steps between what is proposed and what is marked, so that it can be told whose mark was used."""


def juicer(folder: Path, *arguments: str) -> str:
    environment = os.environ | {"JUICER_DATA": str(folder / "data")}
    command = [sys.executable, "-m", "juicer", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def demonstrate(browser: Chromium, server: Server) -> None:
    begin(browser, server.teleop)
    assert any(drive(browser, Hands("one_leg", attempt), SECONDS).success for attempt in range(ATTEMPTS))
    browser.until("teleop.status.kept[0].verification.verdict === 'verified'", 120)


def mark(browser: Chromium, server: Server, episodes: str, versions: Path) -> dict[str, Any]:
    """Annotate the only demonstration; what stands in the file then."""
    begin_marking(browser, server, episodes)
    browser.until(READY)
    for _ in range(BACK):
        browser.press("ArrowLeft")
    browser.press("Enter")
    browser.until("document.querySelector('#progress').textContent.startsWith('1 of 1 marked, 0 to go')")
    end = time.monotonic() + 30
    while not versions.exists() and time.monotonic() < end:
        time.sleep(0.05)
    (version,) = map(json.loads, versions.read_text().splitlines())
    return version


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")
def test_what_hands_recorded_and_marked_in_a_browser_is_trained_on(tmp_path):
    configuration = tmp_path / "mine.yaml"
    configuration.write_text(CONFIGURATION)
    with serving(tmp_path / "data") as server, Chromium(tmp_path / "profile") as browser:
        demonstrate(browser, server)
        (name,) = json.loads(juicer(tmp_path, "stage", "ingest", "--config", str(configuration), "--json"))
        episodes = name.partition("/")[2]
        version = mark(browser, server, episodes, tmp_path / VERSIONS)
    assert version["step"] == version["proposal"] - BACK

    configuration.write_text(f"{CONFIGURATION}labels: {VERSIONS}\n")
    juicer(tmp_path, "run", str(configuration))
    store = open_store(tmp_path / "data")
    (checkpoint,), (annotations,) = store.refs("checkpoint"), store.refs("annotations")
    load_policy(store, checkpoint.id)
    assert {ref.id for ref in store.lineage(checkpoint)} >= {annotations.id, episodes}
    (annotation,) = read_annotations(store.open(annotations))
    assert (annotation.author, annotation.episode_id) == ("human", version["episode"])
    assert load_episodes(store, episodes).read(0).record.operator == "scripted hands"
