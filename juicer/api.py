"""The front door for Python: ``from juicer import api``.

Look into a store, take episodes, evaluations and policies out of it, make environments, and measure a policy of
one's own as ours are measured. Nothing heavy is imported before it is used.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from juicer.errors import ArtifactError, ArtifactNotFound, ConfigError, WrongArtifactKind, did_you_mean
from juicer.text import printable

if TYPE_CHECKING:
    import pandas as pd

    from juicer.artifacts.store import ArtifactStore
    from juicer.episode import ArraySpec, Episode
    from juicer.rollout import Policy, Reaction
    from juicer.sim.env import AssemblyEnv
    from juicer.storage.episodes import EpisodeReader
    from juicer.storage.evaluations import EvaluationRow


@dataclass(frozen=True)
class Evaluation:
    """How a policy did.

    Attributes:
        task: Assembly task.
        randomness: Level of the initial states.
        rows: How each episode ended, in the order of the initial states.
    """

    task: str
    randomness: str
    rows: tuple[EvaluationRow, ...]

    @property
    def successes(self) -> int:
        """Episodes in which everything was assembled."""
        return self.outcomes.get("success", 0)

    @property
    def rate(self) -> float:
        """Share of successes."""
        return self.successes / len(self.rows)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the rate."""
        from juicer.evaluation import wilson_interval

        return wilson_interval(self.successes, len(self.rows))

    @property
    def outcomes(self) -> dict[str, int]:
        """Episodes by how they ended."""
        return dict(Counter(row.outcome.value for row in self.rows))

    @property
    def table(self) -> pd.DataFrame:
        """A row an episode."""
        from juicer.storage.evaluations import EvaluationRow
        from juicer.storage.frames import frame_of

        return frame_of(self.rows, EvaluationRow)

    def __str__(self) -> str:
        """The rate in a sentence, with all that belongs to it."""
        low, high = self.interval
        share = f"{self.successes} of {len(self.rows)} episodes of {self.task} ({self.randomness}) succeeded"
        return f"{share}: {self.rate:.1%} (95 % interval {low:.1%} to {high:.1%})"


def open_store(place: str | Path = "data") -> ArtifactStore:
    """The artifact store in a folder, or at an fsspec URL. Its ``list(kind)`` describes what it holds.

    Raises:
        ArtifactNotFound: If there is no such folder.
    """
    from juicer.artifacts.store import ArtifactStore

    if "://" not in str(place) and not Path(place).expanduser().is_dir():
        raise ArtifactNotFound(f"there is no artifact store in '{place}': it is no folder")
    return ArtifactStore(place)


def load_episodes(store: ArtifactStore, id: str, columns: Iterable[str] = ()) -> EpisodeReader:
    """Episodes of an artifact: ``records``, ``read(number)``, and all steps of an array with ``steps(name)``.

    Args:
        store: Where it is kept.
        id: Its id, or as much of it as is unique.
        columns: Ids of artifacts with columns of these episodes, which are read as if they were their own arrays.

    Raises:
        ArtifactError: If there is no such artifact, it is damaged, or columns are of other episodes.
    """
    from juicer.storage.episodes import EpisodeReader

    joined = [store.open(store.resolve(each, "columns")) for each in columns]
    return EpisodeReader(store.open(store.resolve(id, "episodes")), joined)


def load_evaluation(store: ArtifactStore, id: str) -> Evaluation:
    """What an evaluation found, see :func:`load_episodes`.

    Raises:
        ArtifactError: If there is no such artifact, or it is damaged.
    """
    from juicer.storage.evaluations import read_evaluation

    ref = store.resolve(id, "evaluation")
    rows = tuple(read_evaluation(store.open(ref)))
    config = store.manifest(ref).recipe.config
    if not rows or not {"task", "randomness"} <= set(config):
        raise ArtifactError(f"{ref} does not say which task was evaluated; it is of another version of juicer")
    return Evaluation(str(config["task"]), str(config["randomness"]), rows)


def load_table(store: ArtifactStore, id: str) -> pd.DataFrame:
    """Annotations, a selection, a dataset, an evaluation, or the facts about episodes, as a table.

    See :func:`load_episodes` for how an artifact is named.

    Raises:
        WrongArtifactKind: If the artifact holds no table.
        ArtifactError: If there is no such artifact, or it is damaged.
    """
    from juicer.episode import EpisodeRecord
    from juicer.storage import annotations, dataset, evaluations, selections
    from juicer.storage.frames import frame_of

    ref = store.resolve(id)
    if ref.kind == "episodes":
        reader = load_episodes(store, ref.id)
        return frame_of(reader.records, EpisodeRecord, length=reader.lengths.tolist())
    if ref.kind == "annotations":
        return frame_of(annotations.read_annotations(store.open(ref)), annotations.Annotation)
    if ref.kind == "selection":
        return frame_of(selections.read_selection(store.open(ref)), selections.SelectionRow)
    if ref.kind == "dataset":
        return frame_of(dataset.read_dataset(store.open(ref)), dataset.DatasetRow)
    if ref.kind == "evaluation":
        return frame_of(evaluations.read_evaluation(store.open(ref)), evaluations.EvaluationRow)
    raise WrongArtifactKind(f"{ref} holds no table; episodes, annotations, selections, datasets and evaluations do")


def load_recordings(store: ArtifactStore, id: str) -> pd.DataFrame:
    """What became of each operator log behind demonstrations, a row a log, see :func:`load_episodes`.

    Raises:
        ArtifactError: If there is no such artifact, it is damaged, or was not made of logs.
    """
    from juicer.storage.frames import frame_of
    from juicer.storage.recordings import Recording, read_recordings

    return frame_of(read_recordings(store.open(store.resolve(id, "episodes"))), Recording)


def load_policy(store: ArtifactStore, id: str, task: str, device: str = "cpu") -> Policy:
    """Policy of a checkpoint, ready to act on a task; see :func:`load_episodes`.

    Raises:
        JuicerError: If it is not there or damaged, was not trained for the task, or torch lacks the device.
    """
    from juicer.policy.checkpoint import load_policy

    return load_policy(store.open(store.resolve(id, "checkpoint")), task, device=device)


def make(task: str = "one_leg", **settings: Any) -> AssemblyEnv:
    """Gymnasium environment of a task; the settings are those of :class:`juicer.sim.env.AssemblyEnv`.

    Raises:
        ConfigError: If the task or a setting is unknown.
    """
    from juicer.sim.env import AssemblyEnv

    return AssemblyEnv(task, **settings)


def state(name: str) -> ArraySpec:
    """What a policy of one's own names in ``observations`` to see ``proprioception`` or ``part_poses``.

    Raises:
        ConfigError: If there is no such observation.
    """
    from juicer.observer import STATE_OBSERVATIONS

    known = {spec.name: spec for spec in STATE_OBSERVATIONS}
    if name not in known:
        raise ConfigError(f"unknown observation '{printable(name)}'{did_you_mean(str(name), known)}")
    return known[name]


def image(camera: str, width: int, height: int) -> ArraySpec:
    """The same to see the image ``(height, width, 3)`` of a camera, ``front`` or ``wrist``.

    Raises:
        ConfigError: If there is no such camera, or no such size.
    """
    from juicer.observer import image

    return image(camera, width, height)


def rollout(
    policy: Policy | Reaction,
    task: str,
    seeds: Iterable[int],
    *,
    randomness: str = "low",
    num_envs: int = 8,
    max_steps: int | None = None,
    root_seed: int = 0,
) -> Iterator[Episode]:
    """Let a policy act from initial states of one's choice; see :func:`juicer.rollout.rollout`.

    Args:
        policy: What acts. Its ``observations``, made by :func:`state` and :func:`image`, say what it is shown: the
            whole state if it has none. A plain function is shown one observation at a time, ``(D,)`` an array, and
            gives one action ``(10,)``; it may depend on nothing but its argument, as the episodes take turns.
        task: Assembly task.
        seeds: Initial-state seeds.
        randomness: Level of the initial states.
        num_envs: Environments that run side by side; they shape no result.
        max_steps: Steps after which an episode ends; the task's own limit if None.
        root_seed: Root of the policy's noise.

    Raises:
        InvalidAction: If the policy's actions have a wrong shape, are not finite, or are out of range.
        PolicyFailed: If the policy is none, or raises anything.
        ConfigError: If a name or a number is wrong.
    """
    from juicer.rollout import as_policy, rollout

    acting = as_policy(policy)
    return rollout(acting, task, randomness, seeds, num_envs=num_envs, max_steps=max_steps, root_seed=root_seed)


def evaluate(
    policy: Policy | Reaction,
    task: str,
    *,
    episodes: int = 100,
    randomness: str = "low",
    first: int = 0,
    num_envs: int = 8,
    max_steps: int | None = None,
) -> Evaluation:
    """Success rate of a policy on the initial states on which ``juicer evaluate`` measures, and nothing else is done.

    Args:
        policy: See :func:`rollout`.
        task: Assembly task.
        episodes: How many.
        randomness: Level of the initial states.
        first: Position of the first initial state among those for evaluations.
        num_envs: Environments that run side by side; they shape no result.
        max_steps: Steps after which an episode ends; the task's own limit if None.

    Raises:
        JuicerError: See :func:`rollout`.
    """
    from juicer.seed_ranges import Purpose, claim
    from juicer.sim.arguments import checked_count
    from juicer.storage.evaluations import EvaluationRow

    seeds = claim(Purpose.EVALUATION, checked_count("first", first, 0), checked_count("episodes", episodes))
    runs = rollout(policy, task, seeds, randomness=randomness, num_envs=num_envs, max_steps=max_steps)
    return Evaluation(task, str(randomness), tuple(EvaluationRow.of(index, run) for index, run in enumerate(runs)))
