"""How fast the simulator steps while the scripted operator works, on one core and without pictures.

python -m benchmarks.simulation_speed [--task one_leg] [--episodes 3] [--seed-start 5000]

The same states are then stepped by a bare ``mj_step`` loop with the recorded joint targets: what is left of its rate
is what controller, observation, success test and milestones leave over.
"""

from __future__ import annotations

import argparse
import time

import mujoco
import numpy as np

from juicer.expert.operator import ScriptedOperator
from juicer.seeding import stream
from juicer.sim.env import SUBSTEPS_PER_UPDATE, TARGET_UPDATES, AssemblyEnv


def main() -> None:
    """Solve episodes, then replay their states bare, alternating so that both meet the same machine."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="one_leg")
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--seed-start", type=int, default=5000)
    options = parser.parse_args()
    env = AssemblyEnv(options.task)
    steps, environment_s, operator_s, bare_s = 0, 0.0, 0.0, 0.0
    for seed in range(options.seed_start, options.seed_start + options.episodes):
        observation, _ = env.reset(seed=seed)
        operator = ScriptedOperator(env.task, stream(0, "operator", seed))
        done = False
        while not done:
            start = time.perf_counter()
            action = operator.act(observation).action
            operator_s += time.perf_counter() - start
            before, targets_before = env.get_state(), env.data.ctrl.copy()
            start = time.perf_counter()
            observation, _, terminated, truncated, _ = env.step(action)
            environment_s += time.perf_counter() - start
            after, targets_after = env.get_state(), env.data.ctrl.copy()
            env.set_state(before)
            bare_s += bare_seconds(env, targets_before, targets_after)
            env.set_state(after)
            steps += 1
            done = terminated or truncated
    substeps = TARGET_UPDATES * SUBSTEPS_PER_UPDATE
    rate = steps / environment_s
    print(f"{options.task}, {options.episodes} episodes, {steps} control steps of {substeps} physics steps")
    print(f"  environment     {rate:7.0f} control steps/s  ({substeps * rate:.0f} physics steps/s)")
    print(f"  with operator   {steps / (environment_s + operator_s):7.0f} control steps/s")
    print(f"  bare mj_step    {steps / bare_s:7.0f} control steps/s")
    print(f"  environment / bare {bare_s / environment_s:6.1%}")


def bare_seconds(env: AssemblyEnv, before: np.ndarray, after: np.ndarray) -> float:
    """Time that MuJoCo alone takes for one control step from the environment's present state."""
    model, data = env.model, env.data
    start = time.perf_counter()
    data.ctrl[-1] = after[-1]
    for update in range(1, TARGET_UPDATES + 1):
        data.ctrl[:-1] = before[:-1] + (after[:-1] - before[:-1]) * (update / TARGET_UPDATES)
        mujoco.mj_step(model, data, SUBSTEPS_PER_UPDATE)
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
