"""A policy for several tasks: each row is read as its own task's, and an embedding tells them apart."""

import numpy as np
import pytest
import torch

from juicer.errors import InvalidCheckpoint
from juicer.policy.acting import TrainedPolicy
from juicer.policy.config import PolicyConfig
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.network import FeatureEncoder
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import build_policy
from juicer.policy.tasks import as_shown


@pytest.fixture
def two_tasks(spec):
    """The toy task, and one with a third part that belongs onto the second."""
    other = spec.pairs[0].model_copy(update={"first": 1, "second": 2})
    return {"toy": spec, "tower": spec.model_copy(update={"num_parts": 3, "pairs": (*spec.pairs, other)})}


@pytest.fixture
def tower(observe):
    """Makes observations with three parts."""

    def make(num_rows, seed=0):
        two, more = observe(num_rows, seed), observe(num_rows, seed + 1)
        return {**two, "part_poses": np.concatenate([two["part_poses"], more["part_poses"][:, :7]], axis=1)}

    return make


def tensors(observations):
    return {name: torch.from_numpy(values) for name, values in observations.items()}


def test_one_task_is_shown_nothing_more(spec, observe):
    assert as_shown(observe(3), {"toy": spec}, "toy").keys() == {"proprioception", "part_poses"}


def test_several_tasks_are_shown_their_number(two_tasks, observe, tower):
    assert as_shown(observe(3), two_tasks, "toy")["task"].tolist() == [[0.0]] * 3
    assert as_shown(tower(3), two_tasks, "tower")["task"].tolist() == [[1.0]] * 3


def mixture(two_tasks, toy, high):
    """Rows of both tasks, of one length."""
    shown = {name: as_shown(each, two_tasks, name) for name, each in {"toy": toy, "tower": high}.items()}
    short = shown["toy"]["part_poses"]
    shown["toy"]["part_poses"] = np.pad(short, ((0, 0), (0, 7)))
    return {name: torch.from_numpy(np.concatenate([each[name] for each in shown.values()])) for name in shown["toy"]}


def test_rows_of_a_task_are_prepared_as_if_it_were_the_only_one(two_tasks, observe, tower):
    mixed = mixture(two_tasks, observe(40), tower(30))
    encoder = FeatureEncoder(FeaturesConfig(), two_tasks, 1)
    encoder.fit(mixed)
    state = encoder.prepare(mixed)
    for name, own, rows in (("toy", observe(40), state[:40]), ("tower", tower(30), state[40:])):
        alone = FeatureEncoder(FeaturesConfig(), {name: two_tasks[name]}, 1)
        alone.fit(tensors(own))
        wanted = alone.prepare(tensors(own))
        torch.testing.assert_close(rows[:, : wanted.shape[1]], wanted)
        assert not rows[:, wanted.shape[1] :].any()


def test_tasks_may_share_the_limits_of_the_features_that_they_have_in_common(two_tasks, observe, tower):
    mixed = mixture(two_tasks, observe(40), tower(30))
    encoder = FeatureEncoder(FeaturesConfig(normalisation="together"), two_tasks, 1)
    encoder.fit(mixed)
    state = encoder.prepare(mixed)
    alone = FeatureEncoder(FeaturesConfig(), {"toy": two_tasks["toy"]}, 1)
    common = alone.token_size[1]
    assert common < encoder.token_size[1]
    torch.testing.assert_close(state[:, :common].amin(0), torch.full((common,), -1.0), atol=1e-4, rtol=0)
    torch.testing.assert_close(state[:, :common].amax(0), torch.full((common,), 1.0), atol=1e-4, rtol=0)
    assert not state[:40, common:].any()


def test_the_limits_of_one_task_are_the_same_alone_and_together(spec, observe):
    alone, together = (
        FeatureEncoder(FeaturesConfig(normalisation=kind), {"toy": spec}, 1) for kind in ("per_task", "together")
    )
    for encoder in (alone, together):
        encoder.fit(tensors(observe(40)))
    assert torch.equal(alone.prepare(tensors(observe(9))), together.prepare(tensors(observe(9))))


def test_the_embedding_is_all_that_tells_two_like_tasks_apart(spec, observe):
    tasks = {"first": spec, "second": spec}
    network = build_policy(PolicyConfig(head=MLPHeadConfig(width=16, blocks=1, dropout=0.0)), tasks, seed=0)
    assert network.encoders.embedding.weight.shape == (2, 128)
    streams = [np.random.default_rng(0)] * 4
    acts = {name: TrainedPolicy(network, name).predict(observe(4), streams) for name in tasks}
    assert not np.array_equal(acts["first"], acts["second"])
    network.encoders.embedding.weight[1] = network.encoders.embedding.weight[0]
    np.testing.assert_array_equal(TrainedPolicy(network, "second").predict(observe(4), streams), acts["first"])


def test_another_task_is_refused(two_tasks):
    network = build_policy(PolicyConfig(head=MLPHeadConfig(width=16, blocks=1)), two_tasks, seed=0)
    with pytest.raises(InvalidCheckpoint, match="was trained for toy, tower, not for 'lamp'"):
        TrainedPolicy(network, "lamp")
