"""A small, flawless operator log."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from juicer.demonstration.log import OperatorLog

LogFactory = Callable[..., OperatorLog]


@pytest.fixture
def make_log() -> LogFactory:
    """Factory of successful one_leg logs without idle steps; keyword arguments replace fields."""

    def make(length: int = 80, **changes: Any) -> OperatorLog:
        return dataclasses.replace(_log(length), **changes)

    return make


def _log(length: int) -> OperatorLog:
    rng = np.random.default_rng(0)
    action = np.tile(np.array([0.5, 0.0, 0.1, 1, 0, 0, 0, -1, 0, -1.0]), (length, 1))
    action[:, :3] += rng.normal(0, 0.01, (length, 3))
    steps = {
        "proprioception": rng.normal(size=(length, 16)).astype(np.float32),
        "part_poses": rng.normal(size=(length, 35)).astype(np.float32),
        "sim_state": rng.normal(size=(length, 60)),
        "action": action.astype(np.float32),
        "reward": np.eye(1, length, length - 1, dtype=np.float32)[0],
    }
    return OperatorLog(
        task="one_leg",
        randomness="low",
        seed=7,
        device="test rig",
        success=True,
        outcome="success",
        parts_assembled=1,
        steps=steps,
        final={name: steps[name][-1] for name in ("proprioception", "part_poses", "sim_state")},
        timestamp_s=np.arange(length) * 0.1,
        idle=np.zeros(length, dtype=bool),
        milestones={"leg_lifted": length // 2, "screwed": length - 1},
    )
