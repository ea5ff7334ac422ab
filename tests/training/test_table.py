import dataclasses

import numpy as np
import pytest
import torch

from juicer.errors import TrainingFailed
from juicer.policy.network import build_policy
from juicer.policy.rotations import rot6d_to_matrix
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise
from juicer.training.source import BatchOrder
from juicer.training.table import WindowTable
from juicer.training.windows import cut_windows

CPU = torch.device("cpu")


@pytest.fixture
def make_table(episodes, spec, policy_config):
    def make(frame="relative", learn_padding=True, back_padding=7, lengths=(30, 25, 40), noise=None):
        config = policy_config.model_copy(update={"action_frame": frame})
        network, data = build_policy(config, {"toy": spec}, seed=0), episodes(lengths)
        windows = cut_windows(data.episode_ends, np.arange(len(lengths)), config.horizons, back_padding)
        table = WindowTable(data, windows, network, learn_padding, CPU)
        torch.manual_seed(0)
        table.fit(noise)
        table.normalize()
        return table, network, data

    return make


def test_a_batch_holds_what_the_policy_would_see_and_should_do(make_table):
    table, network, data = make_table(frame="relative")
    rows = torch.tensor([3, 30, 60])
    batch = table.gather(rows)
    recorded, proprioception = table.recorded(rows)
    np.testing.assert_array_equal(recorded[0], data.actions[3:11])
    np.testing.assert_array_equal(proprioception[0], data.observations["proprioception"][3])
    decoded = network.decode_actions(batch.chunk, proprioception)
    np.testing.assert_allclose(decoded, recorded, atol=1e-5)
    seen = {name: torch.from_numpy(values[3:4, None]) for name, values in data.observations.items()}
    np.testing.assert_array_equal(batch.prepared["state"][0], network.encoders.prepare(seen)["state"][0])


def test_training_chunks_fill_the_range_of_the_sampler(make_table):
    table, _, _ = make_table()
    chunk = table.gather(torch.arange(len(table))).chunk
    assert chunk.abs().max() <= 1 + 1e-5


@pytest.mark.parametrize(("learn_padding", "targets"), [(True, 8), (False, 1)])
def test_padding_counts_only_if_asked_for(make_table, learn_padding, targets):
    table, _, _ = make_table(learn_padding=learn_padding, lengths=(30,))
    batch = table.gather(torch.tensor([29]))
    assert batch.weight.sum() == targets
    losses = torch.zeros(1, 8, 10)
    losses[0, -1] = 8.0
    assert batch.average(losses) == (1.0 if learn_padding else 0.0)


@pytest.mark.parametrize("frame", ["absolute", "relative"])
def test_physical_noise_moves_the_gripper_and_keeps_the_absolute_target(make_table, frame):
    noise = PhysicalStateNoise(probability=1.0)
    table, network, _ = make_table(frame=frame, noise=noise)
    rows = torch.arange(len(table))
    torch.manual_seed(1)
    batch = table.gather(rows, noise)
    recorded, proprioception = table.recorded(rows)
    seen = network.encoders.members[0].normalizers[0].denormalize(batch.prepared["state"][:, 0])[:, :16]
    inside = batch.prepared["state"][:, 0, :9].abs().amax(-1) < 1.5
    assert inside.float().mean() > 0.9
    decoded = network.decode_actions(batch.chunk, seen)
    np.testing.assert_allclose(decoded[inside], recorded[inside], atol=1e-4)
    offset = (seen - proprioception)[inside]
    assert 0.003 < offset[:, :3].std() < 0.02


def test_relative_targets_pull_back_against_the_noise(make_table):
    table, network, _ = make_table(frame="relative")
    rows = torch.arange(len(table))
    torch.manual_seed(0)
    noisy = network.action_normalizer.denormalize(table.gather(rows, PhysicalStateNoise(probability=1.0)).chunk)
    clean = network.action_normalizer.denormalize(table.gather(rows).chunk)
    torch.manual_seed(0)
    offset = 0.01 * torch.randn(len(rows), 1, 3)
    np.testing.assert_allclose(noisy[..., :3], clean[..., :3] - offset, atol=1e-5)


def test_noise_reaches_the_given_share_of_a_batch(make_table):
    table, _, _ = make_table()
    rows = torch.arange(50)
    changed = (table.gather(rows, PhysicalStateNoise()).prepared["state"] != table.gather(rows).prepared["state"]).any(
        -1
    )
    assert changed[:, 0].tolist() == [True] * 10 + [False] * 40


def test_the_original_noise_is_in_normalised_units_and_leaves_targets_and_parts_alone(make_table):
    table, _, _ = make_table(frame="absolute")
    rows = torch.arange(len(table))
    torch.manual_seed(0)
    noisy, clean = table.gather(rows, OriginalStateNoise(probability=1.0)), table.gather(rows)
    assert torch.equal(noisy.chunk, clean.chunk)
    assert torch.equal(noisy.prepared["state"][..., 9:], clean.prepared["state"][..., 9:])
    offset = noisy.prepared["state"][..., :3] - clean.prepared["state"][..., :3]
    assert float(offset.std()) == pytest.approx(0.01, rel=0.2)
    rotation = noisy.prepared["state"][..., 3:9].unflatten(-1, (2, 3))
    np.testing.assert_allclose(rotation.norm(dim=-1), 1, atol=1e-5)


def test_physical_noise_turns_the_gripper_by_about_a_tenth_of_a_radian(make_table):
    table, network, _ = make_table(frame="relative")
    rows = torch.arange(len(table))
    noisy = network.action_normalizer.denormalize(table.gather(rows, PhysicalStateNoise(probability=1.0)).chunk)
    clean = network.action_normalizer.denormalize(table.gather(rows).chunk)
    turn = rot6d_to_matrix(noisy[:, 0, 3:9]) @ rot6d_to_matrix(clean[:, 0, 3:9]).transpose(-1, -2)
    angle = torch.acos(((turn.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2).clamp(-1, 1))
    assert 0.12 < angle.mean() < 0.2


def test_an_epoch_shows_every_window_once():
    order = BatchOrder(num_windows=100, batch_size=20, seed=0)
    epoch = torch.cat([order.rows(step) for step in range(5)])
    assert sorted(epoch.tolist()) == list(range(100))
    assert epoch.tolist() != torch.cat([order.rows(step) for step in range(5, 10)]).tolist()


def test_the_rows_of_a_step_need_no_memory_of_the_steps_before():
    told_in_order = BatchOrder(num_windows=33, batch_size=20, seed=0)
    steps = [told_in_order.rows(step) for step in range(9)]
    for step in reversed(range(9)):
        assert torch.equal(BatchOrder(num_windows=33, batch_size=20, seed=0).rows(step), steps[step])


def test_a_batch_may_be_larger_than_the_data():
    rows = BatchOrder(num_windows=7, batch_size=20, seed=0).rows(0)
    assert len(rows) == 20
    assert torch.bincount(rows).min() >= 2


def test_episodes_too_short_for_a_window_are_refused(make_table):
    with pytest.raises(TrainingFailed, match=r"raise windows\.back_padding"):
        make_table(lengths=(5, 6), back_padding=0)


def test_weights_decide_how_often_a_window_is_learned_from():
    weights = np.array([1.0] * 50 + [3.0] * 50)
    order = BatchOrder(100, 64, seed=0, weights=weights)
    rows = np.concatenate([order.rows(step).numpy() for step in range(400)])
    assert np.mean(rows >= 50) == pytest.approx(0.75, abs=0.01)
    again = BatchOrder(100, 64, seed=0, weights=weights)
    np.testing.assert_array_equal(again.rows(123), order.rows(123))


def test_what_a_policy_does_not_see_is_not_taken_and_what_it_lacks_is_named(episodes, spec, policy_config):
    network, data = build_policy(policy_config, {"toy": spec}, seed=0), episodes((30,))
    windows = cut_windows(data.episode_ends, np.arange(1), policy_config.horizons, 7)
    more = dataclasses.replace(data, observations={**data.observations, "front": np.zeros((30, 4, 4, 3), np.uint8)})
    assert set(WindowTable(more, windows, network, True, CPU)._observations) == {"proprioception", "part_poses"}
    less = dataclasses.replace(data, observations={"proprioception": data.observations["proprioception"]})
    with pytest.raises(TrainingFailed, match="observes 'part_poses', which the episodes do not hold; they hold propr"):
        WindowTable(less, windows, network, True, CPU)
