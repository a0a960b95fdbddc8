"""Generate a block with a mast on it, for contact with rigid ground: hexahedra, one body.

    python meshes/block_on_ground.py --out meshes/block_on_ground.msh

Axes: x along the block, y across, z upwards from the ground; the origin is the centre of the underside.  Surfaces: "foot" (the
underside), "shoulders" (the top of the block beside the mast) and "mast_top".
"""

from __future__ import annotations

from dataclasses import dataclass

from blocks import KINDS, Body, box, jacobian_minimum, join
from generator import generate, option


@dataclass(frozen=True)
class BlockOnGround:
    """Lengths in m, and numbers of cells."""

    length: float = option(0.100, "of the block, along x")
    width: float = option(0.040, "of block and mast, along y")
    height: float = option(0.020, "of the block")
    mast: float = option(0.008, "thickness of the mast, along x")
    mast_height: float = option(0.070, "of the mast above the block")
    kind: str = option("hex20", "hex20 or hex8; the other solid kinds work too", KINDS)
    n_shoulder: int = option(3, "cells along the block on each side of the mast")
    n_mast: int = option(2, "cells through the mast")
    n_width: int = option(2, "cells across")
    n_height: int = option(2, "cells up the block")
    n_up: int = option(6, "cells up the mast")


def block_on_ground(given: BlockOnGround) -> dict[str, Body]:
    """Return the body "block".  Local.

    Raises
    ------
    ValueError: lengths that leave no room.
    """
    half, middle = 0.5 * given.length, 0.5 * given.mast

    def piece(x: tuple[float, float], z: tuple[float, float], n_x: int, n_z: int, names) -> Body:
        size, origin = (x[1] - x[0], given.width, z[1]), (x[0], -0.5 * given.width, z[0])  # z: start and height
        return box(given.kind, size, (n_x, given.n_width, n_z), origin, names)

    low, up = (0.0, given.height), (given.height, given.mast_height)
    shoulder = {"z0": "foot", "z1": "shoulders"}
    block = join(
        [
            piece((-half, -middle), low, given.n_shoulder, given.n_height, shoulder),
            piece((-middle, middle), low, given.n_mast, given.n_height, {"z0": "foot"}),
            piece((middle, half), low, given.n_shoulder, given.n_height, shoulder),
            piece((-middle, middle), up, given.n_mast, given.n_up, {"z1": "mast_top"}),
        ]
    )
    if jacobian_minimum(block).min() <= 0.0:
        raise ValueError("lengths must be positive, and the mast thinner than the block is long")
    return {"block": block}


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    generate(__doc__, BlockOnGround, block_on_ground, arguments=arguments)


if __name__ == "__main__":
    main()
