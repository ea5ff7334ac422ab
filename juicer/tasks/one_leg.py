"""one_leg: screw the fourth leg into the square table's top; all five parts lie on the table."""

from __future__ import annotations

from juicer.tasks.specification import AssemblyTask, Insertion
from juicer.tasks.square_table import HIGH_LAYOUTS, SQUARE_TABLE_PARTS, leg_pair

TASK = AssemblyTask(
    name="one_leg",
    parts=SQUARE_TABLE_PARTS,
    base_label="top",
    pairs=(leg_pair(4, "leg", 0),),
    high_layouts=HIGH_LAYOUTS,
    max_steps=1000,
    critical_states=(Insertion(0),),
    gripper_width_m=0.065,
)
