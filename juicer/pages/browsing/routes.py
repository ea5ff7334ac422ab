"""Addresses of the pages that look through the store."""

from __future__ import annotations

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from juicer.pages.rendering import page

router = APIRouter()


@router.get("/")
def artifacts(request: Request) -> Response:
    """The store's artifacts."""
    return page(request, "sentence.html", sentence="the artifacts will be here")
