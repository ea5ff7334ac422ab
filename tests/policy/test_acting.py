import numpy as np
import pytest
import torch

from juicer.errors import ConfigError, InvalidObservation
from juicer.policy.acting import INFERENCE_ROWS, TrainedPolicy
from juicer.policy.config import HorizonConfig, PolicyConfig
from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import build_policy

HEADS = {
    "mlp-denoiser": DiffusionConfig(denoiser=MLPDenoiserConfig(), prediction="sample", spacing="trailing"),
    "unet": DiffusionConfig(denoiser=UNetConfig(channels=(32, 64, 128), step_embedding=32)),
    "regression": MLPHeadConfig(),
}


def policy_of(spec, observe, head, **settings):
    network = build_policy(PolicyConfig(head=head, action_frame="relative", **settings), {"toy": spec}, seed=1)
    network.encoders.fit({name: torch.from_numpy(values) for name, values in observe(500, seed=7).items()})
    return TrainedPolicy(network, "toy")


def streams(indices):
    return [np.random.default_rng([5, index]) for index in indices]


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS.keys())
def test_a_row_is_bit_for_bit_the_same_alone_among_others_and_in_any_order(spec, observe, head):
    policy, num_rows = policy_of(spec, observe, head), INFERENCE_ROWS + 5
    observations = observe(num_rows)
    together = policy.predict(observations, streams(range(num_rows)))
    for rows in ([0], [20], [3, 1, 2], list(range(num_rows))[::-1], list(range(4, 20))):
        chosen = {name: values[rows] for name, values in observations.items()}
        np.testing.assert_array_equal(policy.predict(chosen, streams(rows)), together[rows])


def test_a_row_does_not_depend_on_what_stands_beside_it(spec, observe):
    policy = policy_of(spec, observe, HEADS["mlp-denoiser"])
    one, others = observe(1), observe(9, seed=3)
    alone = policy.predict(one, streams([0]))
    crowd = {name: np.concatenate([others[name], one[name]]) for name in one}
    np.testing.assert_array_equal(policy.predict(crowd, streams([1, 2, 3, 4, 5, 6, 7, 8, 9, 0]))[-1:], alone)


def test_the_result_does_not_depend_on_torch_settings_of_the_caller(spec, observe):
    policy, observations = policy_of(spec, observe, HEADS["mlp-denoiser"]), observe(4)
    before = policy.predict(observations, streams(range(4)))
    torch.set_float32_matmul_precision("medium")
    try:
        after = policy.predict(observations, streams(range(4)))
        assert torch.get_float32_matmul_precision() == "medium"
    finally:
        torch.set_float32_matmul_precision("highest")
    np.testing.assert_array_equal(before, after)


def test_each_row_draws_its_noise_from_its_own_stream(spec, observe):
    policy = policy_of(spec, observe, HEADS["mlp-denoiser"])
    twice = {name: np.repeat(values, 2, axis=0) for name, values in observe(1).items()}
    same = policy.predict(twice, streams([1, 1]))
    np.testing.assert_array_equal(same[0], same[1])
    different = policy.predict(twice, streams([1, 2]))
    assert not np.array_equal(different[0], different[1])


def test_a_stream_is_used_up_so_that_the_next_chunk_has_fresh_noise(spec, observe):
    policy, (own,) = policy_of(spec, observe, HEADS["mlp-denoiser"]), streams([1])
    observations = observe(1)
    assert not np.array_equal(policy.predict(observations, [own]), policy.predict(observations, [own]))


def test_actions_are_absolute_and_ready_for_the_environment(spec, observe):
    policy, observations = policy_of(spec, observe, HEADS["mlp-denoiser"]), observe(3)
    actions = policy.predict(observations, streams(range(3)))
    assert actions.shape == (3, 8, 10)
    assert actions.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(actions[..., 3:6], axis=-1), 1, atol=1e-5)


def test_several_observed_steps_are_taken_oldest_first(spec, observe):
    horizons = HorizonConfig(obs=2, pred=16, action=8)
    policy = policy_of(spec, observe, HEADS["regression"], horizons=horizons)
    history = {name: values.reshape(3, 2, -1) for name, values in observe(6).items()}
    assert policy.obs_horizon == 2
    assert policy.predict(history, streams(range(3))).shape == (3, 8, 10)
    with pytest.raises(InvalidObservation, match=r"must have shape \(3, 2, 16\)"):
        policy.predict(observe(3), streams(range(3)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda o: o.pop("part_poses"), "needs 'part_poses'"),
        (lambda o: o.update(part_poses=o["part_poses"][:, :7]), r"must have shape \(2, 1, 14\)"),
        (lambda o: o["proprioception"].__setitem__((0, 0), np.nan), "holds NaN"),
    ],
)
def test_wrong_observations_are_refused_by_name(spec, observe, change, message):
    observations = observe(2)
    change(observations)
    with pytest.raises(InvalidObservation, match=message):
        policy_of(spec, observe, HEADS["regression"]).predict(observations, streams(range(2)))


def test_initial_weights_depend_on_the_seed_alone(spec):
    config = PolicyConfig(head=DiffusionConfig(denoiser=MLPDenoiserConfig(width=16, blocks=1)))
    torch.manual_seed(3)
    first = build_policy(config, {"toy": spec}, seed=1)
    drawn = torch.rand(1)
    torch.manual_seed(3)
    assert torch.equal(drawn, torch.rand(1)), "building a policy moved the caller's random state"
    second = build_policy(config, {"toy": spec}, seed=1)
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True))


def test_it_declares_what_its_encoders_see_and_is_shown_that_in_its_own_type(spec, observe):
    policy = policy_of(spec, observe, HEADS["mlp-denoiser"])
    assert [(seen.name, seen.shape, seen.dtype) for seen in policy.observations] == [
        ("proprioception", (16,), "float32"),
        ("part_poses", (None,), "float32"),
    ]
    words = {**observe(1), "part_poses": np.full((1, 14), "0.1")}
    with pytest.raises(InvalidObservation, match="'part_poses' must be of type float32, got <U3"):
        policy.predict(words, streams([0]))


def with_samples(policy, number):
    return TrainedPolicy(policy._network, "toy", samples=number)


def test_acting_on_the_densest_sample_a_row_does_not_depend_on_what_stands_beside_it(spec, observe):
    policy = with_samples(policy_of(spec, observe, HEADS["mlp-denoiser"]), 20)
    observations, rows = observe(INFERENCE_ROWS + 3), [18, 0, 5]
    together = policy.predict(observations, streams(range(INFERENCE_ROWS + 3)))
    chosen = {name: values[rows] for name, values in observations.items()}
    np.testing.assert_array_equal(policy.predict(chosen, streams(rows)), together[rows])


def test_the_executed_chunk_is_one_of_the_samples_namely_the_densest(spec, observe):
    policy, observations = policy_of(spec, observe, HEADS["mlp-denoiser"]), observe(1)
    (chunks,) = policy.sample(observations, streams([4]), 300)
    assert chunks.shape == (300, 32, 10)
    (acted,) = with_samples(policy, 300).predict(observations, streams([4]))
    matching = [np.array_equal(acted, chunk[:8].clip(-1, 1)) for chunk in chunks]
    assert sum(matching) == 1


def test_one_sample_is_what_is_predicted_otherwise(spec, observe):
    policy, observations = policy_of(spec, observe, HEADS["mlp-denoiser"]), observe(1)
    (chunks,) = policy.sample(observations, streams([4]), 1)
    np.testing.assert_allclose(chunks[:, :8].clip(-1, 1), policy.predict(observations, streams([4])), atol=1e-5)


def test_there_is_nothing_to_choose_among_where_the_same_is_always_predicted(spec, observe):
    with pytest.raises(ConfigError, match="a head of kind 'mlp' has no samples to choose among"):
        with_samples(policy_of(spec, observe, HEADS["regression"]), 2)
