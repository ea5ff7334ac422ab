"""Settings that change how a step is computed, not what it means."""

from __future__ import annotations

import shutil

import pytest
import torch
from torch import nn

from juicer.errors import ConfigError
from juicer.policy.config import PolicyConfig
from juicer.training.learner import Learner
from juicer.training.ranks import Ranks
from juicer.training.source import Batch
from juicer.training.state import TrainingState, load_state, save_state
from juicer.training.trainer import train

CPU = torch.device("cpu")


class SeesImages(nn.Module):
    """A network with convolutions, in the place of a policy's."""

    def __init__(self):
        super().__init__()
        self.config = PolicyConfig()
        self.net = nn.Sequential(nn.Conv2d(3, 8, 3), nn.GroupNorm(2, 8), nn.ReLU(), nn.Flatten(), nn.LazyLinear(80))
        self.net(torch.zeros(1, 3, 8, 8))

    def compute_loss(self, prepared, chunk):
        images = prepared["images"].permute(0, 3, 1, 2).float() / 255
        return (self.net(images).reshape(chunk.shape) - chunk).square()


def made(training_config, **changes):
    torch.manual_seed(0)
    return Learner(SeesImages(), training_config.model_copy(update=changes), CPU)


def batch(step):
    torch.manual_seed(step)
    images = torch.randint(256, (16, 8, 8, 3), dtype=torch.uint8)
    return Batch({"images": images}, torch.randn(16, 8, 10), torch.ones(16, 8, 1))


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_the_memory_format_changes_rounding_only(training_config, precision):
    usual = made(training_config, precision=precision)
    other = made(training_config, precision=precision, memory_format="channels_last")
    assert other.network.net[0].weight.is_contiguous(memory_format=torch.channels_last)
    losses = [[float(each.learn(batch(step), step)) for step in range(8)] for each in (usual, other)]
    assert losses[0] == pytest.approx(losses[1], rel=2e-2 if precision == "bf16" else 1e-4)
    assert losses[0][-1] < losses[0][0]


def test_a_state_of_the_channels_last_format_is_continued_bit_for_bit(training_config, tmp_path):
    learner = made(training_config, memory_format="channels_last")
    for step in range(6):
        learner.learn(batch(step), step)
    save_state(tmp_path, TrainingState("it", 6, learner.tensors()))
    resumed = made(training_config, memory_format="channels_last")
    resumed.restore(load_state(tmp_path, "it").tensors, 6)
    for step in range(6, 10):
        assert torch.equal(resumed.learn(batch(step), step), learner.learn(batch(step), step))


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("g++"), reason="torch compiles for processors with g++")
def test_a_compiled_network_learns_what_it_did(training_config):
    losses = [
        [float(learner.learn(batch(step), step)) for step in range(8)]
        for learner in (made(training_config), made(training_config, compile=True))
    ]
    assert losses[0] == pytest.approx(losses[1], rel=1e-3)


def test_a_machine_without_a_compiler_is_told_what_to_do(episodes, tasks, policy_config, training_config, monkeypatch):
    monkeypatch.setattr(torch._inductor.config.cpp, "cxx", ("no-such-compiler",))
    monkeypatch.setenv("TORCHINDUCTOR_FORCE_DISABLE_CACHES", "1")
    config = training_config.model_copy(update={"compile": True})
    with pytest.raises(
        ConfigError, match=r"cannot compile the network on this machine .*set training\.compile to false"
    ):
        train([episodes()], policy_config, tasks, config, seed=0)


def test_batch_normalisation_on_processors_is_refused_to_several_processes():
    with pytest.raises(ConfigError, match="batch normalisation needs the whole batch"):
        Ranks(0, 2).join(nn.BatchNorm2d(3), CPU, images=64)


def test_more_processes_than_samples_are_refused():
    assert [Ranks(number, 3).part(8).size for number in range(3)] == [2, 3, 3]
    with pytest.raises(ConfigError, match=r"a batch of 2 .* cannot be shared by 3 processes"):
        Ranks(0, 3).part(2)
