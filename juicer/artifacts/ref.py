"""Pointers to artifacts: small, ordered, and readable by people."""

from __future__ import annotations

import re
from dataclasses import dataclass

from juicer.announced import announced
from juicer.errors import ArtifactNotFound, ConfigError, did_you_mean
from juicer.text import printable

_OURS = (
    *("logs", "episodes", "columns", "annotations", "selection", "dataset"),
    *("estimator", "checkpoint", "evaluation", "analysis", "report"),
)
_WORD = re.compile(r"[a-z][a-z0-9_]{0,39}")
KINDS = (*_OURS, *(name for name in announced("juicer.kinds") if _WORD.fullmatch(name) and name not in _OURS))
"""Every kind of artifact: ours, and those that other packages announce for the stages that make them."""

ID_LENGTH = 16
_ID = re.compile(rf"[0-9a-f]{{{ID_LENGTH}}}")


def require_kind(kind: str) -> None:
    """Refuse what is not a kind of artifact.

    Raises:
        ConfigError: If it is none.
    """
    if kind not in KINDS:
        raise ConfigError(f"unknown kind of artifact '{printable(kind)}'{did_you_mean(str(kind), KINDS)}")


def is_id(name: str) -> bool:
    """Whether a name is that of an artifact; whatever else lies in a store is not juicer's business."""
    return _ID.fullmatch(name) is not None


@dataclass(frozen=True, order=True)
class ArtifactRef:
    """Kind and id of an artifact; reads ``episodes/0123456789abcdef``."""

    kind: str
    id: str

    def __str__(self) -> str:
        """The text that :meth:`parse` takes."""
        return f"{self.kind}/{self.id}"

    @classmethod
    def parse(cls, text: str) -> ArtifactRef:
        """Read ``kind/id``.

        Raises:
            ArtifactNotFound: If the kind is unknown or the id is not 16 hexadecimal digits.
        """
        kind, _, identity = text.partition("/")
        if kind not in KINDS:
            raise ArtifactNotFound(f"'{text}' names no kind of artifact{did_you_mean(kind, KINDS)}")
        if not is_id(identity):
            raise ArtifactNotFound(f"'{text}' must be a kind and an id of {ID_LENGTH} hexadecimal digits")
        return cls(kind, identity)
