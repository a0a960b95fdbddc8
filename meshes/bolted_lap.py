"""Generate a bolted lap joint: two plates that overlap, bolts in a row along the lap, all of hexahedra; hex8 or hex20.

    python meshes/bolted_lap.py --out meshes/bolted_lap.msh
    python meshes/bolted_lap.py --matching 2 --out meshes/bolted_lap_matching.msh

Axes: x along the plates from the clamped end, y across, z upwards; the plates touch at z = 0, "plate_1" is below.
Each hole is in a separate rectangle, with four blocks around it.  The bolts are one body, "bolts", with
clearance in the holes: the heads rest on "plate_2", the nuts are under "plate_1".  Surfaces: "lap_1", "lap_2" (contact of
the plates), "heads", "nuts" (rings outside the hole, with which the bolts press), "top", "bottom" (of the lap,
under the heads and over the nuts), "clamp", "tip", and "cut_1", "cut_2", ... across the shanks, between elements that
share their nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from blocks import Body, block, box, jacobian_minimum, join
from generator import generate, option

KINDS = ("hex8", "hex20")


@dataclass(frozen=True)
class BoltedLap:
    """Lengths in m, and numbers of cells."""

    length: float = option(0.120, "of each plate")
    width: float = option(0.020, "of the plates")
    thickness: float = option(0.005, "of each plate")
    bolts: int = option(3, "number of bolts")
    pitch: float = option(0.020, "from bolt to bolt; the lap is as many of them long as there are bolts")
    hole: float = option(0.0066, "diameter of the holes")
    shank: float = option(0.006, "diameter of the bolts")
    head: float = option(0.010, "diameter of heads and nuts")
    head_height: float = option(0.004, "of heads and nuts")
    kind: str = option("hex8", "hex8 or hex20", KINDS)
    around_1: int = option(3, "cells around a quarter of a hole and across the width, plate_1")
    around_2: int = option(4, "the same, plate_2")
    radial_1: int = option(2, "cells from a hole outwards, plate_1")
    radial_2: int = option(4, "the same, plate_2")
    through_1: int = option(2, "cells through plate_1")
    through_2: int = option(3, "cells through plate_2")
    along_1: int = option(10, "cells along plate_1 outside the lap")
    along_2: int = option(12, "the same, plate_2")
    bolt_around: int = option(4, "cells around a quarter of a bolt")
    bolt_through: int = option(2, "cells along half a shank, and through a head")
    matching: int = option(0, "1 or 2: both plates have the numbers of that one, and the nodes of the lap coincide", (0, 1, 2))


@dataclass(frozen=True)
class _Cells:
    """Numbers of cells of one plate."""

    around: int
    radial: int
    through: int
    along: int
    growth: float = 0.0  # in [0, 1): how much smaller the cells are at the inside of a ring


def bolted_lap(joint: BoltedLap) -> dict[str, Body]:
    """Return the bodies "plate_1", clamped at x = 0, "plate_2", with the free end "tip", and "bolts".  Local.

    Raises
    ------
    ValueError: lengths that turn an element inside out or let parts overlap.
    """
    _check(joint)
    t, start = joint.thickness, joint.length - joint.bolts * joint.pitch
    own = [
        _Cells(joint.around_1, joint.radial_1, joint.through_1, joint.along_1),
        _Cells(joint.around_2, joint.radial_2, joint.through_2, joint.along_2),
    ]
    first, second = [own[joint.matching - 1]] * 2 if joint.matching else own
    below = _free(joint, first, 0.0, -t, {"x0": "clamp"})
    above = _free(joint, second, joint.length, 0.0, {"x1": "tip"})
    bodies = {
        "plate_1": join([below, *_lap(joint, first, -t, {"z0": "bottom", "z1": "lap_1"})]),
        "plate_2": join([*_lap(joint, second, 0.0, {"z0": "lap_2", "z1": "top"}), above]),
        "bolts": join([part for i in range(joint.bolts) for part in _bolt(joint, start + (i + 0.5) * joint.pitch, i + 1)]),
    }
    if min(jacobian_minimum(body).min() for body in bodies.values()) <= 0.0:
        raise ValueError("these lengths turn elements inside out")
    return bodies


def _check(joint: BoltedLap) -> None:
    if not joint.bolts * joint.pitch < joint.length:
        raise ValueError("the lap, bolts x pitch, must be shorter than a plate")
    if not 0.0 < joint.shank < joint.hole < joint.head < min(joint.pitch, joint.width):
        raise ValueError("the diameters must grow from shank to hole to head, and the head be smaller than pitch and width")


def _free(joint: BoltedLap, cells: _Cells, x: float, z: float, names: dict[str, str]) -> Body:
    """Return a plate outside the lap."""
    lengths = (joint.length - joint.bolts * joint.pitch, joint.width, joint.thickness)
    return box(joint.kind, lengths, (cells.along, cells.around, cells.through), (x, 0.0, z), names)


def _lap(joint: BoltedLap, cells: _Cells, z: float, names: dict[str, str]) -> list[Body]:
    """Return a plate on the lap: a rectangle around each hole, cells growing outwards from it."""
    start, parts = joint.length - joint.bolts * joint.pitch, []
    half = 0.5 * np.array([joint.pitch, joint.width])
    for i in range(joint.bolts):
        centre = np.array([start + (i + 0.5) * joint.pitch, 0.5 * joint.width])
        outlines = _circle(0.5 * joint.hole), _rectangle(half)
        parts += _ring(joint.kind, centre, outlines, (z, z + joint.thickness), replace(cells, growth=0.4), names)
    return parts


def _bolt(joint: BoltedLap, x: float, number: int) -> list[Body]:
    """Return the shank in two halves, a head and a nut: a core, a ring around it, and rings beyond the shank."""
    t, h, n = joint.thickness, joint.head_height, joint.bolt_through
    centre = np.array([x, 0.5 * joint.width])
    shank, edge, rim = (_circle(0.5 * diameter) for diameter in (joint.shank, joint.hole, joint.head))
    core = _rectangle(np.full(2, 0.2 * joint.shank))
    flat, parts = _Cells(joint.bolt_around, 1, n, 0), []
    for z, cut, pressing in (
        ((-t - h, -t), {}, {"z1": "nuts"}),
        ((-t, 0.0), {"z1": f"cut_{number}"}, None),
        ((0.0, t), {}, None),
        ((t, t + h), {}, {"z0": "heads"}),
    ):
        corner, size = (*(centre - 0.2 * joint.shank), z[0]), (0.4 * joint.shank, 0.4 * joint.shank, z[1] - z[0])
        parts.append(box(joint.kind, size, (flat.around, flat.around, n), corner, cut))
        parts += _ring(joint.kind, centre, (core, shank), z, flat, cut)
        if pressing is not None:
            parts += _ring(joint.kind, centre, (shank, edge), z, flat, {})
            parts += _ring(joint.kind, centre, (edge, rim), z, _Cells(flat.around, 2, n, 0), pressing)
    return parts


def _ring(kind: str, centre, outlines, z, cells: _Cells, names: dict[str, str]) -> list[Body]:
    """Return the four blocks between two outlines, the inner and the outer one."""
    inside, outside = outlines

    def quarter(k: int):
        def mapping(u, v, w):
            u = u * (1.0 - cells.growth * (1.0 - u))
            flat = (1.0 - u)[:, None] * inside(k, v) + u[:, None] * outside(k, v)
            return np.column_stack([centre + flat, z[0] + w * (z[1] - z[0])])

        return block(kind, mapping, (cells.radial, cells.around, cells.through), names)

    return [quarter(k) for k in range(4)]


def _circle(radius: float):
    """Return the outline (k, v) -> (n, 2) of quarter k, which faces +x, +y, -x or -y, at the places v in [0, 1] along it."""

    def outline(k: int, v):
        angle = 0.5 * np.pi * (k + v - 0.5)
        return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    return outline


def _rectangle(half):
    """Return the outline of a rectangle of half lengths ``half`` (2,), as that of a circle."""
    corners = half * np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])

    def outline(k: int, v):
        return (1.0 - v)[:, None] * corners[k] + v[:, None] * corners[(k + 1) % 4]

    return outline


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    generate(__doc__, BoltedLap, bolted_lap, lambda lap: [("lap_1", "lap_2")] if lap.matching else [], arguments=arguments)


if __name__ == "__main__":
    main()
