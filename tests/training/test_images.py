"""Images of a training: unpacked in the order of its episodes, gathered by window, learned from exactly again."""

from __future__ import annotations

import dataclasses
import shutil
from typing import NamedTuple

import numpy as np
import pytest
import torch

from juicer.episode import Source
from juicer.errors import ArtifactError, StoreNotWritable, TrainingFailed
from juicer.policy.config import PolicyConfig
from juicer.policy.network import build_policy
from juicer.storage.columns import write_columns
from juicer.storage.dataset import DatasetRow
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.training import images as module
from juicer.training.images import Chosen, unpack_images
from juicer.training.state import training_identity
from juicer.training.table import WindowTable
from juicer.training.trainer import train
from juicer.training.windows import cut_windows
from juicer.views import View

VIEW = View(camera="wrist", width=24, height=16)
OTHER = View(camera="front", width=16, height=16)
LENGTHS = (30, 25, 40, 35, 20)


class Disk(NamedTuple):
    free: int


@pytest.fixture
def group_of(tmp_path, episode_factory):
    """Makes an artifact of episodes with random images, and says which episodes of it are chosen, in which order."""

    def make(identity, lengths, order):
        folder, columns = tmp_path / "episodes" / identity, tmp_path / "columns" / identity
        folder.mkdir(parents=True)
        columns.mkdir(parents=True)
        episodes = [episode_factory(length, seed=length) for length in lengths]
        write_episodes(folder, episodes, {})
        rng = np.random.default_rng(int(identity, 16) % 2**32)
        drawn = [{VIEW.name: rng.integers(0, 256, (length, 16, 24, 3), np.uint8)} for length in lengths]
        ends = np.cumsum(lengths)
        write_columns(columns, [VIEW.column], drawn, artifact=identity, episode_ends=ends)
        ids = [episode.record.episode_id for episode in episodes]
        rows = [DatasetRow(identity, ids[place], Source.TELEOP, "one_leg", "0", columns=(identity,)) for place in order]
        expected = [drawn[place][VIEW.name] for place in order]
        return Chosen(EpisodeReader(folder, [columns]), rows), expected

    return make


@pytest.mark.parametrize("read_bytes", [1, 10_000, 2**26])
def test_images_lie_in_the_order_of_the_chosen_episodes(group_of, tmp_path, monkeypatch, read_bytes):
    monkeypatch.setattr(module, "READ_BYTES", read_bytes)
    first, images = group_of("0123456789abcdef", (5, 9, 3, 4), (0, 1, 3))
    second, more = group_of("fedcba9876543210", (6, 2), (1, 0))
    unpacked = unpack_images([first, second], [VIEW.observed()], tmp_path / "scratch")
    np.testing.assert_array_equal(unpacked[VIEW.name], np.concatenate([*images, *more]))


def test_what_is_unpacked_is_used_again_and_what_a_kill_left_half_is_not(group_of, tmp_path, monkeypatch):
    group, images = group_of("0123456789abcdef", (5,), (0,))
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    draft = scratch / f"{VIEW.name}.draft"
    draft.write_bytes(b"half")
    asked = []
    monkeypatch.setattr(module, "require_room", lambda *_: asked.append(draft.exists()))
    unpacked = unpack_images([group], [VIEW.observed()], scratch)
    assert asked == [False], "its room is counted as taken"
    np.testing.assert_array_equal(unpacked[VIEW.name], images[0])
    assert not unpacked[VIEW.name].flags.writeable, "what is mapped to be changed counts as memory"
    monkeypatch.setattr(module, "_unpack", None)
    np.testing.assert_array_equal(unpack_images([group], [VIEW.observed()], scratch)[VIEW.name], images[0])


def test_a_disk_too_small_for_them_is_told_before(group_of, tmp_path, monkeypatch):
    group, _ = group_of("0123456789abcdef", (5,), (0,))
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Disk(0))
    with pytest.raises(StoreNotWritable, match=r"images of 5 steps, unpacked for the training, take about 0\.0 MB"):
        unpack_images([group], [VIEW.observed()], tmp_path / "scratch")


def test_a_view_without_images_is_called_by_its_name(group_of, tmp_path):
    group, _ = group_of("0123456789abcdef", (5,), (0,))
    with pytest.raises(ArtifactError, match=r"looks at front whole 16x16, and the dataset has no such images"):
        unpack_images([group], [VIEW.observed(), OTHER.observed()], tmp_path / "scratch")


@pytest.fixture
def looking(policy_config):
    """A tiny policy that looks at one view."""
    eyes = {"kind": "images", "views": {"wrist": VIEW}, "backbone": {"kind": "patch_cnn"}, "projection": 8}
    return PolicyConfig.model_validate({**policy_config.model_dump(), "observation": {"eyes": eyes}})


@pytest.fixture
def images():
    return {VIEW.name: np.random.default_rng(0).integers(0, 256, (sum(LENGTHS), 16, 24, 3), np.uint8)}


def seen(episodes, images):
    return dataclasses.replace(episodes, observations={**episodes.observations, **images})


def test_a_batch_holds_the_images_of_its_windows(episodes, tasks, looking, images):
    network = build_policy(looking, tasks, seed=0)
    data = seen(episodes(LENGTHS), images)
    windows = cut_windows(data.episode_ends, np.arange(5), looking.horizons, back_padding=7)
    table = WindowTable(data, windows, network, learn_padding=True, device=torch.device("cpu"))
    table.fit()
    table.normalize()
    rows = torch.tensor([3, 60, 17])
    shown = table.gather(rows).prepared["eyes.wrist"]
    np.testing.assert_array_equal(shown, images[VIEW.name][windows.obs_steps[rows]])
    assert table.image_bytes == 16 * 24 * 3


def test_a_killed_training_on_images_resumes_bit_for_bit(episodes, tasks, looking, images, training_config, tmp_path):
    class KilledError(Exception):
        pass

    def kill(done, total, **facts):
        if done >= 23:
            raise KilledError

    config = training_config.model_copy(update={"report_every": 1})
    arguments = ([seen(episodes(LENGTHS), images)], looking, tasks, config)
    straight = train(*arguments, seed=3).checkpoint
    with pytest.raises(KilledError):
        train(*arguments, seed=3, scratch=tmp_path, progress=kill)
    resumed = train(*arguments, seed=3, scratch=tmp_path).checkpoint
    for name, value in straight.weights.items():
        assert torch.equal(value, resumed.weights[name]), name


def test_a_state_is_not_continued_on_other_images(episodes, images):
    data = seen(episodes(LENGTHS), images)
    other = seen(data, {VIEW.name: 255 - images[VIEW.name]})
    assert training_identity(data, {}) == training_identity(dataclasses.replace(data), {})
    assert len({training_identity(each, {}) for each in (data, other, episodes(LENGTHS))}) == 3


def test_a_policy_that_looks_is_not_trained_without_images(episodes, tasks, looking, training_config):
    with pytest.raises(TrainingFailed, match=f"observes '{VIEW.name}', which the episodes do not hold"):
        train([episodes(LENGTHS)], looking, tasks, training_config, seed=0)
