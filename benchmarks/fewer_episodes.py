"""What a study would have concluded from fewer episodes of the same models.

python -m benchmarks.fewer_episodes table_vi --task one_leg --condition bc --condition ta [--episodes 50 25]

All models of the conditions must be evaluated, in the store of this process (`JUICER_DATA`). Their initial states are
put into random orders. Of each order the first few are kept, the same ones of every model, and every statement that can
be judged is judged by these alone: as if their number had been fixed before, and as `evaluate.stop` with its defaults
would have ended. Nothing is computed but verdicts, so models are those of the full training.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from flows.command.choice import Choice
from flows.running.data_folder import open_store
from flows.running.execution import rows_of
from flows.running.plan import evaluated_models
from flows.running.settings import read_settings
from flows.stopping import StopConfig, open_conditions
from juicer.evaluation import ConditionResult, summarise
from juicer.seeding import stream
from juicer.study.claims import CLAIMS, Claim
from juicer.study.material import TaskStudy, task_study
from juicer.study.rules import Ruling


def main() -> None:
    """Print a table of verdicts for each number of episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("configuration")
    parser.add_argument("--task", required=True)
    parser.add_argument("--condition", action="append", default=[])
    parser.add_argument("--episodes", type=int, nargs="+", default=[50, 25])
    parser.add_argument("--orders", type=int, default=100)
    options = parser.parse_args()
    study = read(options.configuration, options.task, options.condition)
    everything = fewest(study)
    rng = stream(0, "orders")
    orders = [rng.permutation(everything).tolist() for _ in range(options.orders)]
    told = {
        claim: ruling
        for claim in CLAIMS
        if options.task in claim.tasks and (ruling := claim.rule.judge(study).ruling) is not Ruling.UNTESTED
    }
    for number in options.episodes:
        kept = [first_of(study, order, dict.fromkeys(study.measured, number)) for order in orders]
        show(f"{number} of {everything} episodes", told, kept)
    stop = StopConfig()
    ended = [stopped(study, order, stop) for order in orders]
    share = sum(map(num_episodes, ended)) / (len(ended) * num_episodes(study))
    show(f"evaluate.stop, looked after every {stop.every}: {share:.0%} of the episodes", told, ended)


def read(configuration: str, task: str, conditions: Sequence[str]) -> TaskStudy:
    """What is known of the usual evaluations of some conditions."""
    store = open_store(read_settings())
    (run,) = Choice(configuration, tasks=(task,), conditions=tuple(conditions)).runs()
    models, _ = evaluated_models(store, run)
    return task_study(store, task, *rows_of([replace(model, shifted={}) for model in models]))


def fewest(study: TaskStudy) -> int:
    """Episodes that every model has."""
    return min(len(model.successes) for each in study.measured.values() for model in each.result.models)


def num_episodes(study: TaskStudy) -> int:
    """Episodes of all models together."""
    return sum(each.result.num_episodes for each in study.measured.values())


def first_of(study: TaskStudy, order: Sequence[int], numbers: Mapping[str, int], *, anytime: bool = False) -> TaskStudy:
    """The study as if each condition had been evaluated on that many initial states of an order."""
    measured = {
        name: replace(each, result=_first_of(each.result, order[: numbers[name]], anytime))
        for name, each in study.measured.items()
    }
    return replace(study, measured=measured)


def _first_of(result: ConditionResult, chosen: Sequence[int], anytime: bool) -> ConditionResult:
    models = [
        replace(
            model,
            initial_states=tuple(model.initial_states[index] for index in chosen),
            successes=tuple(model.successes[index] for index in chosen),
        )
        for model in result.models
    ]
    return replace(summarise(result.condition, models, result.title, anytime=anytime), observes=result.observes)


def stopped(study: TaskStudy, order: Sequence[int], stop: StopConfig) -> TaskStudy:
    """The study as a run with this rule would have left it."""
    numbers = dict.fromkeys(study.measured, min(stop.every, len(order)))
    while True:
        so_far = first_of(study, order, numbers, anytime=True)
        going_on = [name for name in open_conditions(so_far, stop) if numbers[name] < len(order)]
        if not going_on:
            return so_far
        numbers |= {name: min(numbers[name] + stop.every, len(order)) for name in going_on}


def show(title: str, told: Mapping[Claim, Ruling], studies: Sequence[TaskStudy]) -> None:
    """How often each verdict is that of all episodes, and what it is else."""
    print(f"\n{title}")
    for claim, ruling in told.items():
        found = Counter(claim.rule.judge(study).ruling for study in studies)
        others = ", ".join(f"{other} {number / len(studies):.0%}" for other, number in found.items() if other != ruling)
        print(f"  {found[ruling] / len(studies):5.0%}  {ruling:15}  {claim.sentence}{others and f'  [{others}]'}")


if __name__ == "__main__":
    main()
