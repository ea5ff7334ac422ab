"""A video is there whole or not at all, and what goes wrong keeps its name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest

from juicer.errors import ConfigError, InvalidEpisode
from juicer.sim.video import Image, write_strip, write_video

IMAGE: Image = np.zeros((32, 48, 3), np.uint8)


def images_until(error: BaseException) -> Iterator[Image]:
    yield from [IMAGE] * 30
    raise error


def test_a_video_holds_every_image_and_no_draft_stays(tmp_path: Path):
    assert write_video(tmp_path / "video.mp4", [IMAGE] * 7) == 7
    with av.open(str(tmp_path / "video.mp4")) as video:
        assert len([*video.decode(video=0)]) == 7
    assert [path.name for path in tmp_path.iterdir()] == ["video.mp4"]


@pytest.mark.parametrize("before", [None, b"a good video"])
def test_an_interrupted_video_leaves_what_was_there(tmp_path: Path, before: bytes | None):
    video = tmp_path / "video.mp4"
    if before is not None:
        video.write_bytes(before)
    with pytest.raises(KeyboardInterrupt):
        write_video(video, images_until(KeyboardInterrupt()))
    assert [path.read_bytes() for path in tmp_path.iterdir()] == ([] if before is None else [before])


def test_an_episode_of_another_scene_is_not_blamed_on_the_video(tmp_path: Path):
    with pytest.raises(InvalidEpisode, match="this scene has"):
        write_video(tmp_path / "video.mp4", images_until(InvalidEpisode("this scene has another state")))


@pytest.mark.parametrize("name", ["video.nonsense", "nowhere/video.mp4"])
def test_a_video_that_cannot_be_written_is_told_in_a_sentence(tmp_path: Path, name: str):
    with pytest.raises(ConfigError, match=r"/video\.\w+' cannot be written: .*; name a writable file") as caught:
        write_video(tmp_path / name, [IMAGE])
    assert ".draft" not in str(caught.value)


def test_a_strip_shows_images_side_by_side_and_no_draft_stays(tmp_path: Path):
    write_strip(tmp_path / "strip.png", [IMAGE] * 3)
    assert [path.name for path in tmp_path.iterdir()] == ["strip.png"]
    with pytest.raises(ConfigError, match="cannot be written: No such file"):
        write_strip(tmp_path / "nowhere" / "strip.png", [IMAGE])
