"""An episode as a recording for the viewer Rerun: images, poses, numbers. It is to look at, and never read back.

Rerun is large, and an extra: whoever does not look into episodes in this way need not install it.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from juicer.episode import Episode
from juicer.errors import ConfigError
from juicer.imaging.jpeg import encode_jpeg
from juicer.imaging.video import VideoFormat, draw
from juicer.sim.env import STEP_S
from juicer.tasks.registry import get_task
from juicer.text import adding_extra

SUFFIX = ".rrd"
TIMELINES = STEP, TIME = "step", "sim_time"


def require_rerun() -> Any:
    """The library.

    Raises:
        ConfigError: If it is not installed.
    """
    try:
        return importlib.import_module("rerun")
    except ImportError:
        raise ConfigError(f"Rerun is not installed; {adding_extra('rerun')}") from None


def viewer() -> Path:
    """The viewer's program, which comes along with the library."""
    spec = importlib.util.find_spec("rerun_cli")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).with_name("rerun")


def write_recording(episode: Episode, path: Path, name: str) -> int:
    """Write an episode as one file; gives the number of steps whose images are in it.

    Args:
        episode: The episode.
        path: File to write; what is there is replaced.
        name: What the viewer calls the recording.

    Raises:
        ConfigError: If Rerun is not installed, or the file cannot be written.
        StateMissing: If the episode has no simulator states.
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    rr = require_rerun()
    draft = path.with_name(f".draft.{path.name}")
    try:
        # Rerun itself would only warn.
        draft.touch()
        stream = rr.RecordingStream("juicer", recording_id=episode.record.episode_id)
        stream.save(draft, default_blueprint=_blueprint())
        stream.send_recording_name(name)
        _log_numbers(stream, episode)
        _log_poses(stream, episode)
        for milestone, step in episode.record.milestones.items():
            _at(stream, step)
            stream.log("milestones", rr.TextLog(milestone.replace("_", " ")))
        frames = _log_images(stream, episode)
        stream.flush()
        stream.disconnect()
        draft.replace(path)
    except OSError as error:
        raise ConfigError(f"recording '{path}' cannot be written: {error.strerror or error}") from None
    finally:
        draft.unlink(missing_ok=True)
    return frames


def _blueprint() -> Any:
    rrb = importlib.import_module("rerun.blueprint")
    images = rrb.Vertical(
        rrb.Spatial2DView(origin="cameras/front", name="front"), rrb.Spatial2DView(origin="cameras/wrist", name="wrist")
    )
    numbers = rrb.Vertical(
        rrb.TimeSeriesView(origin="gripper", name="gripper [m]"),
        rrb.TimeSeriesView(origin="end_effector", name="end effector [m]"),
        rrb.TextLogView(origin="milestones", name="milestones"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(images, rrb.Spatial3DView(origin="world", name="robot base frame"), numbers),
        rrb.TimePanel(timeline=STEP),
        collapse_panels=True,
    )


def _columns(stream: Any, path: str, steps: Sequence[int], columns: Any) -> None:
    rr = require_rerun()
    times = [rr.TimeColumn(STEP, sequence=steps), rr.TimeColumn(TIME, duration=[step * STEP_S for step in steps])]
    stream.send_columns(path, indexes=times, columns=columns)


def _log_numbers(stream: Any, episode: Episode) -> None:
    rr, steps = require_rerun(), range(len(episode))
    proprioception, action = episode.steps["proprioception"], episode.steps["action"]
    numbers = {
        "gripper/width": proprioception[:, 15],
        "gripper/closing": 0.01 * action[:, 9].astype(np.float64),
        **{f"end_effector/{axis}": proprioception[:, place] for place, axis in enumerate("xyz")},
        **{f"end_effector/wanted_{axis}": action[:, place] for place, axis in enumerate("xyz")},
        "reward": episode.steps["reward"],
    }
    for path, values in numbers.items():
        _columns(stream, path, steps, rr.Scalars.columns(scalars=values.astype(np.float64)))


def _log_poses(stream: Any, episode: Episode) -> None:
    """Of the parts as they were observed, and the way of the end effector; robot base frame."""
    rr, steps = require_rerun(), range(len(episode))
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    way = episode.steps["proprioception"][:, :3]
    stream.log("world/way", rr.LineStrips3D([way]), static=True)
    stream.log("world/end_effector", rr.Points3D([[0, 0, 0]], radii=0.008, labels=["end effector"]), static=True)
    _columns(stream, "world/end_effector", steps, rr.Transform3D.columns(translation=way))
    poses = episode.steps["part_poses"].reshape(len(episode), -1, 7)
    for place, part in enumerate(get_task(episode.record.task).parts):
        path, quat_wxyz = f"world/parts/{part.name}", poses[:, place, 3:]
        stream.log(path, rr.Points3D([[0, 0, 0]], radii=0.008, labels=[part.name]), static=True)
        quat_xyzw = np.roll(quat_wxyz, -1, axis=1)
        transforms = rr.Transform3D.columns(translation=poses[:, place, :3], quaternion=quat_xyzw)
        _columns(stream, path, steps, transforms)


def _log_images(stream: Any, episode: Episode) -> int:
    rr, video_format, frames = require_rerun(), VideoFormat(), 0
    for frame in draw(episode, range(len(episode) + 1), video_format):
        _at(stream, frame.step)
        for camera, image in zip(video_format.cameras, frame.images, strict=True):
            stream.log(f"cameras/{camera}", rr.EncodedImage(contents=encode_jpeg(image), media_type="image/jpeg"))
        frames += 1
    return frames


def _at(stream: Any, step: int) -> None:
    stream.set_time(STEP, sequence=step)
    stream.set_time(TIME, duration=step * STEP_S)
