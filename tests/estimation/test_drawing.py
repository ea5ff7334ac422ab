"""Images of displaced states: each by its label, and not drawn twice."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.displacements import Displacements
from juicer.estimation.drawing import draw_lessons
from juicer.estimation.scenes import MEASURED_STEPS, NEAR_STEPS, Recorded, displaced
from juicer.imaging.renderer import ViewRenderer
from juicer.storage.annotations import Annotation
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.views import GazeCrop, View

pytestmark = pytest.mark.usefixtures("drawing")
VIEWS = (View(camera="front", crop=GazeCrop(), width=16, height=16), View(camera="wrist", width=24, height=16))


@pytest.fixture(scope="module")
def reader(tmp_path_factory, insertions):
    folder = tmp_path_factory.mktemp("episodes")
    write_episodes(folder, insertions, {})
    return EpisodeReader(folder)


@pytest.fixture(scope="module")
def recorded(reader):
    rows = [Annotation(record.episode_id, 20, 0, "human", 1.0) for record in reader.records]
    return Recorded(reader, rows, held_out_share=0.5, seed=0)


def draw(reader, chosen, folder, seed=3, workers=2):
    return draw_lessons(reader, chosen, Displacements(), VIEWS, folder, seed=seed, workers=workers)


def test_every_image_shows_the_scene_of_its_label(reader, recorded, tmp_path):
    chosen = recorded.to_learn_from(70, near_critical=0.5)
    lessons = draw(reader, chosen, tmp_path)
    renderer = ViewRenderer("one_leg")
    for number, scene in enumerate(displaced(reader, chosen.steps, Displacements(), seed=3)):
        np.testing.assert_array_equal(lessons.observations["part_poses"][number], scene.part_poses)
        if number in (0, 40, 69):
            for view in VIEWS:
                image = renderer.draw(scene.positions, view, scene.proprioception[:3])
                np.testing.assert_array_equal(lessons.images[view.name][number], image)
    renderer.close()


def test_what_was_drawn_before_a_kill_is_not_drawn_again(reader, recorded, tmp_path, monkeypatch):
    chosen = recorded.to_learn_from(10, near_critical=0.5)
    lessons = draw(reader, chosen, tmp_path)
    monkeypatch.delattr("juicer.estimation.drawing.DrawingProcesses")
    again = draw(reader, chosen, tmp_path)
    assert again.drawn_by == lessons.drawn_by
    for name in lessons.images:
        np.testing.assert_array_equal(again.images[name], lessons.images[name])
    for name in lessons.observations:
        np.testing.assert_array_equal(again.observations[name], lessons.observations[name])


def test_the_number_of_processes_changes_nothing(reader, recorded, tmp_path):
    chosen = recorded.to_learn_from(70, near_critical=0.5)
    one, two = (draw(reader, chosen, tmp_path / str(workers), workers=workers) for workers in (1, 2))
    for name in one.images:
        np.testing.assert_array_equal(one.images[name], two.images[name])


def test_what_is_measured_on_comes_from_other_demonstrations(reader, recorded):
    learned, measured = recorded.to_learn_from(50, near_critical=0.5), recorded.to_be_measured_on()
    owner = [set(np.searchsorted(reader.episode_ends, each.steps, side="right")) for each in (learned, measured)]
    assert len(owner[0]) == len(owner[1]) == 1
    assert owner[0] != owner[1]


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_a_share_lies_around_critical_states(reader, share):
    rows = [Annotation(record.episode_id, 0, 0, "human", 1.0) for record in reader.records]
    chosen = Recorded(reader, rows, held_out_share=0.5, seed=0).to_learn_from(400, near_critical=share)
    starts = reader.episode_ends - reader.lengths
    step = chosen.steps - starts[np.searchsorted(reader.episode_ends, chosen.steps, side="right")]
    assert (step <= NEAR_STEPS).mean() == pytest.approx(share, abs=0.08)
    assert (chosen.critical_states == 0).mean() == pytest.approx((step <= MEASURED_STEPS).mean())
