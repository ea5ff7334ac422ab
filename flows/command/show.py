"""Commands that look into the store."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import typer

from flows.command.inspection import inspect
from flows.command.recordings import describe_recordings, find_recordings, say_recordings
from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from flows.terminal.headline import headline
from flows.terminal.output import bytes_text, say, say_json, say_table
from juicer.artifacts.catalog import Catalog, Entry
from juicer.artifacts.findings import Listing
from juicer.artifacts.ref import ArtifactRef, require_kind
from juicer.artifacts.store import ArtifactStore
from juicer.errors import UnreadableArtifact
from juicer.text import printable
from stages.runtime.given_files import UNREADABLE

LONGEST_VALUE = 1000
MANY_TROUBLES = 8
_BRANCH, _LAST, _PIPE, _SPACE = "├─ ", "└─ ", "│  ", "   "


def list_kind(kind: str | None, as_json: bool) -> None:
    """``juicer ls``; fails after the list if it could not be complete."""
    if kind is not None:
        require_kind(kind)
    settings = read_settings()
    store = open_store(settings)
    contents = Catalog(store, settings.folder).whole(kind)
    whole = [entry for entry in reversed(contents.entries) if not entry.trouble]
    troubles = [*contents.unseen, *(entry.trouble for entry in reversed(contents.entries) if entry.trouble)]
    if as_json:
        say_json([describe(entry) for entry in whole])
        if troubles:  # the list is the answer; a second document would spoil it
            raise typer.Exit(1)
    elif whole:
        say_table(["kind", "id", "stage", "finished", "size ", "facts"], [_row(entry) for entry in whole])
    elif not troubles:
        say(f"no artifacts{f' of kind {kind}' if kind else ''} in {store.url}")
    if troubles:
        more = f"; and {len(troubles) - MANY_TROUBLES} more" if len(troubles) > MANY_TROUBLES else ""
        raise UnreadableArtifact(f"the list is not complete: {'; '.join(troubles[:MANY_TROUBLES])}{more}")


def show_artifact(text: str, as_json: bool) -> None:
    """``juicer show``."""
    store = open_store(read_settings())
    ref = store.resolve(text)
    manifest = store.manifest(ref)
    if as_json:
        recordings = find_recordings(store, ref)
        content = {**describe(Entry.of(manifest)), "recipe": manifest.recipe.to_json(), "host": dict(manifest.host)}
        say_json(content | ({"recordings": describe_recordings(recordings)} if recordings else {}))
        return
    recipe = manifest.recipe
    stage = printable(recipe.stage)
    say(f"{ref}  made by stage '{stage}' in {manifest.seconds:.1f} s, finished {manifest.finished}")
    name, platform, version = (printable(manifest.host.get(fact)) for fact in ("name", "platform", "juicer"))
    say(f"on {name}, {platform}, juicer {version}")
    for role, refs in recipe.inputs.items():
        say(f"{printable(role)}: {', '.join(map(str, refs))}")
    for label, digest in recipe.files.items():
        shown = digest if digest.startswith(UNREADABLE) else f"sha256 {digest[:16]}"
        say(f"file {printable(label)}: {printable(shown)}")
    _say_section("configuration", recipe.config)
    _say_section("facts", manifest.summary)
    say(f"files ({bytes_text(sum(entry.bytes for entry in manifest.files))})")
    for entry in manifest.files[:20]:
        say(f"  {printable(entry.path)}  {bytes_text(entry.bytes)}")
    if len(manifest.files) > 20:
        say(f"  and {len(manifest.files) - 20} more")
    say_recordings(find_recordings(store, ref))
    say(f"in {store.address(ref)}")


def show_lineage(text: str, as_json: bool) -> None:
    """``juicer lineage``."""
    store = open_store(read_settings())
    ref = store.resolve(text)
    if as_json:
        nodes = [*store.lineage(ref), ref]
        say_json([{"ref": str(node), "parents": [str(parent) for parent in _parents(store, node)]} for node in nodes])
        return
    for line in _tree(store, ref):
        say(line)


def verify_artifacts(text: str | None, as_json: bool) -> None:
    """``juicer verify``; fails if anything is damaged, does not belong, or cannot be looked at."""
    store = open_store(read_settings())
    inspection = inspect(store, Listing((store.resolve(text),)) if text else store.survey())
    if as_json:
        say_json(inspection.as_json())
        if inspection.error():  # which is the answer, not an error
            raise typer.Exit(1)
        return
    for note in inspection.notes():
        say(note)
    if error := inspection.error():
        raise error


def describe(entry: Entry) -> dict[str, Any]:
    """An artifact for machines."""
    return {
        "ref": str(entry.ref),
        "stage": entry.stage,
        "finished": entry.finished,
        "seconds": entry.seconds,
        "bytes": entry.bytes,
        "inputs": {role: [str(ref) for ref in refs] for role, refs in entry.inputs.items()},
        "summary": dict(entry.summary),
    }


def _tree(store: ArtifactStore, ref: ArtifactRef) -> Iterator[str]:
    """Lines of the tree; a chain of ancestors may be longer than Python's stack."""
    seen: set[ArtifactRef] = set()
    waiting = [(ref, "", "")]
    while waiting:
        node, first, rest = waiting.pop()
        if not store.exists(node):
            yield f"{first}{node}  (no longer there)"
            continue
        manifest = store.manifest(node)
        parents = manifest.recipe.parents
        repeated = "  (see above)" if node in seen and parents else ""
        yield f"{first}{node}  {printable(manifest.recipe.stage)}  {headline(manifest.summary)}{repeated}"
        if repeated:
            continue
        seen.add(node)
        for parent in reversed(parents):
            last = parent == parents[-1]
            waiting.append((parent, rest + (_LAST if last else _BRANCH), rest + (_SPACE if last else _PIPE)))


def _parents(store: ArtifactStore, ref: ArtifactRef) -> tuple[ArtifactRef, ...]:
    return store.manifest(ref).recipe.parents if store.exists(ref) else ()


def _row(entry: Entry) -> list[str]:
    return [
        entry.ref.kind,
        entry.ref.id,
        printable(entry.stage),
        entry.finished[:19].replace("T", " "),
        bytes_text(entry.bytes),
        headline(entry.summary),
    ]


def _say_section(title: str, content: Mapping[str, Any], indent: str = "") -> None:
    say(f"{indent}{printable(title)}")
    for key, value in content.items():
        if isinstance(value, dict) and value:
            _say_section(key, value, indent + "  ")
        else:
            # As configurations write it: true, null, ["a"]; texts without their quotes.
            shown = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
            say(f"{indent}  {printable(key)}: {printable(shown, LONGEST_VALUE)}")
