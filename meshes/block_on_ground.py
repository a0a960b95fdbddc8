"""Generate a block with a mast on it, to stand on the ground: hexahedra, one body.

    python meshes/block_on_ground.py --out meshes/block_on_ground.msh

Axes: x along the block, y across, z upwards from the ground; the origin is in the middle of the underside.  Surfaces: "foot" (the
underside), "shoulders" (the top of the block beside the mast) and "mast_top".
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field, fields

from blocks import KINDS, Body, box, jacobian_minimum, join
from msh import summary, write_msh


def _says(default, text: str):
    return field(default=default, metadata={"help": text})


@dataclass(frozen=True)
class BlockOnGround:
    """Lengths in m, and numbers of cells."""

    length: float = _says(0.100, "of the block, along x")
    width: float = _says(0.040, "of block and mast, along y")
    height: float = _says(0.020, "of the block")
    mast: float = _says(0.008, "thickness of the mast, along x")
    mast_height: float = _says(0.070, "of the mast above the block")
    kind: str = _says("hex20", "hex20 or hex8; the other solid kinds work too")
    n_shoulder: int = _says(3, "cells along the block on each side of the mast")
    n_mast: int = _says(2, "cells through the mast")
    n_width: int = _says(2, "cells across")
    n_height: int = _says(2, "cells up the block")
    n_up: int = _says(6, "cells up the mast")


def block_on_ground(given: BlockOnGround) -> dict[str, Body]:
    """Return the body "block".  Local.

    Raises
    ------
    ValueError: lengths that leave no room.
    """
    half, middle = 0.5 * given.length, 0.5 * given.mast

    def piece(x: tuple[float, float], z: tuple[float, float], n_x: int, n_z: int, names) -> Body:
        size, origin = (x[1] - x[0], given.width, z[1]), (x[0], -0.5 * given.width, z[0])  # z: from where on, and how high
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
    """Write the mesh that the command line asks for and print what it holds."""
    show = argparse.ArgumentDefaultsHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], formatter_class=show)
    parser.add_argument("--out", required=True, help="file to write, Gmsh format 2.2")
    for item in fields(BlockOnGround):
        parser.add_argument(
            "--" + item.name.replace("_", "-"),
            type=type(item.default),
            default=item.default,
            help=item.metadata["help"],
            choices=KINDS if item.name == "kind" else None,
        )
    given = vars(parser.parse_args(arguments))
    try:
        bodies = block_on_ground(BlockOnGround(**{item.name: given[item.name] for item in fields(BlockOnGround)}))
        write_msh(given["out"], bodies)
    except (ValueError, OSError) as problem:
        parser.exit(2, f"{parser.prog}: {problem}\n")
    print(f"{given['out']}\n{summary(bodies, [])}")


if __name__ == "__main__":
    main()
