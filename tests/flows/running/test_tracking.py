"""What MLflow is told of a model beside its artifacts."""

from __future__ import annotations

from flows.config import StudyConfig
from flows.loop import ModelOutcome
from flows.running.tracking import Tracking
from juicer.artifacts.ref import ArtifactRef
from juicer.expert.human import Human
from stages.augment import AugmentConfig
from stages.record import RecordSection


class Noting:
    """Recorder that keeps the last model it is told of."""

    def note(self, model):
        self.model = model


def test_all_that_shapes_a_round_is_among_the_parameters():
    config = StudyConfig(
        name="study",
        conditions=("ta_ci",),
        seeds=(0,),
        rounds=3,
        record=RecordSection(temperament=Human()),
        augment_retraining=AugmentConfig(num_snippets=7),
    )
    noting = Noting()
    evaluation = ArtifactRef("evaluation", "1" * 16)
    Tracking(noting, config).finish(ModelOutcome("ta_ci", "TA+CI", 0, ArtifactRef("checkpoint", "0" * 16), evaluation))
    params = noting.model.params
    assert (params["rounds"], params["augment_retraining.num_snippets"]) == (3, 7)
    assert (params["correct.corrections"], params["correct.temperament.kind"]) == (10, "human")
