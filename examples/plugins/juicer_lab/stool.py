"""stool: one leg and a top, and nothing else on the table; both parts are the square table's, in other colours."""

from __future__ import annotations

from dataclasses import replace

from juicer.tasks.specification import AssemblyTask, Insertion
from juicer.tasks.square_table import leg_pair, square_table_leg, square_table_top

TASK = AssemblyTask(
    name="stool",
    parts=(
        replace(square_table_top(), name="stool_top", rgb=(0.30, 0.45, 0.35)),
        replace(square_table_leg(1, 0.20, (0.80, 0.50, 0.28)), name="stool_leg"),
    ),
    base_label="top",
    pairs=(leg_pair(1, "leg", 0),),
    high_layouts=(),
    max_steps=1000,
    critical_states=(Insertion(0),),
    gripper_width_m=0.065,
)
