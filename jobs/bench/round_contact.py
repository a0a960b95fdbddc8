"""Round bodies on flat ones against Hertz, and pushed sideways against Cattaneo and Mindlin.

    python jobs/bench/round_contact.py [--cells 18] [--case sphere roller mindlin ...]

Each row is a scene of its own: a cap pressed by a force on a rigid plane, or on an elastic base of another mesh, as nodes or cells.
Radius of contact and largest pressure come from the pairs at rest (the paraboloid with the closed pairs' force and its second moment,
and the pressure at the middle); stick radius and loss a cycle from the vibration at a frequency far below the first mode.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import quad

import microslip

sys.path.insert(0, str(Path(__file__).parents[2] / "meshes"))

from hertz import Hertz, hertz  # noqa: E402
from msh import write_msh  # noqa: E402

YOUNG, POISSON, MU = 2.1e11, 0.3, 0.4
STIFF = 100.0  # of the contact's own springs, over Young's modulus and the radius of contact
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
friction = {friction}
tangential_stiffness = {k_t}
normal_stiffness = {k_n}
preload = "static"
[statics]
stress_stiffening = false
steps = {steps}
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
levels = {levels}
frequencies = [100.0, 101.0]
points = 2
[solver]
modes = 12
harmonics = 7
samples = 128
"""
# the top moves as one and does not turn: Mindlin's force acts in the plane of the contact
GRIP = """
[[points]]
name = "grip"
position = [0.0, 0.0, {size}]
group = "top"
connection = "rigid"
[[supports]]
point = "grip"
fix = ["y", "rx", "ry", "rz"]
"""


@dataclass(frozen=True)
class Case:
    """What presses on what."""

    shape: str = "sphere"
    pairing: str = "nodes"
    base: int = 0  # cells of the base; 0: rigid plane
    kind: str = "hex8"
    half: bool = False
    friction: float = 0.0


def modulus(case: Case) -> float:
    """Return E* of the contact [Pa]."""
    return YOUNG / (1.0 - POISSON**2) / (2.0 if case.base else 1.0)


def whole_force(case: Case) -> float:
    """Return the force of the whole contact [N], of a roller per metre, that Hertz gives the radius CONTACT."""
    if case.shape == "roller":
        return np.pi * modulus(case) * CONTACT**2 / (4.0 * RADIUS)
    return 4.0 * modulus(case) * CONTACT**3 / (3.0 * RADIUS)


def largest_pressure(case: Case) -> float:
    """Return Hertz's p_0 [Pa]."""
    if case.shape == "roller":
        return 2.0 * whole_force(case) / (np.pi * CONTACT)
    return 1.5 * whole_force(case) / (np.pi * CONTACT**2)


def scene_of(case: Case, cells: int, folder: Path, levels=(1.0,), steps: int = 5):
    """Return the scene of a case and the share of the whole contact that its mesh has."""
    given = Hertz(case.shape, SIZE, RADIUS, case.kind, cells, half=int(case.half), base=case.base)
    bodies = hertz(given)
    write_msh(str(folder / "hertz.msh"), {f"{name}_body": body for name, body in bodies.items()})
    share = 0.5 if case.half else 0.25
    if case.shape == "roller":
        share = float(np.ptp(bodies["cap"].points[:, 1])) * (1.0 if case.half else 0.5)
    held = {"middle_y": "y"} | ({} if case.half else {"middle_x": "x"})
    if case.base:
        held |= {"base_y": "y", "bottom": "xyz"} | ({} if case.half else {"base_x": "x"})
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
        friction=case.friction,
        k_t=STIFF * YOUNG / CONTACT,
        k_n=STIFF * YOUNG / CONTACT,
        force=-share * whole_force(case),
        size=SIZE,
        levels=list(levels),
        steps=steps,
    )
    if case.half:
        for group in ('group = "top"\nforce', 'group = "top"\ndirection', f"position = [0.0, 0.0, {SIZE}]\ndirection"):
            assert group in text
            text = text.replace(group, 'point = "grip"\n' + group.split("\n")[1])
        text += GRIP.format(size=SIZE)
    path = folder / "hertz.toml"
    path.write_text(text)
    return microslip.read(path), share


def at_rest(case: Case, cells: int, folder: Path) -> tuple[str, float, float, float]:
    """Return what is closed, and force, radius of contact and largest pressure over Hertz's."""
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


def mindlin(case: Case, cells: int, folder: Path, shares=(0.5, 0.8)) -> list[str]:
    """Return rows: stick radius, and loss a cycle, over those of Mindlin and Deresiewicz, at shares of the friction limit."""
    levels = [0.5 * q * MU * whole_force(case) for q in shares]  # of half the contact
    scene, share = scene_of(case, cells, folder, levels, steps=5)
    G = YOUNG / (2.0 * (1.0 + POISSON))
    compliance = (2.0 - POISSON) / G * (2.0 if case.base else 1.0)
    P, rows = whole_force(case), []
    with microslip.build(scene) as structure:
        pairs = structure.pairs
        found = microslip.respond(structure, error_bars=False).results.levels
    N = np.maximum(pairs.N0, 0.0)
    for q, level in zip(shares, found):
        slips = (level.state[0] == 1) & (N > 0.0)
        stick = np.sqrt(2.0 * pairs.area[(N > 0.0) & ~slips].sum() / np.pi)  # radius of a disc of that area
        loss = level.energy[0][N > 0.0].sum() / share
        rows.append(
            f"| {in_words(case, cells)} | {q:g} | {stick / (CONTACT * (1.0 - q) ** (1 / 3)):.3f} | {loss / exact_loss(q, P, compliance):.3f} |"
        )
    return rows


def exact_loss(q: float, P: float, compliance: float) -> float:
    """Return the loss a cycle [J] between -q and q of the friction limit: Masing's rule on Mindlin's curve of first loading."""

    def displacement(s):  # when first loaded to the share s of the limit
        return 3.0 * MU * P * compliance / (16.0 * CONTACT) * (1.0 - (1.0 - s) ** (2 / 3))

    # each branch of the loop is the curve of first loading, twice as large both ways
    return 8.0 * (quad(displacement, 0.0, q)[0] - 0.5 * q * displacement(q)) * -MU * P


def in_words(case: Case, cells: int) -> str:
    """Say what presses on what, and how their meshes meet."""
    if not case.base:
        return f"{case.shape} on a rigid plane, nodes"
    how = {"points": "cells", "projected": "nodes projected"}[case.pairing]
    return f"{case.shape} on an elastic base, {'the same mesh' if case.base == cells else 'another mesh'}, {how}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=18, help="of the cap from the contact to a side")
    parser.add_argument("--case", nargs="+", default=["sphere", "roller", "mindlin"], choices=["sphere", "roller", "mindlin"])
    given = parser.parse_args()
    n, other = given.cells, given.cells + 3
    with tempfile.TemporaryDirectory() as folder:
        if {"sphere", "roller"} & set(given.case):
            print(
                "| contact | pairs closed | force | radius over Hertz's | largest pressure over Hertz's |\n| --- | --- | --- | --- | --- |"
            )
        for shape in ("sphere", "roller"):
            for case in (Case(shape), Case(shape, "points", n), Case(shape, "points", other), Case(shape, "projected", other)):
                if shape in given.case:
                    closed, force, radius, p0 = at_rest(case, n, Path(folder))
                    print(f"| {in_words(case, n)} | {closed} | {force:.6f} | {radius:.4f} | {p0:.4f} |", flush=True)
        if "mindlin" in given.case:
            print(
                "\n| contact | share of the limit | stick radius over Mindlin's | loss over Mindlin's |\n| --- | --- | --- | --- |"
            )
            print("\n".join(mindlin(Case("sphere", "projected", n, half=True, friction=MU), n, Path(folder))), flush=True)


if __name__ == "__main__":
    main()
