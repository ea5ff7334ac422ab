"""The paper's Figure 2 in our simulator: what an operator sees before an insertion, without and with the lines.

    python -m benchmarks.laser EPISODES ANNOTATIONS [--data data] [--output laser.webp]

Shown is the first demonstration some steps before the first critical state that is an insertion.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from juicer import api
from juicer.imaging.operator_views import OperatorRenderer, OperatorView
from juicer.storage.annotations import read_annotations
from juicer.tasks.registry import get_task
from juicer.tasks.specification import Insertion

WIDTH, HEIGHT = 480, 360


def main() -> None:
    """Write the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("episodes", help="id of demonstrations")
    parser.add_argument("annotations", help="id of their critical states")
    parser.add_argument("--data", default="data", help="where they are kept")
    parser.add_argument("--before", type=int, default=12, help="steps before the critical state")
    parser.add_argument("--output", type=Path, default=Path("laser.webp"))
    options = parser.parse_args()
    store = api.open_store(options.data)
    episode = api.load_episodes(store, options.episodes)[0]
    task = get_task(episode.record.task)
    insertions = [index for index, state in enumerate(task.critical_states) if isinstance(state, Insertion)]
    marks = read_annotations(store.open(api.find(store, options.annotations, "annotations")))
    step = next(
        mark.step
        for mark in marks
        if mark.episode_id == episode.record.episode_id and mark.critical_state == insertions[0]
    )
    env = api.make(task.name)
    env.set_state(episode.steps["sim_state"][max(step - options.before, 0)])
    renderer = OperatorRenderer(task.name)
    rows = [
        np.concatenate(
            [
                renderer.draw(env.data.qpos, view, WIDTH, HEIGHT, shadows=view is OperatorView.FRONT, lines=lines)
                for view in (OperatorView.FRONT, OperatorView.SIDE)
            ],
            axis=1,
        )
        for lines in (False, True)
    ]
    Image.fromarray(np.concatenate(rows)).save(options.output, quality=85)
    print(f"{options.output}: above without, below with the lines, {options.before} steps before step {step}")


if __name__ == "__main__":
    main()
