"""Generate two blades with a wedge damper under their platforms: hexahedra, non-matching flanks.

    python meshes/damper.py --out meshes/damper.msh

Axes as of the fan sector: x along the circumference, y along the engine's axis, z outwards; the axis is the line x = z = 0. The
blades stand on radii, one on each side of x = 0, mirror images of each other.  The undersides of their platforms
("left_platform", "right_platform") make a roof; the damper is below it, a prism whose flanks ("damper_left", "damper_right")
touch both without sharing nodes.  Roots are clamped at "left_root", "right_root"; tips are "left_tip", "right_tip".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from blocks import KINDS, Body, block, jacobian_minimum, join
from generator import generate, option


@dataclass(frozen=True)
class Damper:
    """Lengths in m, angles in degrees, and numbers of cells."""

    root_radius: float = option(0.270, "from the engine's axis to the held roots")
    ridge_radius: float = option(0.300, "to the ridge of the roof, where the undersides would meet")
    tip_radius: float = option(0.410, "to the tips of the blades")
    n_blades: int = option(60, "on the whole circumference")
    chord: float = option(0.040, "of shank, platform and aerofoil, along the axis")
    shank: float = option(0.010, "thickness of the shank")
    tip: float = option(0.003, "thickness of the tip; the aerofoil tapers to it")
    platform: float = option(0.004, "thickness of the platforms at their edges")
    gap: float = option(0.002, "between the two platforms")
    flank_angle: float = option(45.0, "of the undersides, from the circumference")
    damper_top: float = option(0.004, "width of the damper at its top")
    damper_bottom: float = option(0.016, "width of the damper at its bottom")
    damper_length: float = option(0.030, "along the axis")
    kind: str = option("hex20", "of the blades", KINDS)
    damper_kind: str = option("hex8", "of the damper", KINDS)
    n_chord: int = option(4, "cells of a blade along the axis")
    n_shank: int = option(4, "cells along the shank")
    n_thick: int = option(2, "cells through shank and aerofoil")
    n_platform: int = option(3, "cells of a platform from the shank to its edge")
    n_height: int = option(2, "cells through a platform")
    n_aerofoil: int = option(8, "cells along the aerofoil")
    n_damper: int = option(3, "cells of the damper from flank to flank")
    n_flank: int = option(2, "cells up a flank of the damper")
    n_length: int = option(4, "cells along the damper")

    @property
    def slope(self) -> float:
        """Fall of an underside along the circumference."""
        return float(np.tan(np.radians(self.flank_angle)))


def damper(given: Damper) -> dict[str, Body]:
    """Return the bodies "left", "right" and "damper".  Local.

    Raises
    ------
    ValueError: lengths that leave no room, or turn elements inside out.
    """
    room = 2.0 * (given.ridge_radius * np.sin(np.pi / given.n_blades) - 0.5 * given.shank)
    if not 0.0 < given.gap < given.damper_top < given.damper_bottom < room:
        raise ValueError(f"gap, damper_top, damper_bottom and the room of {1e3 * room:.3g} mm between the shanks must increase")
    bodies = {"left": _blade(given, "left", -1.0), "right": _blade(given, "right", 1.0), "damper": _wedge(given)}
    if min(jacobian_minimum(body).min() for body in bodies.values()) <= 0.0:
        raise ValueError("these lengths and angles turn elements inside out")
    return bodies


def _blade(given: Damper, name: str, side: float) -> Body:
    """Return the blade on the side -1 or 1 of x = 0: quadrilaterals of its section, swept along the axis.

    A place in the section has the height r along the blade's radius and the distance t from it, towards the damper.
    """
    sine, cosine = np.sin(np.pi / given.n_blades), np.cos(np.pi / given.n_blades)
    half, tip = 0.5 * given.shank, 0.5 * given.tip

    def under(t: float) -> tuple[float, float]:
        """Return t and r of the underside, z = ridge - slope |x|."""
        return t, (given.ridge_radius + t * (given.slope * cosine - sine)) / (cosine + given.slope * sine)

    def swept(places, divisions: tuple[int, int], names=None) -> Body:
        t, r = np.array(places).T
        section = np.column_stack([side * (r * sine - t * cosine), r * cosine + t * sine])
        order = [1, 0, 3, 2] if side > 0.0 else [0, 1, 2, 3]  # t points along x in the left blade
        return _prism(given.kind, section[order], given.chord, (divisions[0], given.n_chord, divisions[1]), names)

    end = (given.ridge_radius - 0.5 * given.slope * given.gap) * sine - 0.5 * given.gap * cosine  # half a gap from x = 0
    foot, edge = under(half), under(end)
    low, top = foot[1], edge[1] + given.platform
    parts = [
        swept(
            [(-half, given.root_radius), (half, given.root_radius), foot, (-half, low)],
            (given.n_thick, given.n_shank),
            {"z0": f"{name}_root"},
        ),
        swept([(-half, low), foot, (half, top), (-half, top)], (given.n_thick, given.n_height)),
        swept([foot, edge, (end, top), (half, top)], (given.n_platform, given.n_height), {"z0": f"{name}_platform"}),
        swept(
            [(-end, edge[1]), (-half, low), (-half, top), (-end, top)],
            (given.n_platform, given.n_height),
            {"z0": "outer_undersides"},
        ),
        swept(
            [(-half, top), (half, top), (tip, given.tip_radius), (-tip, given.tip_radius)],
            (given.n_thick, given.n_aerofoil),
            {"z1": f"{name}_tip"},
        ),
    ]
    return join(parts)


def _wedge(given: Damper) -> Body:
    """Return the damper; its flanks lie on the undersides."""
    top, bottom = 0.5 * given.damper_top, 0.5 * given.damper_bottom
    high, low = (given.ridge_radius - given.slope * x for x in (top, bottom))
    section = np.array([(-bottom, low), (bottom, low), (top, high), (-top, high)])
    names = {"x0": "damper_left", "x1": "damper_right", "z0": "damper_bottom", "y0": "damper_end"}
    return _prism(given.damper_kind, section, given.damper_length, (given.n_damper, given.n_length, given.n_flank), names)


def _prism(kind: str, section: np.ndarray, length: float, divisions: tuple[int, int, int], names=None) -> Body:
    """Return a quadrilateral (4, 2) of x and z, counted round, swept along y over ``length`` [m] about y = 0.  Local."""

    def mapping(u, v, w):
        x, z = np.einsum("kn,kd->dn", [(1 - u) * (1 - w), u * (1 - w), u * w, (1 - u) * w], section)
        return np.stack([x, length * (v - 0.5), z], axis=-1)

    return block(kind, mapping, divisions, names)


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    generate(__doc__, Damper, damper, arguments=arguments)


if __name__ == "__main__":
    main()
