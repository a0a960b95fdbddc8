"""A small bladed disc: one sector, and the full ring merged from its rotated copies, for the tests of [cyclic].

The sector has no mirror symmetry.  Its blade is joined to the rim, and the bore is held.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from blocks import Body, block, join
from msh import write_msh
from scene_text import joint, steel, support, table
from scipy.spatial import cKDTree

from microslip.fourier.coefficients import shifted
from microslip.fourier.harmonics import Harmonics

BORE, RIM, TIP, TOP, WIDTH = 0.05, 0.08, 0.12, 0.13, 0.01  # m
BETWEEN = (0.0, 0.3, 0.75, 1.0)  # parts of the sector: on either side of the blade, and under it


def sector(
    kind: str, N: int, s: int = 0, divisions=(1, 1, 1), span: int = 2, shroud: bool = False, damper: bool = False, own: str = ""
) -> dict[str, Body]:
    """Return disc and blade of sector s about the z axis; divisions along radius, part of the angle and width.

    A ``shroud`` on the tip reaches the neighbours: its sides are "shroud_low" and "shroud_high".  A ``damper`` is a body that
    fills the space between this blade and that of the next sector, with sides "damper_low" and "damper_high".
    ``own`` is a suffix of the surfaces of joints.
    """
    parts = []
    for k, (a, b) in enumerate(zip(BETWEEN, BETWEEN[1:])):
        names = {"x0": "bore"} | ({"x1": f"slot{own}"} if k == 1 else {})
        names |= ({"y0": f"low{s}"} if k == 0 else {}) | ({"y1": f"high{s}"} if k == 2 else {})
        parts.append(block(kind, _mapping(N, s, (BORE, RIM), (a, b)), divisions, names))
    names = {"x0": f"root{own}", "x1": "tip", "y0": f"left{s}", "y1": f"right{s}"}
    blade = block(kind, _mapping(N, s, (RIM, TIP), BETWEEN[1:3]), (span, *divisions[1:]), names)
    if shroud:
        tops = [blade]
        for k, (a, b) in enumerate(zip(BETWEEN, BETWEEN[1:])):
            names = ({"y0": f"shroud_low{own}"} if k == 0 else {}) | ({"y1": f"shroud_high{own}"} if k == 2 else {})
            tops.append(block(kind, _mapping(N, s, (TIP, TOP), (a, b)), divisions, names))
        blade = join(tops)
    if not damper:
        return {"disc": join(parts), "blade": blade}
    names = {"y0": f"damper_low{own}", "y1": f"damper_high{own}"}
    between = block(kind, _mapping(N, s, (RIM, TIP), (BETWEEN[2], 1.0 + BETWEEN[1])), (span, *divisions[1:]), names)
    return {"disc": join(parts), "blade": blade, "damper": between}


def ring(kind: str, N: int, **how) -> dict[str, Body]:
    """Return the full ring: the discs merged at their interfaces, each blade and damper a body, and joints of each sector."""
    sectors = [sector(kind, N, s, own=str(s), **how) for s in range(N)]
    names = [
        name for name in sectors[0] if name != "disc"
    ]  # blades first: loads and outputs are on them where dampers touch them
    others = {f"{name}{s}": sectors[s][name] for name in names for s in range(N)}
    return {"disc": join([each["disc"] for each in sectors])} | others


def _mapping(N: int, s: int, radii, part):
    """Return the mapping of a part of sector s: lines of constant angle are inclined with radius and width."""

    def mapping(u, v, w):
        r = radii[0] + (radii[1] - radii[0]) * u
        lean = 0.15 * (r - BORE) / (TIP - BORE) + 0.05 * w * (r / BORE)
        angle = 2.0 * np.pi / N * (s + part[0] + (part[1] - part[0]) * v + lean)
        return np.stack([r * np.cos(angle), r * np.sin(angle), WIDTH * (1.0 + 0.3 * (r - BORE) / RIM) * w], axis=-1)

    return mapping


def at(N: int, s: int = 0, r: float = TIP, v: float = 0.0, w: float = 1.0) -> list[float]:
    """Return a position of the blade of sector s [m]."""
    a, b = BETWEEN[1:3]
    radii = (RIM, TIP)
    u = (r - RIM) / (TIP - RIM)
    return [float(x) for x in _mapping(N, s, radii, (a, b))(np.array([u]), np.array([v]), np.array([w]))[0]]


def turned(N: int, s: int, direction) -> list[float]:
    """Return a direction rotated with sector s."""
    a = 2.0 * np.pi * s / N
    turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    return [float(x) for x in turn @ np.asarray(direction, dtype=float)]


LOAD, OUTPUT = [0.6, 1.0, 0.3], [0.2, 1.0, 0.5]


def load(N: int, s: int = 0, phase: float = 0.0, factor: float = 1.0) -> str:
    direction = [factor * component for component in turned(N, s, LOAD)]
    return table("[loads]", position=at(N, s), direction=direction, phase=phase)


def output(N: int, s: int = 0) -> str:
    return table("[outputs]", name=f"tip{s or ''}", position=at(N, s, w=0.0), direction=turned(N, s, OUTPUT))


def cyclic(N: int, **keys) -> str:
    return table("cyclic", **{"sectors": N, "axis": [0.0, 0.0, 1.0], "faces": ["low0", "high0"]} | keys)


def body_text(
    mesh: str,
    bodies,
    held: str = "bore",
    ring: tuple[int, int] | None = None,
    shrouds: bool = False,
    dampers: bool = False,
    of_shrouds=None,
    **contact,
) -> str:
    """Return the scene of a mesh without loads, outputs, damping, response and solver; ``contact`` are values of its joints.

    ``ring`` has its number of sectors N and the wave h: each sector has separate joints, which start at its phase -h s alpha.
    ``of_shrouds`` are other values of the joints of shrouds, or of dampers.
    """
    keys = {"friction": 0.3, "preload": 2.0e6, "k_t": 5.0e11} | contact
    text = table("model", mesh=mesh) + steel(*bodies) + (support(held) if held else "")
    N, h = ring or (1, 0)
    for s in range(N):
        start = f"start = {-2.0 * np.pi * h * s / N!r}\n"
        of, of_next = (str(s), str((s + 1) % N)) if ring else ("", "")
        text += joint(f"root{of}", f"slot{of}", name=f"root{of}", **keys) + start
        between = [("shrouds", f"shroud_high{of}", f"shroud_low{of_next}")] if shrouds else []
        if dampers:
            text += joint(f"damper_low{of}", f"right{s}", name=f"dampers{of}", **keys | (of_shrouds or {})) + start
            between.append(("neighbours", f"damper_high{of}", f"left{(s + 1) % N}"))
        for name, *surfaces in between:
            text += joint(*surfaces, name=f"{name}{of}", **keys | (of_shrouds or {})) + start
            text += "" if ring else "next_sector = true\n"
    return text


def of_ring(sector, ring, N: int, h: int, U: np.ndarray) -> np.ndarray:
    """Return harmonics 0 to H of the pairs of the ring, (n, 3, N_H), for those of sector 0 in a wave: docs/theory.md, eq. (14.1).

    ``sector`` and ``ring`` are their pairs.
    """
    wave = np.full((ring.n_pairs, *U.shape[1:]), np.nan)
    in_axes = np.einsum("nji,njk->nik", sector.frame, U)
    for s in range(N):
        turn = np.array([turned(N, s, axis) for axis in np.eye(3)]).T
        distance, here = cKDTree(ring.position).query(sector.position @ turn.T)
        assert distance.max() < 1e-9
        there = shifted(turn @ in_axes, np.array(2.0 * np.pi * h * s / N), Harmonics.full(U.shape[2]))
        wave[here] = np.einsum("nij,njk->nik", ring.frame[here], there)
    return wave


def write_sector(folder: Path, N: int, end: str, kind: str = "hex8", name: str = "sector", wave=None, how=None, **body) -> Path:
    """Write mesh and scene of one sector; ``end`` has its tables of damping, response and solver.

    ``body`` are keys of [cyclic], and of :func:`body_text`.
    """
    keys = {key: body.pop(key) for key in ("sectors", "faces") if key in body}
    bodies = sector(kind, N, **(how or {}))
    write_msh(str(folder / f"{name}.msh"), bodies)
    path = folder / f"{name}.toml"
    text = body_text(f"{name}.msh", bodies, **_between(how), **body)
    text += cyclic(N, **({"engine_order": 1} if wave is None else wave), **keys)
    path.write_text(text + load(N) + output(N) + end)
    return path


def write_ring(
    folder: Path, N: int, end: str, kind: str = "hex8", name: str = "ring", h: int = 1, how=None, loads=None, n_outputs=1, **body
) -> Path:
    """Write mesh and scene of the full ring under a travelling wave of loads: sector s leads sector 0 by h s alpha.

    ``loads`` (N,) are factors of the loads of the sectors; the first ``n_outputs`` sectors have outputs.
    """
    bodies = ring(kind, N, **(how or {}))
    write_msh(str(folder / f"{name}.msh"), bodies)
    path = folder / f"{name}.toml"
    factors = np.ones(N) if loads is None else loads
    wave = "".join(load(N, s, 2.0 * np.pi * h * s / N, float(factors[s])) for s in range(N))
    outputs = "".join(output(N, s) for s in range(n_outputs))
    text = body_text(f"{name}.msh", bodies, ring=(N, h), **_between(how), **body)
    path.write_text(text + wave + outputs + end)
    return path


def _between(how) -> dict[str, bool]:
    return {f"{name}s": (how or {}).get(name, False) for name in ("shroud", "damper")}


def write_ring_of_blades(folder: Path, N: int, end: str, h: int, friction: float, kind: str = "hex8", **factors) -> Path:
    """Write a ring whose sectors have ``factors`` (N,) of stiffness and density of the blades, or of contact_stiffness."""
    factors = {name: np.ones(N) for name in ("stiffness", "density", "contact_stiffness")} | factors
    bodies = ring(kind, N)
    write_msh(str(folder / "blades.msh"), bodies)
    text = table("model", mesh="blades.msh") + steel("disc") + support("bore")
    for s in range(N):
        young, density = 2.1e11 * float(factors["stiffness"][s]), 7800.0 * float(factors["density"][s])
        text += table(f"materials.steel{s}", young=young, poisson=0.3, density=density)
        text += table(f"bodies.blade{s}", group=f"blade{s}", material=f"steel{s}")
        k_t = 5.0e11 * float(factors["contact_stiffness"][s])
        text += joint(f"root{s}", f"slot{s}", name=f"root{s}", friction=friction, k_t=k_t, preload=2.0e6)
        text += f"start = {-2.0 * np.pi * h * s / N!r}\n"
        text += load(N, s, 2.0 * np.pi * h * s / N) + output(N, s)
    path = folder / "blades.toml"
    path.write_text(text + end)
    return path
