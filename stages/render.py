"""Images of a view at every step of episodes, drawn from the stored states: derived, never the only copy."""

from __future__ import annotations

import numpy as np

from juicer.artifacts.manifest import HEADLINE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.storage.columns import DRAWN_BY, write_columns
from juicer.storage.episodes import EpisodeReader
from juicer.storage.room import require_room
from juicer.storage.selections import kept_of
from juicer.views import View
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class RenderConfig(StrictConfig):
    """What is drawn."""

    view: View


@stage(
    kind="columns",
    inputs={"episodes": "episodes", "selections": "selection"},
    libraries=("mujoco", "numpy", "zarr"),
    noun="images",
    counts="images",
)
def render(
    context: StageContext, *, episodes: ArtifactRef, selections: tuple[ArtifactRef, ...] = (), config: RenderConfig
) -> None:
    """Draw a view at every step of episodes, as it was seen when it happened; of those judged, the ones kept."""
    from juicer.imaging.recorded import drawing_of

    view = config.view
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    covered = kept_of(reader, (context.store.open(each, "selection") for each in selections))
    with drawing_of(reader, (view,), context.machine.workers, np.flatnonzero(covered).tolist()) as drawing:
        # Images are drawn to be learned from: a disk without room for that is better told before the work.
        needed = drawing.stored_bytes() + drawing.unpacked_bytes
        what = f"the images of {view} of {episodes}, and the same unpacked while a policy learns from them,"
        require_room(context.draft.path, needed, what)
        write_columns(
            context.draft.path,
            [view.column],
            drawing.episodes(context.progress),
            artifact=episodes.id,
            episode_ends=reader.episode_ends,
            covered=covered,
            drawn_by=drawing.drawn_by,
        )
    context.draft.summary |= {
        "images": drawing.num_steps,
        "view": str(view),
        "array": view.name,
        HEADLINE: f"{drawing.num_steps} images, {view}",
        DRAWN_BY: drawing.drawn_by,
    }
