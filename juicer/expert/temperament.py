"""How unlike a machine the scripted operator is."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from juicer.expert.human import Human
from juicer.expert.steady import Steady

Temperament = Annotated[Steady | Human, Field(discriminator="kind")]
"""The steady operator, or the human-like one."""
