"""Commands that look into the store."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from flows.commands.output import bytes_text, say, say_json, say_table
from flows.commands.recordings import describe_recordings, find_recordings, say_recordings
from flows.facts import headline
from flows.settings import read_settings
from flows.store import open_store
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import KINDS, ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError, DamagedArtifact, did_you_mean
from stages.given_files import UNREADABLE

_BRANCH, _LAST, _PIPE, _SPACE = "├─ ", "└─ ", "│  ", "   "


def list_kind(kind: str | None, as_json: bool) -> None:
    """``juicer ls``."""
    if kind is not None and kind not in KINDS:
        raise ConfigError(f"unknown kind of artifact '{kind}'{did_you_mean(kind, KINDS)}")
    store = open_store(read_settings())
    manifests = store.list(kind)
    if as_json:
        say_json([describe(manifest) for manifest in manifests])
        return
    if not manifests:
        say(f"no artifacts{f' of kind {kind}' if kind else ''} in {store.url}")
        return
    rows = [
        [
            manifest.ref.kind,
            manifest.ref.id,
            manifest.recipe.stage,
            manifest.finished[:19].replace("T", " "),
            bytes_text(sum(entry.bytes for entry in manifest.files)),
            headline(manifest.summary),
        ]
        for manifest in manifests
    ]
    say_table(["kind", "id", "stage", "finished", "size ", "facts"], rows)


def show_artifact(text: str, as_json: bool) -> None:
    """``juicer show``."""
    store = open_store(read_settings())
    ref = store.resolve(text)
    manifest = store.manifest(ref)
    if as_json:
        recordings = find_recordings(store, ref)
        content = {**describe(manifest), "recipe": manifest.recipe.to_json(), "host": dict(manifest.host)}
        say_json(content | ({"recordings": describe_recordings(recordings)} if recordings else {}))
        return
    recipe = manifest.recipe
    say(f"{ref}  made by stage '{recipe.stage}' in {manifest.seconds:.1f} s, finished {manifest.finished}")
    say(f"on {manifest.host['name']}, {manifest.host['platform']}, juicer {manifest.host['juicer']}")
    for role, refs in recipe.inputs.items():
        say(f"{role}: {', '.join(map(str, refs))}")
    for label, digest in recipe.files.items():
        say(f"file {label}: {digest if digest.startswith(UNREADABLE) else f'sha256 {digest[:16]}'}")
    _say_section("configuration", recipe.config)
    _say_section("facts", manifest.summary)
    say(f"files ({bytes_text(sum(entry.bytes for entry in manifest.files))})")
    for entry in manifest.files[:20]:
        say(f"  {entry.path}  {bytes_text(entry.bytes)}")
    if len(manifest.files) > 20:
        say(f"  and {len(manifest.files) - 20} more")
    say_recordings(find_recordings(store, ref))
    say(f"in {store.open(ref)}")


def show_lineage(text: str, as_json: bool) -> None:
    """``juicer lineage``."""
    store = open_store(read_settings())
    ref = store.resolve(text)
    if as_json:
        nodes = [*store.lineage(ref), ref]
        say_json([{"ref": str(node), "parents": [str(parent) for parent in _parents(store, node)]} for node in nodes])
        return
    seen: set[ArtifactRef] = set()
    for line in _tree(store, ref, "", "", seen):
        say(line)


def verify_artifacts(text: str | None, as_json: bool) -> None:
    """``juicer verify``; fails if anything is damaged."""
    store = open_store(read_settings())
    refs = [store.resolve(text)] if text else list(store.refs())
    problems = {str(ref): list(found) for ref in refs if (found := store.verify(ref))}
    if as_json:
        say_json({"checked": len(refs), "damaged": problems})
    elif not problems:
        say(f"{len(refs)} artifact{'s are' if len(refs) != 1 else ' is'} as written")
    if problems:
        sentences = "; ".join(f"{ref}: {', '.join(found)}" for ref, found in problems.items())
        raise DamagedArtifact(f"{len(problems)} of {len(refs)} artifacts are damaged: {sentences}; see `juicer repair`")


def describe(manifest: Manifest) -> dict[str, Any]:
    """An artifact for machines."""
    return {
        "ref": str(manifest.ref),
        "stage": manifest.recipe.stage,
        "finished": manifest.finished,
        "seconds": manifest.seconds,
        "bytes": sum(entry.bytes for entry in manifest.files),
        "inputs": {role: [str(ref) for ref in refs] for role, refs in manifest.recipe.inputs.items()},
        "summary": dict(manifest.summary),
    }


def _tree(store: ArtifactStore, ref: ArtifactRef, first: str, rest: str, seen: set[ArtifactRef]) -> Iterator[str]:
    if ref not in store.refs(ref.kind):
        yield f"{first}{ref}  (no longer there)"
        return
    manifest = store.manifest(ref)
    repeated = ref in seen and manifest.recipe.parents
    yield f"{first}{ref}  {manifest.recipe.stage}  {headline(manifest.summary)}{'  (see above)' if repeated else ''}"
    if repeated:
        return
    seen.add(ref)
    parents = manifest.recipe.parents
    for place, parent in enumerate(parents, start=1):
        last = place == len(parents)
        yield from _tree(store, parent, rest + (_LAST if last else _BRANCH), rest + (_SPACE if last else _PIPE), seen)


def _parents(store: ArtifactStore, ref: ArtifactRef) -> tuple[ArtifactRef, ...]:
    return store.manifest(ref).recipe.parents if ref in store.refs(ref.kind) else ()


def _say_section(title: str, content: Any, indent: str = "") -> None:
    say(f"{indent}{title}")
    for key, value in content.items():
        if isinstance(value, dict) and value:
            _say_section(key, value, indent + "  ")
        else:
            say(f"{indent}  {key}: {value}")
