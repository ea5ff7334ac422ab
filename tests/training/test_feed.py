"""Batches are the same, whoever gathers them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from juicer.errors import DamagedArtifact, TrainingFailed
from juicer.policy.draws import Part
from juicer.policy.network import build_policy
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise
from juicer.training.feed import Feed
from juicer.training.source import BatchOrder
from juicer.training.table import WindowTable
from juicer.training.trainer import train
from juicer.training.windows import cut_windows

CPU = torch.device("cpu")


@pytest.fixture
def table(episodes, tasks, policy_config):
    network, data = build_policy(policy_config, tasks, seed=0), episodes()
    windows = cut_windows(data.episode_ends, np.arange(5), policy_config.horizons, back_padding=7)
    table = WindowTable(data, windows, network, learn_padding=False, device=CPU)
    table.fit()
    table.normalize()
    return table


def feed(source, noise=None, part=None):
    return Feed(source, BatchOrder(100, 16, seed=3), noise, seed=3, part=part)


def assert_equal_batches(first, second):
    assert first.prepared.keys() == second.prepared.keys()
    for name, values in first.prepared.items():
        assert torch.equal(values, second.prepared[name])
    assert torch.equal(first.chunk, second.chunk)
    assert torch.equal(first.weight, second.weight)


def test_batches_gathered_ahead_are_those_of_the_training_itself_and_so_is_what_is_drawn_after(table):
    noise = PhysicalStateNoise(probability=0.5)
    one, other = (feed(table, noise).batches(2, 9, loaders, CPU) for loaders in (0, 2))
    for _ in range(7):
        first, drawn = next(one), torch.rand(3)
        second, drawn_after_loading = next(other), torch.rand(3)
        assert_equal_batches(first, second)
        assert torch.equal(drawn, drawn_after_loading)
    assert next(one, None) is None
    assert next(other, None) is None


def test_a_training_with_loaders_ends_in_the_same_weights_bit_for_bit(episodes, tasks, policy_config, training_config):
    alone, fed = (
        train([episodes()], policy_config, tasks, training_config, seed=3, loaders=loaders).checkpoint
        for loaders in (0, 2)
    )
    assert all(torch.equal(values, fed.weights[name]) for name, values in alone.weights.items())


@pytest.mark.parametrize("noise", [None, PhysicalStateNoise(probability=0.3), OriginalStateNoise(probability=0.3)])
def test_parts_of_a_batch_make_the_whole(table, noise):
    whole = feed(table, noise).gather(4)
    for part in (Part(0, 5, 16), Part(5, 11, 16)):
        assert_equal_batches(feed(table, noise, part).gather(4), whole.take(part.rows))


class Failing:
    """Windows that cannot be read."""

    def __init__(self, error):
        self.error = error

    def gather(self, rows, noise=None):
        raise self.error


def test_what_a_loader_finds_wrong_is_told_as_the_training_would_tell_it():
    source = Failing(DamagedArtifact("columns/0123456789abcdef is damaged"))
    with pytest.raises(DamagedArtifact, match=r"^columns/0123456789abcdef is damaged$"):
        next(feed(source).batches(0, 4, 1, CPU))


def test_a_loader_that_dies_is_named_with_its_remedy():
    class Dying:
        def gather(self, rows, noise=None):
            import os
            import signal

            os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(TrainingFailed, match=r"a process that gathers batches has died.* lower JUICER_LOADERS"):
        next(feed(Dying()).batches(0, 4, 1, CPU))
