"""How well proposed critical states agree with what the operator was doing, which the proposer never sees.

python -m benchmarks.critical_states [--tasks one_leg round_table lamp square_table] [--episodes 20]

A grasp is marked where the operator begins to close the gripper on a part for the last time before the part is lifted
(or pushed); an insertion where it begins to lower a part into its hole for the last time. A proposal is right if it
lies at most ``--tolerance`` steps from the mark of its critical state.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from itertools import pairwise
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.annotation.propose import AnnotationConfig, propose
from juicer.demonstration.ingestion import Ingestion, IngestionConfig, steps_to_keep
from juicer.demonstration.recording import record_demonstration
from juicer.expert.hand import ScriptedStep
from juicer.expert.operator import ScriptedOperator
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import TASK_NAMES
from juicer.tasks.specification import AssemblyTask, CriticalState, Insertion, Joint


class Onlooker(ScriptedOperator):
    """The scripted operator, with a note of what it was busy with at every step."""

    def __init__(self, task: AssemblyTask, rng: np.random.Generator) -> None:
        """Begin with an empty page."""
        super().__init__(task, rng)
        self.phases: list[str] = []

    def act(self, observation: Mapping[str, NDArray[np.floating[Any]]]) -> ScriptedStep:
        """Note the phase."""
        step = super().act(observation)
        self.phases.append(step.phase)
        return step


def main() -> None:
    """Record, propose, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=TASK_NAMES, choices=TASK_NAMES)
    parser.add_argument("--randomness", default="low", choices=("low", "med", "high"))
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed-start", type=int, default=7000)
    parser.add_argument("--tolerance", type=int, default=15)
    options = parser.parse_args()
    print("task          critical state       demonstrations  proposed  right  precision  recall  median offset")
    for name in options.tasks:
        env = AssemblyEnv(name, options.randomness)
        offsets: list[list[int]] = [[] for _ in env.task.critical_states]
        demonstrations = 0
        config = IngestionConfig(task=name)
        ingestion = Ingestion(config)
        for seed in range(options.seed_start, options.seed_start + options.episodes):
            operator = Onlooker(env.task, stream(0, "operator", seed))
            log = record_demonstration(env, operator, seed)
            if not log.success:
                continue
            demonstrations += 1
            keep = steps_to_keep(log.steps["action"], log.idle, config.kept_after_toggle)
            phases = [phase for phase, kept in zip(operator.phases, keep, strict=True) if kept]
            demonstration = ingestion.ingest_log(log).episode
            milestones = demonstration.record.milestones
            marks = [marked_step(env.task, state, phases, milestones) for state in env.task.critical_states]
            for proposal in propose(env, demonstration, AnnotationConfig()):
                offsets[proposal.critical_state].append(proposal.step - marks[proposal.critical_state])
        for state, found in zip(env.task.critical_state_names, offsets, strict=True):
            right = sum(abs(offset) <= options.tolerance for offset in found)
            precision = f"{right / len(found):9.0%}" if found else f"{'-':>9}"
            middle = f"{median(found):+.0f} steps" if found else "-"
            print(
                f"{name:<13} {state:<20} {demonstrations:14d} {len(found):9d} {right:6d}  "
                f"{precision} {right / max(demonstrations, 1):7.0%}  {middle}",
                flush=True,
            )


def marked_step(task: AssemblyTask, state: CriticalState, phases: Sequence[str], milestones: Mapping[str, int]) -> int:
    """Step at which the operator began what makes a state critical, for the last time before it had succeeded."""
    if isinstance(state, Insertion):
        pair = task.pairs[state.pair]
        done = "inserted" if pair.joint is Joint.SCREWED else "put_on"
        phase, until = f"insert the {pair.label}", milestones[f"{pair.label}_{done}"]
    elif state.part == 0:
        phase, until = "grasp the base", milestones[f"{task.base_label}_placed"]
    else:
        label = next(pair.label for pair in task.pairs if pair.second == state.part)
        phase, until = f"grasp the {label}", milestones[f"{label}_lifted"]
    begins = [step for step, (last, now) in enumerate(pairwise(phases), start=1) if now == phase != last]
    return max((step for step in begins if step <= until), default=begins[0])


if __name__ == "__main__":
    main()
