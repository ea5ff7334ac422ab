"""An encoder and a head from outside the package: an installed distribution, and nothing of ours edited."""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap

import pytest

from juicer.config import parse_config
from juicer.errors import ConfigError
from juicer.policy.config import PolicyConfig
from juicer.policy.members import BACKBONES, DENOISERS, ENCODERS, HEADS

CONFIGS = '''
from typing import ClassVar, Literal
from juicer.policy.members import EncoderConfig, HeadConfig

class GripperConfig(EncoderConfig):
    """Two tokens of where the gripper is."""
    network: ClassVar[str] = "toy_networks:GripperEncoder"
    kind: Literal["gripper"] = "gripper"
    tokens: int = 2

class LinearConfig(HeadConfig):
    """The simplest head there is."""
    network: ClassVar[str] = "toy_networks:LinearHead"
    kind: Literal["linear"] = "linear"
'''
NETWORKS = """
from torch import nn
from juicer.episode import SIMULATOR
from juicer.policy.condition import flat, flat_size
from juicer.policy.encoder import ObservationEncoder
from juicer.policy.head import ActionHead, squared_error

class GripperEncoder(ObservationEncoder):
    observations = (SIMULATOR["proprioception"],)

    def __init__(self, config, tasks, obs_horizon):
        super().__init__()
        self.token_size = (config.tokens, 4)
        self.layer = nn.Linear(obs_horizon * 3, config.tokens * 4)

    def fit(self, observations):
        pass

    def prepare(self, observations):
        return observations["proprioception"][..., :3]

    def forward(self, prepared):
        return self.layer(prepared.flatten(1)).unflatten(-1, self.token_size)

class LinearHead(ActionHead):
    def __init__(self, config, chunk, condition):
        super().__init__()
        self.chunk = chunk
        self.layer = nn.Linear(flat_size(condition), chunk[0] * chunk[1])

    def compute_loss(self, condition, chunk):
        return squared_error(self.sample(condition, None), chunk)

    def sample(self, condition, noise):
        return self.layer(flat(condition)).unflatten(-1, self.chunk)
"""
ENTRY_POINTS = """
[juicer.encoders]
gripper = toy_configs:GripperConfig
broken = toy_broken:Config
none = json:JSONDecoder
[juicer.heads]
linear = toy_configs:LinearConfig
gripper = toy_configs:GripperConfig
"""
POLICY = {
    "horizons": {"pred": 4, "action": 2},
    "observation": {"state": {"kind": "features"}, "train": {"kind": "gripper"}},
    "head": {"kind": "linear"},
}
USE = """
import json, pathlib, sys
import numpy as np
from juicer.config import parse_config
from juicer.policy.checkpoint import load_policy, save_checkpoint
from juicer.policy.config import PolicyConfig
from juicer.rollout import rollout
from juicer.storage.episodes import EpisodeReader
from juicer.training.config import TrainingConfig
from juicer.training.trainer import train
from juicer.training.windows import TrainingEpisodes
from juicer.policy.feature_spec import feature_spec

policy = parse_config(json.loads(sys.argv[1]), PolicyConfig, origin="test")
rng, length = np.random.default_rng(0), 30
episodes = TrainingEpisodes(
    {"proprioception": rng.normal(size=(2 * length, 16)).astype(np.float32),
     "part_poses": rng.normal(size=(2 * length, 35)).astype(np.float32)},
    rng.uniform(-0.5, 0.5, size=(2 * length, 10)).astype(np.float32), np.array([length, 2 * length]), ["a", "b"],
    ["teleop"] * 2,
)
config = TrainingConfig(steps=3, batch_size=8, warmup_steps=1, validation_fraction=0)
trained = train([episodes], policy, {"one_leg": feature_spec("one_leg")}, config, seed=0)
folder = pathlib.Path(sys.argv[2])
save_checkpoint(folder, trained.checkpoint)
acting = load_policy(folder, "one_leg")
(episode,) = rollout(acting, "one_leg", "low", [0], num_envs=1, max_steps=4)
print(json.dumps({"weights": sorted(trained.checkpoint.weights), "steps": len(episode)}))
"""


@pytest.fixture
def installed(tmp_path):
    """A folder with a distribution as pip would leave it there."""
    (tmp_path / "toy_configs.py").write_text(CONFIGS)
    (tmp_path / "toy_networks.py").write_text(NETWORKS)
    (tmp_path / "toy-1.0.dist-info").mkdir()
    (tmp_path / "toy-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1.0\n")
    (tmp_path / "toy-1.0.dist-info" / "entry_points.txt").write_text(ENTRY_POINTS)
    return tmp_path


def test_an_encoder_and_a_head_from_elsewhere_train_and_act(installed, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(installed)
    path = ":".join(part for part in sys.path if part)
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(USE), json.dumps(POLICY), str(tmp_path / "checkpoint")],
        env={"PYTHONPATH": path, "OMP_NUM_THREADS": "1", "PATH": ""},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
    answer = json.loads(result.stdout)
    assert {"encoders.members.1.layer.weight", "head.layer.weight"} <= set(answer["weights"])
    assert answer["steps"] == 4
    assert "juicer.encoders: 'toy_broken:Config' of package 'toy' is left out: ModuleNotFoundError" in result.stderr
    assert "of package 'toy' is left out: it is not a subclass of EncoderConfig" in result.stderr
    assert (
        "juicer.heads: 'toy_configs:GripperConfig' of package 'toy' is left out: it is not a subclass of HeadConfig"
        in result.stderr
    )


def test_every_folder_is_a_member_and_every_member_has_a_folder():
    for family in (ENCODERS, BACKBONES, HEADS, DENOISERS):
        for kind, config in family.members.items():
            assert config.__module__ == f"{family.package}.{kind}.config"
            assert config.network.startswith(f"{family.package}.{kind}.network:")
            assert config().kind == kind


@pytest.mark.parametrize(
    ("policy", "sentence"),
    [
        ({"observation": {"state": {}}}, "observation.state: must say its 'kind'"),
        (
            {"observation": {"state": {"kind": "feature"}}},
            "kind must be one of estimated, features, images, proprioception.*did you mean 'features'",
        ),
        ({"observation": {"state": {"kind": "features", "pair": 1}}}, "unknown key .*; did you mean 'pairs'"),
        ({"observation": {"pairs": "all"}}, r"observation: names one encoder or several, e\.g\. {state: {kind: feat"),
        ({"observation": {"task": {"kind": "features"}}}, "an encoder may not be called 'task'"),
        ({"head": {"kind": "adversarial"}}, "head: kind must be one of diffusion, flow, mlp"),
    ],
)
def test_a_choice_that_is_none_is_refused_in_a_sentence(policy, sentence):
    with pytest.raises(ConfigError, match=sentence):
        parse_config(policy, PolicyConfig, origin="test")
