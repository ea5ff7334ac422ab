import numpy as np
import torch

from juicer.policy.config import StateObservationConfig
from juicer.policy.encoder import StateEncoder


def tensors(observations):
    return {name: torch.from_numpy(values) for name, values in observations.items()}


def test_the_condition_lists_the_features_of_all_observed_steps(spec, observe):
    encoder = StateEncoder({"toy": spec}, StateObservationConfig(), 2, 8)
    encoder.fit(tensors(observe(100)))
    history = {name: values.reshape(5, 2, -1) for name, values in tensors(observe(10)).items()}
    prepared = encoder.prepare(history)
    assert encoder(prepared).shape == (5, encoder.condition_size)
    np.testing.assert_array_equal(encoder(prepared)[:, : encoder.condition_size // 2], prepared["state"][:, 0])


def test_preparing_a_dataset_at_once_equals_preparing_it_row_by_row(spec, observe):
    encoder, observations = StateEncoder({"toy": spec}, StateObservationConfig(), 1, 8), tensors(observe(40))
    encoder.fit(observations)
    whole = encoder.prepare(observations)["state"]
    rows = [
        encoder.prepare({name: values[i : i + 1] for name, values in observations.items()})["state"] for i in range(40)
    ]
    np.testing.assert_allclose(whole, torch.cat(rows), atol=1e-5)


def test_a_state_unlike_any_demonstrated_stays_bounded(spec, observe):
    encoder, observations = StateEncoder({"toy": spec}, StateObservationConfig(clip=2.0), 1, 8), tensors(observe(40))
    encoder.fit(observations)
    assert encoder.prepare(observations)["state"].abs().max() <= 1 + 1e-5
    far = {**observations, "proprioception": 100 * observations["proprioception"]}
    assert encoder.prepare(far)["state"].abs().max() == 2


def test_only_pairs_count_among_many_parts(spec, observe):
    encoder, observations = StateEncoder({"toy": spec}, StateObservationConfig(), 1, 8), tensors(observe(10))
    assert encoder.sizes == {"proprioception": 16, "part_poses": 14}
    more = spec.model_copy(update={"num_parts": 3})
    with_bystander = {**observations, "part_poses": torch.cat([observations["part_poses"], torch.ones(10, 7)], dim=1)}
    other = StateEncoder({"toy": more}, StateObservationConfig(), 1, 8)
    assert torch.equal(other.prepare(with_bystander)["state"], encoder.prepare(observations)["state"])
