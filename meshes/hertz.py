"""Generate a round body on a flat one, to compare with Hertz: a sphere's cap, or a slice of a roller.

    python meshes/hertz.py --out meshes/hertz.msh --shape sphere --base 20

Axes: z out of the flat surface at z = 0, the contact around the origin.  The cap fills 0 <= x <= size (a quarter), or
-size <= x <= size (a half), and 0 <= y <= size; z = (x^2 + y^2) / 2 R is its lower side.  For a roller, one element long, it is
z = x^2 / 2 R.  Elements are smallest at the contact.  Surfaces: "cap" (the round side), "top", "middle_x", "middle_y", "end_x",
"end_y"; of the base "flat", "bottom", "base_x", "base_y".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from blocks import KINDS, Body, block, jacobian_minimum
from generator import generate, option


@dataclass(frozen=True)
class Hertz:
    """Lengths in m, and numbers of cells."""

    shape: str = option("sphere", "sphere or roller", ("sphere", "roller"))
    size: float = option(0.01, "of the cap, from the contact to its far sides")
    radius: float = option(0.1, "of the round side")
    kind: str = option("hex8", "of the cap", KINDS)
    cells: int = option(18, "of the cap from the contact to a side")
    finest: float = option(0.15, "size of the cells at the contact over that of equal cells")
    half: int = option(0, "1: both sides of x = 0; 0: a quarter", (0, 1))
    base: int = option(0, "cells of an elastic base from the contact to a side; 0: no base")
    base_kind: str = option("hex8", "of the base", KINDS)


def graded(u, finest: float):
    """Return places in [0, 1] with cells of size ``finest`` at 0, relative to equal ones; odd in u."""
    return u * (finest + (1.0 - finest) * u**2)


def hertz(given: Hertz) -> dict[str, Body]:
    """Return the bodies "cap" and, where there is one, "base".  Local."""
    L, b, is_roller = given.size, given.finest, given.shape == "roller"
    slice_width = 2.0 * L * b / given.cells

    def across(u, v):
        x = L * graded(2.0 * u - 1.0 if given.half else u, b)
        return x, (slice_width * v if is_roller else L * graded(v, b))

    def cap(u, v, w):
        x, y = across(u, v)
        bottom = (x**2 + (0.0 if is_roller else y**2)) / (2.0 * given.radius)
        return np.stack([x, y, bottom + (L - bottom) * graded(w, b)], axis=-1)

    def flat(u, v, w):
        x, y = across(u, v)
        return np.stack([x, y, -L * graded(1.0 - w, b)], axis=-1)

    def divisions(n: int):
        return (2 * n if given.half else n, 1 if is_roller else n, n)

    sides = {"x1": "end_x", "y0": "middle_y", "y1": "end_y", "z0": "cap", "z1": "top"} | (
        {} if given.half else {"x0": "middle_x"}
    )
    bodies = {"cap": block(given.kind, cap, divisions(given.cells), sides)}
    if given.base:
        below = {"y0": "base_y", "z0": "bottom", "z1": "flat", "y1": "base_end_y"} | ({} if given.half else {"x0": "base_x"})
        bodies["base"] = block(given.base_kind, flat, divisions(given.base), below)
    if min(jacobian_minimum(body).min() for body in bodies.values()) <= 0.0:
        raise ValueError("size and radius must be positive, and the radius large beside the size")
    return bodies


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    generate(__doc__, Hertz, hertz, arguments=arguments)


if __name__ == "__main__":
    main()
