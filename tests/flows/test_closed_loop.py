"""What juicer is for, in small: a policy that succeeds, and is retrained on its own successes."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from juicer.artifacts.store import ArtifactStore

TIMEOUT_S = 900
"""Two minutes of an idle machine; busy ones have taken more than the five that other tests have."""
pytestmark = pytest.mark.timeout(TIMEOUT_S)

# Enough to succeed in every other episode or so; 16 of them fail all where the rate is below a third only.
RUN = [
    "run",
    "smoke",
    "--set=conditions=[ta_ci]",
    "--set=record.demonstrations=10",
    "--set=augment.num_snippets=32",
    "--set=policies.diffusion.training.steps=1500",
    "--set=collect.successes=1",
    "--set=evaluate.episodes=2",
]


def juicer(data, *arguments):
    environment = {**os.environ, "JUICER_DATA": str(data)}
    command = [sys.executable, "-m", "juicer", *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S - 20, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    """A run whose policy succeeds and learns from that, and the folder of its data."""
    folder = tmp_path_factory.mktemp("closed") / "data"
    return folder, json.loads(juicer(folder, *RUN, "--json")[0])


def test_loop_is_closed_a_policy_is_retrained_on_its_own_successes(closed):
    folder, outcome = closed
    (model,) = outcome["models"]
    assert model["finding"] is None
    store = ArtifactStore(folder)
    made_of = [store.manifest(ref) for ref in store.lineage(store.resolve(model["evaluation"]))]
    (collected,) = [manifest for manifest in made_of if manifest.recipe.stage == "collect"]
    (selected,) = [manifest for manifest in made_of if manifest.recipe.stage == "select"]
    before, after = [manifest.summary for manifest in made_of if manifest.recipe.stage == "train"]
    assert collected.summary["successes"] == selected.summary["kept"] == 1
    assert before["episodes"] == {"teleop": 10, "augmentation": 32}
    assert after["episodes"] == {**before["episodes"], "rollout": 1}
    assert after["timesteps"]["rollout"] == selected.summary["steps"]
    assert set(after["unused_timesteps"].values()) == {0}
    assert outcome["table"][0]["episodes"] == 2
    assert outcome["report"]


def test_closed_loop_is_reused_whole_and_a_dry_run_says_so(closed):
    folder, outcome = closed
    told = json.loads(juicer(folder, *RUN, "--dry-run", "--json")[0])
    assert (told["computed"], told["seconds"]) == (0, 0)
    assert told["reused"] == len(told["calls"]) == 12
    out, err = juicer(folder, *RUN, "--json")
    assert json.loads(out) == outcome
    assert "starting a Prefect server" not in err
