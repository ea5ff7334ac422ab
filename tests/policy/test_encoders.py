"""All encoders of a policy as one: parts of a condition by name."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from juicer.errors import ConfigError
from juicer.policy.condition import flat, flat_size
from juicer.policy.config import PolicyConfig
from juicer.policy.encoder import Encoders
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.network import FeatureEncoder

TWO = PolicyConfig(observation={"near": FeaturesConfig(), "far": FeaturesConfig(pairs="all", clip=3.0)})


def tensors(observations):
    return {name: torch.from_numpy(values)[:, None] for name, values in observations.items()}


def test_encoders_compose_by_being_listed(tasks, observe):
    encoders = Encoders(TWO, tasks)
    encoders.fit(tensors(observe(50)))
    condition = encoders(encoders.prepare(tensors(observe(3))))
    assert {name: tokens.shape[1:] for name, tokens in condition.items()} == encoders.sizes
    assert list(condition) == ["near", "far"]
    assert flat(condition).shape == (3, flat_size(encoders.sizes))
    assert torch.equal(flat(condition)[:, : encoders.sizes["near"][1]], condition["near"][:, 0])


def test_what_several_encoders_see_is_declared_once(tasks):
    assert [spec.name for spec in Encoders(TWO, tasks).observations] == ["proprioception", "part_poses"]


def test_two_encoders_that_see_one_thing_in_two_shapes_are_refused(tasks, monkeypatch):
    proprioception, poses = FeatureEncoder.observations
    monkeypatch.setattr(FeatureEncoder, "observations", (replace(proprioception, shape=(15,)), poses))
    with pytest.raises(ConfigError, match="two encoders of a policy see 'proprioception' in different shapes or types"):
        Encoders(TWO, tasks)
