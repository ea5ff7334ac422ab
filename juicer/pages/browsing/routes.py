"""Addresses of the pages that look through the store; everything in them can be linked to."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any

import yaml
from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from juicer.artifacts.catalog import catalog_of
from juicer.artifacts.manifest import HEADLINE, LABEL, MANIFEST_NAME
from juicer.artifacts.ref import KINDS
from juicer.episode import Outcome
from juicer.pages.browsing.episodes import KINDS_WITH_EPISODES, list_episodes
from juicer.pages.browsing.frames import SHEET_FRAMES, sheet, still, strip
from juicer.pages.browsing.graph import graph_around
from juicer.pages.paging import Number, Word, part_of
from juicer.pages.rendering import page
from juicer.pages.workplace import TheWorkplace
from juicer.sim.env import CONTROL_HZ

FILES = 40
KINDS_OF_RESULTS = ("report", "evaluation", "checkpoint")
_KEPT = {"Cache-Control": "private, max-age=3600"}
"""Images of an artifact stay what they are."""

router = APIRouter()


@router.get("/")
def artifacts(
    request: Request,
    workplace: TheWorkplace,
    kind: Word = "",
    stage: Word = "",
    task: Word = "",
    text: Word = "",
    first: Number = 0,
) -> Response:
    """The store's artifacts."""
    contents = catalog_of(workplace.store, workplace.folder).contents()
    entries = [entry for entry in contents.entries if entry.answers_to(kind, stage, task, text)]
    return page(
        request,
        "browsing/artifacts.html",
        contents=contents,
        part=part_of(request, entries, first),
        asked={"kind": kind, "stage": stage, "task": task, "text": text},
        kinds=[name for name in KINDS if any(entry.ref.kind == name for entry in contents.entries)],
        stages=sorted({entry.stage for entry in contents.entries} - {""}),
        tasks=sorted({name for entry in contents.entries for name in entry.tasks}),
        total_bytes=sum(entry.bytes for entry in entries),
        place=workplace.store.url,
    )


@router.get("/artifacts/{text:path}")
def artifact(request: Request, workplace: TheWorkplace, text: str) -> Response:
    """An artifact: what made it, of what, what it holds, and what was made of it."""
    store = workplace.store
    ref = store.resolve(text)
    manifest = store.manifest(ref)
    summary = manifest.summary
    contents = catalog_of(store, workplace.folder).contents()
    return page(
        request,
        "browsing/artifact.html",
        manifest=manifest,
        entries=contents.by_ref,
        children=contents.children().get(ref, []),
        facts=list(_facts(summary)),
        configuration=yaml.safe_dump(dict(manifest.recipe.config), sort_keys=False, allow_unicode=True),
        files=manifest.files[:FILES],
        total_bytes=sum(file.bytes for file in manifest.files),
        has_episodes=ref.kind in KINDS_WITH_EPISODES,
        has_failures=summary.get("successes", summary.get("episodes")) != summary.get("episodes"),
        place=store.address(ref),
        manifest_name=MANIFEST_NAME,
    )


@router.get("/episodes")
def episodes(
    request: Request,
    workplace: TheWorkplace,
    artifact: Word = "",
    outcome: Word = "",
    lacking: Word = "",
    first: Number = 0,
    episode: Annotated[int | None, Query(ge=0, le=10**9)] = None,
    frame: Number = 0,
) -> Response:
    """Episodes of an artifact, or one of them step by step."""
    if not artifact:
        return _choice(request, workplace, "Episodes", KINDS_WITH_EPISODES, first, "No artifact holds episodes yet")
    found = list_episodes(workplace.store, workplace.store.resolve(artifact))
    if episode is not None:
        line = found.line(episode)
        return page(
            request, "browsing/episode.html", found=found, line=line, frame=min(frame, line.length), hz=CONTROL_HZ
        )
    return page(
        request,
        "browsing/episodes.html",
        found=found,
        part=part_of(request, found.chosen(outcome, lacking), first),
        asked={"outcome": outcome, "lacking": lacking},
        outcomes=["failure", *(each for each in Outcome if any(line.outcome is each for line in found.lines))],
        lackings=[
            name for name in found.milestones if any(line.lacks(found.milestones) == name for line in found.lines)
        ],
    )


@router.get("/episodes/sheet.jpg")
def episode_sheet(
    workplace: TheWorkplace,
    artifact: Word,
    episode: Number,
    first: Number = 0,
    stride: Annotated[int, Query(ge=1, le=10**6)] = 1,
    count: Annotated[int, Query(ge=1, le=SHEET_FRAMES)] = SHEET_FRAMES,
) -> Response:
    """Small images of many steps of an episode."""
    store = workplace.store
    return _jpeg(sheet(store, store.resolve(artifact), episode, first, stride, count))


@router.get("/episodes/still.jpg")
def episode_still(workplace: TheWorkplace, artifact: Word, episode: Number, frame: Number) -> Response:
    """A step of an episode."""
    store = workplace.store
    return _jpeg(still(store, store.resolve(artifact), episode, frame))


@router.get("/lineage")
def lineage(request: Request, workplace: TheWorkplace, artifact: Word = "", first: Number = 0) -> Response:
    """What an artifact was made from, and what was made from it."""
    if not artifact:
        return _choice(request, workplace, "Lineage", KINDS_OF_RESULTS, first, "No policy has been trained yet")
    store = workplace.store
    ref = store.resolve(artifact)
    contents = catalog_of(store, workplace.folder).contents()
    return page(
        request,
        "browsing/lineage.html",
        ref=ref,
        entry=contents.by_ref.get(ref),
        entries={str(each.ref): each for each in contents.entries},
        graph=graph_around(store, contents, ref),
        contents=contents,
        has_episodes=ref.kind in KINDS_WITH_EPISODES,
    )


@router.get("/lineage/strip.jpg")
def lineage_strip(workplace: TheWorkplace, artifact: Word) -> Response:
    """Images by which one tells an artifact of episodes."""
    return _jpeg(strip(workplace.store, workplace.store.resolve(artifact)))


def _choice(
    request: Request, workplace: TheWorkplace, title: str, kinds: Sequence[str], first: int, nothing: str
) -> Response:
    """Artifacts that a page can be about."""
    contents = catalog_of(workplace.store, workplace.folder).contents()
    entries = [entry for entry in contents.entries if entry.ref.kind in kinds]
    return page(
        request,
        "browsing/choice.html",
        title=title,
        address=request.url.path,
        part=part_of(request, entries, first),
        contents=contents,
        nothing=nothing,
    )


def _facts(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What is not said above already."""
    for key, value in summary.items():
        if key not in (HEADLINE, LABEL):
            yield key.replace("_", " "), _told(value)


def _told(value: Any) -> str:
    if value in ([], {}, "", None):
        return "none"
    if isinstance(value, float):
        return f"{value:.0f}" if value.is_integer() else f"{value:.6g}"
    if isinstance(value, list) and all(isinstance(each, str) for each in value):
        return ", ".join(value)
    if isinstance(value, dict) and all(isinstance(each, int | float) for each in value.values()):
        return ", ".join(f"{name.replace('_', ' ')} {_told(each)}" for name, each in value.items())
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _jpeg(content: bytes) -> Response:
    return Response(content, media_type="image/jpeg", headers=_KEPT)
