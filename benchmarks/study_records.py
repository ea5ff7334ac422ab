"""Pack what the page of a study is written from, without the gigabytes behind it.

python -m benchmarks.study_records ARCHIVE STORE [STORE ...]

ARCHIVE is a tar, compressed with xz, of a store that holds the rows of every evaluation, analyses as they are, and of
everything else the manifests: recipes, summaries, times, checksums. Unpacked, `juicer report` writes from it the page
that it writes from the stores, but for the megabytes of evaluations, whose example episodes are left out. So a study is
put together from machines that never met: of what several stores have, the first one's is taken. Nothing can be trained
or rolled out from it.
"""

from __future__ import annotations

import argparse
import io
import tarfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from juicer.artifacts.manifest import MANIFEST_NAME
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.storage.evaluations import EXAMPLES


def main() -> None:
    """Pack, and say how much it was."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archive", type=Path)
    parser.add_argument("stores", nargs="+", type=Path, metavar="store")
    options = parser.parse_args()
    for path in options.stores:
        if not path.is_dir():
            parser.error(f"folder '{path}' does not exist")
    count = pack(options.archive, [ArtifactStore(path) for path in options.stores])
    print(f"{options.archive}: {count} artifacts, {options.archive.stat().st_size / 1e6:.1f} MB")


def pack(archive: Path, stores: list[ArtifactStore]) -> int:
    """Write the archive and give the number of artifacts in it."""
    # Named alike, manifests compress together.
    chosen = sorted({ref: store for store in reversed(stores) for ref in store.refs()}.items())
    # An archive that is there already stays until the new one is whole.
    draft = archive.with_name(f".{archive.name}")
    with tarfile.open(draft, "w:xz") as tar:
        for ref, store in chosen:
            for path, content in _records(store, ref):
                entry = tarfile.TarInfo(f"{ref}/{path}")
                entry.size = len(content)
                tar.addfile(entry, io.BytesIO(content))
    draft.replace(archive)
    return len(chosen)


def _records(store: ArtifactStore, ref: ArtifactRef) -> Iterator[tuple[str, bytes]]:
    manifest = store.manifest(ref)
    if ref.kind in ("evaluation", "analysis"):
        kept = tuple(entry for entry in manifest.files if not entry.path.startswith(f"{EXAMPLES}/"))
        folder = store.open(ref, read=[entry.path for entry in kept])
        manifest = replace(manifest, files=kept)
        yield from ((entry.path, (folder / entry.path).read_bytes()) for entry in kept)
    yield MANIFEST_NAME, manifest.to_text().encode()


if __name__ == "__main__":
    main()
