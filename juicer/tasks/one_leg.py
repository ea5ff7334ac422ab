"""one_leg: screw the fourth leg into the square table's top; all five parts lie on the table."""

from __future__ import annotations

from juicer.tasks.specification import AssemblyPair, AssemblyTask
from juicer.tasks.square_table import ASSEMBLED_LEG_POSES, base_pose, square_table_leg, square_table_top

_PARTS = (
    square_table_top(),
    square_table_leg(1, -0.20, (0.55, 0.62, 0.70)),
    square_table_leg(2, -0.12, (0.55, 0.62, 0.70)),
    square_table_leg(3, 0.12, (0.55, 0.62, 0.70)),
    square_table_leg(4, 0.20, (0.80, 0.50, 0.28)),
)

# FurnitureBench's three stored layouts of high randomness (world frame, quaternion wxyz).
_HIGH = (
    (
        base_pose(0.2332, 0.0017, 0.4307, 0.701, 0.705, -0.081, -0.077),
        base_pose(0.1740, 0.1241, 0.4300, 0.754, -0.003, 0.004, -0.657),
        base_pose(0.1500, 0.1491, 0.4383, 0.004, -0.648, -0.761, 0.001),
        base_pose(0.1895, -0.1195, 0.4324, 0.469, -0.542, -0.449, -0.534),
        base_pose(0.1288, -0.1531, 0.4333, 0.442, -0.006, 0.005, -0.897),
    ),
    (
        base_pose(0.2105, -0.0207, 0.4307, 0.700, 0.708, 0.063, 0.071),
        base_pose(0.1702, 0.1141, 0.4301, 0.014, -0.748, -0.664, 0.006),
        base_pose(0.2095, -0.0462, 0.4340, 0.000, -0.706, -0.708, 0.000),
        base_pose(0.0991, 0.2111, 0.4312, 0.446, 0.544, 0.454, -0.547),
        base_pose(0.2546, -0.1481, 0.4317, 0.514, -0.013, 0.010, -0.857),
    ),
    (
        base_pose(0.1401, -0.0737, 0.4322, 0.695, 0.697, -0.129, -0.123),
        base_pose(0.1628, 0.0707, 0.4313, 0.341, 0.615, 0.347, -0.621),
        base_pose(0.3183, -0.0781, 0.4300, 0.386, 0.589, 0.388, -0.595),
        base_pose(0.1021, 0.1526, 0.4308, 0.635, -0.011, 0.015, -0.773),
        base_pose(0.2820, 0.0850, 0.4315, 0.033, 0.701, 0.040, -0.711),
    ),
)

ONE_LEG = AssemblyTask(
    name="one_leg",
    parts=_PARTS,
    pairs=(AssemblyPair(first=0, second=4, targets=ASSEMBLED_LEG_POSES, operator_target=0),),
    high_layouts=tuple({part.name: pose for part, pose in zip(_PARTS, layout, strict=True)} for layout in _HIGH),
    max_steps=1000,
    num_critical_states=1,
    gripper_width_m=0.065,
    milestones=("top_placed", "leg_lifted", "leg_upright", "over_hole", "inserted", "screwed"),
)
