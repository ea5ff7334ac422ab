"""The loop for one model: demonstrations in, an evaluated policy out. Reads like the diagram in the README."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from flows.conditions import Condition
from flows.config import RunConfig
from flows.loop_config import LoopConfig
from juicer.artifacts.manifest import STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.demonstration.log import SUFFIX
from juicer.errors import ArtifactNotFound, ConfigError
from juicer.policy.config import PolicyConfig
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.text import printable
from juicer.views import View
from stages.annotate import annotate
from stages.augment import AugmentConfig, augment
from stages.collect import collect
from stages.dataset import dataset
from stages.encode import EncodeConfig, encode
from stages.estimate import EstimateConfig, estimate
from stages.evaluate import evaluate
from stages.ingest import ingest
from stages.memorise import MemoriseConfig, memorise
from stages.record import record
from stages.render import RenderConfig, render
from stages.runtime.session import Session
from stages.select import select
from stages.train import TrainConfig, train


@dataclass(frozen=True)
class ModelOutcome:
    """What became of one model.

    Attributes:
        condition: Name of its condition.
        title: What people read instead; if the policy does not see states, it says what it sees.
        seed: Its seed.
        checkpoint: The last one trained.
        evaluation: How it did.
        finding: Why it learned from less than it should, as a sentence.
        observes: What it sees, and what it was taught with beside; empty if that is not known.
        setting: What its condition changes in the configuration, in words; empty if nothing.
    """

    condition: str
    title: str
    seed: int
    checkpoint: ArtifactRef
    evaluation: ArtifactRef
    finding: str = ""
    observes: str = ""
    setting: str = ""


_Selected = tuple[ArtifactRef, ArtifactRef]
"""Rollouts, and a selection of them."""


@dataclass(frozen=True)
class _Data:
    """What a model is trained on in the end.

    Attributes:
        loop: The loop of its task.
        session: Session of the last turn of collect, select, train.
        demonstrations: What it begins with.
        episodes: These and corrective episodes.
        selections: Rollouts of the model's predecessors, and which of them are kept.
        findings: Why there are no more of these.
    """

    loop: LoopConfig
    session: Session
    demonstrations: ArtifactRef
    episodes: tuple[ArtifactRef, ...]
    selections: tuple[_Selected, ...] = ()
    findings: tuple[str, ...] = ()


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
        checkpoint = _train(session, loop, loop.final_training(condition, seed), [data])
        findings = [*data.findings, *_findings(session, checkpoint)]
    evaluation = evaluate(session, checkpoint=checkpoint, config=loop.evaluation)
    findings += _findings(session, evaluation)
    observes = _observes(session, evaluation)
    title = condition.title if observes in ("", STATE) else f"{condition.title} ({observes})"
    return ModelOutcome(
        name, title, seed, checkpoint, evaluation, "; ".join(findings), observes, setting=condition.setting
    )


def _train_jointly(
    session: Session, config: LoopConfig, condition: Condition, seed: int
) -> tuple[ArtifactRef, list[str]]:
    """One model for several tasks, and what it had to do without; it can do without the successes of one."""
    gathered = {
        task: _gather(session.for_model(f"{session.label} {task}", session.record), loop, condition, seed)
        for task, loop in config.mix.items()
    }
    # It is one model, whichever task's run asks for it.
    first = next(iter(config.mix.values()))
    checkpoint = _train(session, first, config.final_training(condition, seed), gathered.values())
    findings = [f"{task}: {finding}" for task, data in gathered.items() for finding in data.findings]
    return checkpoint, [*findings, *_findings(session, checkpoint)]


def _train(session: Session, config: LoopConfig, training: TrainConfig, gathered: Iterable[_Data]) -> ArtifactRef:
    """A model trained on all that was gathered, and on the images that it looks at."""
    gathered = tuple(gathered)
    selected = [each for data in gathered for each in data.selections]
    learned = [*((ref,) for data in gathered for ref in data.episodes), *selected]
    mixed = dataset(
        session,
        episodes=tuple(episodes for episodes, *_ in learned),
        selections=tuple(selection for _, selection in selected),
        columns=tuple(column for each in learned for column in _columns(session, training.policy, *each)),
        config=config.dataset,
    )
    estimators = tuple(ref for data in gathered for ref in _estimators(data, training.policy))
    return train(session, dataset=mixed, estimators=estimators, config=training)


def _columns(
    session: Session, policy: PolicyConfig, episodes: ArtifactRef, *selections: ArtifactRef
) -> Iterator[ArtifactRef]:
    """What a policy learns from beside the arrays of the episodes: images, and features of such."""

    def images(views: Iterable[View]) -> tuple[ArtifactRef, ...]:
        return tuple(
            render(session, episodes=episodes, selections=selections, config=RenderConfig(view=view)) for view in views
        )

    yield from images(policy.learned_views)
    for part in policy.fixed_parts:
        yield encode(session, episodes=episodes, images=images(part.views_seen), config=EncodeConfig(encoder=part))


def _gather(session: Session, config: LoopConfig, condition: Condition, seed: int) -> _Data:
    """Data of one task: demonstrations, corrective episodes, and what models trained on these achieve themselves."""
    training = config.training(condition, seed)
    demonstrations = get_demonstrations(session, config)
    data = _data(session, config, demonstrations, config.augment if condition.augment else None)
    for turn in range(1, config.turns(condition) + 1):
        checkpoint = _train(data.session, config, training, [data])
        session = session.for_round(turn)
        rollouts = collect(session, checkpoint=checkpoint, config=config.collection(seed, turn))
        selection = select(session, episodes=rollouts, config=config.select)
        if finding := _findings(session, selection):
            return replace(data, findings=(*data.findings, *finding))
        augmentation = (config.augment_retraining or config.augment) if condition.augment else None
        data = _data(session, config, demonstrations, augmentation, (*data.selections, (rollouts, selection)))
    return data


def _findings(session: Session, ref: ArtifactRef) -> tuple[str, ...]:
    """What an artifact says of its own emptiness, if anything.

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
    """Demonstrations from a human's logs if there are any, else from the scripted operator."""
    if config.logs is not None:
        return ingest(session, files=find_logs(config.logs), config=config.ingestion)
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
    selections: tuple[_Selected, ...] = (),
) -> _Data:
    """Demonstrations, what models have achieved themselves, and corrective episodes if any are wanted and found."""
    if augmentation is None:
        return _Data(config, session, demonstrations, (demonstrations,), selections)
    annotations = annotate(session, episodes=demonstrations, labels=config.labels, config=config.annotate)
    corrective = augment(session, episodes=demonstrations, annotations=annotations, config=augmentation)
    if findings := _findings(session, corrective):
        return _Data(config, session, demonstrations, (demonstrations,), selections, findings)
    return _Data(config, session, demonstrations, (demonstrations, corrective), selections)


def _estimators(data: _Data, policy: PolicyConfig) -> Iterator[ArtifactRef]:
    """What a policy that estimates poses has to know before it is trained; the same for every condition and seed."""
    for encoder in policy.observation.values():
        if isinstance(encoder, EstimatedConfig):
            session, loop, demonstrations = data.session, data.loop, data.demonstrations
            annotations = annotate(session, episodes=demonstrations, labels=loop.labels, config=loop.annotate)
            config = EstimateConfig(encoder=encoder)
            yield estimate(session, episodes=demonstrations, annotations=annotations, config=config)
