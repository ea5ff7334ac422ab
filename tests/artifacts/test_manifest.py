"""Manifests: complete, readable, sealed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from juicer.artifacts.manifest import FileEntry, Manifest, describe_host, plain
from juicer.artifacts.recipe import Recipe


@pytest.fixture
def manifest(recipe: Recipe) -> Manifest:
    return Manifest(
        recipe=recipe,
        files=(FileEntry("a.bin", 10, "ab" * 32), FileEntry("ü.bin", 5, "cd" * 32)),
        summary={"episodes": 3, "rate": 0.1},
        host=describe_host(),
        started="2026-01-01T12:00:00.000+00:00",
        finished="2026-01-01T12:00:01.500+00:00",
        seconds=1.5,
    )


def test_a_manifest_reads_back_from_its_text(manifest: Manifest) -> None:
    assert Manifest.from_text(manifest.to_text()) == manifest


def test_a_manifest_knows_its_artifact(manifest: Manifest, recipe: Recipe) -> None:
    assert manifest.ref == recipe.ref


def test_no_byte_of_a_manifest_changes_unnoticed(manifest: Manifest) -> None:
    content = manifest.to_text().encode()
    for place in range(len(content)):
        altered = bytearray(content)
        altered[place] ^= 1
        with pytest.raises(ValueError, match=r"manifest|version|checksum|decode"):
            Manifest.from_text(altered.decode())


@pytest.mark.parametrize("length", [0, 1, 100, -1])
def test_a_truncated_manifest_is_refused(manifest: Manifest, length: int) -> None:
    with pytest.raises(ValueError, match=r"not a manifest|checksum"):
        Manifest.from_text(manifest.to_text()[:length])


def test_a_manifest_of_another_schema_says_so(manifest: Manifest) -> None:
    body = json.loads(manifest.to_text()) | {"schema_version": 99}
    with pytest.raises(ValueError, match="schema version 99"):
        Manifest.from_text(json.dumps(body))


@pytest.mark.parametrize("path", ["/etc/passwd", "../other", "a/../../b"])
def test_a_forged_manifest_cannot_name_files_outside_its_artifact(manifest: Manifest, path: str) -> None:
    with pytest.raises(ValueError, match="leads out of the artifact"):
        FileEntry(path, 0, "ab" * 32)
    forged = manifest.to_text().replace("a.bin", path)
    with pytest.raises(ValueError, match=r"leads out of the artifact|checksum"):
        Manifest.from_text(forged)


def test_summaries_may_hold_numpy_numbers_and_numbers_that_are_none() -> None:
    facts = {
        "count": np.int64(3),
        "rates": np.array([0.5, np.nan]),
        "worst": float("inf"),
        "nested": ({"a": np.bool_(True)},),
    }
    assert plain(facts) == {"count": 3, "rates": [0.5, None], "worst": None, "nested": [{"a": True}]}
