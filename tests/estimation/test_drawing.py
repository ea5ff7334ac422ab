"""Images of displaced states: each by its label, and not drawn twice."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.displacements import Displacements
from juicer.estimation.drawing import DONE_FILE, StatesToDraw, draw_states
from juicer.estimation.scenes import MEASURED_STEPS, NEAR_STEPS, Recorded, displaced
from juicer.imaging.processes import DrawingProcesses
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
    sets = {"learned": StatesToDraw(chosen, Displacements())}
    return draw_states(reader, sets, VIEWS, folder, seed=seed, workers=workers)["learned"]


def test_every_image_shows_the_scene_of_its_label(reader, recorded, tmp_path):
    chosen = recorded.to_learn_from(70, near_critical=0.5)
    drawn = draw(reader, chosen, tmp_path)
    renderer = ViewRenderer("one_leg")
    for number, scene in enumerate(displaced(reader, chosen.steps, Displacements(), seed=3)):
        np.testing.assert_array_equal(drawn.observations["part_poses"][number], scene.part_poses)
        if number in (0, 40, 69):
            for view in VIEWS:
                image = renderer.draw(scene.positions, view, scene.proprioception[:3])
                np.testing.assert_array_equal(drawn.images[view.name][number], image)
    renderer.close()


def test_what_was_drawn_before_a_kill_is_not_drawn_again(reader, recorded, tmp_path, monkeypatch):
    chosen = recorded.to_learn_from(10, near_critical=0.5)
    drawn = draw(reader, chosen, tmp_path)
    monkeypatch.delattr("juicer.estimation.drawing.DrawingProcesses")
    again = draw(reader, chosen, tmp_path)
    assert again.drawn_by == drawn.drawn_by
    for name in drawn.images:
        np.testing.assert_array_equal(again.images[name], drawn.images[name])
    for name in drawn.observations:
        np.testing.assert_array_equal(again.observations[name], drawn.observations[name])


def test_a_kill_while_what_is_true_was_written_costs_no_more_than_drawing_again(
    reader, recorded, tmp_path, monkeypatch
):
    chosen = recorded.to_learn_from(10, near_critical=0.5)
    before = draw(reader, chosen, tmp_path / "before")

    def killed(file, **_):
        file.write(b"PK half of it")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("juicer.estimation.drawing.np.savez", killed)
        with pytest.raises(KeyboardInterrupt):
            draw(reader, chosen, tmp_path / "killed")
    again = draw(reader, chosen, tmp_path / "killed")
    for name in before.observations:
        np.testing.assert_array_equal(again.observations[name], before.observations[name])
    assert {path.name for path in (tmp_path / "killed" / "learned").iterdir()} == {
        DONE_FILE,
        *(view.name for view in VIEWS),
    }


def test_room_is_asked_for_once_and_for_all(reader, recorded, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("juicer.estimation.drawing.require_room", lambda _, needed, what: asked.append((needed, what)))
    sets = {
        name: StatesToDraw(recorded.to_learn_from(number, 0.5), Displacements())
        for name, number in (("a", 3), ("b", 4))
    }
    draw_states(reader, sets, VIEWS, tmp_path, seed=0, workers=1)
    assert asked == [(7 * 3 * (16 * 16 + 24 * 16), "the images of 7 displaced states")]


def test_one_set_of_processes_draws_every_view_of_every_set(reader, recorded, tmp_path, monkeypatch):
    started = []

    class Counted(DrawingProcesses):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            started.extend(self.pids)

    monkeypatch.setattr("juicer.estimation.drawing.DrawingProcesses", Counted)
    states = StatesToDraw(recorded.to_learn_from(3, 0.5), Displacements())
    draw_states(reader, {"a": states, "b": states}, VIEWS, tmp_path, seed=0, workers=1)
    assert len(started) == 1


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
