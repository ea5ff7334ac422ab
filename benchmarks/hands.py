"""How often hands at the page of teleoperation assemble, and how long that takes: real server, real browser, real keys.

    python -m benchmarks.hands [--task one_leg] [--demonstrations 10]

The hands see the numbers that the page shows, and press its keys. An episode that is not a success after some time is
discarded. Time is real: the machine should have nothing else to do.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.page.chromium import Chromium
from benchmarks.page.driving import Driven, begin, drive
from benchmarks.page.hands import Hands
from benchmarks.page.server import serving
from juicer.evaluation import wilson_interval
from juicer.sim.env import STEP_S

ROW = "{:>5}  {:>7}  {:>6}  {:>10}  {:>5}  {:>5}  {:>4}"


def main() -> None:
    """Drive and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="one_leg")
    parser.add_argument("--demonstrations", type=int, default=10)
    parser.add_argument("--most-seconds", type=float, default=300.0, help="after which an episode is discarded")
    options = parser.parse_args()
    print(ROW.format("state", "success", "real s", "recorded s", "steps", "undos", "keys"))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        server = stack.enter_context(serving(folder))
        browser = stack.enter_context(Chromium(folder / "profile"))
        begin(browser, server.teleop, options.task)
        began = time.monotonic()
        all_driven = []
        for number in range(options.demonstrations):
            driven = drive(browser, Hands(options.task, number), options.most_seconds)
            all_driven.append(driven)
            print(row(driven), flush=True)
        minutes = (time.monotonic() - began) / 60
        browser.until("teleop.status.kept.every(({verification}) => verification.verdict !== 'checking')", 120)
        print(summary(all_driven, minutes, browser.evaluate("teleop.status.demonstrations")))


def row(driven: Driven) -> str:
    """What became of one initial state."""
    success, recorded = "yes" if driven.success else "no", f"{driven.acted * STEP_S:.1f}"
    return ROW.format(
        driven.seed, success, f"{driven.seconds:.1f}", recorded, driven.steps, driven.undos, driven.presses
    )


def summary(all_driven: list[Driven], minutes: float, verified: int) -> str:
    """What became of all."""
    successes = sum(driven.success for driven in all_driven)
    low, high = wilson_interval(successes, len(all_driven))
    return (
        f"{successes} of {len(all_driven)} assembled: {successes / len(all_driven):.0%} ({low:.0%} to {high:.0%}); "
        f"{verified} verified by replay; {minutes:.1f} minutes"
    )


if __name__ == "__main__":
    main()
