"""Episodes as images and videos, of the steps, cameras and sizes one asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from juicer import api
from juicer.episode import Episode
from juicer.errors import ConfigError

pytestmark = pytest.mark.usefixtures("drawing")


def test_images_are_of_the_steps_and_cameras_asked_for(insertions: list[Episode]):
    episode = insertions[0]
    plain = api.images(episode, [3], captions=False)
    assert [image.shape for image in plain] == [(240, 320, 3)]
    both = api.images(episode, [3], camera=("front", "wrist"), captions=False)[0]
    np.testing.assert_array_equal(both[:, :320], plain[0])
    captioned = api.images(episode, 3, width=160, height=120)
    assert len(captioned) == 3
    assert captioned[0].shape[0] > 120


def test_a_video_has_a_frame_a_step_and_plays_at_the_speed_asked_for(insertions: list[Episode], tmp_path: Path):
    path = api.video(tmp_path / "episode.mp4", insertions[0], camera="wrist", width=160, height=120, speed=2)
    with av.open(str(path)) as container:
        (stream,) = container.streams
        assert (stream.frames, stream.average_rate) == (len(insertions[0]) + 1, 20)


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"camera": "frnot"}, "did you mean 'front'"),
        ({"camera": 3}, "camera must be the name of a camera or several, got 3"),
        ({"width": "wide"}, "width must be a whole number"),
        ({"height": 5}, "pixels, not 320x5"),
        ({"steps": 0}, "steps must be a whole number of at least 1"),
        ({"steps": [-1]}, "none is -1"),
        ({"steps": [10**6]}, "none is 1000000"),
        ({"steps": None}, "none is None"),
    ],
)
def test_images_that_cannot_be_are_refused(insertions: list[Episode], settings: dict[str, Any], problem: str):
    with pytest.raises(ConfigError, match=problem):
        api.images(insertions[0], **settings)


@pytest.mark.parametrize(
    ("name", "speed", "problem"),
    [
        ("a.mp4", 0, "speed must be a number from 0.1 to 100, got 0"),
        ("a.mp4", "2", "speed must be"),
        ("none/a.mp4", 1, "cannot be written"),
        ("a.txt", 1, "name a writable file that ends in .mp4"),
    ],
)
def test_a_video_that_cannot_be_is_refused(
    insertions: list[Episode], tmp_path: Path, name: str, speed: Any, problem: str
):
    with pytest.raises(ConfigError, match=problem):
        api.video(tmp_path / name, insertions[0], width=160, height=120, speed=speed)
    assert list(tmp_path.iterdir()) == []


def test_only_an_episode_can_be_drawn():
    with pytest.raises(ConfigError, match="an episode can be drawn, not a list"):
        api.images([])
