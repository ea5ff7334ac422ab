"""A rollout that got stuck, for people to finish."""

from __future__ import annotations

from juicer.demonstration.log import OperatorLog
from juicer.episode import Episode, EpisodeRecord, Outcome, Source
from juicer.expert.operator import ScriptedOperator
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder
from juicer.teleoperation.drivers import Driver
from juicer.teleoperation.origin import Origin, origin_of
from juicer.teleoperation.take import Take

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


def corrected_log(rollout: Episode, step: int) -> OperatorLog:
    """What the scripted operator's hands make of a rollout, from one of its steps on."""
    return corrected_from(origin_of(rollout, step))


def corrected_from(origin: Origin) -> OperatorLog:
    """The same from anywhere in one_leg."""
    env = AssemblyEnv("one_leg")
    take, operator = Take(env, origin.seed, origin.state), ScriptedOperator(env.task, stream(1, "operator", SEED))
    while not take.done:
        wish = operator.act(take.observation)
        take.act(wish.action, idle=wish.idle)
    take.began = "began"
    take.drivers.append(Driver("Anna", "keyboard", "original", 1.0))
    return take.log("ended", origin)
