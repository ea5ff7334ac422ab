from __future__ import annotations

import pytest

from juicer.augmentation.reference import Reference, reference_of
from juicer.episode import Episode
from juicer.sim.env import AssemblyEnv

CRITICAL_STEP = 16


@pytest.fixture(scope="session")
def reference(insertions: list[Episode]) -> Reference:
    return reference_of(insertions[0], CRITICAL_STEP, 0, steps_after_gripper_change=5)


@pytest.fixture(scope="session")
def env() -> AssemblyEnv:
    return AssemblyEnv("one_leg", max_steps=100_000)
