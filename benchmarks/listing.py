"""How long it takes to list many artifacts, for the first time and later, and to show each page about them.

python -m benchmarks.listing STORE [--artifacts 10000] [--folder FOLDER]

The manifests of a store are written again and again as those of other seeds, so that they are as large as real ones.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

from starlette.testclient import TestClient

from juicer.artifacts.catalog import Catalog, catalog_of
from juicer.artifacts.manifest import MANIFEST_NAME, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.pages.application import create_application
from juicer.pages.workplace import Workplace

PAGES = (
    "/",
    "/?kind=evaluation&text=success",
    "/?first=5000",
    "/episodes",
    "/lineage",
    "/artifacts/{}",
    "/lineage?artifact={}",
    "/annotate",
)


def main() -> None:
    """Write, list, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("store", type=Path)
    parser.add_argument("--artifacts", type=int, default=10_000)
    parser.add_argument("--folder", type=Path, default=None, help="where to write; a temporary one if left out")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        store = ArtifactStore(folder / "store")
        last = multiply(ArtifactStore(options.store).list(), store, options.artifacts)
        print(f"{'seconds':44}{'wall':>10}{'CPU':>10}")
        timed("all manifests, as a run reads them", store.list)
        timed("the list, for the first time", Catalog(store, folder).whole)
        timed("the list, by the next process", lambda: Catalog(store, folder).whole())
        client = TestClient(create_application(Workplace(store, folder)))
        timed("first page after a start", lambda: client.get("/"))
        for page in PAGES:
            timed(page, partial(client.get, page.format(last)))
        catalog_of.cache_clear()


def multiply(manifests: Iterable[Manifest], store: ArtifactStore, count: int) -> ArtifactRef:
    """Write manifests with recipes of their own, each made from the copies of what the original was made from."""
    originals, number = list(manifests), 0
    while True:
        copies: dict[ArtifactRef, ArtifactRef] = {}
        for manifest in originals:
            recipe = manifest.recipe
            inputs = {role: tuple(copies.get(ref, ref) for ref in refs) for role, refs in recipe.inputs.items()}
            made = replace(manifest, recipe=replace(recipe, inputs=inputs, config={**recipe.config, "copy": number}))
            copies[manifest.ref] = made.ref
            path = store.cache / str(made.ref) / MANIFEST_NAME
            path.parent.mkdir(parents=True)
            path.write_text(made.to_text())
            number += 1
            if number == count:
                return made.ref


def timed(what: str, do: Callable[[], object]) -> None:
    """Print how long something takes."""
    wall, cpu = time.perf_counter(), time.process_time()
    do()
    print(f"{what:44}{time.perf_counter() - wall:10.2f}{time.process_time() - cpu:10.2f}", flush=True)


if __name__ == "__main__":
    main()
