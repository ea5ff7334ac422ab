"""A study that took no time: small artifacts in a real store, as its stages would have made them."""

from __future__ import annotations

import json

import pytest
import torch

from juicer.artifacts.recipe import Recipe
from juicer.episode import Outcome
from juicer.policy.checkpoint import Checkpoint, CheckpointMetadata, save_checkpoint
from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.network import build_policy
from juicer.seeding import stream
from juicer.storage.curves import CURVES_FILE
from juicer.storage.evaluations import EvaluationRow, write_evaluation
from stages.evaluate import facts
from stages.tracking.destination import Destination
from stages.tracking.model import Model

TITLES = {"bc": "BC", "ta_ci": "TA+CI"}
IDENTITIES = {"bc": "fedcba9876543210", "ta_ci": "0123456789abcdef"}
RATES = {"bc": 0.5, "ta_ci": 0.85}
PAIR = PairSpec(first=0, second=1, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
TASKS = {"one_leg": FeatureSpec(num_parts=2, pairs=(PAIR,), mounted_m=0.005, mounted_cosine=0.94)}
POLICY = PolicyConfig(head=DiffusionConfig(denoiser=MLPDenoiserConfig(width=16, blocks=1), prediction="sample"))


class FakeStudy:
    """Makes models whose every stage is an artifact."""

    def __init__(self, store, name="study"):
        self.store, self.name = store, name

    def put(self, stage, kind, fill=lambda folder: None, config=None, **made):
        inputs = {role: refs for role, refs in made.pop("inputs", {}).items() if refs}
        recipe = Recipe(stage, kind, inputs, {"study": self.name, **(config or {})})
        with self.store.create(recipe) as draft:
            if not draft.adopted:
                (draft.path / "content.txt").write_text(stage)
                fill(draft.path)
                draft.summary |= made
        return recipe.ref

    def episodes(self):
        logs = self.put("record", "logs", logs=50, successes=50)
        return self.put("ingest", "episodes", inputs={"logs": (logs,)}, episodes=50, steps=28_900)

    def train(self, condition, seed, episodes, selections=()):
        def fill(folder):
            network = build_policy(POLICY, TASKS, seed)
            save_checkpoint(folder, Checkpoint(metadata(), network.state_dict(), None))
            (folder / "content.txt").unlink()
            points = [[step, (0.02 + len(episodes) / 100) + 0.9 / step] for step in range(10, 500, 10)]
            (folder / CURVES_FILE).write_text(json.dumps({"train/loss": points}))

        inputs = {"episodes": tuple(episodes), "selections": tuple(selections)}
        mixed = self.put("dataset", "dataset", inputs=inputs, episodes=50)
        inputs = {"dataset": (mixed,)}
        return self.put("train", "checkpoint", fill, {"seed": seed}, inputs=inputs, tasks=["one_leg"], steps=500)

    def model(self, condition="bc", seed=0, episodes_evaluated=100):
        episodes = [self.episodes()]
        if condition == "ta_ci":
            labels = self.put("annotate", "annotations", inputs={"episodes": tuple(episodes)}, critical_states=50)
            inputs = {"episodes": tuple(episodes), "annotations": (labels,)}
            episodes.append(self.put("augment", "episodes", inputs=inputs, snippets=150))
        checkpoint = self.train(condition, seed, episodes)
        if condition == "ta_ci":
            inputs = {"checkpoint": (checkpoint,)}
            rollouts = self.put(
                "collect",
                "episodes",
                config={"seed": seed},
                inputs=inputs,
                episodes=120,
                successes=50,
                success_rate=0.4,
            )
            kept = self.put("select", "selection", inputs={"episodes": (rollouts,)}, kept=50)
            checkpoint = self.train(condition, seed, [*episodes, rollouts], [kept])
        draws = stream(seed, condition).random(episodes_evaluated) < RATES[condition]
        rows = [
            EvaluationRow(index, 3_000_000 + index, Outcome.SUCCESS if success else Outcome.TIMEOUT, int(success), 423)
            for index, success in enumerate(draws)
        ]
        evaluation = self.put(
            "evaluate",
            "evaluation",
            lambda folder: write_evaluation(folder, rows),
            {"condition": condition, "episodes": episodes_evaluated},
            inputs={"checkpoint": (checkpoint,)},
            **facts(rows, ("screwed",)),
        )
        return Model(
            study=self.name,
            identity=IDENTITIES[condition],
            condition=condition,
            title=TITLES[condition],
            seed=seed,
            task="one_leg",
            params={"condition": condition, "seed": seed, "train.training.steps": 500, "train.seed": seed},
            evaluation=str(evaluation),
        )

    def models(self, seeds=range(5)):
        made = [self.model(condition, seed) for seed in seeds for condition in TITLES]
        page = "<!doctype html><h1>Everything about the study</h1>"
        report = self.put("report", "report", lambda folder: (folder / "report.html").write_text(page), conditions=2)
        return [model.model_copy(update={"report": str(report)}) for model in made]


def metadata():
    return CheckpointMetadata(policy=POLICY, tasks=TASKS, acting_weights="raw", step=500)


@pytest.fixture
def study(store):
    """Makes models of a study."""
    torch.manual_seed(0)
    return FakeStudy(store)


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory):
    """The tables of MLflow, which take seconds to make."""
    folder = tmp_path_factory.mktemp("empty")
    Destination(f"sqlite:///{folder / 'mlflow.db'}", folder / "tracking", folder / "mlflow-files").initialise()
    return folder / "mlflow.db"


@pytest.fixture
def data(tmp_path, empty_database):
    """A data folder with an empty database."""
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "mlflow.db").write_bytes(empty_database.read_bytes())
    return folder


@pytest.fixture
def destination(data):
    """The database of the data folder."""
    return place(data)


def place(data):
    return Destination(f"sqlite:///{data / 'mlflow.db'}", data / "tracking" / "here", data / "mlflow-files")
