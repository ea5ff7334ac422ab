import numpy as np
import torch

from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.network import FeatureEncoder


def tensors(observations):
    return {name: torch.from_numpy(values) for name, values in observations.items()}


def test_the_features_of_every_observed_step_are_a_token(spec, observe):
    encoder = FeatureEncoder(FeaturesConfig(), {"toy": spec}, 2)
    encoder.fit(tensors(observe(100)))
    history = {name: values.reshape(5, 2, -1) for name, values in tensors(observe(10)).items()}
    prepared = encoder.prepare(history)
    assert encoder(prepared).shape == (5, *encoder.token_size)
    np.testing.assert_array_equal(encoder(prepared)[:, 1], prepared[:, 1])


def test_preparing_a_dataset_at_once_equals_preparing_it_row_by_row(spec, observe):
    encoder, observations = FeatureEncoder(FeaturesConfig(), {"toy": spec}, 1), tensors(observe(40))
    encoder.fit(observations)
    whole = encoder.prepare(observations)
    rows = [encoder.prepare({name: values[i : i + 1] for name, values in observations.items()}) for i in range(40)]
    np.testing.assert_allclose(whole, torch.cat(rows), atol=1e-5)


def test_a_state_unlike_any_demonstrated_stays_bounded(spec, observe):
    encoder, observations = FeatureEncoder(FeaturesConfig(clip=2.0), {"toy": spec}, 1), tensors(observe(40))
    encoder.fit(observations)
    assert encoder.prepare(observations).abs().max() <= 1 + 1e-5
    far = {**observations, "proprioception": 100 * observations["proprioception"]}
    assert encoder.prepare(far).abs().max() == 2


def test_only_pairs_count_among_many_parts(spec, observe):
    encoder, observations = FeatureEncoder(FeaturesConfig(), {"toy": spec}, 1), tensors(observe(10))
    assert [seen.name for seen in encoder.observations] == ["proprioception", "part_poses"]
    more = spec.model_copy(update={"num_parts": 3})
    with_bystander = {**observations, "part_poses": torch.cat([observations["part_poses"], torch.ones(10, 7)], dim=1)}
    other = FeatureEncoder(FeaturesConfig(), {"toy": more}, 1)
    assert torch.equal(other.prepare(with_bystander), encoder.prepare(observations))
