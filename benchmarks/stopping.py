"""How many episodes two conditions need until their comparison is decided, from evaluations that were run to the end.

python -m benchmarks.stopping FIRST SECOND [--orders 2000]     # ids of two evaluations on the same initial states

Recorded episodes are put into random orders, and each order is looked at after every block. `decided` is the share of
orders in which the comparison is decided at 5 % before they end, `episodes` what a model took until then (or to the
end), `steps` the share of control steps that both took together, which is what evaluations cost. `wrong` is the share
that is decided although both are equally good: for each pair of episodes that ended differently a coin is tossed which
of the two succeeded. `five models each` draws the pairs of five models from the recorded ones, looked at together.
"""

from __future__ import annotations

import argparse
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.evaluation import anytime_interval, anytime_p_value, mcnemar_p_value, wilson_interval
from juicer.seeding import stream
from juicer.storage.evaluations import read_evaluation
from juicer.study.statistics import LEVEL, state_p_value

ROW = "{:28} {:>5} {:>8} {:>9} {:>7} {:>7} {:>7}"
EVERY = (5, 10, 25)
MODELS = 5
WIDTHS = (0.3, 0.25, 0.2, 0.15)

Ends = NDArray[np.bool_]
Numbers = NDArray[np.int64]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first")
    parser.add_argument("second")
    parser.add_argument("--orders", type=int, default=2000)
    arguments = parser.parse_args()
    store = open_store(read_settings())
    first, first_steps = read(store, arguments.first)
    second, second_steps = read(store, arguments.second)
    steps = np.stack([first_steps, second_steps])
    only = int(np.sum(first & ~second)), int(np.sum(~first & second))
    print(f"{first.sum()} and {second.sum()} of {len(first)} episodes succeeded, {only[0]} and {only[1]} alone")
    print(f"all episodes: p = {mcnemar_p_value(*only):.2g} (exact), {anytime_p_value(*only):.2g} (anytime-valid)\n")
    print(ROW.format("comparison", "every", "decided", "episodes", "95 %", "steps", "wrong"))
    for title, models in (("one model each", 1), ("five models each", MODELS)):
        for every in EVERY:
            print(compared(title, first, second, steps, every, models, arguments.orders))
    print(f"\n{'width of the interval':28} {'every':>5} {'first':>9} {'second':>7}")
    for width in WIDTHS:
        needed = [np.mean(until_narrow(each, width, EVERY[-1], arguments.orders)) for each in (first, second)]
        print(f"{width:<28} {EVERY[-1]:5} {needed[0]:9.0f} {needed[1]:7.0f}")
    for each in (first, second):
        intervals = [interval(int(each.sum()), len(each)) for interval in (wilson_interval, anytime_interval)]
        told = " and ".join(f"{low:.1%} to {high:.1%}" for low, high in intervals)
        print(f"{each.sum()} of {len(each)}: {told} (Wilson's, fixed number; anytime-valid)")


def read(store: ArtifactStore, name: str) -> tuple[Ends, Numbers]:
    """Whether each episode of an evaluation succeeded, and its length [control steps]."""
    rows = read_evaluation(store.open(store.resolve(name, "evaluation")))
    return (
        np.array([row.outcome is Outcome.SUCCESS for row in rows]),
        np.array([row.length for row in rows], dtype=np.int64),
    )


def compared(title: str, first: Ends, second: Ends, steps: Numbers, every: int, models: int, orders: int) -> str:
    """A row of the table."""
    rng = stream(0, title)
    drawn = [draw(rng, len(first), models) for _ in range(orders)]
    ends = [stopped_after(first[order] & ~second[order], ~first[order] & second[order], every) for order in drawn]
    looked = np.array([min(end, len(first)) for end in ends])
    spent = [steps[:, order[:, :end]].sum() / steps[:, order].sum() for order, end in zip(drawn, looked, strict=True)]
    wrong = 0
    for order in drawn:
        differ, coin = first[order] != second[order], rng.random(order.shape) < 0.5
        wrong += stopped_after(differ & coin, differ & ~coin, every) <= len(first)
    return ROW.format(
        title,
        every,
        f"{np.mean([end <= len(first) for end in ends]):.1%}",
        f"{looked.mean():.1f}",
        f"{np.quantile(looked, 0.95):.0f}",
        f"{np.mean(spent):.0%}",
        f"{wrong / orders:.1%}",
    )


def draw(rng: np.random.Generator, episodes: int, models: int) -> Numbers:
    """Recorded pairs in random order: each once, or for several models drawn anew ``(models, episodes)``."""
    return rng.permutation(episodes)[None] if models == 1 else rng.integers(episodes, size=(models, episodes))


def stopped_after(first_only: Ends, second_only: Ends, every: int) -> int:
    """Episodes of each model after which the comparison is decided; more than there are if it never is."""
    episodes = first_only.shape[1]
    states = (second_only.astype(int) - first_only).sum(axis=0).tolist()
    for look in [*range(every, episodes, every), episodes]:
        if state_p_value(states[:look], anytime=True) <= LEVEL:
            return look
    return episodes + 1


_interval = cache(anytime_interval)


def until_narrow(ends: Ends, width: float, every: int, orders: int) -> list[int]:
    """Episodes until the interval of a rate is narrow enough, in each order, or all."""
    found = []
    rng = stream(0, "width")
    for _ in range(orders):
        successes = np.cumsum(rng.permutation(ends))
        looks = range(every, len(ends), every)
        spans = ((look, _interval(int(successes[look - 1]), look)) for look in looks)
        found.append(next((look for look, (low, high) in spans if high - low <= width), len(ends)))
    return found


if __name__ == "__main__":
    main()
