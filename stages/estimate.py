"""An estimator learns to read off images where parts are, from recorded states and displaced ones."""

from __future__ import annotations

from collections.abc import Mapping

from juicer.artifacts.manifest import HEADLINE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import Seed, StrictConfig
from juicer.displacements import Displacements
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.storage.annotations import read_annotations
from juicer.storage.columns import DRAWN_BY
from juicer.storage.curves import CurveWriter
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

UNDISPLACED = Displacements(**dict.fromkeys(Displacements.model_fields, 0.0))


class EstimateConfig(StrictConfig):
    """What is estimated, from what, and how that is learned."""

    encoder: EstimatedConfig = EstimatedConfig()
    seed: Seed = 0


@stage(
    kind="estimator",
    inputs={"episodes": "episodes", "annotations": "annotations"},
    libraries=("mujoco", "numpy", "torch"),
    noun="states",
    counts="states",
    needs="device",
)
def estimate(context: StageContext, *, episodes: ArtifactRef, annotations: ArtifactRef, config: EstimateConfig) -> None:
    """Learn where parts are from displaced renderings of recorded states; the poses are the simulator's."""
    from juicer.estimation.drawing import StatesToDraw, draw_states
    from juicer.estimation.learning import learn
    from juicer.estimation.scenes import Recorded
    from juicer.policy.encoders.estimated.estimator import build_estimator
    from juicer.policy.encoders.estimated.files import save_estimator
    from juicer.policy.feature_spec import feature_spec
    from juicer.policy.pretrained.loading import load_pretrained

    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    reader.require_state()
    estimator, seed, scratch = config.encoder.estimator, config.seed, context.draft.scratch
    rows = read_annotations(context.store.open(annotations, "annotations"))
    recorded = Recorded(reader, rows, estimator.validation_fraction, seed)
    task = get_task(reader.records[0].task)
    untaught = build_estimator(config.encoder, task.name, feature_spec(task.name), seed)
    load_pretrained(untaught, context.machine.weights)
    learned_from = recorded.to_learn_from(estimator.states, estimator.near_critical)
    drawn = draw_states(
        reader,
        {
            "learned": StatesToDraw(learned_from, estimator.displacements),
            "held_out": StatesToDraw(recorded.to_be_measured_on(), UNDISPLACED),
        },
        tuple(estimator.views.values()),
        scratch,
        seed=seed,
        workers=context.machine.workers,
        progress=context.progress,
    )
    curves = CurveWriter(scratch, context.metrics)
    learned = learn(
        untaught,
        drawn["learned"],
        drawn["held_out"],
        tuple(zip(task.critical_state_names, task.critical_states, strict=True)),
        seed=seed,
        identity=context.draft.ref.id,
        scratch=scratch / "state",
        device=context.machine.device,
        progress=context.progress,
        metrics=curves,
    )
    save_estimator(context.draft.path, learned.estimator)
    curves.finish(context.draft.path)
    context.draft.summary |= {
        "task": task.name,
        "states": estimator.states,
        "steps": estimator.steps,
        DRAWN_BY: sorted({name for each in drawn.values() for name in each.drawn_by}),
        **learned.facts,
        "train/loss": learned.loss,
        "validation/loss": learned.errors.loss,
        "error_mm": dict(learned.errors.error_mm),
        "error_deg": dict(learned.errors.error_deg),
        HEADLINE: _headline(estimator.states, learned.errors.error_mm),
    }


def _headline(states: int, error_mm: Mapping[str, float]) -> str:
    """E.g. ``32,000 states; off by 0.9 mm at insert leg``."""
    errors = ", ".join(f"{error:.1f} mm at {name}" for name, error in error_mm.items())
    return f"{states:,} states" + (f"; off by {errors}" if errors else "")
