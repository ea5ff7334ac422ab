"""Commands that look into the store name what they could not look at, and leave alone what is not juicer's."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from flows.command.cli import call
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore

NOBODY = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
TO_ALL = 0o755


@pytest.fixture
def place():
    """A folder that every user may enter."""
    folder = Path(tempfile.mkdtemp(prefix="juicer-test-"))
    folder.chmod(TO_ALL)
    yield folder
    for path in (folder, *(path for path in folder.rglob("*") if path.is_dir() and not path.is_symlink())):
        path.chmod(TO_ALL)
    shutil.rmtree(folder)


@pytest.fixture
def store(place, monkeypatch):
    monkeypatch.setenv("JUICER_DATA", str(place / "data"))
    return ArtifactStore(place / "data")


@pytest.fixture
def refs(store):
    """Episodes, annotations of them, and a selection from both."""
    made = []
    for kind in ("episodes", "annotations", "selection"):
        recipe = Recipe(f"make {kind}", kind, inputs={"parents": tuple(made)})
        with store.create(recipe) as draft:
            (draft.path / "a.bin").write_bytes(b"0123456789")
            draft.summary |= {"episodes": 1}
        made.append(recipe.ref)
    return made


def finish(capsys, *arguments, status=0):
    assert call([*arguments]) == status
    captured = capsys.readouterr()
    assert len(captured.err.splitlines()) == (1 if status else 0)
    return captured.err if status else captured.out


def as_nobody(*arguments):
    """Status, output and complaint of a command run by a user without any rights."""
    prefix = NOBODY if os.geteuid() == 0 else []
    command = [*prefix, sys.executable, "-m", "flows.command.cli", *arguments]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "Traceback" not in result.stderr
    return result.returncode, result.stdout, result.stderr


def test_verify_leaves_alone_what_is_not_juicers(capsys, store, refs):
    (store.cache / "episodes" / "notes").mkdir()
    shutil.copytree(store.cache / str(refs[0]), store.cache / f"{refs[0]}.before")
    (store.cache / "episodes" / ".DS_Store").write_text("x")
    assert finish(capsys, "verify") == "3 artifacts are as written\n"
    assert "no artifact answers to 'notes'" in finish(capsys, "repair", "notes", status=1)
    assert (store.cache / "episodes" / "notes").is_dir()


def test_verify_says_which_litter_to_remove_and_does_not_fail(capsys, store, refs):
    (store.cache / str(refs[0]) / ".DS_Store").write_text("x")
    out = finish(capsys, "verify")
    assert f"{refs[0]}: file '.DS_Store' does not belong to it; remove that from {store.cache / str(refs[0])}" in out
    assert "3 artifacts are as written" in out
    found = json.loads(finish(capsys, "verify", "--json"))
    assert found["litter"] == {str(refs[0]): ["file '.DS_Store' does not belong to it"]}
    assert finish(capsys, "repair", refs[0].id) == f"{refs[0]} is whole; nothing to repair\n"


def test_verify_fails_for_a_stray_file_without_pointing_to_repair(capsys, store, refs):
    (store.cache / str(refs[0]) / "notes.txt").write_text("mine")
    line = finish(capsys, "verify", status=1)
    assert "1 of 3 artifacts hold what does not belong there" in line
    assert "file 'notes.txt' does not belong to it; remove that" in line
    assert "repair" not in line


def test_a_manifest_that_was_written_into_is_mended_and_nothing_is_deleted(capsys, store, refs):
    path = store.cache / str(refs[0]) / "manifest.json"
    whole = path.read_text()
    path.write_text(whole + "\n")
    assert "1 of 3 artifacts are damaged" in finish(capsys, "verify", status=1)
    out = finish(capsys, "repair", refs[0].id)
    assert f"restored {refs[0]} without computing anything" in out
    assert path.read_text() == whole


def test_an_artifact_whose_manifest_is_lost_is_moved_aside(capsys, store, refs):
    path = store.cache / str(refs[0]) / "manifest.json"
    path.write_text("{}")
    line = finish(capsys, "repair", refs[0].id, status=1)
    aside = store.cache / ".aside" / str(refs[0]) / "1"
    assert f"nothing was deleted: all of it is now in '{aside}'; run the flow that made it again" in line
    assert (aside / "a.bin").read_bytes() == b"0123456789"


@pytest.mark.parametrize("mode", [0o000, 0o111])
@pytest.mark.usefixtures("python_of_nobody")
def test_a_folder_that_cannot_be_read_is_named_and_fails_every_command_that_needs_it(store, refs, mode):
    (store.cache / "episodes").chmod(mode)
    hidden = f"folder '{store.cache / 'episodes'}' cannot be read (Permission denied)"
    for command in (["verify"], ["ls"], ["show", refs[0].id], ["lineage", refs[0].id], ["show", refs[1].id[:4]]):
        status, _, err = as_nobody(*command)
        assert status == 1, command
        assert hidden in err, command
    status, out, _ = as_nobody("verify", "--json")
    assert status == 1
    assert json.loads(out)["unseen"] == [hidden]
    assert json.loads(out)["checked"] == 2
    status, out, _ = as_nobody("ls", "--json")
    assert status == 1
    assert len(json.loads(out)) == 2


@pytest.mark.usefixtures("python_of_nobody")
def test_a_store_that_cannot_be_read_is_named(store, refs):
    store.cache.chmod(0)
    for command in (["verify"], ["ls"], ["show", refs[0].id], ["lineage", refs[0].id]):
        status, _, err = as_nobody(*command)
        assert status == 1, command
        assert f"folder '{store.cache}' cannot be read (Permission denied)" in err, command


@pytest.mark.usefixtures("python_of_nobody")
def test_an_artifact_that_cannot_be_read_is_named_and_not_called_damaged(store, refs):
    (store.cache / str(refs[0])).chmod(0)
    for command in (["verify"], ["ls"], ["show", refs[0].id], ["lineage", refs[1].id]):
        status, _, err = as_nobody(*command)
        assert status == 1, command
        assert "'manifest.json' cannot be read (Permission denied)" in err, command
        assert "damaged" not in err, command
    status, _, err = as_nobody("repair", refs[0].id)
    assert status == 1
    assert f"the data folder '{store.cache}' cannot be written: you have no right to write in it" in err


@pytest.mark.usefixtures("python_of_nobody")
def test_a_data_folder_that_may_only_be_read_is_enough_for_looking(store, refs):
    for command in (["verify"], ["ls"], ["show", refs[0].id], ["lineage", refs[2].id]):
        status, out, err = as_nobody(*command)
        assert (status, err) == (0, ""), command
        assert out


def test_a_store_that_is_not_there_is_no_mistake_but_said(capsys, store):
    assert "no artifacts in" in finish(capsys, "ls")
    assert "there is no such place yet" in finish(capsys, "verify")
    assert not store.cache.exists()


def test_a_store_that_is_a_file_is_named(capsys, store):
    store.cache.write_text("mine")
    for command in (["ls"], ["verify"], ["show", "0123"]):
        assert f"folder '{store.cache}' cannot be read (Not a directory)" in finish(capsys, *command, status=1)
    assert f"the data folder '{store.cache}' cannot be created" in finish(capsys, "repair", "0123", status=1)


def test_texts_from_elsewhere_cannot_steer_the_terminal(capsys, store):
    recipe = Recipe("x\x1b[2J", "episodes", config={"a\x1b[31m": "b\nc"}, files={"logs/\x1b]0;x": "00"})
    with store.create(recipe) as draft:
        (draft.path / "a\x1b[2J.bin").write_bytes(b"1")
        draft.summary |= {"reason": "\x1b[2J" + "x" * 20_000_000, "\x1b": "\x9b"}
    assert sum(map(len, map(str, store.manifest(recipe.ref).summary.values()))) < 10_000
    for command in (["ls"], ["show", recipe.id], ["lineage", recipe.id], ["verify"]):
        out = finish(capsys, *command)
        assert all(line.isprintable() for line in out.splitlines()), command
        assert len(out) < 20_000
    (store.cache / str(recipe.ref) / "\x1b[2J").write_text("")
    assert all(line.isprintable() for line in finish(capsys, "verify", status=1).splitlines())


def test_lists_are_complete_or_fail(capsys, store, refs):
    (store.cache / str(refs[0]) / "manifest.json").write_text("{}")
    assert call(["ls"]) == 1
    captured = capsys.readouterr()
    assert refs[1].id in captured.out
    assert f"the list is not complete: artifact {refs[0]} is damaged" in captured.err


def test_values_are_shown_as_configurations_write_them(capsys, store):
    recipe = Recipe("train", "checkpoint", config={"learn": True, "grasp": None, "names": ["a"], "kind": "mlp"})
    with store.create(recipe) as draft:
        (draft.path / "a.bin").write_bytes(b"1")
    lines = [line.strip() for line in finish(capsys, "show", recipe.id).splitlines()]
    assert {"learn: true", "grasp: null", 'names: ["a"]', "kind: mlp"} <= set(lines)
