"""The loop for one model: demonstrations in, an evaluated policy out. Reads like the diagram in the README."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from flows.analysing import analyse
from flows.annotations import annotations_of
from flows.conditions import Condition
from flows.config import RunConfig
from flows.loop_config import LoopConfig
from flows.stopping import measure
from juicer.artifacts.manifest import STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.augmentation.config import UniformPlacement
from juicer.demonstration.log import SUFFIX
from juicer.errors import ArtifactNotFound, ConfigError
from juicer.policy.config import PolicyConfig
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.members import EncoderConfig
from juicer.reporting.setting import Setting
from juicer.text import printable
from stages.augment import AugmentConfig, augment
from stages.collect import collect
from stages.correct import correct
from stages.dataset import dataset
from stages.encode import EncodeConfig, encode
from stages.estimate import EstimateConfig, estimate
from stages.evaluate import evaluate
from stages.ingest import ingest
from stages.memorise import MemoriseConfig, memorise
from stages.record import record
from stages.render import RenderConfig, render
from stages.runtime.context import NoRecord
from stages.runtime.session import Session
from stages.select import select
from stages.train import TrainConfig, train

_Fixed = tuple[EncoderConfig, tuple[ArtifactRef, ...]]
"""An encoder that a training does not change, and the estimators that it needs."""


@dataclass(frozen=True)
class ModelOutcome:
    """What became of one model.

    Attributes:
        condition: Name of its condition.
        title: What people read instead; if the policy does not see states, it says what it sees.
        seed: Its seed.
        checkpoint: The last one trained.
        evaluation: How it did.
        shifted: How it did under each shift, by name; none under one that it cannot notice.
        findings: Why it learned from less than it should, and what its evaluation says of itself, as clauses.
        observes: What it sees, and what it was taught with beside; empty if that is not known.
        analyses: What else was found out about it, by the names in the configuration.
        setting: What its condition changes in the configuration.
        method: The condition that comes with juicer and has the same parts; empty if there is none.
    """

    condition: str
    title: str
    seed: int
    checkpoint: ArtifactRef
    evaluation: ArtifactRef
    findings: tuple[str, ...] = ()
    observes: str = ""
    analyses: Mapping[str, ArtifactRef] = field(default_factory=dict)
    shifted: Mapping[str, ArtifactRef | None] = field(default_factory=dict)
    setting: Setting = field(default_factory=Setting)
    method: str = ""

    @property
    def finding(self) -> str:
        """All of them, as a sentence; empty if there are none."""
        return "; ".join(self.findings)


@dataclass(frozen=True)
class _Gained:
    """What the turns of collect, select, train have brought so far.

    Attributes:
        rollouts: All rollouts of the model's predecessors.
        selections: Those of which some are kept, and which.
        corrections: What an operator has made of others.
    """

    rollouts: tuple[ArtifactRef, ...] = ()
    selections: tuple[tuple[ArtifactRef, ArtifactRef], ...] = ()
    corrections: tuple[ArtifactRef, ...] = ()

    @property
    def learned(self) -> tuple[tuple[ArtifactRef, ...], ...]:
        """Episodes, each with the selection of it if there is one."""
        return (*((ref,) for ref in self.corrections), *self.selections)


@dataclass(frozen=True)
class _Data:
    """What a model is trained on in the end.

    Attributes:
        loop: The loop of its task.
        session: Session of the last turn of collect, select, train.
        demonstrations: What it begins with.
        corrective: Corrective episodes grown from these, if there are any.
        gained: What its predecessors have brought.
        findings: Why there is no more of it.
        start: The model that its training goes on from; none if it starts from nothing.
    """

    loop: LoopConfig
    session: Session
    demonstrations: ArtifactRef
    corrective: tuple[ArtifactRef, ...] = ()
    gained: _Gained = _Gained()
    findings: tuple[str, ...] = ()
    start: ArtifactRef | None = None

    @property
    def learned(self) -> tuple[tuple[ArtifactRef, ...], ...]:
        """Episodes, each with the selection of it if there is one."""
        return (*((ref,) for ref in (self.demonstrations, *self.corrective)), *self.gained.learned)


def run_model(session: Session, config: RunConfig, name: str, seed: int) -> ModelOutcome:
    """Train and evaluate the model of a condition and seed; whatever is in the store is reused.

    A model that finds nothing to retrain on is evaluated as it is: a condition's average must not leave out its worst.
    """
    condition, loop = config.method(name), config.loop(name)
    findings: list[str] = []
    if condition.replay:
        demonstrations = get_demonstrations(session, loop)
        checkpoint = memorise(session, episodes=demonstrations, config=MemoriseConfig())
    elif condition.joint_policy:
        checkpoint, findings = _train_jointly(session, loop, condition, seed)
    else:
        data = _gather(session, loop, condition, seed)
        session = data.session
        training = loop.training(condition, seed, goes_on=data.start is not None)
        checkpoint = _train(session, loop, training, [data], data.start)
        findings = [*data.findings, *_findings(session, checkpoint)]
    evaluation = measure(session, checkpoint, loop.evaluation, config.evaluate.stop)
    findings += _findings(session, evaluation)
    observes = _observes(session, evaluation)
    title = condition.title if observes in ("", STATE) else f"{condition.title} ({observes})"
    return ModelOutcome(
        condition=name,
        title=title,
        seed=seed,
        checkpoint=checkpoint,
        evaluation=evaluation,
        findings=tuple(findings),
        observes=observes,
        setting=condition.setting_in_words,
        method=condition.method,
        analyses=_analyses(session, config, name, seed, checkpoint),
        shifted=_evaluate_shifted(session, config, name, checkpoint),
    )


def _analyses(
    session: Session, config: RunConfig, name: str, seed: int, checkpoint: ArtifactRef
) -> dict[str, ArtifactRef]:
    """What is asked of this model; there are no samples to analyse of one that always predicts the same."""
    condition, loop = config.method(name), config.loop(name)
    if condition.replay or not loop.final_training(condition, seed).policy.draws_samples:
        return {}
    get = partial(get_demonstrations, session, loop)
    return {
        key: analyse(session, loop, checkpoint, analysis, get)
        for key, analysis in loop.analyses.items()
        if analysis.concerns(name, is_first_seed=seed == config.first_seed)
    }


def _evaluate_shifted(
    session: Session, config: RunConfig, name: str, checkpoint: ArtifactRef
) -> dict[str, ArtifactRef | None]:
    """How a model does under each shift that it can notice, if it is asked."""
    condition, loop = config.method(name), config.loop(name)
    sees_images = not condition.replay and bool(loop.final_training(condition, seed=0).policy.views_seen)
    return {
        key: evaluate(
            session.for_model(f"{session.label} under {key}", session.record),
            checkpoint=checkpoint,
            config=loop.evaluation_under(shift),
        )
        if shift.can_be_noticed(sees_images=sees_images)
        else None
        for key, shift in config.shifts_of(name).items()
    }


def evaluate_further(session: Session, config: RunConfig, model: ModelOutcome) -> ModelOutcome:
    """The same model, evaluated on one more block of initial states; what the blocks before it said is replaced."""
    measured = config.loop(model.condition).evaluation
    evaluation = measure(session, model.checkpoint, measured, config.evaluate.stop, model.evaluation)
    superseded = _findings(session, model.evaluation)
    kept = (finding for finding in model.findings if finding not in superseded)
    return replace(model, evaluation=evaluation, findings=(*kept, *_findings(session, evaluation)))


def _train_jointly(
    session: Session, config: LoopConfig, condition: Condition, seed: int
) -> tuple[ArtifactRef, list[str]]:
    """One model for several tasks, and what it had to do without; it can do without the successes of one."""
    # The curves of those that it learns from stand apart by task once it is published; live they would run together.
    gathered = {
        task: _gather(session.for_model(f"{session.label} {task}", NoRecord()), loop, condition, seed)
        for task, loop in config.mix.items()
    }
    session = session.for_model(session.label, session.record.for_round(config.turns(condition)))
    # It is one model, whichever task's run asks for it.
    first = next(iter(config.mix.values()))
    checkpoint = _train(session, first, config.final_training(condition, seed), tuple(gathered.values()))
    findings = [f"{task}: {finding}" for task, data in gathered.items() for finding in data.findings]
    return checkpoint, [*findings, *_findings(session, checkpoint)]


def _train(
    session: Session,
    config: LoopConfig,
    training: TrainConfig,
    gathered: Collection[_Data],
    start: ArtifactRef | None = None,
) -> ArtifactRef:
    """A model trained on all that was gathered, and on the images that it looks at; it may go on from another."""
    policy = training.policy
    fixed = [[(part, _estimators(data, part)) for part in policy.fixed_parts] for data in gathered]
    # Whole episodes first, then those of which a selection is kept; the split into families goes by this order.
    learned = sorted(
        ((own, each) for own, data in zip(fixed, gathered, strict=True) for each in data.learned),
        key=lambda pair: len(pair[1]),
    )
    mixed = dataset(
        session,
        episodes=tuple(episodes for _, (episodes, *_) in learned),
        selections=tuple(selection for _, (_, *selections) in learned for selection in selections),
        columns=tuple(column for own, each in learned for column in _columns(session, policy, own, *each)),
        config=config.dataset,
    )
    estimators = tuple(ref for own in fixed for _, refs in own for ref in refs)
    return train(session, dataset=mixed, estimators=estimators, start=start, config=training)


def _columns(
    session: Session, policy: PolicyConfig, fixed: Sequence[_Fixed], episodes: ArtifactRef, *selections: ArtifactRef
) -> Iterator[ArtifactRef]:
    """What a policy learns from beside the arrays of the episodes: images, and what is read off such."""
    for view in policy.learned_views:
        yield render(session, episodes=episodes, selections=selections, config=RenderConfig(view=view))
    for part, estimators in fixed:
        config = EncodeConfig(encoder=part)
        yield encode(session, episodes=episodes, selections=selections, estimators=estimators, config=config)


def _gather(session: Session, config: LoopConfig, condition: Condition, seed: int) -> _Data:
    """Data of one task: demonstrations, corrective episodes, and what models trained on these achieve themselves."""
    demonstrations = get_demonstrations(session, config)
    data = _data(session, config, demonstrations, config.augment if condition.augment else None)
    noted: tuple[str, ...] = ()
    for turn in range(1, config.turns(condition) + 1):
        training = config.training(condition, seed, goes_on=data.start is not None)
        checkpoint = _train(data.session, config, training, [data], data.start)
        session = session.for_round(turn)
        rollouts = collect(session, checkpoint=checkpoint, config=config.collection(seed, turn))
        gained, findings = _gain(session, config, condition, data.gained, rollouts)
        noted += (*(f"round {turn}: {finding}" for finding in _findings(session, rollouts)), *findings)
        if gained.learned == data.gained.learned:
            break
        augmentation = (config.augment_retraining or config.augment) if condition.augment else None
        data = _data(session, config, demonstrations, augmentation, gained)
        data = replace(data, start=checkpoint if condition.retraining_steps else None)
    return replace(data, findings=(*data.findings, *noted))


def _gain(
    session: Session, config: LoopConfig, condition: Condition, gained: _Gained, rollouts: ArtifactRef
) -> tuple[_Gained, tuple[str, ...]]:
    """What there is with a turn's rollouts, and why they brought less than they should."""
    gained = replace(gained, rollouts=(*gained.rollouts, rollouts))
    selection = select(session, episodes=rollouts, config=config.select)
    findings = _findings(session, selection)
    if not findings:
        gained = replace(gained, selections=(*gained.selections, (rollouts, selection)))
    if condition.correct:
        corrections = correct(session, episodes=rollouts, config=config.correction)
        if none := _findings(session, corrections):
            findings += none
        else:
            gained = replace(gained, corrections=(*gained.corrections, corrections))
    return gained, findings


def _findings(session: Session, ref: ArtifactRef) -> tuple[str, ...]:
    """Why an artifact holds nothing, or less than it seems to, if it says so.

    An artifact that is not made yet, in a run in thought, is assumed to hold what is expected of it.
    """
    try:
        finding = session.store.manifest(ref).finding
    except ArtifactNotFound:
        return ()
    return (finding,) if finding else ()


def _observes(session: Session, evaluation: ArtifactRef) -> str:
    """What the policy saw; empty in a run in thought."""
    try:
        return session.store.manifest(evaluation).observes
    except ArtifactNotFound:
        return ""


def get_demonstrations(session: Session, config: LoopConfig) -> ArtifactRef:
    """Demonstrations from a human's logs if there are any, else from the scripted operator.

    All models of a run learn from the logs that were there when it began: people may go on recording.
    """
    if config.logs is not None:
        if config.logs not in session.listed:
            session.listed.setdefault(config.logs, find_logs(config.logs))
        return ingest(session, files=session.listed[config.logs], config=config.ingestion)
    logs = record(session, config=config.recording)
    return ingest(session, logs=logs, config=config.ingestion)


def find_logs(folder: Path) -> tuple[Path, ...]:
    """Everything in a folder that is named like an operator log, by name; ingestion says which of it is one.

    Raises:
        ConfigError: If there is no such folder, it cannot be read, or nothing in it is named so.
    """
    shown = printable(folder)
    try:
        paths = sorted(folder.iterdir())
    except (FileNotFoundError, NotADirectoryError):
        raise ConfigError(f"logs: folder '{shown}' does not exist") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it has an impossible name"
        raise ConfigError(f"logs: folder '{shown}' cannot be read: {reason}") from None
    logs = tuple(path for path in paths if path.suffix.lower() == SUFFIX)
    if not logs:
        raise ConfigError(f"logs: folder '{shown}' holds no operator log (*{SUFFIX})")
    return logs


def _data(
    session: Session,
    config: LoopConfig,
    demonstrations: ArtifactRef,
    augmentation: AugmentConfig | None,
    gained: _Gained = _Gained(),
) -> _Data:
    """Demonstrations, what models have brought, and corrective episodes if any are wanted and found."""
    data = _Data(config, session, demonstrations, gained=gained)
    if augmentation is None:
        return data
    annotations = annotations_of(session, config, demonstrations)
    # Drawn uniformly they are the same in every turn.
    rollouts = () if isinstance(augmentation.placement, UniformPlacement) else gained.rollouts
    corrective = augment(
        session, episodes=demonstrations, annotations=annotations, rollouts=rollouts, config=augmentation
    )
    findings = _findings(session, corrective)
    return replace(data, corrective=() if findings else (corrective,), findings=findings)


def _estimators(data: _Data, encoder: EncoderConfig) -> tuple[ArtifactRef, ...]:
    """What an encoder that estimates poses has to learn beforehand; the same for every condition and seed."""
    if not isinstance(encoder, EstimatedConfig):
        return ()
    session, loop, demonstrations = data.session, data.loop, data.demonstrations
    annotations = annotations_of(session, loop, demonstrations)
    config = EstimateConfig(encoder=encoder)
    return (estimate(session, episodes=demonstrations, annotations=annotations, config=config),)
