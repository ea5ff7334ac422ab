"""What another package adds works like our own, without a line in ours: a task, a stage, a kind of artifact."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "plugins"

LOOP = """
import json, sys
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from stages.evaluate import EvaluateConfig, evaluate
from stages.ingest import ingest
from stages.memorise import MemoriseConfig, memorise
from stages.record import RecordConfig, record
from stages.runtime.catalog import find_stage
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session

if __name__ == "__main__":
    store = ArtifactStore(sys.argv[1])
    session = Session(store, perform_here, machine=Machine(num_envs=1), isolate=True)
    start = {"task": "stool", "randomness": "low"}
    logs = record(session, config=RecordConfig(**start, demonstrations=1, max_recordings=3))
    episodes = ingest(session, logs=logs, config=IngestionConfig(task="stool"))
    checkpoint = memorise(session, episodes=episodes, config=MemoriseConfig())
    evaluation = evaluate(session, checkpoint=checkpoint, config=EvaluateConfig(**start, episodes=1, max_steps=40))
    measure = find_stage("measure")
    lengths = measure(session, episodes=episodes, config=measure.config_model())
    made = {"logs": logs, "episodes": episodes, "evaluation": evaluation, "lengths": lengths}
    print(json.dumps({name: store.manifest(ref).recipe.to_json() for name, ref in made.items()}))
"""


def install(folder: Path, entry_points: dict[str, dict[str, str]]) -> dict[str, str]:
    """Announce entry points as an installation does; gives an environment that finds them."""
    about = folder / "juicer_lab-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: juicer-lab\nVersion: 1.0\n")
    groups = (
        f"[{group}]\n" + "\n".join(f"{k} = {v}" for k, v in names.items()) for group, names in entry_points.items()
    )
    (about / "entry_points.txt").write_text("\n".join(groups) + "\n")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder), str(EXAMPLE)])}


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The example, installed."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    return install(tmp_path_factory.mktemp("site"), project["entry-points"])


def python(environment: dict[str, str], *arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=environment, cwd=cwd, capture_output=True, text=True, timeout=250)


@pytest.fixture(scope="module")
def store(environment, tmp_path_factory) -> tuple[Path, dict[str, dict]]:
    """A store with what the loop made of the stool, and its recipes."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "loop.py").write_text(LOOP)
    done = python(environment, str(folder / "loop.py"), str(folder / "store"), cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "store", json.loads(done.stdout.splitlines()[-1])


def test_a_task_from_outside_is_recorded_and_evaluated_in_processes_of_their_own(store) -> None:
    _, recipes = store
    assert [part["name"] for part in recipes["logs"]["tasks"]["stool"]["parts"]] == ["stool_top", "stool_leg"]
    assert recipes["logs"]["tasks"]["stool"]["parts"][1]["handling"]["pick_m"] == 0.0115
    assert "handling" not in recipes["evaluation"]["tasks"]["stool"]["parts"][1]


def test_a_stage_from_outside_has_an_identity_of_its_own_source(store) -> None:
    _, recipes = store
    recipe = recipes["lengths"]
    assert (recipe["stage"], recipe["kind"]) == ("measure", "lengths")
    assert {"juicer_lab.measure", "juicer.storage.episodes"} <= set(recipe["modules"])
    assert recipe["tasks"] == {"stool": {}}


def test_artifacts_of_a_kind_from_outside_are_listed_and_repaired(store, environment, tmp_path) -> None:
    folder, _ = store
    env = {**environment, "JUICER_DATA": str(tmp_path), "JUICER_STORE": str(folder)}
    listed = python(env, "-m", "juicer", "ls", "lengths")
    assert "measure" in listed.stdout, listed.stderr
    (damaged,) = (folder / "lengths").iterdir()
    (damaged / "lengths.json").write_text("[]")
    repaired = python(env, "-m", "juicer", "repair", damaged.name)
    assert repaired.returncode == 0, repaired.stderr
    assert json.loads((damaged / "lengths.json").read_text()) != []


def test_what_the_readme_says_makes_an_artifact_of_the_stage_from_outside(store, environment, tmp_path) -> None:
    folder, _ = store
    (script,) = re.findall(r"```python\n(.*?)```", (EXAMPLE / "README.md").read_text(), re.DOTALL)
    (tmp_path / "data").symlink_to(folder)
    done = python(environment, "-c", script, cwd=tmp_path)
    assert done.stdout.startswith("lengths/"), done.stderr


def test_a_task_from_outside_is_offered_wherever_tasks_are(environment) -> None:
    assert "stool" in python(environment, "-m", "juicer", "run", "--help").stdout
    shown = python(environment, "-m", "juicer", "config", "smoke", "--set", "task=stool")
    assert "task: stool" in shown.stdout, shown.stderr


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("import nothing_of_the_kind", "ModuleNotFoundError: No module named 'nothing_of_the_kind'"),
        ("TASK = 3", "it is not an AssemblyTask but of type int"),
        ("from juicer.tasks.lamp import TASK", "it calls itself 'lamp'"),
        (
            "from dataclasses import replace\nfrom juicer.tasks.lamp import TASK\n"
            "TASK = replace(TASK, name='broken', pairs=(replace(TASK.pairs[0], second=7),))",
            "pair 'bulb' joins parts 0 and 7 of 3",
        ),
        (
            "from dataclasses import replace\nfrom juicer.tasks.lamp import TASK\n"
            "TASK = replace(TASK, name='broken', parts=('a', 'b'))",
            "its parts.0",
        ),
    ],
)
def test_a_broken_task_from_outside_is_one_sentence_and_stops_no_other(tmp_path, source, sentence) -> None:
    (tmp_path / "broken_lab.py").write_text(source)
    env = install(tmp_path, {"juicer.tasks": {"broken": "broken_lab:TASK"}})
    asked = python(env, "-m", "juicer", "config", "smoke", "--set", "task=broken")
    assert asked.returncode != 0
    assert "Traceback" not in asked.stderr
    said = " ".join(asked.stderr.split())
    assert "task 'broken', which is 'broken_lab:TASK' of package 'juicer-lab', cannot be used" in said
    assert sentence in said
    assert python(env, "-m", "juicer", "config", "smoke", "--set", "task=lamp").returncode == 0
