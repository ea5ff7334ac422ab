"""A film is there whole or not at all, and what goes wrong keeps its name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest

from juicer.errors import ConfigError, InvalidEpisode
from juicer.sim.film import Picture, write_strip, write_video

PICTURE: Picture = np.zeros((32, 48, 3), np.uint8)


def pictures_until(error: BaseException) -> Iterator[Picture]:
    yield from [PICTURE] * 30
    raise error


def test_a_film_holds_every_picture_and_no_draft_stays(tmp_path: Path):
    assert write_video(tmp_path / "film.mp4", [PICTURE] * 7) == 7
    with av.open(str(tmp_path / "film.mp4")) as film:
        assert len([*film.decode(video=0)]) == 7
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


@pytest.mark.parametrize("before", [None, b"a good film"])
def test_an_interrupted_film_leaves_what_was_there(tmp_path: Path, before: bytes | None):
    film = tmp_path / "film.mp4"
    if before is not None:
        film.write_bytes(before)
    with pytest.raises(KeyboardInterrupt):
        write_video(film, pictures_until(KeyboardInterrupt()))
    assert [path.read_bytes() for path in tmp_path.iterdir()] == ([] if before is None else [before])


def test_an_episode_of_another_scene_is_not_blamed_on_the_film(tmp_path: Path):
    with pytest.raises(InvalidEpisode, match="this scene has"):
        write_video(tmp_path / "film.mp4", pictures_until(InvalidEpisode("this scene has another state")))


@pytest.mark.parametrize("name", ["film.nonsense", "nowhere/film.mp4"])
def test_a_film_that_cannot_be_written_is_told_in_a_sentence(tmp_path: Path, name: str):
    with pytest.raises(ConfigError, match=r"/film\.\w+' cannot be written: .*; name a writable file") as caught:
        write_video(tmp_path / name, [PICTURE])
    assert ".draft" not in str(caught.value)


def test_a_strip_shows_pictures_side_by_side_and_no_draft_stays(tmp_path: Path):
    write_strip(tmp_path / "strip.png", [PICTURE] * 3)
    assert [path.name for path in tmp_path.iterdir()] == ["strip.png"]
    with pytest.raises(ConfigError, match="cannot be written: No such file"):
        write_strip(tmp_path / "nowhere" / "strip.png", [PICTURE])
