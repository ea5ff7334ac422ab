"""What may touch what, and how much it rubs.

MuJoCo mixes the friction of two geoms by their maximum, PhysX by their mean. Every pair's value is therefore
set explicitly through priorities: the geom of higher priority decides alone. The values are the means that
FurnitureBench's settings give in PhysX (parts 0.15, table 0.10, everything else 1.0):

=========  ==================  ========
decides    pair                friction
=========  ==================  ========
fingers    finger, anything    0.575
fixture    fence, part         0.575
table      table, part         0.125
part       part, part; thread  0.15
=========  ==================  ========
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# Solids collide with solids, beads with beads and bores, and a peg with the bead that lines a hole too. Nothing else
# can reach a bead: it lies behind its bore, or winds close around its peg.
SOLID, BEAD, PEG_SHAFT = 1, 2, 4


@dataclass(frozen=True)
class Surface:
    """Contact properties of a geom."""

    friction: float
    priority: int
    condim: int
    contype: int = SOLID
    conaffinity: int = SOLID

    def attributes(self) -> dict[str, Any]:
        """Keyword arguments for ``add_geom``; torsional and rolling friction as lengths [m]."""
        return {
            "friction": (self.friction, 0.003, 1e-4),
            "priority": self.priority,
            "condim": self.condim,
            "contype": self.contype,
            "conaffinity": self.conaffinity,
            "solimp": (0.95, 0.99, 0.001, 0.5, 2.0),
        }


PART = Surface(friction=0.15, priority=0, condim=3)
PEG = Surface(friction=0.15, priority=0, condim=3, contype=SOLID | PEG_SHAFT, conaffinity=SOLID)
BORE_WALL = Surface(friction=0.15, priority=0, condim=3, contype=SOLID | BEAD, conaffinity=SOLID | BEAD)
PEG_BEAD = Surface(friction=0.15, priority=0, condim=3, contype=BEAD, conaffinity=BEAD)
HOLE_BEAD = Surface(friction=0.15, priority=0, condim=3, contype=BEAD, conaffinity=BEAD | PEG_SHAFT)
TABLE = Surface(friction=0.125, priority=1, condim=3)
FIXTURE = Surface(friction=0.575, priority=2, condim=3)
ARM = Surface(friction=0.575, priority=2, condim=3, contype=0, conaffinity=SOLID)
FINGER = Surface(friction=0.575, priority=3, condim=4)
