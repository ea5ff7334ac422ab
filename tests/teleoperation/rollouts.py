"""A rollout that got stuck, for people to finish."""

from __future__ import annotations

from juicer.episode import Episode, EpisodeRecord, Outcome, Source
from juicer.expert.operator import ScriptedOperator
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder

SEED = SEED_RANGES[Purpose.COLLECTION][3]
STUCK_FOR = 20


def stuck_rollout() -> Episode:
    """One that lifts the leg of one_leg, and then does nothing more."""
    env = AssemblyEnv("one_leg")
    env.reset(seed=SEED)
    operator, recorder = ScriptedOperator(env.task, stream(0, "operator", SEED)), EpisodeRecorder(env)
    while "leg_lifted" not in recorder.info.get("milestones", ()):
        action = operator.act(recorder.observation).action
        recorder.step(action)
    for _ in range(STUCK_FOR):
        recorder.step(action)
    record = EpisodeRecord(
        source=Source.ROLLOUT, task="one_leg", randomness="low", seed=SEED, outcome=Outcome.TIMEOUT,
        milestones=recorder.info["milestones"], policy="0123456789abcdef",
    )  # fmt: skip
    return recorder.episode(record)
