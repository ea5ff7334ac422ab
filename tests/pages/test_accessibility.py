"""Axe-core, which knows what people with a screen reader, a keyboard or weak eyes need, finds nothing serious."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.page.chromium import CHROMIUM, Chromium

AXE = "axe-core@4.14.1"
NPM = shutil.which("npm")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium"),
    pytest.mark.skipif(NPM is None, reason="needs npm, which brings axe-core"),
    pytest.mark.usefixtures("drawing"),
]

PAGES = {
    "artifacts": "/",
    "artifacts, none of which answers": "/?text=nonsense",
    "artifact": "/artifacts/{run.evaluation}",
    "checkpoint": "/artifacts/{run.checkpoint}",
    "episodes, of which artifact": "/episodes",
    "episodes": "/episodes?artifact={run.evaluation}",
    "episodes, none of which answers": "/episodes?artifact={run.episodes}&outcome=failure",
    "episode step by step": "/episodes?artifact={run.episodes}&episode=0&frame=3",
    "episode that was not kept": "/episodes?artifact={run.evaluation}&episode=1",
    "lineage, of which artifact": "/lineage",
    "lineage": "/lineage?artifact={run.evaluation}",
    "teleoperation": "/teleop",
    "annotation, of which demonstrations": "/annotate",
    "annotation": "/annotate/{run.episodes.id}",
    "sentence": "/nowhere",
    "sentence about an artifact": "/artifacts/0123456789abcdef",
}
RUN = """axe.run().then(({passes, violations}) => ({
  passes: passes.length,
  violations: violations.map(({impact, id, nodes}) => [impact, id, ...nodes.map(({html}) => html)]),
}))"""


@pytest.fixture(scope="module")
def axe(request: pytest.FixtureRequest) -> str:
    """The script, which is fetched once a machine."""
    assert request.config.cache is not None
    folder = request.config.cache.mkdir(AXE.replace("@", "-"))
    script = folder / "node_modules" / "axe-core" / "axe.min.js"
    if not script.exists():
        command = [str(NPM), "install", "--no-save", "--ignore-scripts", "--prefix", str(folder), AXE]
        fetched = subprocess.run(command, capture_output=True, text=True, check=False)
        if fetched.returncode:
            pytest.skip(f"npm cannot bring axe-core: {fetched.stderr[:200]}")
    return script.read_text(encoding="utf-8")


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Chromium]:
    with Chromium(tmp_path / "profile") as browser:
        yield browser


def serious(browser: Chromium, axe: str) -> list[list[str]]:
    """What is found in the page as it is now, in light and in dark."""
    found = []
    browser.evaluate(f"{axe}; 0")
    for is_dark in (False, True):
        browser.dark(is_dark)
        told = browser.evaluate(RUN)
        assert told["passes"] > 10
        found += [each for each in told["violations"] if each[0] in ("serious", "critical")]
    return found


@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_no_serious_obstacle(address, run, browser, axe, page):
    browser.open(address + PAGES[page].format(run=run))
    if page == "annotation":
        browser.until("document.querySelector('#judging:not([hidden])')?.ariaBusy === 'false'")
    assert serious(browser, axe) == []


def test_driving_has_no_serious_obstacle(address, run, browser, axe):
    browser.open(f"{address}/teleop")
    browser.until("document.querySelector('select[name=task]').options.length > 0")
    browser.evaluate("document.querySelector('#begin button').click()")
    browser.until("!document.querySelector('#drive').hidden && document.querySelectorAll('#panes canvas').length > 3")
    assert serious(browser, axe) == []


def test_a_damaged_artifact_and_an_empty_store_have_no_serious_obstacle(address, run, browser, axe):
    for ref in (run.checkpoint, run.evaluation):
        (run.store.cache / str(ref) / "manifest.json").write_text("{}")
    for page in ("/", f"/artifacts/{run.checkpoint}"):
        browser.open(address + page)
        assert serious(browser, axe) == []
    for ref in run.store.refs():
        run.store.set_aside(ref)
    browser.open(address)
    assert "juicer run smoke" in browser.evaluate("document.body.textContent")
    assert serious(browser, axe) == []
