"""Generate a round body on a flat one with uniform cells up to the edge of the contact, to compare with Cattaneo and Mindlin.

    python meshes/hertz_rings.py --out meshes/rings.msh --shape sphere --rings 24 --base-rings 30

Axes: z out of the flat surface at z = 0, the contact around the origin; both bodies are at y >= 0.  A sphere's cap and its base
are halves of cylinders, meshed in rings about the z axis; a roller and its base are slices one element long, meshed in rows.
Rings or rows are of equal width from the middle (of a sphere: from half the radius of contact) to beyond the edge, and grow
from there, and downwards.  Surfaces: "cap" and "flat" (up to the last equal ring), "top", "bottom", "middle_y", "end_y" (roller),
"base_y", "base_end_y".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from blocks import SIDES, Body, block, jacobian_minimum, join
from generator import generate, option

CORE = 0.5  # radius of the innermost ring of a sphere, over that of the contact
SQUARE = 0.25  # half the side of the inner square, over the radius of the contact
BLEND = 3  # rings from the square to the innermost one
BEYOND = 1.15  # radius of the largest of the equal rings, over that of the contact


@dataclass(frozen=True)
class Rings:
    """Lengths in m, and numbers of cells."""

    shape: str = option("sphere", "sphere or roller", ("sphere", "roller"))
    size: float = option(0.01, "radius and height of each body (of a roller: half its width, and height)")
    radius: float = option(0.1, "of the round side")
    contact: float = option(0.00125, "radius of the contact that is expected")
    rings: int = option(24, "rings, or rows, of the cap over the radius of contact")
    base_rings: int = option(24, "of the base")
    angles: int = option(3, "cells of the cap on an eighth of a circle")
    base_angles: int = option(3, "of the base")
    growth: float = option(1.3, "of one cell over the one before, away from the contact")


def growing(first: float, start: float, end: float, growth: float) -> np.ndarray:
    """Return places from ``start`` to ``end`` in steps that begin near ``first`` and grow evenly, with both ends.  Local."""
    n = max(1, round(np.log1p((end - start) / first * (growth - 1.0)) / np.log(growth)))
    steps = growth ** np.arange(n)
    return start + (end - start) * np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])


def radii(given: Rings, rings: int, start: float) -> np.ndarray:
    """Return the radii of rings from ``start`` outwards, over the radius of contact up to BEYOND equal, [m].  Local."""
    n = round((BEYOND - start) * rings)
    equal = given.contact * (start + np.arange(n + 1) / rings)
    return np.concatenate([equal[:-1], growing(given.contact / rings, equal[-1], given.size, given.growth)])


def _steps(places: np.ndarray):
    """Return the function that takes equal cells of [0, 1] to those between ``places``."""
    return lambda u: np.interp(u, np.linspace(0.0, 1.0, len(places)), places)


def half_disc(given: Rings, rings: int, angles: int):
    """Return the parts of the half disc y >= 0: functions (u, v) -> (x, y), and numbers of cells.  Local."""
    square, outwards = SQUARE * given.contact, radii(given, rings, CORE)
    blend = np.linspace(square, outwards[0], BLEND + 1)[:-1]
    at = _steps(np.concatenate([blend, outwards]))

    def fan(first, n_eighths):
        """Return a part that covers a number of eighths of the circle, from the square's boundary outwards."""

        def part(u, v):
            angle, r = np.pi / 4.0 * (first + n_eighths * (1.0 - u)), at(v)
            round_share = np.clip((r - square) / (outwards[0] - square), 0.0, 1.0)
            unit = np.stack([np.cos(angle), np.sin(angle)])
            side = 1.0 / np.abs(unit).max(axis=0)  # of the square, over its half side
            return unit * (r * (round_share + (1.0 - round_share) * side))

        return part, (n_eighths * angles, BLEND + len(outwards) - 1)

    def middle(u, v):  # rays from the centre meet the square's sides at the nodes of the fans
        tangent = np.tan(np.pi / 4.0 * np.stack([2.0 * u - 1.0, v]))
        return square * tangent

    return [(middle, (2 * angles, angles)), fan(3.0, 1), fan(1.0, 2), fan(0.0, 1)]


def strip(given: Rings, rows: int):
    """Return the one part of a roller's slice: a function (u, v) -> (x, y), and numbers of cells.  Local."""
    places = radii(given, rows, 0.0)
    across = _steps(np.concatenate([-places[:0:-1], places]))
    width = 2.0 * given.contact / given.rings
    return [(lambda u, v: np.stack([across(u), width * v]), (2 * (len(places) - 1), 1))]


def one_body(given: Rings, rings: int, angles: int, is_cap: bool) -> Body:
    """Return the cap or the base, meshed with this number of rings.  Local."""
    depths = _steps(growing(given.contact / rings, 0.0, given.size, given.growth) / given.size)
    is_roller = given.shape == "roller"

    def placed(plane):
        def mapping(u, v, w):
            x, y = plane(u, v)
            if not is_cap:
                return np.stack([x, y, -given.size * depths(1.0 - w)], axis=-1)
            bottom = (x**2 + (0.0 if is_roller else y**2)) / (2.0 * given.radius)
            return np.stack([x, y, bottom + (given.size - bottom) * depths(w)], axis=-1)

        return mapping

    names = {"z0": "cap", "z1": "top"} if is_cap else {"z0": "bottom", "z1": "flat"}
    parts = strip(given, rings) if is_roller else half_disc(given, rings, angles)
    n_deep = len(growing(given.contact / rings, 0.0, given.size, given.growth)) - 1
    sides = dict(zip(SIDES[:4], SIDES[:4])) | names
    body = join([block("hex8", placed(plane), (*cells, n_deep), sides) for plane, cells in parts])
    return replace(body, faces=_surfaces(body, given, rings, is_cap))


def _surfaces(body: Body, given: Rings, rings: int, is_cap: bool) -> dict[str, list[np.ndarray]]:
    """Return the faces by name: the contact up to the last equal ring, and the planes of the symmetry conditions."""
    contact, far, prefix = ("cap", "top", "") if is_cap else ("flat", "bottom", "base_")
    x, y = body.points[:, 0], body.points[:, 1]
    across = np.abs(x) if given.shape == "roller" else np.hypot(x, y)
    reach = BEYOND + (0.6 / rings if is_cap else 0.1)  # the base covers all of the cap's surface
    touching, sides = body.faces[contact][0], np.concatenate([body.faces[side][0] for side in SIDES[:4]])
    surfaces = {far: body.faces[far]}
    surfaces[contact] = [touching[(across[touching] < reach * given.contact).all(axis=1)]]
    surfaces["middle_y" if is_cap else "base_y"] = [sides[(np.abs(y[sides]) < 1e-12).all(axis=1)]]
    if given.shape == "roller":
        surfaces[prefix + "end_y"] = [sides[(y[sides] > y.max() - 1e-12).all(axis=1)]]
    return surfaces


def hertz_rings(given: Rings) -> dict[str, Body]:
    """Return the bodies "cap" and "base".  Local."""
    bodies = {
        "cap": one_body(given, given.rings, given.angles, True),
        "base": one_body(given, given.base_rings, given.base_angles, False),
    }
    if min(jacobian_minimum(body).min() for body in bodies.values()) <= 0.0:
        raise ValueError("the radius of contact must be small beside size and radius")
    return bodies


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    generate(__doc__, Rings, hertz_rings, arguments=arguments)


if __name__ == "__main__":
    main()
