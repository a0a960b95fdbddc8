"""Round bodies on flat ones compared with Hertz; tangential_loading.py adds tangential loads.

    python jobs/bench/round_contact.py [--cells 18] [--case sphere roller]

Each row is a separate scene: a cap pressed by a force on a rigid plane, or on an elastic base of another mesh, with nodes or
cells as contact points.  Radius of contact and largest pressure come from the pairs at rest: the paraboloid with the force and
the second moment of the closed pairs, and the pressure at the centre.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "meshes"))

from hertz import Hertz, hertz  # noqa: E402
from msh import write_msh  # noqa: E402

YOUNG, POISSON = 2.1e11, 0.3
STIFF = 100.0  # stiffness of the contact springs over Young's modulus and the radius of contact
SIZE, RADIUS, CONTACT = 0.01, 0.1, 0.00125  # m: of the cap, of curvature, and of the contact that the force is chosen for
SCENE = """
[model]
mesh = "hertz.msh"
[materials.steel]
young = {young}
poisson = {poisson}
density = 7850.0
[bodies.cap]
group = "cap_body"
material = "steel"
{base}
{supports}
[[joints]]
name = "contact"
surfaces = {surfaces}
{against}
pairing = "{pairing}"
gap = "geometry"
tolerance = 0.01
friction = 0.0
tangential_stiffness = {k_t}
normal_stiffness = {k_n}
preload = "static"
[statics]
stress_stiffening = false
steps = 5
[[statics.forces]]
group = "top"
force = [0.0, 0.0, {force}]
[[loads]]
group = "top"
direction = [1.0, 0.0, 0.0]
[[outputs]]
name = "top"
position = [0.0, 0.0, {size}]
direction = [1.0, 0.0, 0.0]
[damping]
ratio = 0.001
[response]
levels = [1.0]
frequencies = [100.0, 101.0]
points = 2
[solver]
modes = 12
harmonics = 7
samples = 128
"""


@dataclass(frozen=True)
class Case:
    """The two bodies of a contact."""

    shape: str = "sphere"
    pairing: str = "nodes"
    base: int = 0  # cells of the base; 0: rigid plane
    kind: str = "hex8"


def modulus(case: Case) -> float:
    """Return E* of the contact [Pa]."""
    return YOUNG / (1.0 - POISSON**2) / (2.0 if case.base else 1.0)


def whole_force(case: Case) -> float:
    """Return the force [N] (of a roller per metre) of the full contact that produces the radius CONTACT according to Hertz."""
    if case.shape == "roller":
        return np.pi * modulus(case) * CONTACT**2 / (4.0 * RADIUS)
    return 4.0 * modulus(case) * CONTACT**3 / (3.0 * RADIUS)


def largest_pressure(case: Case) -> float:
    """Return Hertz's p_0 [Pa]."""
    if case.shape == "roller":
        return 2.0 * whole_force(case) / (np.pi * CONTACT)
    return 1.5 * whole_force(case) / (np.pi * CONTACT**2)


def scene_of(case: Case, cells: int, folder: Path):
    """Return the scene of a case and the share of the full contact that its mesh covers."""
    given = Hertz(case.shape, SIZE, RADIUS, case.kind, cells, base=case.base)
    bodies = hertz(given)
    write_msh(str(folder / "hertz.msh"), {f"{name}_body": body for name, body in bodies.items()})
    share = 0.25
    if case.shape == "roller":
        share = float(np.ptp(bodies["cap"].points[:, 1])) * 0.5
    held = {"middle_y": "y", "middle_x": "x"}
    if case.base:
        held |= {"base_y": "y", "bottom": "xyz", "base_x": "x"}
    if case.shape == "roller":
        held |= {"end_y": "y"} | ({"base_end_y": "y"} if case.base else {})
    supports = "\n".join(f'[[supports]]\ngroup = "{group}"\nfix = {list(axes)}'.replace("'", '"') for group, axes in held.items())
    plane = 'against = "plane"\nplane_point = [0.0, 0.0, 0.0]\nplane_normal = [0.0, 0.0, 1.0]'
    text = SCENE.format(
        young=YOUNG,
        poisson=POISSON,
        base='[bodies.base]\ngroup = "base_body"\nmaterial = "steel"' if case.base else "",
        supports=supports,
        surfaces='["cap", "flat"]' if case.base else '["cap"]',
        against="" if case.base else plane,
        pairing=case.pairing,
        k_t=STIFF * YOUNG / CONTACT,
        k_n=STIFF * YOUNG / CONTACT,
        force=-share * whole_force(case),
        size=SIZE,
    )
    path = folder / "hertz.toml"
    path.write_text(text)
    return microslip.read(path), share


def at_rest(case: Case, cells: int, folder: Path) -> tuple[str, float, float, float]:
    """Return the closed pairs as text, and force, radius of contact and largest pressure over Hertz's."""
    scene, share = scene_of(case, cells, folder)
    with microslip.build(scene) as structure:
        pairs = structure.pairs
    N, x, y = np.maximum(pairs.N0, 0.0), pairs.position[:, 0], pairs.position[:, 1]
    force = N.sum() / (share * whole_force(case))
    if case.shape == "roller":  # of p_0 sqrt(1 - x2 / a2): the mean of x2 is a2 / 4
        radius = np.sqrt(4.0 * (N @ x**2) / N.sum())
        r = np.abs(x)
    else:  # the mean of r2 is 2 a2 / 5
        r = np.hypot(x, y)
        radius = np.sqrt(2.5 * (N @ r**2) / N.sum())
    inner = r < 0.3 * CONTACT
    shape = np.sqrt(1.0 - (r[inner] / CONTACT) ** 2)
    p0 = N[inner].sum() / (pairs.area[inner] @ shape)
    return f"{(N > 0.0).sum()} of {pairs.n_pairs}", force, radius / CONTACT, p0 / largest_pressure(case)


def in_words(case: Case, cells: int) -> str:
    """Return a text with the two bodies and the relation of their meshes."""
    if not case.base:
        return f"{case.shape} on a rigid plane, nodes"
    how = {"points": "cells", "mortar": "mortar", "projected": "nodes projected"}[case.pairing]
    return f"{case.shape} on an elastic base of {'the same' if case.base == cells else 'another'} mesh, {how}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=18, help="of the cap from the contact to a side")
    parser.add_argument("--case", nargs="+", default=["sphere", "roller"], choices=["sphere", "roller"])
    given = parser.parse_args()
    n, other = given.cells, given.cells + 3
    with tempfile.TemporaryDirectory() as folder:
        print(
            "| contact | pairs closed | force | radius over Hertz's | largest pressure over Hertz's |\n| --- | --- | --- | --- | --- |"
        )
        for shape in ("sphere", "roller"):
            apart = [Case(shape, pairing, base) for pairing in ("mortar", "points") for base in (n, other)]
            for case in (Case(shape), *apart, Case(shape, "projected", other)):
                if shape in given.case:
                    closed, force, radius, p0 = at_rest(case, n, Path(folder))
                    print(f"| {in_words(case, n)} | {closed} | {force:.6f} | {radius:.4f} | {p0:.4f} |", flush=True)


if __name__ == "__main__":
    main()
