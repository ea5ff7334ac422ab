"""The stage calls by which a model is analysed."""

from __future__ import annotations

from collections.abc import Callable

from flows.analyses import Analysis, MonitorAnalysis, SamplingAnalysis
from flows.annotations import annotations_of
from flows.loop_config import LoopConfig
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.policy_rollout import RolloutConfig
from stages.evaluate import evaluate
from stages.modes import ModesConfig, modes
from stages.monitor import MonitorConfig, MonitorSection, monitor
from stages.runtime.session import Session
from stages.sampling import SamplingConfig, SamplingSection, sampling


def analyse(
    session: Session,
    config: LoopConfig,
    checkpoint: ArtifactRef,
    analysis: Analysis,
    get_demonstrations: Callable[[], ArtifactRef],
) -> ArtifactRef:
    """Make an analysis of a model.

    Args:
        session: Session of the model's stages.
        config: The loop that it was trained in.
        checkpoint: The model.
        analysis: What is to be known.
        get_demonstrations: Makes or finds the demonstrations of the loop, for an analysis that needs them.
    """
    if isinstance(analysis, SamplingAnalysis):
        demonstrations = get_demonstrations()
        annotations = annotations_of(session, config, demonstrations)
        drawn = SamplingConfig.model_validate({**_section(analysis, SamplingSection), "task": config.task})
        return sampling(session, checkpoint=checkpoint, episodes=demonstrations, annotations=annotations, config=drawn)
    rollouts = config.evaluation.model_copy(update={"episodes": analysis.episodes or config.evaluation.episodes})
    if isinstance(analysis, MonitorAnalysis):
        where = {**_section(rollouts, RolloutConfig), "episodes": rollouts.episodes}
        watch = {**_section(analysis, MonitorSection), **where}
        return monitor(session, checkpoint=checkpoint, config=MonitorConfig.model_validate(watch))
    evaluations = tuple(
        evaluate(session, checkpoint=checkpoint, config=rollouts.model_copy(update={"samples": samples}))
        for samples in analysis.samples
    )
    cost = ModesConfig(task=config.task, predictions=analysis.predictions)
    return modes(session, checkpoint=checkpoint, evaluations=evaluations, config=cost)


def _section(config: StrictConfig, model: type[StrictConfig]) -> dict[str, object]:
    """The part of a configuration that another model has as well."""
    return {name: getattr(config, name) for name in model.model_fields}
