"""What belongs to which round of a model's making."""

from __future__ import annotations

import pytest

from stages.tracking.history import read_history


class Rounds:
    """Makes models round by round, each from all that its predecessors brought."""

    def __init__(self, study):
        self.study = study
        self.episodes, self.selections = [study.episodes()], []

    def train(self):
        """Train on what there is."""
        return self.study.train("dagger", 0, self.episodes, self.selections)

    def turn(self, number, kept, corrected):
        """Train, collect, and keep what a turn brings."""
        inputs = {"checkpoint": (self.train(),)}
        rollouts = self.study.put("collect", "episodes", config={"turn": number}, inputs=inputs, episodes=10)
        inputs = {"episodes": (rollouts,)}
        if kept:
            self.selections.append(self.study.put("select", "selection", inputs=inputs, kept=3))
            self.episodes.append(rollouts)
        if corrected:
            self.episodes.append(self.study.put("correct", "episodes", inputs=inputs, corrections=2))


@pytest.fixture
def history(store, study):
    """A model of four rounds, of which the first brings corrections alone, the third successes alone."""
    rounds = Rounds(study)
    for number, (kept, corrected) in enumerate([(False, True), (True, True), (True, False)], start=1):
        rounds.turn(number, kept, corrected)
    inputs = {"checkpoint": (rounds.train(),)}
    return read_history(store, study.put("evaluate", "evaluation", inputs=inputs))


def stages(history, prefix):
    return sorted(history.known[ref].recipe.stage for ref, found in history.rounds.items() if found == prefix)


def test_a_round_has_its_number_whatever_the_one_before_it_brought(history):
    assert stages(history, "round_1/") == ["collect", "correct", "dataset", "train"]
    assert stages(history, "round_2/") == ["collect", "correct", "dataset", "select", "train"]
    assert stages(history, "round_3/") == ["collect", "dataset", "select", "train"]
    assert stages(history, "") == ["dataset", "evaluate", "ingest", "record", "train"]


def test_the_time_of_a_model_includes_what_was_chosen_and_corrected_in_its_rounds(history):
    shared = sum(
        each.seconds for each in history.known.values() if each.recipe.stage in ("record", "ingest", "dataset")
    )
    assert history.seconds == pytest.approx(sum(each.seconds for each in history.known.values()) - shared)
