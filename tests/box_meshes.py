"""Small structured meshes of every element kind, and settings for them, for the tests of mesh and assembly."""

from __future__ import annotations

import numpy as np

from microslip.mesh.data import ElementBlock, Mesh
from microslip.tables.joint import Joint
from microslip.tables.structure import Body, Material, Model, Orientation, Support
from microslip.tables.structure_tables import StructureTables
from microslip.tables.vibration import Load, Output

STEEL = Material(young=2.1e11, poisson=0.3, density=7800.0)
KINDS = ("tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15", "pyramid5", "pyramid13")
# A hexahedron of corners 0 to 7 as six tetrahedra, two wedges, or six pyramids about its centre, 8; neighbours match.
_SPLIT = {
    "hex": [[0, 1, 2, 3, 4, 5, 6, 7]],
    "wedge": [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]],
    "pyramid": [[3, 7, 4, 0, 8], [5, 6, 2, 1, 8], [4, 5, 1, 0, 8], [2, 6, 7, 3, 8], [1, 2, 3, 0, 8], [7, 6, 5, 4, 8]],
    "tet": [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]],
}
EDGES = {
    "tet10": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "hex20": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
    "wedge15": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
    "pyramid13": [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)],
}


def box(kind: str, n=(2, 2, 2), size=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n_points, 3) and elements (n_elements, n_nodes) of a box in VTK order."""
    index = np.arange(np.prod(np.add(n, 1))).reshape(np.add(n, 1))
    grid = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, k + 1) for k in n), indexing="ij"), axis=-1)
    points = grid.reshape(-1, 3) * size + origin
    a, b = slice(None, -1), slice(1, None)
    corners = ((a, a, a), (b, a, a), (b, b, a), (a, b, a), (a, a, b), (b, a, b), (b, b, b), (a, b, b))
    hexes = np.stack([index[corner].ravel() for corner in corners], axis=1)
    family = kind.rstrip("0123456789")
    if family == "pyramid":
        hexes = np.hstack([hexes, len(points) + np.arange(len(hexes))[:, None]])
        points = np.concatenate([points, points[hexes[:, :8]].mean(axis=1)])
    elements = hexes[:, _SPLIT[family]].reshape(-1, len(_SPLIT[family][0]))
    return add_mid_sides(points, elements, EDGES[kind]) if kind in EDGES else (points, elements)


def add_mid_sides(points: np.ndarray, elements: np.ndarray, edges) -> tuple[np.ndarray, np.ndarray]:
    """Add a node in the middle of every edge."""
    ends = np.sort(elements[:, edges].reshape(-1, 2), axis=1)
    unique, index = np.unique(ends, axis=0, return_inverse=True)
    mid = index.ravel().reshape(len(elements), len(edges)) + len(points)
    return np.concatenate([points, points[unique].mean(axis=1)]), np.hstack([elements, mid])


def mesh_of(*parts, groups=None, faces=()) -> Mesh:
    """Return a Mesh of (group, kind, points, elements) parts without common nodes; numbers of nodes start from 1001.

    ``groups`` maps names of node sets to functions of the points (n_points, 3) that return which of them belong to the set.
    """
    points = np.concatenate([part[2] for part in parts])
    blocks, start, first = [], 0, 1
    for group, kind, own, elements in parts:
        blocks.append(ElementBlock(kind, group, elements + start, np.arange(first, first + len(elements))))
        start, first = start + len(own), first + len(elements)
    node_groups = {block.group: np.unique(block.nodes) for block in blocks}
    for name, claim in (groups or {}).items():
        node_groups[name] = np.flatnonzero(claim(points))
    return Mesh("box.msh", points, np.arange(1001, 1001 + len(points)), tuple(blocks), tuple(faces), node_groups)


def joint(name="joint", surfaces=("lower_top", "upper_bottom"), **changes) -> Joint:
    values = {"friction": 0.3, "tangential_stiffness": 2e13, "normal_stiffness": 3e13, "preload": 5e7, "pairing": "nodes"}
    return Joint.of_file(name=name, surfaces=surfaces, **{**values, **changes})


def settings(bodies, supports=(), joints=(), loads=(), outputs=(), file="box.msh", scale=1.0, **more) -> StructureTables:
    """Return the tables of a mesh of steel; ``bodies`` maps names to groups, supports are (group, axes)."""
    return StructureTables.of_file(
        model=Model.of_file(mesh=str(file), scale=scale, take=()),
        materials={"steel": STEEL},
        bodies={name: Body(group=group, material="steel") for name, group in bodies.items()},
        supports=tuple(Support(group=group, fix=tuple(fix)) for group, fix in supports),
        joints=tuple(joints),
        loads=tuple(load if isinstance(load, Load) else Load(**load) for load in loads),
        outputs=tuple(Output(**output) for output in outputs),
    ).with_keys(**more)


def made_of(given: StructureTables, material: Material, orientation: Orientation | None = None) -> StructureTables:
    """Return the tables with another material of all bodies."""
    axes = None if orientation is None else "axes"
    return given.with_keys(
        materials={"steel": material},
        orientations={} if orientation is None else {"axes": orientation},
        bodies={name: body.with_keys(orientation=axes) for name, body in given.bodies.items()},
    )
