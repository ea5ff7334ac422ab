"""Columns: aligned to the episodes of one artifact, cheap to read in pieces, never joined to other episodes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from juicer.artifacts.contents import checked_when_read
from juicer.episode import ArraySpec, Episode, Role
from juicer.errors import ArtifactError, DamagedArtifact, InvalidEpisode, UnreadableArtifact
from juicer.storage import columns as module
from juicer.storage.columns import COLUMNS, ColumnReader, write_columns
from juicer.storage.episodes import EpisodeReader, write_episodes

ARTIFACT = "0123456789abcdef"
LENGTHS = (5, 9, 1)
ENDS = np.cumsum(LENGTHS)
IMAGE = ArraySpec("front", (12, 16, 3), "uint8", Role.DERIVED)
SPEED = ArraySpec("speed", (), "float32", Role.DERIVED)

EpisodeFactory = Callable[..., Episode]


def derived(lengths: tuple[int, ...] = LENGTHS) -> Iterator[dict[str, Any]]:
    rng = np.random.default_rng(0)
    for length in lengths:
        images = rng.integers(0, 256, (length, *IMAGE.shape), np.uint8)
        yield {"front": images, "speed": rng.normal(size=length).astype(np.float32)}


@pytest.fixture
def episodes(tmp_path: Path, episode_factory: EpisodeFactory) -> Path:
    folder = tmp_path / "episodes" / ARTIFACT
    folder.mkdir(parents=True)
    write_episodes(folder, [episode_factory(length, seed=length) for length in LENGTHS], {})
    return folder


@pytest.fixture
def columns(tmp_path: Path) -> Path:
    folder = tmp_path / "columns" / "fedcba9876543210"
    folder.mkdir(parents=True)
    write_columns(folder, [IMAGE, SPEED], derived(), artifact=ARTIFACT, episode_ends=ENDS)
    return folder


@pytest.mark.parametrize(("chunk_steps", "chunk_bytes", "shard_bytes"), [(1, 1, 1), (2, 2000, 5000), (8, 2**15, 2**25)])
def test_columns_read_back_exactly_whatever_the_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk_steps: int, chunk_bytes: int, shard_bytes: int
) -> None:
    monkeypatch.setattr(module, "CHUNK_STEPS", chunk_steps)
    monkeypatch.setattr(module, "CHUNK_BYTES", chunk_bytes)
    monkeypatch.setattr(module, "SHARD_BYTES", shard_bytes)
    write_columns(tmp_path, [IMAGE, SPEED], derived(), artifact=ARTIFACT, episode_ends=ENDS)
    reader = ColumnReader(tmp_path)
    for name in ("front", "speed"):
        written = np.concatenate([values[name] for values in derived()])
        np.testing.assert_array_equal(reader.steps(name), written)
        for span in (slice(0, 1), slice(4, 11), slice(14, 15)):
            np.testing.assert_array_equal(reader.steps(name, span), written[span])


def test_columns_are_read_as_if_they_were_the_episodes_own(episodes: Path, columns: Path) -> None:
    reader = EpisodeReader(episodes, [columns])
    written = list(derived())
    assert reader.schema.names(Role.DERIVED) == ("front", "speed")
    for index in range(len(reader)):
        episode = reader.read(index)
        np.testing.assert_array_equal(episode.steps["front"], written[index]["front"])
        np.testing.assert_array_equal(episode.steps["speed"], written[index]["speed"])
        assert episode.record == EpisodeReader(episodes).read(index).record
    np.testing.assert_array_equal(reader.steps("speed", slice(5, 14)), written[1]["speed"])
    np.testing.assert_array_equal(reader.steps("action"), EpisodeReader(episodes).steps("action"))


def test_columns_of_some_episodes_are_read_in_their_places_and_nowhere_else(episodes: Path, tmp_path: Path) -> None:
    folder = tmp_path / "some"
    folder.mkdir()
    first, _, last = derived()
    covered = np.array([True, False, True])
    write_columns(folder, [IMAGE, SPEED], [first, last], artifact=ARTIFACT, episode_ends=ENDS, covered=covered)
    reader = EpisodeReader(episodes, [folder])
    np.testing.assert_array_equal(reader.covered, covered)
    np.testing.assert_array_equal(reader.read(0).steps["front"], first["front"])
    np.testing.assert_array_equal(reader.read(2).steps["speed"], last["speed"])
    np.testing.assert_array_equal(reader.steps("front", slice(2, 5)), first["front"][2:])
    assert len(reader.steps("front", slice(5, 5))) == 0
    for span in (slice(None), slice(4, 6), slice(13, 15), slice(6, 8)):
        with pytest.raises(ArtifactError, match=rf"cover 2 of the 3 episodes of {ARTIFACT}, and not number 1; derive"):
            reader.steps("front", span)
    with pytest.raises(InvalidEpisode, match="for more than 2 of the 3 episodes"):
        write_columns(
            tmp_path, [IMAGE, SPEED], [first, last, last], artifact=ARTIFACT, episode_ends=ENDS, covered=covered
        )


def test_columns_that_an_older_version_wrote_are_of_all_episodes(episodes: Path, columns: Path) -> None:
    path = columns / COLUMNS / "zarr.json"
    content = json.loads(path.read_text())
    del content["attributes"]["covered"], content["attributes"]["drawn_by"]
    path.write_text(json.dumps(content))
    assert EpisodeReader(episodes, [columns]).covered.all()


def test_a_window_unpacks_little_of_a_column_and_a_column_is_few_files(tmp_path: Path) -> None:
    image = ArraySpec("front", (240, 320, 3), "uint8", Role.DERIVED)
    frames = [{"front": np.zeros((300, *image.shape), np.uint8) + np.arange(300, dtype=np.uint8)[:, None, None, None]}]
    write_columns(tmp_path, [image], frames, artifact=ARTIFACT, episode_ends=np.array([300]))
    array = zarr.open_array(tmp_path / COLUMNS / "data" / "front", mode="r")
    assert array.chunks[0] == 8
    assert len(list((tmp_path / COLUMNS / "data" / "front").rglob("c/*/*/*/*"))) == 3


def test_every_chunk_is_compared_with_its_checksum_when_it_is_read(columns: Path) -> None:
    paths = [path.relative_to(columns).as_posix() for path in columns.rglob("*") if path.is_file()]
    chunks = {path for path in paths if "/c/" in path}
    assert checked_when_read(columns, paths) == chunks
    assert len(chunks) == 3
    path = columns / COLUMNS / "data" / "speed" / "c" / "0"
    content = bytearray(path.read_bytes())
    content[10] ^= 1
    path.write_bytes(content)
    reader = ColumnReader(columns)
    sentence = (
        r"^artifact columns/fedcba9876543210 is damaged: "
        r"array 'data/speed' has other content than when it was written; "
        r"recompute it with `juicer repair fedcba9876543210`$"
    )
    with pytest.raises(DamagedArtifact, match=sentence):
        reader.steps("speed")
    reader.steps("front")


def test_a_chunk_that_may_not_be_read_is_not_called_damaged(columns: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = ColumnReader(columns)

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("zarr.core.array.Array.__getitem__", refuse)
    with pytest.raises(UnreadableArtifact, match=r"may be whole, but array 'data/speed' cannot be read \(Permission"):
        reader.steps("speed")


def test_columns_of_another_artifact_are_refused(episodes: Path, columns: Path, tmp_path: Path) -> None:
    other = tmp_path / "episodes" / "aaaaaaaaaaaaaaaa"
    episodes.rename(other)
    with pytest.raises(ArtifactError, match=rf"belong to the episodes {ARTIFACT}, not to aaaaaaaaaaaaaaaa; derive"):
        EpisodeReader(other, [columns])


def test_columns_of_other_steps_are_refused(episodes: Path, tmp_path: Path) -> None:
    write_columns(tmp_path, [SPEED], speeds((5, 9, 2)), artifact=ARTIFACT, episode_ends=np.cumsum((5, 9, 2)))
    with pytest.raises(ArtifactError, match="are of 3 episodes that end elsewhere than the 3 in"):
        EpisodeReader(episodes, [tmp_path])


def speeds(lengths: tuple[int, ...]) -> list[dict[str, Any]]:
    return [{"speed": np.zeros(length, np.float32)} for length in lengths]


def test_two_arrays_of_one_name_are_refused(episodes: Path, columns: Path, tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"have an array 'front', and so have the episodes in .* leave one out"):
        EpisodeReader(episodes, [columns, columns])
    action = ArraySpec("action", (), "float32", Role.DERIVED)
    values = [{"action": each["speed"]} for each in speeds(LENGTHS)]
    write_columns(tmp_path, [action], values, artifact=ARTIFACT, episode_ends=ENDS)
    with pytest.raises(ArtifactError, match="have an array 'action'"):
        EpisodeReader(episodes, [tmp_path])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (speeds((5, 9)), r"for 2 of the 3 episodes of 0123456789abcdef"),
        (speeds((5, 9, 1, 1)), r"for more than the 3 episodes"),
        (speeds((5, 8, 1)), r"'speed' has 8 steps in episode 1 of 0123456789abcdef, which has 9"),
        (
            [{"velocity": np.zeros(5, np.float32)}],
            r"episode 0 of 0123456789abcdef needs the columns \['speed'\], got \['velocity'\]",
        ),
        ([{"speed": np.zeros(5)}], r"'speed' holds float64 but must hold float32"),
        ([{"speed": np.zeros((5, 1), np.float32)}], r"'speed' has shape \(1,\) a step"),
        ([{"speed": np.full(5, np.nan, np.float32)}], r"'speed' holds NaN or infinite values in episode 0"),
    ],
)
def test_columns_that_do_not_fit_the_episodes_are_not_written(
    tmp_path: Path, values: list[Mapping[str, Any]], words: str
) -> None:
    with pytest.raises(InvalidEpisode, match=words):
        write_columns(tmp_path, [SPEED], values, artifact=ARTIFACT, episode_ends=ENDS)


@pytest.mark.parametrize(
    "spec",
    [
        ArraySpec("speed", (), "float32", Role.OBSERVATION),
        ArraySpec("speed", (None,), "float32", Role.DERIVED),
    ],
)
def test_only_derived_arrays_of_known_size_are_columns(tmp_path: Path, spec: ArraySpec) -> None:
    with pytest.raises(InvalidEpisode, match=r"were derived from episodes|needs the sizes of its entries"):
        write_columns(tmp_path, [spec], speeds(LENGTHS), artifact=ARTIFACT, episode_ends=ENDS)


def test_columns_of_no_episode_can_be_joined(tmp_path: Path) -> None:
    folder = tmp_path / "episodes" / ARTIFACT
    folder.mkdir(parents=True)
    write_episodes(folder, [], {}, may_be_empty=True)
    write_columns(tmp_path, [SPEED], [], artifact=ARTIFACT, episode_ends=np.array([], np.int64))
    assert len(EpisodeReader(folder, [tmp_path])) == 0


Edit = Callable[[dict[str, Any]], None]
FORGERIES: dict[str, Edit] = {
    "version": lambda attributes: attributes.update(schema_version=99),
    "no version": lambda attributes: attributes.clear(),
    "no arrays": lambda attributes: attributes.pop("arrays"),
    "arrays": lambda attributes: attributes.update(arrays={"speed": 1}),
    "twice": lambda attributes: attributes.update(arrays=2 * attributes["arrays"]),
    "role": lambda attributes: attributes["arrays"][0].update(role="action"),
    "name": lambda attributes: attributes["arrays"][0].update(name="../../etc"),
    "size": lambda attributes: attributes["arrays"][0].update(shape=[10**15]),
    "type": lambda attributes: attributes["arrays"][0].update(dtype="object"),
    "covered": lambda attributes: attributes.update(covered=[1, 0, 1]),
    "covered too few": lambda attributes: attributes.update(covered=[True]),
    "drawn by": lambda attributes: attributes.update(drawn_by={"a": 1}),
    "episodes": lambda attributes: attributes.update(episodes="\x1b[2J" * 1000),
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_columns_that_juicer_would_not_write_are_refused(episodes: Path, columns: Path, forgery: str) -> None:
    path = columns / COLUMNS / "zarr.json"
    content = json.loads(path.read_text())
    FORGERIES[forgery](content["attributes"])
    path.write_text(json.dumps(content))
    with pytest.raises(ArtifactError) as caught:
        EpisodeReader(episodes, [columns]).read(0)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize("edit", ["more steps", "absurd chunks", "absurd size"])
def test_an_array_of_absurd_size_takes_no_memory(episodes: Path, columns: Path, edit: str) -> None:
    path = columns / COLUMNS / "data" / "speed" / "zarr.json"
    content = json.loads(path.read_text())
    if edit == "absurd chunks":
        content["chunk_grid"]["configuration"]["chunk_shape"] = [10**12]
    else:
        content["shape"] = [10**15 if edit == "absurd size" else 16]
    path.write_text(json.dumps(content))
    with pytest.raises(ArtifactError, match=r"not one of theirs|absurd size|cannot be opened"):
        EpisodeReader(episodes, [columns]).read(0)


def test_a_folder_without_columns_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="holds no columns"):
        ColumnReader(tmp_path)


def test_an_array_that_is_not_there_is_named(columns: Path) -> None:
    with pytest.raises(ArtifactError, match="have no array 'sped'; did you mean 'speed'"):
        ColumnReader(columns).steps("sped")
