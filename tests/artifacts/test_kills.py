"""SIGKILL at any moment: the artifact is absent or whole, scratch survives, and a restart leaves no litter."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

Make = Callable[..., ArtifactRef]
Litter = Callable[[ArtifactStore], list[str]]

CHILD = """
import json, os, signal, sys, time
from pathlib import Path
from juicer.artifacts import local, store as store_module, workspace
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore

url, content, moment = sys.argv[1], json.loads(sys.argv[2]), sys.argv[3]

def die(*arguments, **options):
    os.kill(os.getpid(), signal.SIGKILL)

def after(module, name):
    original = getattr(module, name)
    def call(*arguments, **options):
        original(*arguments, **options)
        die()
    setattr(module, name, call)

if moment == "hashing":
    store_module.describe_files = die
if moment == "syncing":
    local.sync_tree = die
if moment == "manifest":
    after(local, "sync_tree")
if moment == "renamed":
    local.sync = die
if moment == "committed":
    store_module.discard_tree = die
if moment == "cleared":
    clear = local.LocalBackend._clear
    local.LocalBackend._clear = lambda *arguments: (clear(*arguments), die())
if moment == "replaced":
    local.discard_tree = lambda path: path.parent.name == "graves" and path.exists() and die()

replacing = len(sys.argv) > 4
with ArtifactStore(url).create(Recipe.from_json(content), replacing=replacing) as draft:
    (draft.scratch / "step-100").write_bytes(b"resume from here")
    (draft.path / "a.bin").write_bytes(b"0123456789")
    if moment == "half":
        with (draft.path / "b.bin").open("wb") as file:
            file.write(bytes(5000))
            die()
    for number in range(200):
        (draft.path / f"{number}.bin").write_bytes(bytes(1000))
        if moment == "slowly":
            print(number, flush=True)
            time.sleep(0.002)
    if moment == "full":
        die()
"""


def start(store: ArtifactStore, recipe: Recipe, moment: str, *, replacing: bool = False) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", CHILD, store.url, json.dumps(recipe.to_json()), moment]
    command += ["replacing"] if replacing else []
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize("moment", ["half", "full", "hashing", "syncing", "manifest"])
def test_killed_before_the_rename_there_is_no_artifact(
    store: ArtifactStore, recipe: Recipe, make: Make, litter: Litter, moment: str
) -> None:
    with start(store, recipe, moment) as child:
        assert child.wait() == -signal.SIGKILL
    assert store.find(recipe) is None
    assert store.refs() == []
    with store.create(recipe) as draft:
        assert not draft.adopted
        assert list(draft.path.iterdir()) == []
        assert (draft.scratch / "step-100").read_bytes() == b"resume from here"
        (draft.path / "a.bin").write_bytes(b"0123456789")
    assert store.verify(recipe.ref) == []
    assert litter(store) == []


@pytest.mark.parametrize("moment", ["renamed", "committed"])
def test_killed_after_the_rename_the_artifact_is_whole(
    store: ArtifactStore, recipe: Recipe, make: Make, litter: Litter, moment: str
) -> None:
    with start(store, recipe, moment) as child:
        assert child.wait() == -signal.SIGKILL
    assert store.find(recipe) == recipe.ref
    assert store.verify(recipe.ref) == []
    make(store, replace(recipe, code="next"))
    assert litter(store) == []


@pytest.mark.parametrize("kills", [4, pytest.param(25, marks=pytest.mark.slow)])
def test_killed_at_any_moment_the_artifact_is_absent_or_whole(
    store: ArtifactStore, recipe: Recipe, litter: Litter, kills: int
) -> None:
    chance = random.Random(0)
    for attempt in range(kills):
        tried = replace(recipe, config={"attempt": attempt})
        with start(store, tried, "slowly") as child:
            assert child.stdout is not None
            child.stdout.readline()
            time.sleep(chance.uniform(0, 0.6))
            child.kill()
        if store.find(tried):
            assert store.verify(tried.ref) == []
    with start(store, recipe, "") as child:
        assert child.wait() == 0
    assert [path for path in litter(store) if path.startswith("drafts")] == []


@pytest.mark.parametrize("moment", ["half", "full", "hashing", "syncing", "manifest", "cleared", "renamed", "replaced"])
@pytest.mark.parametrize("damaged", [False, True])
def test_killed_while_an_artifact_is_replaced_nothing_of_it_is_lost(
    store: ArtifactStore, recipe: Recipe, make: Make, litter: Litter, moment: str, damaged: bool
) -> None:
    before = make(store, recipe, {"a.bin": b"old"})
    old = store.manifest(before)
    if damaged:
        (store.cache / str(before) / "a.bin").write_bytes(b"x")
    with start(store, recipe, moment, replacing=True) as child:
        child.wait()
    # Work on something else is the occasion on which what was left is cleared away.
    make(store, replace(recipe, code="next"))
    if store.find(recipe) is None:
        assert damaged
        assert moment == "cleared"
    else:
        is_old = store.manifest(before) == old
        assert [str(finding) for finding in store.verify(before)] == (
            ["file 'a.bin' has 1 bytes instead of 3"] if damaged and is_old else []
        )
        assert is_old == (moment not in ("renamed", "replaced"))
    assert [path for path in litter(store) if not path.startswith("scratch")] == []
    kept = [(Path(aside) / "a.bin").read_bytes() for aside in store.asides(before)]
    assert kept == ([b"x"] if damaged and moment in ("cleared", "renamed", "replaced") else [])


def test_the_draft_of_a_dead_process_is_cleaned_up_by_work_on_another_id(
    store: ArtifactStore, recipe: Recipe, make: Make, litter: Litter
) -> None:
    with start(store, recipe, "full") as child:
        child.wait()
    assert f"drafts/{recipe.id}/a.bin" in litter(store)
    make(store, replace(recipe, code="other"))
    # Its scratch is the next attempt's.
    assert litter(store) == [f"scratch/{recipe.id}", f"scratch/{recipe.id}/step-100"]


def test_the_draft_of_a_living_process_is_left_alone(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    with start(store, recipe, "slowly") as child:
        assert child.stdout is not None
        child.stdout.readline()
        make(store, replace(recipe, code="other"))
        assert (store.cache / ".work" / "drafts" / recipe.id / "a.bin").exists()
        child.communicate()
    assert store.verify(recipe.ref) == []
