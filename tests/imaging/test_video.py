"""A video is there whole or not at all, and what goes wrong keeps its name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from juicer.episode import STATE_KEY, Episode
from juicer.errors import ConfigError, InvalidEpisode
from juicer.imaging.video import Image, VideoFormat, draw, every, write_strip, write_video
from juicer.sim.env import AssemblyEnv
from juicer.views import CAMERAS, View

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


def test_what_is_wrong_with_an_image_is_not_blamed_on_the_file(tmp_path: Path):
    with pytest.raises(ValueError, match="dtype `uint8` but got `float64`"):
        write_video(tmp_path / "video.mp4", [np.zeros((120, 160, 3))])
    assert list(tmp_path.iterdir()) == []


def test_a_strip_shows_images_side_by_side_and_no_draft_stays(tmp_path: Path):
    write_strip(tmp_path / "strip.png", [IMAGE] * 3)
    assert [path.name for path in tmp_path.iterdir()] == ["strip.png"]
    with pytest.raises(ConfigError, match="cannot be written: No such file"):
        write_strip(tmp_path / "nowhere" / "strip.png", [IMAGE])


def test_an_episode_is_seen_by_every_camera_from_its_first_state_to_its_end(drawing: None, insertions: list[Episode]):
    episode = insertions[0]
    steps = every(episode, 10)
    frames = list(draw(episode, steps, VideoFormat(width=160, height=120)))
    assert [frame.step for frame in frames] == steps == [0, 10, 20, 30, 40, len(episode)]
    assert all(len(frame.images) == len(CAMERAS) for frame in frames)
    assert all(image.shape == (120, 160, 3) for frame in frames for image in frame.images)
    assert not np.array_equal(*frames[0].images)


def test_a_state_that_is_no_number_is_left_out(drawing: None, insertions: list[Episode]):
    final = {**insertions[0].final, STATE_KEY: np.full_like(insertions[0].final[STATE_KEY], np.nan)}
    diverged = replace(insertions[0], final=final)
    (frame,) = draw(diverged, [0, len(diverged)], VideoFormat(cameras=("front",), width=160, height=120))
    assert frame.step == 0


def test_a_state_of_an_explosion_is_left_out_and_one_of_another_scene_is_refused(
    drawing: None, insertions: list[Episode]
):
    states = np.array(insertions[0].steps[STATE_KEY], dtype=np.float64)
    states[3:] *= 1e6
    exploded = replace(insertions[0], steps={**insertions[0].steps, STATE_KEY: states})
    small = VideoFormat(cameras=("front",), width=160, height=120)
    assert [frame.step for frame in draw(exploded, [0, 2, 4], small)] == [0, 2]
    other = replace(
        insertions[0],
        steps={**insertions[0].steps, STATE_KEY: states[:, 1:]},
        final={**insertions[0].final, STATE_KEY: states[-1, 1:]},
    )
    with pytest.raises(InvalidEpisode):
        list(draw(other, [0], small))


@pytest.mark.parametrize("size", [(0, 0), (160, 119), (1281, 720), (99999, 99999), (-480, 360)])
def test_a_size_that_cannot_be_drawn_or_read_is_refused(size: tuple[int, int]):
    with pytest.raises(ConfigError, match="measures 160x120 to 1280x720 pixels"):
        VideoFormat(width=size[0], height=size[1])


def test_a_film_shows_what_a_policy_saw(drawing, insertions):
    view = View(camera="wrist", width=24, height=16)
    video_format = VideoFormat(("front",), 160, 120, (view,))
    (frame,) = draw(insertions[0], [7], video_format)
    env = AssemblyEnv("one_leg")
    env.set_state(insertions[0].state(7))
    np.testing.assert_array_equal(frame.seen[0], env.render_view(view))
    env.close()
