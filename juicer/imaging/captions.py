"""Captions burnt into images of an episode: what is shown, at which step, and which milestones were reached."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import PIL.Image
from PIL import ImageDraw, ImageFont

from juicer.episode import Episode, Outcome
from juicer.imaging.video import Frame, Image, VideoFormat
from juicer.sim.env import STEP_S
from juicer.text import printable
from juicer.views import GazeCrop, View

GAP = 4
"""Pixels between the images of two cameras."""

NEWS_STEPS = 15
"""Steps for which a milestone that was just reached is highlighted."""

_PAGE, _LABEL = (20, 23, 27), (20, 23, 27)
_INK, _MUTED, _NEWS, _GOOD = (240, 242, 244), (164, 172, 180), (255, 176, 92), (132, 214, 132)
_SEPARATOR = "  ·  "
_LONGEST = 60
"""Letters of one item of a title; ids and names are shorter."""

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont


def ending(episode: Episode) -> str:
    """How an episode ended, e.g. ``part lost after 312 steps``."""
    return f"{_words(episode.record.outcome.value)} after {len(episode)} steps"


@dataclass
class Captioner:
    """Puts images of cameras side by side below a title, the step and the milestones; below them those of the views.

    Steps of a demonstration are told as those of the recording, in which idle steps count.

    All text stands above the images: players cover the lower edge while a video is paused.

    Attributes:
        episode: Whose frames they are.
        video_format: How they were drawn.
        title: Items of the title; none leaves it out.
        text_px: Height of the letters; chosen by the size of the images if left out.
    """

    episode: Episode
    video_format: VideoFormat
    title: Sequence[str] = ()
    text_px: int | None = None
    _lines: list[str] = field(init=False)

    def __post_init__(self) -> None:
        """Choose letters, and break the title into lines."""
        size = self.text_px or max(13, round(self.video_format.height / 20))
        self._small_px, self._large_px = size, round(1.3 * size)
        self._font = ImageFont.load_default(self._small_px)
        self._large = ImageFont.load_default(self._large_px)
        self._row = round(1.45 * size)
        self._inner_width = len(self.video_format.cameras) * (self.video_format.width + GAP) - GAP
        self._margin = max(6, size // 2)
        self._lines = _broken([printable(item, _LONGEST) for item in self.title], self._font, self._room)

    @property
    def _room(self) -> int:
        return self._inner_width - 2 * self._margin

    def captioned(self, frames: Iterable[Frame]) -> Iterator[Image]:
        """One image ``(height, width, 3)`` a frame; both are even, as H.264 needs them."""
        for frame in frames:
            yield self.caption(frame)

    def caption(self, frame: Frame) -> Image:
        """The image of one frame."""
        titled = len(self._lines) * self._row
        header = titled + round(2.9 * self._row) + self._margin // 2
        height = header + self.video_format.height + (GAP + self._views_height if self.video_format.views else 0)
        canvas = PIL.Image.new("RGB", (self._inner_width + self._inner_width % 2, height + height % 2), _PAGE)
        pen = ImageDraw.Draw(canvas)
        for number, line in enumerate(self._lines):
            pen.text((self._margin, self._margin // 2 + number * self._row), line, _INK, self._font)
        self._tell(pen, frame.step, titled)
        for place, (camera, image) in enumerate(zip(self.video_format.cameras, frame.images, strict=True)):
            left = place * (self.video_format.width + GAP)
            canvas.paste(PIL.Image.fromarray(image), (left, header))
            self._label(pen, camera, left, header)
        left, top = 0, header + self.video_format.height + GAP
        for view, image in zip(self.video_format.views, frame.seen, strict=True):
            # Every pixel is shown as it is: they are what the policy saw.
            shown = PIL.Image.fromarray(image).resize(self._shown(view), PIL.Image.Resampling.NEAREST)
            canvas.paste(shown, (left, top))
            gaze = " gaze" if isinstance(view.crop, GazeCrop) else ""
            self._label(pen, f"policy: {view.camera}{gaze}", left, top)
            left += shown.width + GAP
        return np.asarray(canvas)

    @property
    def _views_height(self) -> int:
        """Height of the views in a row that is as wide as the cameras' images, and at most as high."""
        shape = sum(view.width / view.height for view in self.video_format.views)
        return min(
            self.video_format.height, int((self._inner_width - GAP * (len(self.video_format.views) - 1)) / shape)
        )

    def _shown(self, view: View) -> tuple[int, int]:
        return max(1, int(self._views_height * view.width / view.height)), self._views_height

    def _label(self, pen: ImageDraw.ImageDraw, camera: str, left: int, top: int) -> None:
        width = self._font.getlength(camera) + self._margin
        pen.rectangle((left, top, left + width, top + self._row - 2), fill=_LABEL)
        pen.text((left + self._margin // 2, top), camera, _MUTED, self._font)

    def _tell(self, pen: ImageDraw.ImageDraw, step: int, top: int) -> None:
        left, first = self._margin, top + self._margin // 2
        now = f"step {self.episode.recorded_step(step)}"
        pen.text((left, first), now, _INK, self._large)
        beside = left + self._large.getlength(now) + self._small_px / 2
        right: float = self._inner_width - self._margin
        if step == len(self.episode):
            outcome = self.episode.record.outcome
            told = _words(outcome.value)
            color = _GOOD if outcome is Outcome.SUCCESS else _NEWS
            left_of_outcome = right - self._large.getlength(told)
            if left_of_outcome > beside:
                pen.text((left_of_outcome, first), told, color, self._large)
                right = left_of_outcome - self._small_px / 2
        told = self._progress(step, right - beside)
        pen.text((beside, first + self._large_px - self._small_px), told, _MUTED, self._font)
        self._list_milestones(pen, step, first + round(1.6 * self._row))

    def _progress(self, step: int, room: float) -> str:
        """As much as there is room for."""
        numbered = self.episode.recorded_step
        seconds = f"{numbered(step) * STEP_S:.1f} s"
        whole = f"of {numbered(len(self.episode))}{_SEPARATOR}{seconds}"
        return next((told for told in (whole, seconds) if self._font.getlength(told) <= room), "")

    def _list_milestones(self, pen: ImageDraw.ImageDraw, step: int, top: int) -> None:
        """The milestones reached so far, the latest last; the earliest are left out if there are too many."""
        reached = sorted((at, name) for name, at in self.episode.record.milestones.items() if at <= step)
        told = [(at, f"{_words(name)} {self.episode.recorded_step(at)}") for at, name in reached]
        while told and self._font.getlength(_SEPARATOR.join(text for _, text in told)) > self._room:
            if len(told) == 1:
                break
            told = told[1:]
        left: float = self._margin
        for index, (at, text) in enumerate(told):
            shown = (_SEPARATOR if index else "") + text
            is_news = index == len(told) - 1 and step - at < NEWS_STEPS
            pen.text((left, top), shown, _NEWS if is_news else _MUTED, self._font)
            left += self._font.getlength(shown)


def _words(name: str) -> str:
    return printable(name, _LONGEST).replace("_", " ")


def _broken(items: Sequence[str], font: Font, room: float) -> list[str]:
    """Items joined to lines that fit; an item wider than a line is cut."""
    lines: list[str] = []
    for item in items:
        fitting = item
        while font.getlength(fitting) > room and len(fitting) > 1:
            fitting = f"{fitting.removesuffix('…')[:-1]}…"
        joined = f"{lines[-1]}{_SEPARATOR}{fitting}" if lines else ""
        if joined and font.getlength(joined) <= room:
            lines[-1] = joined
        else:
            lines.append(fitting)
    return lines
