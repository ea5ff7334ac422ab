"""What a policy has to know of a task of ours."""

from __future__ import annotations

from juicer.policy.config import FeatureSpec, PairSpec
from juicer.tasks.registry import get_task
from juicer.tasks.specification import MOUNTED_COSINE, MOUNTED_M


def feature_spec(task_name: str) -> FeatureSpec:
    """The numbers of a task that its features need."""
    task = get_task(task_name)
    pairs = tuple(
        PairSpec(
            first=pair.first,
            second=pair.second,
            target=pair.targets[pair.operator_target],
            also_at=tuple(target for index, target in enumerate(pair.targets) if index != pair.operator_target),
            any_rotation=pair.any_rotation,
        )
        for pair in task.pairs
    )
    return FeatureSpec(num_parts=len(task.parts), pairs=pairs, mounted_m=MOUNTED_M, mounted_cosine=MOUNTED_COSINE)
