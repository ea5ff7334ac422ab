"""The sections of a study, each by itself: a new one is a function here and nothing elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from juicer.reporting.section import Section
from juicer.study.analyses_section import analyses_section
from juicer.study.claims import claims_section
from juicer.study.cost import cost_section
from juicer.study.curve_section import curve_section
from juicer.study.effort import effort_section
from juicer.study.learned import learned_section
from juicer.study.material import TaskStudy
from juicer.study.robustness import robustness_section
from juicer.study.rounds import rounds_section
from juicer.study.success import differences_section, success_section

Builder = Callable[[Sequence[TaskStudy]], Section | None]
BESIDE_RATES: tuple[Builder, ...] = (
    differences_section,
    robustness_section,
    curve_section,
    claims_section,
    rounds_section,
    effort_section,
    learned_section,
    cost_section,
)
"""What is told beside success rates and analyses, which a run's report tells in its own way."""
BUILDERS: tuple[Builder, ...] = (success_section, analyses_section, *BESIDE_RATES)


def sections(studies: Sequence[TaskStudy], builders: Sequence[Builder] = BUILDERS) -> tuple[Section, ...]:
    """Sections that have something to say, in their order."""
    return tuple(section for build in builders if (section := build(studies)))
