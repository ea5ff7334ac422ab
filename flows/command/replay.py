"""``juicer replay``: a video of any episode in the store."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flows.command.chosen import Chosen, check_place, choose, episode_number
from flows.running.context import open_run
from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from flows.terminal.output import say, say_json
from juicer.errors import ConfigError

if TYPE_CHECKING:
    from juicer.episode import Episode
    from juicer.imaging.video import Image, VideoFormat
    from juicer.views import View

BOTH = "both"
STRIP_IMAGES = 6
STRIP_SIZE = (320, 240)
FRAMES_PER_SECOND = 20


def replay_episode(
    text: str, episode_name: str, video: Path | None, camera: str, size: str, speed: float, as_json: bool
) -> None:
    """``juicer replay``."""
    from juicer.imaging.video import VIDEO_SUFFIXES, draw, every, write_video
    from juicer.reporting.seen import views_of

    settings = read_settings()
    store = open_store(settings)
    ref = store.resolve(text)
    video_format = _video_format(camera, size, views_of(store, ref) if ref.kind == "evaluation" else ())
    index = episode_number(store, ref, episode_name)
    video = video or Path(f"{ref.id}-{index}.mp4")
    check_place(video, "video", VIDEO_SUFFIXES)
    stride, rate = _pace(speed)
    with open_run(settings, None) as run_context:
        chosen = choose(store, ref, index, run_context.board, settings.devices[0])
        episode = chosen.episode
        steps = every(episode, stride)
        captioner = _captioner(chosen, video_format)
        progress = run_context.board.started("replay", video.name, str(ref))

        def images() -> Iterator[Image]:
            for done, image in enumerate(captioner.captioned(draw(episode, steps, video_format)), start=1):
                progress(done, len(steps))
                yield image

        frames = write_video(video, images(), rate)
        strip = _write_strip(episode, video_format, video)
    _report(chosen, video, strip, len(steps) - frames, as_json)


def _video_format(camera: str, size: str, views: tuple[View, ...]) -> VideoFormat:
    from juicer.imaging.video import VideoFormat
    from juicer.views import CAMERAS

    parts = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})", size)
    if parts is None:
        raise ConfigError(f"size '{size}' must be the width and height of a camera's image, e.g. 480x360")
    return VideoFormat(CAMERAS if camera == BOTH else (camera,), int(parts[1]), int(parts[2]), views)


def _pace(speed: float) -> tuple[int, Fraction]:
    """Steps from frame to frame, and frames a second, for a speed in multiples of real time."""
    from juicer.sim.env import CONTROL_HZ

    steps_a_second = Fraction(speed).limit_denominator(100) * CONTROL_HZ
    stride = max(1, int(steps_a_second // FRAMES_PER_SECOND))
    return stride, steps_a_second / stride


def _captioner(chosen: Chosen, video_format: VideoFormat) -> Any:
    from juicer.imaging.captions import Captioner, ending
    from juicer.provenance import provenance

    record = chosen.episode.record
    title = [record.task, *provenance(record), chosen.name, f"initial state {record.seed}", ending(chosen.episode)]
    if chosen.evaluated and chosen.evaluated.differences:
        row = chosen.evaluated.row
        title.append(f"the evaluation recorded {row.outcome.value} after {row.length} steps")
    return Captioner(chosen.episode, video_format, title)


def _write_strip(episode: Episode, video_format: VideoFormat, video: Path) -> Path:
    from juicer.imaging.captions import Captioner
    from juicer.imaging.video import VideoFormat, draw, evenly_spaced, write_strip

    small = VideoFormat(video_format.cameras[:1], *STRIP_SIZE)
    strip = video.with_suffix(".png")
    frames = draw(episode, evenly_spaced(episode, STRIP_IMAGES), small)
    write_strip(strip, list(Captioner(episode, small).captioned(frames)))
    return strip


def _report(chosen: Chosen, video: Path, strip: Path, left_out: int, as_json: bool) -> None:
    record, evaluated = chosen.episode.record, chosen.evaluated
    if as_json:
        facts: dict[str, Any] = {"outcome": record.outcome.value, "seed": record.seed, "steps": len(chosen.episode)}
        if evaluated:
            facts["recomputed"] = not evaluated.is_kept
            facts["differences"] = list(evaluated.differences)
        say_json({"video": str(video), "strip": str(strip), "left_out": left_out, **facts})
        return
    steps = f"{len(chosen.episode)} steps, {record.outcome.value}, initial state {record.seed}"
    say(f"{video}: {steps}; images in {strip}")
    if evaluated and not evaluated.is_kept:
        verdict = "; ".join(evaluated.differences)
        say(
            f"computed again, but not as it was evaluated: {verdict}; the video shows what happened now"
            if verdict
            else "computed again; outcome, length and milestones are those of the evaluation"
        )
    if left_out:
        say(f"frames left out: {left_out}, whose state is not finite or cannot be restored: the simulation diverged")
