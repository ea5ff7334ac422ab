"""The notebooks run from their first cell to their last, and were stored with results that show no machine."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from flows.running.execution import execute
from flows.runs import load_runs
from juicer.artifacts.store import ArtifactStore
from stages.runtime.execution import perform_here
from stages.runtime.session import Session

NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples").glob("*.ipynb"))
MOST_BYTES = 300_000
STUDY = (
    "conditions=[replay, bc]",
    "record.demonstrations=2",
    "policies.diffusion.training.steps=100",
    "evaluate.episodes=2",
    "evaluate.max_steps=60",
)
"""As the notebooks ask for, in a few seconds."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, drawing: None) -> Path:
    """A folder beside the data of a study."""
    place = tmp_path_factory.mktemp("examples")
    (config,) = load_runs("smoke", STUDY)
    execute(Session(ArtifactStore(place / "data"), perform_here), config, None)
    (place / "examples").mkdir()
    return place / "examples"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("IPYTHONDIR", str(folder / "ipython"))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_with_results_of_this_code_and_of_no_machine(path: Path):
    assert path.stat().st_size < MOST_BYTES
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    shown = str([output for cell in cells for output in cell.outputs if output.output_type != "display_data"])
    assert not re.search(r"/(home|tmp|root|work|Users)/|Traceback", shown)
