from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.geometry import matrix_to_rot6d, normalised, quat_to_matrix
from juicer.policy.config import FeatureSpec, PairSpec

Observations = dict[str, NDArray[np.float32]]


@pytest.fixture
def spec() -> FeatureSpec:
    """Two parts, the second of which belongs 5 cm above the first."""
    pair = PairSpec(first=0, second=1, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
    return FeatureSpec(num_parts=2, pairs=(pair,), mounted_m=0.005, mounted_cosine=0.94)


@pytest.fixture
def tasks(spec) -> dict[str, FeatureSpec]:
    """What a policy for the toy task alone knows of it."""
    return {"toy": spec}


@pytest.fixture
def observe() -> Callable[..., Observations]:
    """Makes random but valid observations: unit rotations, positions within the workspace."""

    def make(num_rows: int, seed: int = 0) -> Observations:
        rng = np.random.default_rng(seed)

        def poses() -> NDArray[np.float64]:
            position = rng.uniform([0.3, -0.3, 0.0], [0.7, 0.3, 0.3], size=(num_rows, 3))
            return np.concatenate([position, normalised(rng.normal(size=(num_rows, 4)))], axis=1)

        gripper = poses()
        proprioception = np.concatenate(
            [
                gripper[:, :3],
                matrix_to_rot6d(quat_to_matrix(gripper[:, 3:])),
                rng.normal(size=(num_rows, 6)),
                rng.uniform(0, 0.065, size=(num_rows, 1)),
            ],
            axis=1,
        )
        part_poses = np.concatenate([poses(), poses()], axis=1)
        return {"proprioception": proprioception.astype(np.float32), "part_poses": part_poses.astype(np.float32)}

    return make
