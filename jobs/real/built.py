"""Models of verification manuals without a mesh file: built from their public definition, as Abaqus input files.

NAFEMS, Selected Benchmarks for Natural Frequency Analysis: FV52.  Ansys' verification manual (its scripts are in the package
ansys-mapdl-core): VM244, VM281, VM301, VM302, by their geometry, material and supports, with quadratic hexahedra of reduced
integration (SOLID186); VM320 as matrices with one row.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[2] / "meshes")]

from blocks import Body, block, box, join  # noqa: E402


def thick_plate() -> str:
    """NAFEMS FV52: 10 x 10 x 1 m, w = 0 along the four lower edges, free in its plane; with the mesh of the definition."""
    plate = box("hex20", (10.0, 10.0, 1.0), (4, 4, 1))
    x, y, z = plate.points.T
    at_edge = (z == 0.0) & ((x == 0.0) | (x == 10.0) | (y == 0.0) | (y == 10.0))
    return _input("C3D20", plate, (200e9, 0.3, 8000.0), {"EDGES": (at_edge, "3, 3")})


def turning_plate() -> str:
    """VM281: a plate of 152.4 x 50.8 x 2.54 mm, clamped at y = 0."""
    plate = box("hex20", (0.0508, 0.1524, 0.00254), (8, 24, 1), (-0.0254, 0.0, -0.00127))
    return _input("C3D20R", plate, (2e11, 0.3, 7850.0), {"BASE": (plate.points[:, 1] == 0.0, "1, 3")})


def annular_plate() -> str:
    """VM244: radii 185 and 500 mm, 5 mm thick, aluminium; w = 0 along the lower outer edge, in m, kg, s."""
    disc = annulus(0.185, 0.5, 0.005, (6, 48, 1))
    at_edge = (np.hypot(*disc.points[:, :2].T) > 0.5 - 1e-8) & (disc.points[:, 2] < 1e-8)
    return _input("C3D20R", disc, (70e9, 0.3, 2700.0), {"EDGE": (at_edge, "3, 3")})


def turning_disc() -> str:
    """VM301: diameters 6 and 24 inches, 0.12 inches thick, clamped at the inner radius."""
    disc = annulus(3.0 * 0.0254, 12.0 * 0.0254, 0.12 * 0.0254, (6, 40, 1))
    return _input(
        "C3D20R", disc, (2.03e11, 0.3, 7850.0), {"BORE": (np.hypot(*disc.points[:, :2].T) < 3.0 * 0.0254 + 1e-8, "1, 3")}
    )


RING = 0.176, 0.00088, 0.02, 24  # VM302: outer diameter, thickness, length [m]; sectors


def turning_ring() -> str:
    """VM302: one of 24 sectors of a thin ring, fixed along z in its middle plane."""
    outer, thickness, length, N = RING

    def mapping(u, v, w):
        radius, angle = 0.5 * outer - thickness * (1.0 - u), 2.0 * np.pi / N * (v - 0.5)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), length * (w - 0.5)], axis=-1)

    ring = join([block("hex20", mapping, (1, 2, 2))])
    angle, radius = np.arctan2(ring.points[:, 1], ring.points[:, 0]) * N / np.pi, np.hypot(*ring.points[:, :2].T)
    is_middle = np.abs(ring.points[:, 2]) < 1e-8
    at = {
        "LOW": angle < -1.0 + 1e-6,
        "HIGH": angle > 1.0 - 1e-6,
        "POINT": is_middle & (abs(angle) < 1e-6) & (radius > radius.max() - 1e-8),
    }
    return _input("C3D20R", ring, (2.1e11, 0.3, 7850.0), {"MIDDLE": (is_middle, "3, 3")}, at)


def annulus(inner: float, outer: float, thickness: float, cells: tuple[int, int, int]) -> Body:
    """Return a disc with a hole about z, cells along the radius, the circumference and z."""

    def mapping(u, v, w):
        radius, angle = inner + (outer - inner) * u, 2.0 * np.pi * v
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), thickness * w], axis=-1)

    return join([block("hex20", mapping, cells)])


def _input(
    element: str,
    body: Body,
    material: tuple[float, float, float],
    supports: Mapping[str, tuple[np.ndarray, str]],
    sets: Mapping[str, np.ndarray] = {},  # noqa: B006  not changed
) -> str:
    """Return an input file: one body, its material (E, nu, rho), supports, {name: (nodes, directions)}, and node sets."""
    young, poisson, density = material
    lines = ["*NODE"]
    lines += [f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in enumerate(body.points.tolist(), 1)]
    lines.append(f"*ELEMENT, TYPE={element}, ELSET=BODY")
    for i, nodes in enumerate((body.elements + 1).tolist(), 1):
        lines += [", ".join(map(str, [i, *nodes[:10]])) + ",", ", ".join(map(str, nodes[10:]))]
    for name, at in {**{name: at for name, (at, _) in supports.items()}, **sets}.items():
        lines += [f"*NSET, NSET={name}", *(str(node) for node in np.flatnonzero(at) + 1)]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{young!r}, {poisson!r}", "*DENSITY", f"{density!r}"]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY"]
    lines += [f"{name}, {directions}" for name, (_, directions) in supports.items()]
    return "\n".join([*lines, "*STEP", "*FREQUENCY", "10", "*END STEP", ""])


_ROW = "%%MatrixMarket matrix coordinate real symmetric\n1 1 1\n1 1 {}\n"
_DAMPER = """# VM320: one mass on a spring, a damper and a friction element
[model]
stiffness = "vm320_K.mtx"
mass = "vm320_M.mtx"
damping = "vm320_C.mtx"

[[joints]]
name = "damper"
pairs = "vm320_pairs.csv"

[[loads]]
dof = 0

[[outputs]]
name = "mass"
dof = 0

[response]
levels = [123.024]              # N: half of mu N
frequencies = [25.0, 45.0]      # Hz
points = 400

[solver]
harmonics = 1                   # as the manual
samples = 1024
"""

_RING = """# VM302: a thin ring that turns, with Coriolis forces; a spring of 5 rad/s holds its rotation about the axis
[model]
mesh = "vm302.inp"

[cyclic]
sectors = 24
axis = [0.0, 0.0, 1.0]
faces = ["LOW", "HIGH"]
engine_order = 2

[[springs]]
groups = ["POINT"]
direction = [0.0, 1.0, 0.0]
stiffness = 0.08

[[loads]]
position = [0.088, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]

[[outputs]]
name = "ring"
position = [0.088, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]

[damping]
ratio = 0.001

[response]
levels = [1.0]
frequencies = [50.0, 100.0]

[statics]
rotation_speed = 1256.6371      # rad/s: 12,000 rpm
coriolis = true
"""

BUILT: dict[str, Callable[[], str]] = {
    "vm320.toml": lambda: _DAMPER,
    "vm320_K.mtx": lambda: _ROW.format(2.4e7),
    "vm320_M.mtx": lambda: _ROW.format(944.6),
    "vm320_C.mtx": lambda: _ROW.format(7700.0),
    "vm320_pairs.csv": lambda: "x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n0,-1,-1,-1,-1,-1,1.0,246.048,0.0,2.4e7,2.4e7\n",
    "fv52.inp": thick_plate,
    "vm244.inp": annular_plate,
    "vm281.inp": turning_plate,
    "vm301.inp": turning_disc,
    "vm302.inp": turning_ring,
    "vm302.toml": lambda: _RING,
}
