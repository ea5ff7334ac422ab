"""How long it takes to open an artifact, as against hashing all of it.

python -m benchmarks.opening [--gigabytes 2] [--folder FOLDER]

An artifact of images as a column of them would have, and one like a checkpoint, are written once and then opened: in
a new process, and again in the same. Hashing everything is what each opening did, and what `juicer verify` does.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec

from juicer.artifacts.contents import SETTLED_NS
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.storage.curves import CURVES_FILE

IMAGE = (240, 320, 3)
SHARD = 100
WEIGHTS_BYTES = 276 * 10**6
"""Of a checkpoint with the paper's network."""


def main() -> None:
    """Write, open, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gigabytes", type=float, default=2.0)
    parser.add_argument("--folder", type=Path, default=None, help="where to write; a temporary one if left out")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        store = ArtifactStore(Path(folder) / "store")
        images, checkpoint = write_images(store, options.gigabytes * 1e9), write_checkpoint(store)
        # Contents are remembered of files that were not written just now.
        time.sleep(2 * SETTLED_NS / 1e9)
        print(f"{'':44}{'everything':>12}{'opening':>12}{'again':>12}{'ratio':>10}")
        compare(store, images, "images", lambda: store.open(images))
        compare(store, checkpoint, "checkpoint", lambda: store.open(checkpoint))
        compare(store, checkpoint, "checkpoint, for its curves", lambda: store.open(checkpoint, read=[CURVES_FILE]))


def write_images(store: ArtifactStore, num_bytes: float) -> ArtifactRef:
    """Noise, which no compression makes smaller."""
    frame_bytes = int(np.prod(IMAGE))
    num_shards = max(1, round(num_bytes / frame_bytes / SHARD))
    rng = np.random.default_rng(0)
    with store.create(Recipe("images", "episodes")) as draft:
        array = zarr.create_array(
            draft.path / "columns.zarr",
            shape=(num_shards * SHARD, *IMAGE),
            chunks=(1, *IMAGE),
            shards=(SHARD, *IMAGE),
            dtype=np.uint8,
            compressors=(BloscCodec(cname="zstd", clevel=3, shuffle="noshuffle"), Crc32cCodec()),
        )
        for shard in range(num_shards):
            array[shard * SHARD : (shard + 1) * SHARD] = rng.integers(0, 256, (SHARD, *IMAGE), np.uint8)
    return draft.ref


def write_checkpoint(store: ArtifactStore) -> ArtifactRef:
    """Weights and a few curves."""
    with store.create(Recipe("weights", "checkpoint")) as draft:
        (draft.path / "weights.safetensors").write_bytes(np.random.default_rng(0).bytes(WEIGHTS_BYTES))
        (draft.path / CURVES_FILE).write_text("{}")
    return draft.ref


def compare(store: ArtifactStore, ref: ArtifactRef, name: str, open_it: Callable[[], object]) -> None:
    """One row: hashing everything, the first opening of a process and its second one; the ratio of the first two."""
    files = store.manifest(ref).files
    label = f"{name}: {len(files)} files, {sum(entry.bytes for entry in files) / 1e9:.2f} GB"
    everything_s = seconds(lambda: store.verify(ref))
    first_s, again_s = in_new_process(lambda: (seconds(open_it), seconds(open_it)))
    ratio = f"{everything_s / first_s:.0f}x"
    print(f"{label:44}{everything_s:10.3f} s{first_s:10.4f} s{again_s:10.4f} s{ratio:>10}")


def seconds(action: Callable[[], object]) -> float:
    """Wall time of an action."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def in_new_process(measure: Callable[[], tuple[float, float]]) -> tuple[float, float]:
    """What a function gives in a process that remembers nothing."""
    context = multiprocessing.get_context("fork")
    receiving, sending = context.Pipe(duplex=False)
    process = context.Process(target=lambda: sending.send(measure()))
    process.start()
    result: tuple[float, float] = receiving.recv()
    process.join()
    return result


if __name__ == "__main__":
    main()
