"""Generate a lap joint: two beams of tetrahedra that overlap and touch on the lap; tet10 or tet4.

    python meshes/lap_joint.py --out meshes/lap_joint.msh

Axes: x along the beams from the clamped end, y across, z upwards; the contact is at z = 0, "beam_1" is below it.
The nodes of both beams coincide on the lap ("lap_1", "lap_2") without being shared.
"""

from __future__ import annotations

from dataclasses import dataclass

from blocks import KINDS, Body, box, jacobian_minimum, join
from generator import generate, option


@dataclass(frozen=True)
class LapJoint:
    """Lengths in m, and numbers of cells; a cell is six tetrahedra."""

    length: float = option(0.120, "of each beam")
    overlap: float = option(0.030, "length of the lap")
    width: float = option(0.020, "of the beams")
    thickness: float = option(0.005, "of each beam")
    kind: str = option("tet10", "tet10 or tet4; the other solid kinds work too", KINDS)
    n_free: int = option(18, "cells along a beam outside the lap")
    n_overlap: int = option(4, "cells along the lap")
    n_width: int = option(2, "cells across the beams")
    n_thickness: int = option(3, "cells through a beam")


def lap_joint(joint: LapJoint) -> dict[str, Body]:
    """Return the bodies "beam_1", clamped at x = 0, and "beam_2", with the free end "tip".  Local."""
    start, end = joint.length - joint.overlap, 2.0 * joint.length - joint.overlap
    t = joint.thickness

    def piece(x0, x1, z0, n, names):
        return box(joint.kind, (x1 - x0, joint.width, t), (n, joint.n_width, joint.n_thickness), (x0, 0.0, z0), names)

    bodies = {
        "beam_1": join(
            [
                piece(0.0, start, -t, joint.n_free, {"x0": "clamp"}),
                piece(start, joint.length, -t, joint.n_overlap, {"z1": "lap_1"}),
            ]
        ),
        "beam_2": join(
            [
                piece(start, joint.length, 0.0, joint.n_overlap, {"z0": "lap_2"}),
                piece(joint.length, end, 0.0, joint.n_free, {"x1": "tip"}),
            ]
        ),
    }
    if min(jacobian_minimum(body).min() for body in bodies.values()) <= 0.0:
        raise ValueError("lengths must be positive, and the overlap shorter than a beam")
    return bodies


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    generate(__doc__, LapJoint, lap_joint, lambda parameters: [("lap_1", "lap_2")], arguments=arguments)


if __name__ == "__main__":
    main()
