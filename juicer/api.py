"""The front door for Python: ``from juicer import api``.

Look into a store, take episodes, evaluations and policies out of it, make environments, and measure a policy of
one's own as ours are measured. Nothing heavy is imported before it is used, no environment variable is read, and
every mistake raises a :class:`juicer.errors.JuicerError`.

An artifact is named by its id, by as much of the beginning of it as is unique, or by the name of its model,
``study/task/condition/seed-0``; see :func:`find`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from juicer.errors import ArtifactNotFound, ConfigError, did_you_mean
from juicer.library.measured import Evaluation
from juicer.text import printable

if TYPE_CHECKING:
    import pandas as pd

    from juicer.artifacts.ref import ArtifactRef
    from juicer.artifacts.store import ArtifactStore
    from juicer.episode import ArraySpec, Episode
    from juicer.evaluation import PairedComparison
    from juicer.imaging.video import Image
    from juicer.library.episodes import Episodes
    from juicer.rollout import Policy, Reaction
    from juicer.sim.env import AssemblyEnv

_SETTINGS = ("randomness", "render_mode", "max_steps", "shift")


def open_store(place: str | Path = "data") -> ArtifactStore:
    """The artifact store in a folder, or at an fsspec URL such as ``s3://bucket/prefix``.

    Raises:
        ArtifactNotFound: If there is no such folder.
        ConfigError: If the place is neither a text nor a path.
    """
    from juicer.artifacts.store import ArtifactStore

    if not isinstance(place, str | Path) or not str(place).strip():
        raise ConfigError(f"a store is opened by the path of a folder or a URL, not by {place!r}")
    try:
        if "://" in str(place) or Path(place).expanduser().is_dir():
            return ArtifactStore(place)
        missing = "folder"
    except RuntimeError:  # the home of a user who does not exist
        missing = "user"
    raise ArtifactNotFound(f"there is no artifact store in '{printable(place)}': there is no such {missing}")


def artifacts(store: ArtifactStore, kind: str | None = None) -> pd.DataFrame:
    """Every artifact, oldest first, by its id: kind, name, stage, time and size; with a kind, the facts of each, too.

    Raises:
        ConfigError: If there is no such kind.
    """
    from juicer.library.tables import artifact_table

    return artifact_table(store, kind)


def models(store: ArtifactStore) -> pd.DataFrame:
    """Every model that a report in the store names, by its name: what it is, what it achieved, and its artifacts."""
    from juicer.library.tables import model_table

    return model_table(store)


def find(store: ArtifactStore, name: str, *kinds: str) -> ArtifactRef:
    """The one artifact that an id, the beginning of an id, ``kind/id`` or the name of a model means.

    A model's name is ``study/task/condition/seed-0``. Every part may be left out that is not needed to tell the models
    apart; if several reports name one, the newest counts. A model has an evaluation, a checkpoint and a report: which
    of them is meant is decided by ``kinds``, the evaluation if there are none.

    Raises:
        ArtifactError: If nothing or several things answer to the name, or it is of another kind.
    """
    from juicer.library import names

    return names.find(store, name, *kinds)


def lineage(store: ArtifactStore, name: str) -> pd.DataFrame:
    """An artifact and everything it was made from, by id, parents first.

    Raises:
        ArtifactError: See :func:`find`.
    """
    from juicer.library.tables import lineage_table

    return lineage_table(store, find(store, name))


def load_episodes(store: ArtifactStore, name: str, columns: Iterable[str] = ()) -> Episodes:
    """Episodes of an artifact; of an evaluation, the few that it keeps.

    ``episodes.table`` has a row an episode, ``episodes[0]`` or ``episodes["id"]`` is one of them, and
    ``episodes.steps("action")`` has all steps of all episodes, which end at ``episodes.episode_ends``.

    Args:
        store: Where they are kept.
        name: Of the artifact, see :func:`find`.
        columns: Ids of artifacts with columns of these episodes, which are read as if they were their own arrays.

    Raises:
        ArtifactError: See :func:`find`; or if the artifact is damaged, or columns are of other episodes.
    """
    from juicer.library.episodes import Episodes
    from juicer.storage.evaluations import EXAMPLES

    ref = find(store, name, "episodes", "evaluation")
    folder = store.open(ref)
    joined = [store.open(find(store, each, "columns")) for each in columns]
    return Episodes(folder / EXAMPLES if ref.kind == "evaluation" else folder, joined)


def step_table(episode: Episode) -> pd.DataFrame:
    """A row a step of an episode; ``table["action"]`` has a column for each number of an action.

    Simulator states and images are left out.
    """
    from juicer.library import tables

    return tables.step_table(episode)


def load_table(store: ArtifactStore, name: str) -> pd.DataFrame:
    """Rows of an artifact: the facts about episodes, annotations, a selection, a dataset, or an evaluation.

    Raises:
        ArtifactError: See :func:`load_episodes`.
    """
    from juicer.library.tables import row_table

    ref = find(store, name, "evaluation", "episodes", "annotations", "selection", "dataset")
    if ref.kind in ("annotations", "selection", "dataset"):
        return row_table(store, ref)
    return load_episodes(store, str(ref)).table if ref.kind == "episodes" else load_evaluation(store, str(ref)).table


def load_recordings(store: ArtifactStore, name: str) -> pd.DataFrame:
    """What became of each operator log behind demonstrations, a row a log.

    Raises:
        ArtifactError: See :func:`load_episodes`; or if the episodes were not made of logs.
    """
    from juicer.storage.frames import frame_of
    from juicer.storage.recordings import Recording, read_recordings

    return frame_of(read_recordings(store.open(find(store, name, "episodes"))), Recording)


def load_evaluation(store: ArtifactStore, name: str) -> Evaluation:
    """What an evaluation found.

    Raises:
        ArtifactError: See :func:`load_episodes`.
    """
    return Evaluation.load(store, find(store, name, "evaluation"), name)


def load_curves(store: ArtifactStore, name: str) -> pd.DataFrame:
    """Training curves of a checkpoint, a row a step and a column a curve; empty if nothing was trained.

    Raises:
        ArtifactError: See :func:`load_episodes`.
    """
    from juicer.library.tables import curve_table
    from juicer.storage.curves import read_curves

    return curve_table(read_curves(store.open(find(store, name, "checkpoint"))))


def load_policy(
    store: ArtifactStore, name: str, task: str | None = None, device: str = "cpu", max_steps: int | None = None
) -> Policy:
    """Policy of a checkpoint, ready to act.

    Args:
        store: Where it is kept.
        name: See :func:`find`.
        task: Assembly task; may be left out if the policy was trained for one only.
        device: Torch device that computes the actions, e.g. ``cuda``.
        max_steps: Steps that its episodes may take, if more than the task's own limit: a replay, which never looks
            again, holds its last action that long, and would begin anew behind it. Others need not know.

    Raises:
        JuicerError: If it is not there or damaged, was not trained for the task, or torch lacks the device; or if
            ``max_steps`` is not a number of steps.
    """
    from juicer.library.policies import load_policy

    return load_policy(store, find(store, name, "checkpoint"), task, device, max_steps)


def tasks() -> pd.DataFrame:
    """Every assembly task: its Gymnasium id, size, critical states and milestones."""
    from juicer.library.tables import task_table

    return task_table()


def make(task: str = "one_leg", **settings: Any) -> AssemblyEnv:
    """Gymnasium environment of a task; the settings are those of :class:`juicer.sim.env.AssemblyEnv`.

    Raises:
        ConfigError: If the task or a setting is unknown.
    """
    from juicer.sim.env import AssemblyEnv

    for name in settings:
        if name not in _SETTINGS:
            raise ConfigError(f"an environment has no setting '{name}'{did_you_mean(name, _SETTINGS)}")
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


def initial_states(episodes: int = 100, first: int = 0) -> range:
    """Seeds of the initial states of evaluations: where ``juicer evaluate`` starts, and nothing else ever does.

    Args:
        episodes: How many.
        first: Position of the first among them.

    Raises:
        ConfigError: If there are not as many.
    """
    from juicer.seed_ranges import Purpose, claim
    from juicer.sim.arguments import checked_count

    return claim(Purpose.EVALUATION, checked_count("first", first, 0), checked_count("episodes", episodes))


def rollout(
    policy: Policy | Reaction,
    task: str,
    seeds: Iterable[int],
    *,
    randomness: str = "low",
    num_envs: int = 8,
    max_steps: int | None = None,
    root_seed: int = 0,
    shift: object = None,
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
        shift: In what the scenes differ from training: one of :mod:`juicer.shifts`, as ``"push"`` for its defaults or
            ``{"kind": "push", "force_n": 20.0}``.

    Raises:
        InvalidAction: If the policy's actions have a wrong shape, are not finite, or are out of range.
        PolicyFailed: If it is not a policy, or raises anything.
        ConfigError: If a name or a number is wrong.
    """
    from juicer.rollout import as_policy, rollout
    from juicer.sim.arguments import checked_count, shown

    acting, noise = as_policy(policy), checked_count("root_seed", root_seed, 0)
    if not isinstance(seeds, Iterable):
        raise ConfigError(f"seeds must be a sequence of initial-state seeds, such as [0, 1], got {shown(seeds)}")
    return rollout(
        acting, task, randomness, seeds, num_envs=num_envs, max_steps=max_steps, root_seed=noise, shift=shift
    )


def evaluate(
    policy: Policy | Reaction,
    task: str,
    *,
    episodes: int = 100,
    randomness: str = "low",
    first: int = 0,
    num_envs: int = 8,
    max_steps: int | None = None,
    root_seed: int = 0,
    shift: object = None,
) -> Evaluation:
    """Success rate of a policy on the initial states on which ``juicer evaluate`` measures, and nothing else is done.

    There are ``episodes`` of them, from the position ``first`` among the initial states for evaluations on; the other
    arguments are those of :func:`rollout`.

    Raises:
        JuicerError: See :func:`rollout`.
    """
    from juicer.library.policies import observed_by
    from juicer.shifts import parse_shift
    from juicer.storage.evaluations import EvaluationRow

    seeds, shift = initial_states(episodes, first), parse_shift(shift)
    runs = rollout(
        policy,
        task,
        seeds,
        randomness=randomness,
        num_envs=num_envs,
        max_steps=max_steps,
        root_seed=root_seed,
        shift=shift,
    )
    rows = tuple(EvaluationRow.of(index, run) for index, run in enumerate(runs))
    name = getattr(policy, "__name__", type(policy).__name__)
    return Evaluation(name, task, str(randomness), max_steps, rows, shift=shift, observes=observed_by(policy))


def compare(first: Evaluation, second: Evaluation) -> PairedComparison:
    """Two policies on the same initial states: McNemar's exact test over the states that both started from.

    Raises:
        ConfigError: If the evaluations are of different tasks, settings or initial states.
    """
    from juicer.library.measured import compare

    return compare(first, second)


def images(
    episode: Episode,
    steps: int | Iterable[int] = 6,
    *,
    camera: str | Sequence[str] = "front",
    width: int = 320,
    height: int = 240,
    captions: bool = True,
) -> list[Image]:
    """Images of an episode with simulator states, each ``(height, width, 3)`` of bytes.

    Args:
        episode: What is shown.
        steps: How many images, evenly spaced from the first step to the end; or which steps.
        camera: ``front`` or ``wrist``, or several of them side by side.
        width: Width of each camera's image [pixels].
        height: Its height [pixels].
        captions: Whether the step and the milestones reached stand above the image.

    Raises:
        JuicerError: If the episode has no simulator states, there is no such step or camera, or nothing can draw.
    """
    from juicer.library import drawing

    return drawing.images(episode, steps, drawing.video_format_of(camera, width, height), captions=captions)


def video(
    path: str | Path,
    episode: Episode,
    *,
    camera: str | Sequence[str] = ("front", "wrist"),
    width: int = 320,
    height: int = 240,
    speed: float = 1.0,
) -> Path:
    """Write a captioned video of an episode into an ``.mp4``, and give its path; ``speed`` in multiples of real time.

    Raises:
        JuicerError: See :func:`images`; or if the file cannot be written.
    """
    from juicer.library import drawing

    return drawing.video(Path(path), episode, drawing.video_format_of(camera, width, height), speed)
