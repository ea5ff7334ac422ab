"""Images of a view at every step of episodes, drawn from the stored states: derived, never the only copy."""

from __future__ import annotations

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.storage.columns import DRAWN_BY, write_columns
from juicer.storage.episodes import EpisodeReader
from juicer.storage.room import require_room
from juicer.views import View
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class RenderConfig(StrictConfig):
    """What is drawn."""

    view: View


@stage(
    kind="columns",
    inputs={"episodes": "episodes"},
    libraries=("mujoco", "numpy", "zarr"),
    noun="images",
    counts="images",
    headline=("images",),
)
def render(context: StageContext, *, episodes: ArtifactRef, config: RenderConfig) -> None:
    """Draw a view at every step of episodes, as it was seen when it happened."""
    from juicer.imaging.recorded import drawing_of

    view = config.view
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    with drawing_of(reader, view, context.machine.workers) as drawing:
        require_room(context.draft.path, drawing.stored_bytes(), f"the images of {view} of {episodes}")
        write_columns(
            context.draft.path,
            [view.column],
            ({view.name: images} for images in drawing.episodes(context.progress)),
            artifact=episodes.id,
            episode_ends=reader.episode_ends,
            facts={"view": view.model_dump_json(), DRAWN_BY: drawing.gl},
        )
    context.draft.summary |= {
        "images": int(reader.lengths.sum()),
        "view": str(view),
        "array": view.name,
        DRAWN_BY: drawing.gl,
    }
