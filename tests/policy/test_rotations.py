import numpy as np
import torch

from juicer import geometry
from juicer.policy import rotations


def test_torch_and_numpy_share_their_conventions():
    rng = np.random.default_rng(0)
    quats = geometry.normalised(rng.normal(size=(50, 4)))
    matrices = geometry.quat_to_matrix(quats)
    np.testing.assert_allclose(rotations.quat_to_matrix(torch.from_numpy(quats)), matrices, atol=1e-12)
    rot6d = geometry.matrix_to_rot6d(matrices)
    np.testing.assert_allclose(rotations.matrix_to_rot6d(torch.from_numpy(matrices)), rot6d, atol=1e-12)
    np.testing.assert_allclose(rotations.rot6d_to_matrix(torch.from_numpy(rot6d)), matrices, atol=1e-12)


def test_euler_angles_turn_about_x_then_y_then_z_of_the_moving_frame():
    a, b, c = 0.3, -0.7, 1.1
    expected = geometry.axis_rotation("x", a) @ geometry.axis_rotation("y", b) @ geometry.axis_rotation("z", c)
    matrix = rotations.euler_xyz_to_matrix(torch.tensor([[a, b, c]], dtype=torch.float64))
    np.testing.assert_allclose(matrix[0], expected, atol=1e-12)


def test_a_degenerate_prediction_stays_finite():
    assert torch.isfinite(rotations.rot6d_to_matrix(torch.zeros(3, 6))).all()


def test_rotate_back_is_the_transposed_product():
    rng = np.random.default_rng(1)
    matrix = torch.from_numpy(rng.normal(size=(4, 3, 3)))
    vector = torch.from_numpy(rng.normal(size=(4, 3)))
    expected = np.einsum("nji,nj->ni", matrix.numpy(), vector.numpy())
    np.testing.assert_allclose(rotations.rotate_back(matrix, vector), expected)
