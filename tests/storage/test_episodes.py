"""Stored episodes: exact, small, streamed, and never silently incomplete."""

from __future__ import annotations

import gc
import shutil
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zarr

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.episode import DEMONSTRATION, SIMULATOR, ArraySpec, Episode, Outcome, Role, Schema, Source
from juicer.errors import ArtifactError, DamagedArtifact, InvalidEpisode, NothingLeft, StateMissing
from juicer.storage import episodes as module
from juicer.storage.arrays import EVERY_CHUNK
from juicer.storage.episodes import EpisodeReader, write_episodes

EpisodeFactory = Callable[..., Episode]


def assert_equal(first: Episode, second: Episode) -> None:
    assert first.record == second.record
    assert second.schema == first.schema.sized(first.steps)
    for key in first.schema.names():
        assert second.steps[key].dtype == first.steps[key].dtype
        np.testing.assert_array_equal(first.steps[key], second.steps[key])
    for key in first.schema.ends:
        np.testing.assert_array_equal(first.final[key], second.final[key])


@pytest.mark.parametrize("chunk_bytes", [1, 700, 2**22])
def test_episodes_read_back_exactly_whatever_the_chunks(
    tmp_path: Path, episode_factory: EpisodeFactory, monkeypatch: pytest.MonkeyPatch, chunk_bytes: int
) -> None:
    monkeypatch.setattr(module, "CHUNK_BYTES", chunk_bytes)
    written = [episode_factory(length, seed=length) for length in (1, 12, 7, 30)]
    assert write_episodes(tmp_path, iter(written), {}) == 4
    reader = EpisodeReader(tmp_path)
    assert len(reader) == 4
    assert reader.lengths.tolist() == [1, 12, 7, 30]
    assert reader.episode_ends.tolist() == [1, 13, 20, 50]
    for index, episode in enumerate(written):
        assert_equal(episode, reader.read(index))
    assert_equal(written[-1], reader.read(-1))


def test_records_keep_every_fact(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    facts = {
        "source": Source.AUGMENTATION,
        "task": "lamp",
        "randomness": "high",
        "seed": 2**40,
        "outcome": Outcome.PART_LOST,
        "parts_assembled": 2,
        "milestones": {"leg_lifted": 3, "inserted": 9},
        "policy": "0123456789abcdef",
        "parent": "0123456789abcdef",
        "critical_state": 1,
        "device": "keyboard",
        "operator": "Ada",
        "recorded_at": "2026-11-26T14:03:00+01:00",
        "log": "demo_7.npz",
        "episode_id": "fedcba9876543210",
    }
    plain, full = episode_factory(3), episode_factory(3, **{**facts, "seed": 5})
    full = Episode(type(full.record)(**facts), full.steps, full.final)
    write_episodes(tmp_path, [plain, full], {})
    assert EpisodeReader(tmp_path).records == [plain.record, full.record]


def test_whole_arrays_are_time_major(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    written = [episode_factory(length, seed=length) for length in (4, 9)]
    write_episodes(tmp_path, written, {})
    reader = EpisodeReader(tmp_path)
    for key in SIMULATOR.names():
        np.testing.assert_array_equal(reader.steps(key), np.concatenate([episode.steps[key] for episode in written]))


def test_attributes_are_kept(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    write_episodes(tmp_path, [episode_factory()], {"task": "one_leg", "seeds": [1, 2]})
    assert EpisodeReader(tmp_path).attributes == {"task": "one_leg", "seeds": [1, 2]}


def test_an_episode_of_500_steps_takes_less_than_a_megabyte(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    write_episodes(tmp_path, [episode_factory(500, seed=seed, sim_state_size=180) for seed in range(3)], {})
    size = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    assert size / 3 < 1e6


def test_memory_does_not_grow_with_the_number_of_episodes(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    def generate() -> Iterator[Episode]:
        for seed in range(40):
            yield episode_factory(500, seed=seed, sim_state_size=170)

    gc.collect()
    tracemalloc.start()
    write_episodes(tmp_path, generate(), {})
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Forty such episodes hold 34 megabytes.
    assert peak < 20e6


def test_no_episode_at_all_is_a_finding(tmp_path: Path) -> None:
    with pytest.raises(NothingLeft, match="no episode to store"):
        write_episodes(tmp_path, [], {})


def test_episodes_of_different_shape_are_refused(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    with pytest.raises(InvalidEpisode, match=r"'part_poses' has shape \(14,\) a step but \(7,\)"):
        write_episodes(tmp_path, [episode_factory(num_parts=1), episode_factory(num_parts=2)], {})


def test_episodes_of_other_arrays_are_refused(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    plain = episode_factory(4)
    more = {"recorded_step": np.arange(4, dtype=np.int32), "continuous": np.ones(4, bool)}
    record = replace(plain.record, episode_id="")
    other = replace(plain, record=replace(record, seed=9), steps={**plain.steps, **more}, schema=DEMONSTRATION)
    with pytest.raises(InvalidEpisode, match=r"has the arrays .*'continuous'.* but the episodes before have"):
        write_episodes(tmp_path, [plain, other], {})


def test_an_episode_is_stored_once_and_found_by_its_id(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    first, second = (episode_factory(4, seed=seed) for seed in (1, 2))
    with pytest.raises(InvalidEpisode, match=f"episode {first.record.episode_id} is there twice"):
        write_episodes(tmp_path / "twice", [first, second, first], {})
    write_episodes(tmp_path, [first, second], {})
    reader = EpisodeReader(tmp_path)
    assert reader.ids == {first.record.episode_id: 0, second.record.episode_id: 1}
    assert reader.find(second.record.episode_id) == 1
    with pytest.raises(ArtifactError, match="holds no episode 0123456789abcdef"):
        reader.find("0123456789abcdef")


def test_images_and_flags_are_stored_as_they_are_in_chunks_of_their_own(
    tmp_path: Path, episode_factory: EpisodeFactory
) -> None:
    plain = episode_factory(600)
    front = ArraySpec("front", (96, 96, 3), "uint8", Role.OBSERVATION)
    images = np.random.default_rng(0).integers(0, 255, (601, 96, 96, 3), np.uint8)
    episode = replace(
        plain,
        steps={**plain.steps, "front": images[:-1]},
        final={**plain.final, "front": images[-1]},
        schema=SIMULATOR.extended(front),
    )
    write_episodes(tmp_path, [episode], {})
    reader = EpisodeReader(tmp_path)
    assert_equal(episode, reader.read(0))
    chunks = {name: zarr.open_array(tmp_path / "episodes.zarr" / "data" / name).chunks[0] for name in episode.steps}
    assert chunks["front"] == 2**22 // (96 * 96 * 3)
    assert chunks["reward"] == chunks["sim_state"] == 2048


def test_data_without_simulator_states_say_so(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    plain = episode_factory(4)
    schema = Schema(tuple(spec for spec in SIMULATOR if spec.role is not Role.STATE))
    arrays = {name: plain.steps[name] for name in schema.names()}
    write_episodes(tmp_path, [Episode(plain.record, arrays, {n: plain.final[n] for n in schema.ends}, schema)], {})
    reader = EpisodeReader(tmp_path)
    assert "sim_state" not in reader.read(0).steps
    with pytest.raises(StateMissing, match="only what was recorded in juicer's own simulator can be replayed"):
        reader.require_state()
    with pytest.raises(ArtifactError, match="have no array 'sim_state'; valid: action, "):
        reader.steps("sim_state")


def test_reading_past_the_end_is_an_error(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    write_episodes(tmp_path, [episode_factory()], {})
    with pytest.raises(IndexError):
        EpisodeReader(tmp_path).read(1)


def test_a_folder_without_episodes_is_named(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="holds no episodes"):
        EpisodeReader(tmp_path)


def test_another_schema_version_is_named(
    tmp_path: Path, episode_factory: EpisodeFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(module, "SCHEMA_VERSION", 99)
        write_episodes(tmp_path, [episode_factory()], {})
    with pytest.raises(ArtifactError, match="schema version 99"):
        EpisodeReader(tmp_path)


def test_episodes_of_the_first_layout_are_still_read(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    written = [episode_factory(length, seed=length) for length in (4, 9)]
    write_episodes(tmp_path, written, {"task": "one_leg"})
    group = zarr.open_group(tmp_path / "episodes.zarr")
    group.attrs.put({"task": "one_leg", "schema_version": 1})
    path = tmp_path / "episodes.parquet"
    added = ["episode_id", "operator", "recorded_at", "log", "parent_step", "shift"]
    table = pq.read_table(path).drop_columns(added)
    pq.write_table(table.add_column(0, "episode", pa.array([0, 1], pa.int32())), path)
    reader = EpisodeReader(tmp_path)
    assert reader.records == [episode.record for episode in written]
    np.testing.assert_array_equal(reader.read(1).state(9), written[1].final["sim_state"])
    np.testing.assert_array_equal(reader.steps("action")[4:], written[1].steps["action"])


def test_episodes_from_before_there_were_corrections_and_shifts_are_still_read(
    tmp_path: Path, episode_factory: EpisodeFactory
) -> None:
    written = [episode_factory(length, seed=length) for length in (4, 9)]
    write_episodes(tmp_path, written, {"task": "one_leg"})
    group = zarr.open_group(tmp_path / "episodes.zarr")
    group.attrs.put({**group.attrs.asdict(), "schema_version": 2})
    path = tmp_path / "episodes.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["parent_step", "shift"]), path)
    assert EpisodeReader(tmp_path).records == [episode.record for episode in written]


def test_the_shift_of_an_episode_is_kept(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    written = [episode_factory(4, shift='{"kind":"push"}'), episode_factory(4, seed=1)]
    write_episodes(tmp_path, written, {})
    assert [record.shift for record in EpisodeReader(tmp_path).records] == ['{"kind":"push"}', None]


def test_no_file_of_stored_episodes_can_vanish_unnoticed(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    # Zarr alone reads a missing chunk as zeros.
    store = ArtifactStore(tmp_path / "store")
    with store.create(Recipe("ingest", "episodes")) as draft:
        write_episodes(draft.path, [episode_factory(40, seed=seed) for seed in range(3)], {})
    folder = store.open(draft.ref)
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert any(path.match("data/sim_state/c/*/*") for path in files)
    for path in files:
        content = path.read_bytes()
        path.unlink()
        assert store.verify(draft.ref)
        path.write_bytes(content)
    assert store.verify(draft.ref) == []


def test_chunks_that_vanish_after_opening_are_never_read_as_zeros(
    tmp_path: Path, episode_factory: EpisodeFactory
) -> None:
    write_episodes(tmp_path, [episode_factory(40)], {})
    reader = EpisodeReader(tmp_path)
    shutil.rmtree(tmp_path / "episodes.zarr" / "data" / "action" / "c")
    with pytest.raises(DamagedArtifact, match="array 'data/action' has lost a chunk"):
        reader.steps("action")


def test_chunks_of_zeros_are_as_they_were(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    episode = episode_factory(40)
    episode.steps["reward"][:] = 0
    write_episodes(tmp_path, [episode], {})
    assert (EpisodeReader(tmp_path).steps("reward") == 0).all()
    # Older versions did not write them.
    group = zarr.open_group(tmp_path / "episodes.zarr")
    group.attrs.put({name: value for name, value in group.attrs.items() if name != EVERY_CHUNK})
    shutil.rmtree(tmp_path / "episodes.zarr" / "data" / "reward" / "c")
    assert (EpisodeReader(tmp_path).steps("reward") == 0).all()


def test_equal_episodes_make_equal_files(tmp_path: Path, episode_factory: EpisodeFactory) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        write_episodes(tmp_path / name, [episode_factory(50, seed=seed) for seed in range(3)], {"a": 1})
    for path in (tmp_path / "first").rglob("*"):
        if path.is_file():
            assert path.read_bytes() == (tmp_path / "second" / path.relative_to(tmp_path / "first")).read_bytes()
