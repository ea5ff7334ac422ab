"""Artifact references."""

from __future__ import annotations

import pytest

from juicer.artifacts.ref import ArtifactRef
from juicer.errors import ArtifactNotFound


def test_a_reference_reads_back_what_it_prints() -> None:
    ref = ArtifactRef("episodes", "0123456789abcdef")
    assert str(ref) == "episodes/0123456789abcdef"
    assert ArtifactRef.parse(str(ref)) == ref


def test_references_sort_by_kind_and_then_id() -> None:
    refs = [ArtifactRef("episodes", "b" * 16), ArtifactRef("episodes", "a" * 16), ArtifactRef("annotations", "c" * 16)]
    assert sorted(refs) == [refs[2], refs[1], refs[0]]


def test_an_unknown_kind_is_answered_with_the_nearest() -> None:
    with pytest.raises(ArtifactNotFound, match="did you mean 'episodes'"):
        ArtifactRef.parse("episode/0123456789abcdef")


@pytest.mark.parametrize("identity", ["", "123", "0123456789ABCDEF", "0123456789abcdef0", "../456789abcdef0"])
def test_an_id_is_sixteen_hexadecimal_digits(identity: str) -> None:
    with pytest.raises(ArtifactNotFound, match="16 hexadecimal digits"):
        ArtifactRef.parse(f"episodes/{identity}")
