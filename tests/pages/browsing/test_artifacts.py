"""The list of artifacts and the page of each tell what there is, whatever state the store is in."""

from __future__ import annotations

import html
import re
import threading

import pytest

from juicer.artifacts import catalog
from juicer.artifacts.manifest import MANIFEST_NAME
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import KINDS
from tests.pages.conftest import commit


def listed(text: str) -> set[str]:
    return set(re.findall(r'href="/artifacts/([a-z]+/[0-9a-f]{16})"', text))


def names(*refs) -> set[str]:
    return set(map(str, refs))


def test_empty_store_says_what_to_do(client):
    assert "juicer run smoke" in client.get("/").text


@pytest.mark.parametrize("page", ["/episodes", "/lineage"])
def test_page_about_nothing_offers_what_it_can_be_about(client, run, page):
    assert f'href="{page}?artifact={run.evaluation}"' in client.get(page).text


@pytest.mark.parametrize("page", ["/", "/episodes", "/lineage", "/lineage?artifact={}", "/annotate"])
def test_every_page_about_the_store_says_where_there_may_be_more_that_cannot_be_looked_at(client, run, page):
    folder = run.store.cache / "episodes"
    folder.rename(folder.with_name("elsewhere"))
    # Which nobody can look through, whatever their rights.
    folder.symlink_to(folder)
    text = html.unescape(client.get(page.format(run.logs)).text)
    assert f"There may be more artifacts: folder '{folder}' cannot be read" in text


@pytest.mark.parametrize("page", ["/", "/episodes", "/lineage", "/annotate"])
def test_no_page_says_that_there_is_nothing_where_nothing_can_be_looked_at(client, store, page):
    assert "<code>juicer" in client.get(page).text
    store.cache.mkdir(exist_ok=True)
    for kind in KINDS:
        (store.cache / kind).symlink_to(store.cache / kind)
    assert "<code>juicer" not in client.get(page).text


def test_every_artifact_is_listed(client, run):
    text = client.get("/").text
    assert listed(text) == names(run.logs, run.episodes, run.checkpoint, run.evaluation)
    assert "success 50%" in text


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ({"kind": "episodes"}, {"episodes"}),
        ({"stage": "train"}, {"checkpoint"}),
        ({"task": "one_leg", "kind": "evaluation"}, {"evaluation"}),
        ({"task": "lamp"}, set()),
        ({"text": "SUCCESS 50%"}, {"evaluation"}),
        ({"kind": "nonsense"}, set()),
    ],
)
def test_filters_choose(client, run, asked, found):
    assert listed(client.get("/", params=asked).text) == names(*(getattr(run, name) for name in found))


def test_artifact_says_what_it_was_made_from_and_what_was_made_of_it(client, run):
    text = client.get(f"/artifacts/{run.episodes}").text
    assert listed(text) == names(run.logs, run.checkpoint)
    assert f'href="/episodes?artifact={run.episodes}"' in text
    assert "episodes.parquet" in text


def test_first_letters_of_an_id_are_enough(client, run):
    assert "2 demonstrations" in client.get(f"/artifacts/{run.episodes.id[:8]}").text


@pytest.mark.parametrize("text", ["0123456789abcdef", "nonsense/0123456789abcdef", "%00", "../../etc/passwd", "‮"])
def test_unknown_artifact_is_a_page_with_a_sentence(client, run, text):
    answer = client.get(f"/artifacts/{text}")
    assert answer.status_code == 404
    assert '<p class="sentence">' in answer.text


def test_artifact_that_was_deleted_leaves_the_list_and_its_page_says_so(client, run):
    client.get("/")
    run.store.set_aside(run.checkpoint)
    assert str(run.checkpoint) not in client.get("/").text
    assert client.get(f"/artifacts/{run.checkpoint}").status_code == 404
    assert "no longer there" in client.get(f"/artifacts/{run.evaluation}").text


def test_damaged_manifest_is_listed_with_what_is_wrong_until_it_is_mended(client, run):
    path = run.store.open(run.checkpoint) / MANIFEST_NAME
    whole = path.read_bytes()
    path.write_bytes(whole[:50])
    assert f"Artifact {run.checkpoint} is damaged" in client.get("/").text
    answer = client.get(f"/artifacts/{run.checkpoint}")
    assert answer.status_code == 409
    assert "juicer repair" in answer.text
    path.write_bytes(whole)
    assert "is damaged" not in client.get("/").text


def test_foreign_texts_are_escaped(client, store):
    commit(store, Recipe("train", "checkpoint"), {"headline": "<script>alert(1)</script>\u202e"})
    text = client.get("/").text
    assert "<script>alert" not in text
    assert "\u202e" not in text
    assert "&lt;script&gt;" in text


def test_long_list_is_shown_in_parts(client, store):
    for seed in range(101):
        commit(store, Recipe("record", "logs", config={"seed": seed}), {})
    first = client.get("/?kind=logs")
    assert len(listed(first.text)) == 100
    assert "1 to 100 of 101 artifacts" in first.text
    following = re.search(r'rel="next" href="([^"]*)"', first.text)[1].replace("&amp;", "&")
    assert len(listed(client.get(following).text)) == 1


@pytest.mark.parametrize("page", ["/?kind=episodes&", "/episodes?", "/episodes?artifact={episodes}&", "/annotate?"])
def test_behind_the_end_of_a_list_a_link_leads_back_into_it(client, run, page):
    text = client.get(f"{page.format(episodes=run.episodes)}first=1000").text
    assert "The list ends before number 1001." in text
    assert "1000 of" not in text
    assert "<table" not in text
    previous = html.unescape(re.search(r'rel="prev" href="([^"]*)"', text)[1])
    assert previous.endswith("first=0")
    assert "<table" in client.get(previous).text


def test_behind_the_end_of_a_long_list_the_link_leads_to_its_last_lines(client, store):
    for seed in range(101):
        commit(store, Recipe("record", "logs", config={"seed": seed}), {})
    previous = re.search(r'rel="prev" href="([^"]*)"', client.get("/?first=1000").text)[1]
    assert "101 to 101 of 101 artifacts" in client.get(html.unescape(previous)).text


def all_of(known):
    while (contents := known.contents()).unread:
        pass
    return contents


def test_page_of_a_large_store_does_not_wait_for_all_of_it(run, monkeypatch, tmp_path):
    monkeypatch.setattr(catalog, "PATIENCE_SECONDS", 0.0)
    is_released = threading.Event()
    monkeypatch.setattr(
        type(run.store), "manifest", lambda store, ref, read=run.store.manifest: is_released.wait() and read(ref)
    )
    known = catalog.Catalog(run.store, tmp_path)
    assert known.contents().unread == 4
    is_released.set()
    assert len(all_of(known).entries) == 4


@pytest.mark.parametrize("content", [b"", b"[{}]", b"null", b"\xff", b'[{"ref": 1}]'])
def test_nonsense_in_the_kept_catalog_counts_as_none(run, tmp_path, content):
    (tmp_path / catalog.FILE).write_bytes(content)
    assert len(all_of(catalog.Catalog(run.store, tmp_path)).entries) == 4


@pytest.mark.parametrize("query", ["first=-1", "first=x", "first=99999999999999", f"text={'x' * 201}"])
def test_nonsense_in_an_address_is_refused_with_a_sentence(client, query):
    answer = client.get(f"/?{query}")
    assert answer.status_code == 400
    assert "is not valid" in answer.text


@pytest.mark.parametrize("nothing", [[], {}, "", None])
def test_a_fact_that_is_empty_is_told_as_none(client, store, nothing):
    with store.create(Recipe("record", "logs", {})) as draft:
        draft.summary["left_out"] = nothing
    text = client.get(f"/artifacts/{draft.ref}").text
    assert re.search(r"left out</t[hd]>\s*<td[^>]*>none</td>|left out</dt>\s*<dd[^>]*>none</dd>", text)
