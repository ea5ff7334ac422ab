"""Captions say what is shown, fit into the image, and come through whatever they hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from juicer.episode import DEMONSTRATION, Outcome
from juicer.imaging.captions import GAP, Captioner, ending
from juicer.imaging.video import Frame, VideoFormat
from juicer.provenance import provenance
from juicer.views import View

BOTH = VideoFormat(width=320, height=240)
MILESTONES = {"top_placed": 3, "leg_lifted": 7}


def frame_of(video_format, step):
    image = np.full((video_format.height, video_format.width, 3), 90, np.uint8)
    return Frame(step, (image,) * len(video_format.cameras))


@pytest.mark.parametrize("video_format", [BOTH, VideoFormat(("wrist",), 161, 121), VideoFormat(width=1280, height=720)])
def test_captioned_images_are_even_and_hold_the_cameras_images_unchanged(episode_factory, video_format):
    episode = episode_factory(12, milestones=MILESTONES)
    image = Captioner(episode, video_format, ["one_leg", "initial state 3"]).caption(frame_of(video_format, 5))
    height, width, _ = image.shape
    assert height % 2 == width % 2 == 0
    assert width - (len(video_format.cameras) * (video_format.width + GAP) - GAP) in (0, 1)
    assert np.all(image[height - video_format.height : height - 1, video_format.width // 2] == 90)


def test_every_step_milestone_and_the_outcome_change_the_caption(episode_factory):
    captioner = Captioner(episode_factory(12, milestones=MILESTONES), BOTH)
    shown = [captioner.caption(frame_of(BOTH, step)) for step in range(13)]
    text_ends = len(shown[0]) - BOTH.height
    captions = {image[:text_ends].tobytes() for image in shown}
    assert len(captions) == 13
    without = Captioner(episode_factory(12), BOTH).caption(frame_of(BOTH, 7))
    assert not np.array_equal(without[:text_ends], shown[7][:text_ends])
    failed = Captioner(episode_factory(12, milestones=MILESTONES, outcome=Outcome.TIMEOUT), BOTH)
    assert not np.array_equal(failed.caption(frame_of(BOTH, 12)), shown[12])
    assert np.array_equal(failed.caption(frame_of(BOTH, 11)), shown[11])


def test_steps_of_a_demonstration_are_told_as_those_of_the_recording(episode_factory):
    plain = episode_factory(12, milestones={"leg_lifted": 5})
    numbers = np.arange(12, dtype=np.int32)
    numbers[5:] += 3
    kept = {"recorded_step": numbers, "continuous": np.ones(12, bool)}
    demonstration = replace(plain, steps={**plain.steps, **kept}, schema=DEMONSTRATION)
    recorded = replace(
        episode_factory(15), record=replace(plain.record, milestones={"leg_lifted": 8}, episode_id="recorded")
    )
    shown = Captioner(demonstration, BOTH).caption(frame_of(BOTH, 6))
    np.testing.assert_array_equal(shown, Captioner(recorded, BOTH).caption(frame_of(BOTH, 9)))


@pytest.mark.parametrize("text", ["\x1b[2J\n", "w" * 10_000, "\ud800 \u202e", "日本語", ""])
def test_no_text_breaks_a_caption(episode_factory, text):
    episode = episode_factory(12, milestones={text: 2, "leg_lifted": 3}, device=text)
    video_format = VideoFormat(("front",), 160, 120)
    image = Captioner(episode, video_format, [text, *provenance(episode.record)]).caption(frame_of(video_format, 12))
    assert image.shape[1] == 160
    assert len(image) < 400


def test_a_title_too_long_for_a_line_takes_several(episode_factory):
    short = Captioner(episode_factory(12), BOTH, ["one"]).caption(frame_of(BOTH, 0))
    long = Captioner(episode_factory(12), BOTH, [f"item number {n}" for n in range(20)]).caption(frame_of(BOTH, 0))
    assert len(long) > len(short)


def test_an_ending_tells_outcome_and_steps(episode_factory):
    assert ending(episode_factory(12, outcome=Outcome.TIMEOUT)) == "timeout after 12 steps"


def test_the_outcome_stands_clear_of_the_time(episode_factory):
    video_format = VideoFormat(("front",), 240, 180)
    episode = episode_factory(300)
    end = Captioner(episode, video_format).caption(frame_of(video_format, 300))
    row = end[: end.shape[0] - video_format.height - 20]
    green = np.flatnonzero(((row[..., 1] > 180) & (row[..., 0] < 160)).any(axis=0))
    before = row[:, green[0] - 4 : green[0] - 1]
    assert before.max() < 60


def test_what_the_policy_saw_stands_below_the_cameras_pixel_by_pixel(episode_factory):
    views = (View(camera="front", width=32, height=16), View(camera="wrist", width=16, height=16))
    video_format = replace(BOTH, views=views)
    rng = np.random.default_rng(0)
    seen = tuple(rng.integers(0, 256, (view.height, view.width, 3), dtype=np.uint8) for view in views)
    frame = replace(frame_of(video_format, 5), seen=seen)
    episode = episode_factory(12)
    image, without = (
        Captioner(episode, video_format).caption(frame),
        Captioner(episode, BOTH).caption(frame_of(BOTH, 5)),
    )
    assert image.shape[1] == without.shape[1]
    assert np.array_equal(image[: len(without) - 1], without[:-1])
    row = image[len(without) :]
    colours = {tuple(colour) for colour in seen[1][-4:].reshape(-1, 3).tolist()}
    assert colours <= {tuple(colour) for colour in row.reshape(-1, 3).tolist()}
