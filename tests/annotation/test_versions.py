"""What people say about critical states is kept, whoever else says something, and whatever happens meanwhile."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from juicer.annotation.measures import measure
from juicer.annotation.standing import agreed_labels, standing
from juicer.annotation.versions import Entry, read_versions, save, versions_path
from juicer.errors import AnnotationConflict, AnnotationsNotSaved, InvalidLabels

EPISODE, OTHER = "694280317a4adfb7", "47aee4c91856a8d3"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return versions_path(tmp_path, "one_leg")


def said(step: int | None, author: str = "Ada", after: int = 0, episode: str = EPISODE, **more) -> Entry:
    return Entry(episode=episode, critical_state=0, step=step, after=after, author=author, **more)


def agreed(path: Path) -> list[tuple[str, int]]:
    return [(label.recording, label.step) for label in agreed_labels(read_versions(path), path)]


def test_versions_are_numbered_and_nothing_that_was_said_changes(path: Path):
    save(path, [said(140), said(150, episode=OTHER)])
    before = path.read_bytes()
    (version,) = save(path, [said(142, after=1)])
    assert version.version == 3
    assert path.read_bytes().startswith(before)
    assert agreed(path) == [(EPISODE, 142), (OTHER, 150)]


def test_who_has_not_seen_the_newest_version_saves_nothing(path: Path):
    save(path, [said(140)])
    before = path.read_bytes()
    with pytest.raises(AnnotationConflict, match="was annotated meanwhile by Ada; look at both"):
        save(path, [said(150, "Bob", episode=OTHER), said(150, "Bob")])
    assert path.read_bytes() == before


def test_of_many_who_save_at_once_one_does(path: Path):
    def attempt(number: int) -> bool:
        try:
            save(path, [said(number, f"annotator {number}")])
        except AnnotationConflict:
            return False
        return True

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(attempt, range(24))) == 1
    assert len(read_versions(path)) == 1


def test_what_two_people_disagree_on_is_not_agreed_until_one_settles_it(path: Path):
    save(path, [said(140)])
    save(path, [said(150, "Bob", after=1)])
    (stands,) = standing(read_versions(path)).values()
    assert stands.is_disputed
    assert [(each.author, each.step) for each in stands.opinions] == [("Ada", 140), ("Bob", 150)]
    assert agreed(path) == []
    save(path, [said(140, "Bob", after=2, settles=True)])
    assert agreed(path) == [(EPISODE, 140)]
    assert measure(read_versions(path)).steps_between_annotators == 10


def test_two_who_say_the_same_agree_on_the_newest(path: Path):
    save(path, [said(140)])
    save(path, [said(142, "Bob", after=1)])
    assert agreed(path) == [(EPISODE, 142)]


def test_undoing_is_a_version_that_brings_back_what_was_said_before(path: Path):
    save(path, [said(140)])
    save(path, [said(150, after=1)])
    save(path, [said(None, after=2, undoes=2)])
    assert agreed(path) == [(EPISODE, 140)]
    save(path, [said(None, after=3, undoes=1)])
    assert agreed(path) == []
    for undoes, author in ((1, "Ada"), (3, "Ada"), (9, "Ada"), (2, "Bob")):
        with pytest.raises(InvalidLabels, match="could be taken back"):
            save(path, [said(None, author, after=4, undoes=undoes)])


def test_undoing_what_settled_a_dispute_opens_it_again(path: Path):
    save(path, [said(140)])
    save(path, [said(150, "Bob", after=1)])
    save(path, [said(140, "Bob", after=2, settles=True)])
    save(path, [said(None, "Bob", after=3, undoes=3)])
    (stands,) = standing(read_versions(path)).values()
    assert stands.is_disputed


@pytest.mark.parametrize("rest", [b'{"episode": "6942', b"{", b"\xff"])
def test_what_a_kill_leaves_of_a_line_is_passed_over_and_replaced(path: Path, rest: bytes):
    save(path, [said(140)])
    with path.open("ab") as file:
        file.write(rest)
    assert agreed(path) == [(EPISODE, 140)]
    save(path, [said(141, after=1)])
    assert [version.step for version in read_versions(path)] == [140, 141]


def test_a_last_line_whose_end_an_editor_took_away_still_counts(path: Path):
    save(path, [said(140)])
    path.write_bytes(path.read_bytes().rstrip(b"\n"))
    save(path, [said(141, after=1)])
    assert [version.step for version in read_versions(path)] == [140, 141]


LINE = {"episode": EPISODE, "critical_state": 0, "step": 140, "after": 0, "author": "Ada", "version": 1}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("nonsense", "line 1: it is not JSON"),
        ("", "line 1: it is not JSON"),
        ("[" * 100_000, "line 1: it is not JSON"),
        ("3", "line 1: must hold keys and values"),
        (json.dumps({**LINE, "step": "here"}), "line 1: step: must be a whole number, got 'here'"),
        (json.dumps({**LINE, "step": -1}), "step: must be at least 0, got -1"),
        (json.dumps({**LINE, "step": 140.5}), "step: must be a whole number"),
        (json.dumps({**LINE, "stp": 1}), "unknown key 'stp'; did you mean 'step'?"),
        (json.dumps({**LINE, "episode": "../../etc"}), "episode: must match"),
        (json.dumps({**LINE, "author": "\x1b[31m"}), "author: must be plain text"),
        (json.dumps({**LINE, "version": 7}), "line 1: version 7 stands in place of 1"),
        (json.dumps({**LINE, "step": None}), "must have either a step or a version that it undoes"),
    ],
)
def test_a_file_edited_to_nonsense_is_refused_in_one_sentence_and_left_alone(path: Path, line: str, message: str):
    path.parent.mkdir()
    path.write_text(f"{line}\n")
    for attempt in (lambda: read_versions(path), lambda: save(path, [said(150)])):
        with pytest.raises(InvalidLabels) as refusal:
            attempt()
        assert message in str(refusal.value)
        assert str(refusal.value).isprintable()
        assert len(str(refusal.value)) < 700
    assert path.read_text() == f"{line}\n"


def test_only_a_plain_file_of_sensible_size_is_read_or_written(path: Path):
    path.parent.mkdir()
    os.mkfifo(path)
    with pytest.raises(InvalidLabels, match="not a plain file"):
        read_versions(path)
    with pytest.raises((AnnotationsNotSaved, InvalidLabels)):
        save(path, [said(140)])


def test_a_full_disk_loses_nothing_and_says_so(path: Path):
    save(path, [said(140)])
    before = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 50, hard))
    try:
        with pytest.raises(AnnotationsNotSaved, match="File too large; nothing of this was saved"):
            save(path, [said(141, after=1)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, ignored)
    assert path.read_bytes() == before
    save(path, [said(141, after=1)])


KILLED = """
import sys
from pathlib import Path
from juicer.annotation.versions import Entry, save
for number in range(10**6):
    save(Path(sys.argv[1]), [Entry(episode=f"{number:016x}", critical_state=0, step=number, after=0, author="Ada")])
    print(number, flush=True)
"""


def test_what_was_confirmed_before_a_kill_is_there(path: Path):
    with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        confirmed = [int(process.stdout.readline()) for _ in range(20)]
        process.kill()
        confirmed += map(int, process.stdout.read().split())
    assert len(read_versions(path)) >= len(confirmed)
    save(path, [said(3)])


def on_page(step: int | None, keys: int, seconds: float, author: str = "Ada", **more) -> Entry:
    return said(step, author, keys=keys, seconds=seconds, tool="juicer 0.1, page", **more)


def test_measures_are_of_what_people_did(path: Path):
    save(path, [on_page(140, 1, 2.0, proposal=140), on_page(155, 4, 6, proposal=150, episode=OTHER)])
    save(path, [on_page(140, 1, 1.0, "Bob", after=1, proposal=140)])
    save(path, [on_page(None, 1, 1.0, after=2, undoes=2, episode=OTHER)])
    save(path, [on_page(149, 1, 2.0, after=4, proposal=150, episode=OTHER)])
    measures = measure(read_versions(path))
    assert (measures.demonstrations, measures.marks, measures.annotators, measures.undone) == (2, 2, 2, 1)
    assert (measures.judged, measures.keys, measures.seconds, measures.minutes) == (3, 8 / 3, 4.0, 0.2)
    assert measures.agreement == 1.0
    assert measures.steps_from_proposal == pytest.approx(1 / 3)
    assert (measures.steps_between_annotators, measures.compared) == (0, 1)
    assert measure([]).keys is None


def test_what_was_imported_says_nothing_of_what_judging_a_demonstration_took(path: Path):
    imported = [said(140, episode=f"{number:016x}", tool="juicer 0.1, import") for number in range(25)]
    save(path, [*imported, *(on_page(140, 2, 12.0, episode=f"{number:016x}") for number in range(25, 50))])
    measures = measure(read_versions(path))
    assert (measures.demonstrations, measures.elsewhere) == (50, 25)
    assert (measures.judged, measures.keys, measures.seconds, measures.minutes) == (25, 2.0, 12.0, 5.0)
    assert measure(read_versions(path)[:25]).seconds is None
    # What somebody marks on the page as well is no longer from elsewhere alone.
    save(path, [on_page(140, 1, 3.0, "Bob", episode=f"{0:016x}", after=1)])
    assert measure(read_versions(path)).elsewhere == 24
