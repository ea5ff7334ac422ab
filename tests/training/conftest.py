from collections.abc import Callable, Sequence

import numpy as np
import pytest

from juicer.geometry import matrix_to_rot6d, rotvec_to_matrix
from juicer.policy.config import FeatureSpec, HorizonConfig, PairSpec, PolicyConfig
from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.training.config import TrainingConfig
from juicer.training.windows import TrainingEpisodes

STEP_M = 0.02


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
def policy_config() -> PolicyConfig:
    """A diffusion policy of a few thousand weights."""
    head = DiffusionConfig(
        denoiser=MLPDenoiserConfig(width=32, blocks=1, step_embedding=8), prediction="sample", spacing="trailing"
    )
    return PolicyConfig(head=head, action_frame="relative", horizons=HorizonConfig(pred=8, action=4))


@pytest.fixture
def training_config() -> TrainingConfig:
    return TrainingConfig(
        steps=40,
        batch_size=16,
        learning_rate=1e-3,
        warmup_steps=5,
        ema_decay=0.9,
        validation_fraction=0.2,
        report_every=10,
        validate_every=20,
        save_every=17,
    )


@pytest.fixture
def episodes() -> Callable[..., TrainingEpisodes]:
    """Makes episodes in which the gripper flies straight to the second part and closes there."""

    def make(
        lengths: Sequence[int] = (30, 25, 40, 35, 20), seed: int = 0, family: str = "demo", source: str = "teleop"
    ) -> TrainingEpisodes:
        rng = np.random.default_rng(seed)
        parts = [_fly_to_a_part(length, rng) for length in lengths]
        return TrainingEpisodes(
            observations={
                "proprioception": np.concatenate([part[0] for part in parts]).astype(np.float32),
                "part_poses": np.concatenate([part[1] for part in parts]).astype(np.float32),
            },
            actions=np.concatenate([part[2] for part in parts]).astype(np.float32),
            episode_ends=np.cumsum(lengths),
            families=[f"{family}/{index}" for index in range(len(lengths))],
            sources=[source] * len(lengths),
        )

    return make


def _fly_to_a_part(length, rng):
    goal = rng.uniform([0.4, -0.2, 0.0], [0.7, 0.2, 0.1])
    position = np.array([0.55, 0.0, 0.3]) + rng.normal(scale=0.02, size=3)
    rotation = matrix_to_rot6d(rotvec_to_matrix(np.array([np.pi, 0, 0]) + rng.normal(scale=0.1, size=3)))
    proprioception, actions = np.zeros((length, 16)), np.zeros((length, 10))
    part_poses = np.tile([0.6, 0.1, 0.0, 1, 0, 0, 0, *goal, 1, 0, 0, 0], (length, 1))
    for step in range(length):
        offset = goal - position
        distance = np.linalg.norm(offset)
        target = position + offset * min(1, STEP_M / max(distance, 1e-9))
        proprioception[step] = [*position, *rotation, *np.zeros(6), 0.065]
        actions[step] = [*target, *rotation, 1 if distance < STEP_M else -1]
        position = target
    return proprioception, part_poses, actions
