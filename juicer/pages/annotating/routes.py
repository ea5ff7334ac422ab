"""Addresses of the page on which critical states are marked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from juicer.annotation.measures import Measures, measure
from juicer.annotation.rewriting import text_of
from juicer.annotation.standing import SAME_STEPS, agreed_labels, standing
from juicer.annotation.versions import read_versions
from juicer.artifacts.catalog import catalog_of
from juicer.errors import AnnotationConflict
from juicer.pages.annotating.choosing import demonstrations, look_at
from juicer.pages.annotating.desk import Desk, desk_of
from juicer.pages.annotating.explaining import explain
from juicer.pages.annotating.saying import Judged, Marks, Undo, say, take_back
from juicer.pages.annotating.sheets import HEIGHT, STEPS, VIEWS, WIDTH
from juicer.pages.annotating.work import Work
from juicer.pages.paging import Number, part_of
from juicer.pages.rendering import page
from juicer.pages.workplace import TheWorkplace
from juicer.reporting.paper import PAPER_TABLE_IV

router = APIRouter(prefix="/annotate")

_FOR_AN_HOUR = {"Cache-Control": "private, max-age=3600"}
"""An episode's id is a digest of its content, but the next version of juicer may draw it otherwise."""


@router.get("")
def choose(request: Request, workplace: TheWorkplace, first: Number = 0) -> Response:
    """Which demonstrations can be annotated, and how far each set is."""
    contents = catalog_of(workplace.store, workplace.folder).contents()
    part = part_of(request, demonstrations(contents.entries), first)
    sets = look_at(workplace, part.lines)
    return page(request, "annotate_choose.html", sets=sets, part=part, contents=contents)


@router.get("/{name}")
def annotate(request: Request, workplace: TheWorkplace, name: str) -> Response:
    """The page for one set of demonstrations."""
    ref, desk = desk_of(workplace, name)
    setting = {
        "address": f"/annotate/{ref.id}",
        "states": [{"name": name, **asdict(explain(desk.task, index))} for index, name in enumerate(desk.names)],
        "sheet": {"width": WIDTH, "height": HEIGHT, "steps": STEPS, "views": list(VIEWS)},
        "same": SAME_STEPS,
        "paper": asdict(PAPER_TABLE_IV[desk.task.name]) if desk.task.name in PAPER_TABLE_IV else None,
    }
    return page(request, "annotate.html", ref=ref, task=desk.task.name, path=str(desk.path), setting=setting)


@router.get("/{name}/work")
def work(workplace: TheWorkplace, name: str) -> Work:
    """What is to be judged, as far as it is known, and what judging took so far."""
    _, desk = desk_of(workplace, name)
    ready = desk.proposals() is not None
    episodes = desk.work() if ready else []
    return Work(ready, desk.proposed, len(desk.reader), episodes, _measures(desk))


@router.get("/{name}/measures")
def measures(workplace: TheWorkplace, name: str) -> Measures:
    """What judging took so far."""
    return _measures(desk_of(workplace, name)[1])


@router.get("/{name}/labels.{ending}")
def labels(workplace: TheWorkplace, name: str, ending: str) -> Response:
    """What is agreed on, as a labels file."""
    _, desk = desk_of(workplace, name)
    agreed = agreed_labels(read_versions(desk.path), desk.path)
    text = text_of([label for label in agreed if label.recording in desk.reader.ids], f".{ending}")
    attachment = {"Content-Disposition": f'attachment; filename="{desk.task.name}.{ending}"'}
    return Response(text, media_type="text/plain; charset=utf-8", headers=attachment)


@router.get("/{name}/{episode}/signals")
def signals(workplace: TheWorkplace, name: str, episode: str) -> JSONResponse:
    """Signals of a demonstration, step by step."""
    _, desk = desk_of(workplace, name)
    return JSONResponse(desk.signals(episode), headers=_FOR_AN_HOUR)


@router.get("/{name}/{episode}/{first}.jpg")
def sheet(
    workplace: TheWorkplace,
    name: str,
    episode: str,
    first: int,
    count: int = STEPS,
    view: Annotated[list[str] | None, Query()] = None,
) -> Response:
    """Images of some steps: a column a step, a row a view."""
    _, desk = desk_of(workplace, name)
    return Response(desk.sheet(episode, first, count, view or VIEWS), media_type="image/jpeg", headers=_FOR_AN_HOUR)


@router.post("/{name}/marks")
def mark(workplace: TheWorkplace, name: str, said: Marks) -> Response:
    """Save marks, all or none; gives what stands now, also if nothing was saved."""
    _, desk = desk_of(workplace, name)
    return _saved(desk, said.marks, lambda: say(desk, said))


@router.post("/{name}/undo")
def undo(workplace: TheWorkplace, name: str, what: Undo) -> Response:
    """Save that marks are taken back, all or none; gives what stands now, also if nothing was saved."""
    _, desk = desk_of(workplace, name)
    return _saved(desk, what.marks, lambda: take_back(desk, what))


def _saved(desk: Desk, about: Sequence[Judged], do: Callable[[], object]) -> Response:
    """Save something, and tell what stands then; also where somebody else was quicker."""
    told: dict[str, Any] = {}
    status = HTTPStatus.OK
    try:
        do()
    except AnnotationConflict as error:
        told, status = {"error": str(error)}, HTTPStatus.CONFLICT
    stands, proposals = standing(read_versions(desk.path)), desk.proposals() or {}
    keys = [(each.episode, each.critical_state) for each in about]
    told["marks"] = [asdict(desk.judgement(key, stands, proposals)) for key in keys]
    return JSONResponse(told, status)


def _measures(desk: Desk) -> Measures:
    return measure([version for version in read_versions(desk.path) if version.episode in desk.reader.ids])
