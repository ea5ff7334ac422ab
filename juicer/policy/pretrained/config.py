"""Which weights a network starts from, as configuration."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from juicer.config import StrictConfig
from juicer.errors import did_you_mean
from juicer.policy.pretrained.known import KNOWN

NON_COMMERCIAL = "-NC"
"""What the short name of a licence holds that allows no commercial use."""


class Weights(StrictConfig):
    """A file of weights: what it is counts, not where it lies."""

    file: str = Field(
        pattern=r"^\w[\w.-]*$", max_length=200, description="name of the file in the folder of weights, JUICER_WEIGHTS"
    )
    sha256: str = Field(
        pattern=r"^[0-9a-f]{64}$", max_length=64, description="digest of the file, as sha256sum prints it"
    )
    licence: str = Field(min_length=1, max_length=200, description="what may be done with it, e.g. MIT")
    part: str = Field(
        default="", max_length=200, description="how the names of the tensors begin that are taken; all if empty"
    )

    @property
    def is_commercial(self) -> bool:
        """Whether its licence allows commercial use, as far as its name tells."""
        return NON_COMMERCIAL not in self.licence.upper()


def _from_name(given: Any) -> Any:
    """What a name stands for; so a configuration holds the digest in either case."""
    if not isinstance(given, str):
        return given
    if given not in KNOWN:
        raise ValueError(f"there are no weights of this name{did_you_mean(given, KNOWN)}")
    known = KNOWN[given]
    if known.sha256 is None:
        origin = f"by {known.left_by}" if known.left_by else f"from {known.url}"
        raise ValueError(
            f"nobody has published the digest of '{known.file}': get it once {origin}, see what "
            f"`juicer doctor --encoders` says of it, and write weights: {{file: {known.file}, sha256: THAT, "
            f"licence: {known.licence}}}"
        )
    return {"file": known.file, "sha256": known.sha256, "licence": known.licence}


WeightsField = Annotated[Weights, BeforeValidator(_from_name)]
"""Weights by a name of :data:`juicer.policy.pretrained.known.KNOWN`, or a file of one's own."""
