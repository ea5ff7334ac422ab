import numpy as np
import pytest
import torch

from juicer.policy.actions import action_frame


def chunk_of(observe, num_rows, length):
    poses = [torch.from_numpy(observe(num_rows, seed)["proprioception"][:, :9]) for seed in range(length)]
    gripper = torch.ones(num_rows, length, 1)
    return torch.cat([torch.stack(poses, dim=1), gripper], dim=-1)


@pytest.mark.parametrize("name", ["absolute", "relative"])
def test_decoding_undoes_encoding(name, observe):
    frame = action_frame(name)
    absolute = chunk_of(observe, 6, 4)
    proprioception = torch.from_numpy(observe(6, seed=9)["proprioception"])
    decoded = frame.decode(frame.encode(absolute, proprioception), proprioception)
    np.testing.assert_allclose(decoded, absolute, atol=1e-6)


def test_relative_actions_are_zero_displacement_where_the_gripper_already_is(observe):
    proprioception = torch.from_numpy(observe(3)["proprioception"])
    absolute = torch.cat([proprioception[:, None, :9], torch.ones(3, 1, 1)], dim=-1)
    encoded = action_frame("relative").encode(absolute, proprioception)
    expected = torch.tensor([0, 0, 0, 1, 0, 0, 0, 1, 0, 1.0]).expand(3, 1, 10)
    np.testing.assert_allclose(encoded, expected, atol=1e-6)


def test_displacement_is_along_base_axes_whatever_the_gripper_points_to(observe):
    proprioception = torch.from_numpy(observe(3)["proprioception"])
    absolute = torch.cat([proprioception[:, None, :9], torch.ones(3, 1, 1)], dim=-1)
    absolute[..., 2] += 0.1
    encoded = action_frame("relative").encode(absolute, proprioception)
    np.testing.assert_allclose(encoded[:, 0, :3], torch.tensor([[0, 0, 0.1]] * 3), atol=1e-6)


@pytest.mark.parametrize("name", ["absolute", "relative"])
def test_decoded_rotations_are_true_rotations(name, observe):
    proprioception = torch.from_numpy(observe(5)["proprioception"])
    decoded = action_frame(name).decode(torch.randn(5, 8, 10), proprioception)
    rows = decoded[..., 3:9].reshape(5, 8, 2, 3)
    np.testing.assert_allclose(rows @ rows.transpose(-1, -2), torch.eye(2).expand(5, 8, 2, 2), atol=1e-5)
