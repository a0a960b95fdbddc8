"""Generate one sector of a bladed disc whose blades touch at shrouds: disc, blade and shroud are one body of hexahedra.

    python meshes/shrouded_disc.py --out meshes/shrouded_disc.msh

The axis is z; the sector begins at the angle 0 and ends at 360 degrees over the number of blades.  Lines of constant angle lean
with z: shrouds meet on inclined faces, and blades that bend along the axis slide on their neighbours.  Surfaces: "bore",
"disc_low" and "disc_high" (cyclic faces of the disc), "shroud_low" and "shroud_high" (where shrouds touch the neighbours'),
"shroud_top".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from blocks import KINDS, Body, block, jacobian_minimum, join
from generator import generate, option


@dataclass(frozen=True)
class ShroudedDisc:
    """Lengths in m, angles in degrees, and numbers of cells."""

    n_blades: int = option(12, "blades on the disc")
    bore: float = option(0.060, "inner radius of the disc")
    rim: float = option(0.090, "outer radius of the disc")
    tip: float = option(0.190, "radius at which the blade ends and the shroud begins")
    top: float = option(0.196, "outer radius of the shroud")
    disc_width: float = option(0.024, "of the disc along the axis")
    blade_width: float = option(0.030, "of blade and shroud along the axis")
    thickness: float = option(0.10, "of the blade, as a share of the sector's angle")
    lean: float = option(25.0, "of blade and shroud faces against the axis, at the tip")
    kind: str = option("hex20", "hex20 or hex8; the other solid kinds work too", KINDS)
    n_span: int = option(8, "cells along the blade")
    n_width: int = option(3, "cells along the axis")
    n_side: int = option(2, "cells of disc and shroud on each side of the blade")
    n_disc: int = option(2, "cells along the radius of the disc")


def shrouded_disc(given: ShroudedDisc) -> dict[str, Body]:
    """Return the body "sector".  Local.

    Raises
    ------
    ValueError: lengths that leave no room.
    """
    sector, half = 2.0 * np.pi / given.n_blades, 0.5 * given.thickness
    across = ((0.0, 0.5 - half), (0.5 - half, 0.5 + half), (0.5 + half, 1.0))
    per_width = np.tan(np.radians(given.lean)) / given.tip  # rad a metre along the axis

    def width(r):
        share = np.clip((r - given.bore) / (given.rim - given.bore), 0.0, 1.0)
        return given.disc_width + (given.blade_width - given.disc_width) * share

    def piece(radii: tuple[float, float], part: tuple[float, float], divisions, names=None) -> Body:
        def mapping(u, v, w):
            r = radii[0] + (radii[1] - radii[0]) * u
            z = width(r) * (w - 0.5)
            angle = sector * (part[0] + (part[1] - part[0]) * v) + per_width * z
            return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)

        return block(given.kind, mapping, divisions, names)

    counts = (given.n_side, 1, given.n_side)
    ring = [{"y0": "disc_low"}, {}, {"y1": "disc_high"}]
    shroud = [{"y0": "shroud_low", "x1": "shroud_top"}, {"x1": "shroud_top"}, {"y1": "shroud_high", "x1": "shroud_top"}]
    parts = [
        piece((given.bore, given.rim), part, (given.n_disc, n, given.n_width), names | {"x0": "bore"})
        for part, n, names in zip(across, counts, ring, strict=True)
    ]
    parts.append(piece((given.rim, given.tip), across[1], (given.n_span, 1, given.n_width)))
    parts += [
        piece((given.tip, given.top), part, (1, n, given.n_width), names)
        for part, n, names in zip(across, counts, shroud, strict=True)
    ]
    body = join(parts)
    if jacobian_minimum(body).min() <= 0.0:
        raise ValueError("radii must rise from bore to top, and the thickness lie between 0 and 1")
    return {"sector": body}


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    generate(__doc__, ShroudedDisc, shrouded_disc, arguments=arguments)


if __name__ == "__main__":
    main()
