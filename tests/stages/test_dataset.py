"""A dataset in the making: what its recipe names, and columns that a stage outside the package derives."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace

import numpy as np
import pytest

from juicer.artifacts.recipe import Recipe
from juicer.episode import Outcome, Role, Source
from juicer.errors import ArtifactError, ConfigError
from juicer.policy.config import FeatureSpec, PairSpec
from juicer.storage.columns import ColumnReader
from juicer.storage.dataset import grouped, read_dataset, write_dataset
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.training.mixing import DatasetConfig
from juicer.training.reading import read_episodes
from stages.dataset import dataset
from stages.select import SelectConfig, select
from stages.train import TrainConfig, train

SPEED = '''
"""A column from outside the package: how fast the end effector moves."""

from __future__ import annotations

import numpy as np

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import ArraySpec, Role
from juicer.storage.columns import write_columns
from juicer.storage.episodes import EpisodeReader
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

SPEED = ArraySpec("speed", (1,), "float32", Role.DERIVED)


class SpeedConfig(StrictConfig):
    unit_m_s: float = 1.0


@stage(kind="columns", inputs={"episodes": "episodes"}, libraries=("numpy",))
def speed(context: StageContext, *, episodes: ArtifactRef, config: SpeedConfig) -> None:
    """How fast the end effector moves."""
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    columns = (
        {"speed": np.linalg.norm(reader.read(index).steps["proprioception"][:, 9:12], axis=1, keepdims=True)}
        for index in range(len(reader))
    )
    write_columns(context.draft.path, [SPEED], columns, artifact=episodes.id, episode_ends=reader.episode_ends)
    context.draft.summary["episodes"] = len(reader)
'''
TASKS = {
    "one_leg": FeatureSpec(
        num_parts=5, pairs=(PairSpec(first=0, second=1, target=(0.0,) * 7),), mounted_m=0.005, mounted_cosine=0.94
    )
}


@pytest.fixture(scope="module")
def speed(tmp_path_factory):
    """The module with the stage."""
    folder = tmp_path_factory.mktemp("outside")
    (folder / "measures").mkdir()
    (folder / "measures" / "__init__.py").write_text("")
    (folder / "measures" / "speed.py").write_text(SPEED)
    sys.path.insert(0, str(folder))
    yield importlib.import_module("measures.speed")
    sys.path.remove(str(folder))


def stored(session, name, *episodes):
    recipe = Recipe("by hand", "episodes", config={"name": name})
    with session.store.create(recipe) as draft:
        write_episodes(draft.path, episodes, {})
    return recipe.ref


@pytest.fixture
def demonstrations(session, episode_factory):
    return stored(session, "demonstrations", *(moving(episode_factory(10 + seed, seed=seed)) for seed in range(3)))


def moving(episode):
    steps = dict(episode.steps)
    steps["proprioception"] = steps["proprioception"].copy()
    steps["proprioception"][:, 9:12] = np.random.default_rng(len(episode)).normal(size=(len(episode), 3))
    return replace(episode, steps=steps)


@pytest.fixture
def rollouts(session, episode_factory):
    failed = episode_factory(8, seed=10, source=Source.ROLLOUT, outcome=Outcome.TIMEOUT)
    return stored(session, "rollouts", episode_factory(9, seed=11, source=Source.ROLLOUT), failed)


def rows_of(session, ref):
    return read_dataset(session.store.open(ref, "dataset"))


def test_a_dataset_names_all_that_it_is_made_of(session, demonstrations, rollouts):
    selection = select(session, episodes=rollouts, config=SelectConfig())
    ref = dataset(session, episodes=(demonstrations, rollouts), selections=(selection,), config=DatasetConfig())
    manifest = session.store.manifest(ref)
    assert manifest.recipe.parents == (demonstrations, rollouts, selection)
    assert manifest.summary == {
        "episodes": 4,
        "steps": 10 + 11 + 12 + 9,
        "families": 4,
        "tasks": ["one_leg"],
        "sources": {"teleop": 3, "rollout": 1},
        "headline": "episodes 4, steps 42",
        "label": "4 episodes",
    }
    assert [row.episodes for row in rows_of(session, ref)] == [demonstrations.id] * 3 + [rollouts.id]


def test_a_selection_of_rollouts_that_are_not_given_is_refused(session, demonstrations, rollouts):
    selection = select(session, episodes=rollouts, config=SelectConfig())
    with pytest.raises(ArtifactError, match=r"a selection judges episode .*, which is in none of the episodes given"):
        dataset(session, episodes=(demonstrations,), selections=(selection,), config=DatasetConfig())


def test_a_column_of_a_stage_from_outside_is_learned_from(session, demonstrations, rollouts, speed):
    columns = speed.speed(session, episodes=demonstrations, config=speed.SpeedConfig())
    ref = dataset(session, episodes=(demonstrations, rollouts), columns=(columns,), config=DatasetConfig())
    first, second = grouped(rows_of(session, ref))
    assert {row.columns for row in first} == {(columns.id,)}
    assert {row.columns for row in second} == {()}
    reader = EpisodeReader(session.store.open(demonstrations), [session.store.open(columns)])
    assert reader.schema.names(Role.DERIVED) == ("speed",)
    chosen = [first[2], first[0]]
    read = read_episodes(reader, chosen, TASKS, ("proprioception", "part_poses", "speed"))
    velocities = read.observations["proprioception"][:, 9:12]
    np.testing.assert_allclose(read.observations["speed"][:, 0], np.linalg.norm(velocities, axis=1), rtol=1e-6)
    assert read.episode_ends.tolist() == [12, 22]
    # What a policy does not ask for is not read.
    assert "speed" not in read_episodes(reader, chosen, TASKS).observations


def test_columns_of_episodes_that_are_not_given_are_refused(session, demonstrations, rollouts, speed):
    columns = speed.speed(session, episodes=demonstrations, config=speed.SpeedConfig())
    with pytest.raises(
        ArtifactError, match=f"{columns} are columns of {demonstrations}, which is none of the episodes"
    ):
        dataset(session, episodes=(rollouts,), columns=(columns,), config=DatasetConfig())


def test_a_task_that_nobody_knows_is_refused_in_a_sentence(session, episode_factory):
    foreign = stored(session, "foreign", episode_factory(20, task="stack_cups"))
    ref = dataset(session, episodes=(foreign,), config=DatasetConfig())
    with pytest.raises(ConfigError, match="stack_cups"):
        train(session, dataset=ref, config=TrainConfig())


def test_an_episode_that_is_no_longer_where_the_dataset_says_is_named(session, demonstrations):
    ref = dataset(session, episodes=(demonstrations,), config=DatasetConfig())
    rows = [replace(row, episode_id="f" * 16) for row in rows_of(session, ref)[:1]]
    forged = Recipe("by hand", "dataset")
    with session.store.create(forged) as draft:
        write_dataset(draft.path, rows)
    with pytest.raises(ArtifactError, match="holds no episode ffffffffffffffff"):
        train(session, dataset=forged.ref, config=TrainConfig())
    session.store.set_aside(demonstrations)
    with pytest.raises(ArtifactError, match=f"artifact {demonstrations} does not exist"):
        train(session, dataset=ref, config=TrainConfig())


def test_columns_are_made_again_byte_for_byte(session, demonstrations, speed):
    first = speed.speed(session, episodes=demonstrations, config=speed.SpeedConfig())
    other = speed.speed(session, episodes=demonstrations, config=speed.SpeedConfig(unit_m_s=2))
    assert first != other
    assert session.store.manifest(first).files == session.store.manifest(other).files
    assert ColumnReader(session.store.open(first)).artifact == demonstrations.id
