"""A stage runs once for a recipe, and leaves an artifact or nothing."""

from __future__ import annotations

import importlib
import time
from dataclasses import replace
from threading import Thread

import pytest

from juicer.artifacts.workspace import Workspace, delete_tree
from juicer.errors import ConfigError, NothingLeft, WrongArtifactKind
from stages.runtime.context import StageInterrupted


def test_second_call_with_the_same_recipe_does_not_run_the_body(toys, session, store, diary):
    session = replace(session, display=diary, record=diary)
    first = toys.write(session, config=toys.ToyConfig(words=3))
    second = toys.write(session, config=toys.ToyConfig(words=3))
    assert first == second
    assert diary.states == [("write", "done"), ("write", "reused")]
    assert diary.progress == [(3, 3, {"mood": "good"})]


def test_waiting_for_another_run_is_told_and_ends_when_the_user_asks_for_an_end(toys, session, store, diary):
    session = replace(session, display=diary, record=diary)
    ref = toys.write(session, config=toys.ToyConfig(words=3))
    delete_tree(store.open(ref))
    ended = []

    def write():
        try:
            toys.write(session, config=toys.ToyConfig(words=3))
        except StageInterrupted:
            ended.append("interrupted")

    diary.states.clear()
    diary.progress.clear()
    with Workspace(store.cache / ".work").lock(ref.id):
        waiting = Thread(target=write)
        waiting.start()
        deadline = time.monotonic() + 10
        while not diary.progress and time.monotonic() < deadline:
            time.sleep(0.01)
        assert waiting.is_alive()
        session.stop.set()
        waiting.join(10)
        assert ended == ["interrupted"]
    assert diary.progress[0] == (0, 0, {"waiting_for": "another run"})
    assert diary.states == [("write", "stopped")]


def test_another_config_makes_another_artifact(toys, session):
    assert toys.write(session, config=toys.ToyConfig(words=1)) != toys.write(session, config=toys.ToyConfig(words=2))


def test_lineage_config_libraries_and_summary_are_recorded(toys, session, store, tmp_path):
    note = tmp_path / "note.txt"
    note.write_text("remember")
    episodes = toys.write(session, config=toys.ToyConfig(words=4))
    counted = toys.count(session, episodes=(episodes,), notes=(note,), config=toys.ToyConfig())
    manifest = store.manifest(counted)
    assert store.lineage(counted) == [episodes]
    assert manifest.recipe.inputs == {"episodes": (episodes,)}
    assert list(manifest.recipe.files) == ["notes/note.txt"]
    assert manifest.summary == {"total": 4}
    assert "numpy" in store.manifest(episodes).recipe.libraries
    assert "toys.simple" in manifest.recipe.modules
    assert not any(name.startswith("stages") for name in manifest.recipe.modules)


def test_changed_file_from_outside_makes_another_artifact(toys, session, tmp_path):
    note = tmp_path / "note.txt"
    refs = []
    for text in ("one", "two", "one"):
        note.write_text(text)
        refs.append(toys.count(session, episodes=(), notes=(note,), config=toys.ToyConfig()))
    assert refs[0] == refs[2] != refs[1]


def test_input_of_the_wrong_kind_is_refused_before_anything_runs(toys, session, store):
    episodes = toys.write(session, config=toys.ToyConfig())
    counted = toys.count(session, episodes=(episodes,), config=toys.ToyConfig())
    with pytest.raises(WrongArtifactKind, match=r"kind 'annotations' but stage 'count' needs 'episodes'"):
        toys.count(session, episodes=(counted,), config=toys.ToyConfig(words=9))
    assert len(store.refs()) == 2


def test_missing_file_and_two_files_of_one_name_are_refused(toys, session, tmp_path):
    with pytest.raises(ConfigError, match=r"gone\.txt' does not exist"):
        toys.count(session, episodes=(), notes=(tmp_path / "gone.txt",), config=toys.ToyConfig())
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "note.txt").write_text(folder)
    pair = (tmp_path / "a" / "note.txt", tmp_path / "b" / "note.txt")
    with pytest.raises(ConfigError, match=r"two of the notes are named 'note\.txt'"):
        toys.count(session, episodes=(), notes=pair, config=toys.ToyConfig())


@pytest.mark.parametrize("isolate", [False, True])
def test_failing_body_leaves_nothing_and_its_error_passes(toys, session, store, isolate, diary):
    with pytest.raises(NothingLeft, match="nothing to work on"):
        toys.fail(replace(session, isolate=isolate, display=diary), config=toys.ToyConfig())
    assert store.refs() == []
    assert diary.states == [("fail", "failed")]


def test_forced_stage_runs_again_once_and_keeps_its_id(toys, session, diary):
    first = toys.write(session, config=toys.ToyConfig())
    forced = replace(session, forced=frozenset({"write"}), display=diary, fresh=set())
    assert toys.write(forced, config=toys.ToyConfig()) == first
    assert toys.write(forced, config=toys.ToyConfig()) == first
    assert diary.states == [("write", "done"), ("write", "reused")]


def test_forced_stage_that_is_interrupted_leaves_what_was_there(toys, session, store):
    ref = toys.write(session, config=toys.ToyConfig())
    before = store.manifest(ref)
    forced = replace(session, forced=frozenset({"write"}), fresh=set())
    forced.stop.set()
    with pytest.raises(StageInterrupted):
        toys.write(forced, config=toys.ToyConfig())
    assert store.manifest(ref) == before
    assert store.verify(ref) == []


def test_interrupt_takes_effect_at_the_next_report(toys, session, store):
    session.stop.set()
    with pytest.raises(StageInterrupted):
        toys.write(session, config=toys.ToyConfig())
    assert store.refs() == []


def test_inputs_are_given_by_keyword(toys, session):
    with pytest.raises(TypeError, match="by keyword"):
        toys.write(session, toys.ToyConfig())


def test_stage_knows_its_config_and_which_roles_take_many(toys):
    assert toys.write.config_model is toys.ToyConfig
    assert toys.count.takes_many("episodes")
    assert not toys.write.takes_many("config")
    assert toys.write.description == "Write some words."


def test_a_plug_in_from_outside_counts_where_it_is_chosen_and_for_what_works_with_the_result(
    toys, session, store, tmp_path, monkeypatch
):
    (tmp_path / "gadget.py").write_text(
        "from typing import ClassVar\nfrom toys.simple import ToyConfig\n\n\n"
        "class GadgetConfig(ToyConfig):\n    network: ClassVar[str] = 'gadget_engine:Engine'\n"
    )
    (tmp_path / "gadget_engine.py").write_text("class Engine:\n    pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    gadget = importlib.import_module("gadget")
    episodes = toys.write(session, config=gadget.GadgetConfig())
    counted = toys.count(session, episodes=(episodes,), config=toys.ToyConfig())
    again = toys.count(session, episodes=(counted_anew(toys, session),), config=toys.ToyConfig())
    assert store.recipe(episodes).plugins == ("gadget", "gadget_engine")
    assert {"gadget", "gadget_engine"} <= set(store.recipe(counted).modules)
    assert store.recipe(counted).plugins == ()
    assert "gadget" not in store.recipe(again).modules


def counted_anew(toys, session):
    """Episodes that no gadget made."""
    return toys.write(session, config=toys.ToyConfig(words=5))
