"""What the annotation page asks of the server, and what it is told when something is wrong."""

from __future__ import annotations

import io
import shutil
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

from juicer.annotation.versions import read_versions
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Source
from juicer.pages.annotating.proposals import find_proposals
from juicer.pages.application import create_application
from juicer.pages.workplace import Workplace
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from tests.annotation.poses import part_poses
from tests.pages.annotating.conftest import propose_for

FIRST, SECOND = f"{0:016x}", f"{1:016x}"


@pytest.fixture
def client(tmp_path: Path) -> TestClient:
    return TestClient(create_application(Workplace(ArtifactStore(tmp_path / "data"), tmp_path / "data")))


@pytest.fixture
def address(fill) -> str:
    return f"/annotate/{fill([0, 3]).id}"


def work(client: TestClient, address: str):
    for _ in range(200):
        answer = client.get(f"{address}/work").json()
        if answer["ready"]:
            return answer
        time.sleep(0.05)
    raise AssertionError("proposals do not arrive")


def mark(client: TestClient, address: str, step: int, author: str = "Ada", after: int = 0, **more):
    marks = [{"episode": FIRST, "critical_state": 0, "step": step, "after": after, **more}]
    return client.post(f"{address}/marks", json={"author": author, "marks": marks})


def test_demonstrations_in_doubt_come_first(client, address):
    episodes = work(client, address)["episodes"]
    assert [each["id"] for each in episodes] == [SECOND, FIRST]
    assert episodes[0]["marks"][0]["proposal"] == {"step": 23, "confidence": 0.4}


def test_what_is_saved_names_its_author_and_the_proposal_that_it_answers(client, address, versions):
    work(client, address)
    answer = mark(client, address, 21, keys=2, seconds=1.5)
    assert answer.json()["marks"][0]["opinions"] == [{"author": "Ada", "step": 21, "version": 1}]
    (version,) = read_versions(versions)
    assert (version.author, version.step, version.proposal, version.confidence) == ("Ada", 21, 20, 0.95)
    assert (version.keys, version.seconds) == (2, 1.5)
    assert client.get(f"{address}/measures").json()["agreement"] == 1.0


def test_second_of_two_pages_is_shown_both_marks_and_overwrites_nothing(client, address, versions):
    mark(client, address, 20)
    late = mark(client, address, 25, "Bob")
    assert late.status_code == 409
    assert "meanwhile by Ada" in late.json()["error"]
    assert late.json()["marks"][0]["opinions"][0]["step"] == 20
    assert len(read_versions(versions)) == 1
    both = mark(client, address, 25, "Bob", after=1).json()["marks"][0]
    assert both["disputed"]
    assert both["agreed"] is None
    settled = mark(client, address, 20, "Bob", after=2, settles=True).json()["marks"][0]
    assert (settled["disputed"], settled["agreed"]) == (False, 20)


def undo(client: TestClient, address: str, *undone: tuple[str, int, int], author: str = "Ada"):
    """Take back versions, told by episode, newest version seen, and version."""
    marks = [
        {"episode": episode, "critical_state": 0, "after": after, "undoes": undoes} for episode, after, undoes in undone
    ]
    return client.post(f"{address}/undo", json={"author": author, "marks": marks})


def test_undoing_takes_back_ones_own_mark_only(client, address, versions):
    mark(client, address, 20)
    refused = undo(client, address, (FIRST, 1, 1), author="Bob")
    assert refused.status_code == 400
    assert "version 1 is not a mark of Bob" in refused.json()["error"]
    answer = undo(client, address, (FIRST, 1, 1)).json()
    assert answer["marks"][0]["opinions"] == []
    assert answer["marks"][0]["newest"] == 2


def test_marks_are_taken_back_together_or_not_at_all(client, address, versions):
    mark(client, address, 20)
    mark(client, address, 21, episode=SECOND)
    mark(client, address, 25, "Bob", after=2, episode=SECOND)
    before = versions.read_bytes()
    refused = undo(client, address, (FIRST, 1, 1), (SECOND, 2, 2))
    assert refused.status_code == 409
    assert "meanwhile by Bob" in refused.json()["error"]
    assert [len(each["opinions"]) for each in refused.json()["marks"]] == [1, 2]
    assert versions.read_bytes() == before
    answer = undo(client, address, (FIRST, 1, 1), (SECOND, 3, 2))
    assert answer.status_code == 200
    assert [[each["author"] for each in stands["opinions"]] for stands in answer.json()["marks"]] == [[], ["Bob"]]


def test_undoing_the_same_again_takes_back_nothing_older(client, address, versions):
    mark(client, address, 20)
    mark(client, address, 22, after=1)
    # The answer to the first attempt is lost.
    for _ in range(2):
        answer = undo(client, address, (FIRST, 2, 2))
        assert answer.status_code == 200
        assert [each["step"] for each in answer.json()["marks"][0]["opinions"]] == [20]
    assert len(read_versions(versions)) == 3


@pytest.mark.parametrize(
    ("change", "status", "sentence"),
    [
        ({"episode": "nobody"}, 409, "holds no episode nobody"),
        ({"critical_state": 1}, 409, "one_leg has 1 critical states"),
        ({"step": 9999}, 409, "and not 9999"),
        ({"step": -1}, 400, "is not valid"),
        ({"step": 1.5}, 400, "is not valid"),
        ({"more": 1}, 400, "is not valid"),
    ],
)
def test_marks_of_what_is_not_there_are_refused(client, address, versions, change, status, sentence):
    marks = [{"episode": FIRST, "critical_state": 0, "step": 20, "after": 0} | change]
    answer = client.post(f"{address}/marks", json={"author": "Ada", "marks": marks})
    assert answer.status_code == status
    assert sentence in answer.json()["error"]
    assert not versions.exists()


def test_what_is_not_there_cannot_be_taken_back(client, address, versions):
    mark(client, address, 20)
    before = versions.read_bytes()
    assert "holds no episode nobody" in undo(client, address, ("nobody", 1, 1)).json()["error"]
    marks = [{"episode": FIRST, "critical_state": 1, "after": 1, "undoes": 1}]
    answer = client.post(f"{address}/undo", json={"author": "Ada", "marks": marks})
    assert answer.status_code == 409
    assert "one_leg has 1 critical states" in answer.json()["error"]
    assert versions.read_bytes() == before


@pytest.mark.parametrize("ending", ["x.csv", "pdf"])
def test_labels_are_only_written_in_formats_that_are_read(client, address, ending):
    answer = client.get(f"{address}/labels.{ending}")
    assert answer.status_code == 400
    assert f"not written as '.{ending}'" in answer.json()["error"]


def test_name_that_steers_a_terminal_is_refused(client, address, versions):
    assert "plain text" in mark(client, address, 20, "\x1b[31m").json()["error"]
    assert not versions.exists()


def test_versions_edited_to_nonsense_are_a_sentence_and_stay_as_they_are(client, address, versions):
    versions.parent.mkdir()
    versions.write_text("nonsense\n")
    for answer in (client.get(f"{address}/work"), mark(client, address, 20)):
        assert answer.status_code == 400
        assert "line 1: it is not JSON" in answer.json()["error"]
    assert versions.read_text() == "nonsense\n"


def test_proposals_that_could_not_be_read_are_looked_for_again(client, address, tmp_path):
    (table,) = (tmp_path / "data" / "annotations").glob("*/annotations.parquet")
    whole = table.read_bytes()
    table.write_bytes(b"damaged")
    for _ in range(2):
        while (answer := client.get(f"{address}/work")).status_code == 200:
            assert not answer.json()["ready"]
        assert "juicer repair" in answer.json()["error"]
    table.write_bytes(whole)
    client.get(f"{address}/work")  # tells of the last search, and begins another
    assert work(client, address)["episodes"]
    assert mark(client, address, 21).status_code == 200


def test_requests_that_come_together_share_one_search(client, address, monkeypatch):
    searches = []

    def read_slowly(folder):
        time.sleep(0.3)
        return EpisodeReader(folder)

    def search(*arguments):
        searches.append(arguments)
        return {}

    monkeypatch.setattr("juicer.pages.annotating.desk.EpisodeReader", read_slowly)
    monkeypatch.setattr("juicer.pages.annotating.desk.find_proposals", search)
    with ThreadPoolExecutor(2) as together:
        answers = list(together.map(lambda _: client.get(f"{address}/measures"), range(2)))
    assert [answer.status_code for answer in answers] == [200, 200]
    work(client, address)
    assert len(searches) == 1


def test_more_sets_than_are_kept_open_are_searched_once_each(client, fill, monkeypatch):
    searches = []

    def search(store, data, ref, *_):
        searches.append(ref)
        return {}

    monkeypatch.setattr("juicer.pages.annotating.desk.find_proposals", search)
    addresses = [f"/annotate/{fill([0] * number).id}" for number in range(1, 7)]
    for _ in range(3):
        for address in addresses:
            work(client, address)
    assert len(searches) == len(set(searches)) == len(addresses)


def test_a_mark_waits_until_it_is_known_what_was_proposed(client, address, versions, monkeypatch):
    known = threading.Event()

    def find_slowly(*arguments):
        known.wait(30)
        return find_proposals(*arguments)

    monkeypatch.setattr("juicer.pages.annotating.desk.find_proposals", find_slowly)
    monkeypatch.setattr("juicer.pages.annotating.saying.PATIENCE_SECONDS", 0.05)
    early = mark(client, address, 21)
    assert (early.status_code, read_versions(versions)) == (409, [])
    assert "still being searched" in early.json()["error"]
    known.set()
    work(client, address)
    assert mark(client, address, 21).status_code == 200
    (version,) = read_versions(versions)
    assert (version.proposal, version.confidence) == (20, 0.95)


def test_artifact_that_is_deleted_while_its_page_is_open_is_a_sentence(client, address, tmp_path):
    work(client, address)
    shutil.rmtree(tmp_path / "data" / "episodes")
    for answer in (client.get(f"{address}/work"), mark(client, address, 20), client.get(f"{address}/{FIRST}/16.jpg")):
        assert answer.status_code == 404
        assert "no artifact answers to" in answer.json()["error"]


def test_folder_that_refuses_writes_is_a_sentence(client, address, versions):
    versions.parent.write_text("a file stands here")
    answer = mark(client, address, 20)
    assert answer.status_code == 507
    assert "nothing of this was saved" in answer.json()["error"]


def test_sheet_shows_the_steps_that_were_asked_for(client, address):
    def pixels(path: str):
        answer = client.get(f"{address}/{FIRST}/{path}")
        assert answer.status_code == 200, answer.text
        return np.asarray(Image.open(io.BytesIO(answer.content)), dtype=int)

    sheet, one = pixels("16.jpg"), pixels("18.jpg?count=1&view=wrist")
    assert sheet.shape == (3 * 240, 8 * 320, 3)
    assert np.abs(sheet[480:, 640:960] - one).mean() < 4
    assert np.abs(sheet[480:, 960:1280] - one).mean() < np.abs(sheet[:240, 640:960] - one).mean()


@pytest.mark.parametrize(
    "path", ["9999.jpg", "-1.jpg", "0.jpg?count=9", "0.jpg?count=0", "0.jpg?view=side", "0.jpg?view=wrist&view=wrist"]
)
def test_sheet_of_what_is_not_there_is_a_sentence(client, address, path):
    answer = client.get(f"{address}/{FIRST}/{path}")
    assert answer.status_code == 400
    assert answer.json()["error"]


def test_signals_have_an_entry_for_every_step(client, address):
    steps = next(each["steps"] for each in work(client, address)["episodes"] if each["id"] == FIRST)
    signals = client.get(f"{address}/{FIRST}/signals").json()
    plain = {name: values for name, values in signals.items() if name != "distance_m"}
    assert {len(values) for values in (*plain.values(), *signals["distance_m"])} == {steps}
    assert signals["distance_m"][0][-1] < signals["distance_m"][0][0]
    assert max(signals["contacts"]) >= 1


def test_agreed_marks_leave_as_tables(client, address):
    mark(client, address, 20)
    assert client.get(f"{address}/labels.csv").text == f"recording,step,critical_state\n{FIRST},20,0\n"
    assert client.get(f"{address}/labels.jsonl").json() == {"recording": FIRST, "step": 20, "critical_state": 0}
    assert client.get(f"{address}/labels.exe").status_code == 400


def test_every_critical_state_that_the_task_expects_is_listed_found_or_not(client, tmp_path, episode_factory):
    address = f"/annotate/{propose_for(tmp_path, episode_factory(9, task='lamp', num_parts=3), {2: 4}).id}"
    (only,) = work(client, address)["episodes"]
    assert [mark["proposal"] and mark["proposal"]["step"] for mark in only["marks"]] == [None, None, 4, None, None]
    assert all(mark["expected"] for mark in only["marks"])
    page = client.get(address).text
    assert page.count("The last step at which") == 5
    # Each is shown by examples of its own kind.
    assert page.count("the gripper is open, and still a little away from the") == 3
    assert page.count("is held, and still clear of what it goes into") == 2


@pytest.mark.parametrize("found", [{3: 1, 4: 6}, {4: 6}, {}])
def test_critical_states_ahead_of_a_correction_are_expected_of_it_even_if_not_found(
    client, tmp_path, episode_factory, found
):
    correction = episode_factory(
        9, task="lamp", num_parts=3, source=Source.CORRECTION, parent="0123456789abcdef", parent_step=300
    )
    correction.steps["part_poses"][0] = part_poses(get_task("lamp"), [0])
    (only,) = work(client, f"/annotate/{propose_for(tmp_path, correction, found).id}")["episodes"]
    assert [mark["expected"] for mark in only["marks"]] == [False, False, False, True, True]


def test_pages_show_what_is_there(client, address):
    mark(client, address, 20)
    chosen = client.get("/annotate", headers={"accept": "text/html"})
    assert address in chosen.text
    page = client.get(address).text
    assert "one_leg.versions.jsonl" in page
    assert "insert leg" in page
    assert client.get("/annotate/nothing", headers={"accept": "text/html"}).status_code == 404
