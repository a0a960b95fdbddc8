"""The demo's fan sector at speed: contact at rest, compared with CalculiX' contact solution on the same mesh.

    python jobs/bench/against_calculix.py [--size small] [--flank N] [--reduced] [--ccx PATH]

Needs ``ccx`` (Debian: calculix-ccx).  The CalculiX input has the elements of the scene (C3D20; C3D20R with --reduced), its
centrifugal force, supports, contact stiffness and friction: surface-to-surface contact with linear pressure-overclosure,
geometrically linear, in the scene's load steps.  Compared for each flank: the sums of normal and friction forces, and the
distance between the lines of action of the normal forces; the largest contact pressure; the mean radial displacement of the
blade's flanks and their rotation about the engine's axis.  Flanks that slide on their upper edges hardly resist this rotation.
This program runs with node pairs, with mortars, and with one contact point per facet cell.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()

from mpi4py import MPI

from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces
from microslip.linear.joint_springs import linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.scene.read import changed
from microslip.statics.equilibrium import Flexibility, equilibrium

JOBS = Path(__file__).parents[1]
sys.path.insert(0, str(JOBS.parent / "meshes"))

from blocks import Body  # noqa: E402
from fan_sector import SIZES, Shape, fan_sector  # noqa: E402
from msh import write_msh  # noqa: E402

# corners of the faces S1 to S6 of a hexahedron
FACES = [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
FLANKS = ("left", "right")  # x < 0 and x > 0


@dataclass(frozen=True)
class Contact:
    """Contact results of one program on the blade: for each flank, in the order of FLANKS."""

    normal: np.ndarray  # (2, 3) N, sum of the normal forces
    friction: np.ndarray  # (2, 3) N
    moment: np.ndarray  # (2, 3) N m, of the normal forces about the origin
    pressure: float  # Pa, the largest contact pressure reported
    radial: float  # m, mean of the blade's flanks
    turn: float  # rad, of the blade's flanks, about y
    seconds: float

    @property
    def line(self) -> np.ndarray:
        """The point nearest to the origin on the line of action of each resultant normal force, (2, 3) [m]."""
        return np.cross(self.normal, self.moment) / np.sum(self.normal**2, axis=1)[:, None]


def flank_of(x: np.ndarray) -> np.ndarray:
    """Return the flank of the points at x: 0 left, 1 right, (n,)."""
    return (x > 0.0).astype(int)


def deck(bodies: dict[str, Body], scene, kind: str) -> str:
    """Return the CalculiX input of a scene of the fan sector, with elements of a CalculiX type."""
    return "\n".join([*mesh_lines(bodies, scene, kind), *contact_lines(scene.joints[0]), *step_lines(bodies, scene), ""])


def mesh_lines(bodies: dict[str, Body], scene, kind: str) -> list[str]:
    """Return nodes, elements, materials, surfaces and the set of fixed nodes."""
    points = np.concatenate([body.points for body in bodies.values()])
    lines = ["*NODE, NSET=ALL"]  # CalculiX reads at most 20 characters a number, and 16 numbers a line
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(points, 1)]
    n_nodes = n_elements = 0
    for name, body in bodies.items():
        lines += [f"*ELEMENT, TYPE={kind}, ELSET={name.upper()}"]
        for i, nodes in enumerate(body.elements + n_nodes + 1, n_elements + 1):
            lines += [", ".join(map(str, [i, *nodes[:14]])) + ",", ", ".join(map(str, nodes[14:]))]
        lines += material_lines(name.upper(), scene.materials[scene.bodies[name].material])
        for surface in {"blade_root", "disc_slot"} & set(body.faces):
            lines += surface_lines(body, surface, n_elements)
        if "disc_base" in body.faces:
            lines += ["*NSET, NSET=BASE", *(f"{i}," for i in body.face_nodes("disc_base") + n_nodes + 1)]
        n_nodes, n_elements = n_nodes + len(body.points), n_elements + len(body.elements)
    return lines


def material_lines(body: str, material) -> list[str]:
    """Return the material of a body and its section."""
    return [
        f"*MATERIAL, NAME=OF_{body}",
        "*ELASTIC",
        f"{material.young:.12g}, {material.poisson:.12g}",
        "*DENSITY",
        f"{material.density:.12g}",
        f"*SOLID SECTION, ELSET={body}, MATERIAL=OF_{body}",
    ]


def contact_lines(joint) -> list[str]:
    """Return contact of the two flanks, with springs and friction of the joint."""
    lines = []
    for flank in FLANKS:
        lines += ["*CONTACT PAIR, INTERACTION=JOINT, TYPE=SURFACE TO SURFACE", f"BLADE_ROOT_{flank}, DISC_SLOT_{flank}".upper()]
    return [
        *lines,
        "*SURFACE INTERACTION, NAME=JOINT",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        f"{joint.normal_stiffness:.12g}",
        "*FRICTION",
        f"{joint.friction:.12g}, {joint.tangential_stiffness:.12g}",
    ]


def step_lines(bodies: dict[str, Body], scene) -> list[str]:
    """Return supports, centrifugal force in the load steps of the scene, and the output requests of the last one."""
    axis = ", ".join(f"{value:.12g}" for value in (*scene.model.axis_point, *scene.model.axis))
    lines = [
        "*BOUNDARY",
        "BASE, 1, 3",
        "*STEP, INC=1000",
        "*STATIC, DIRECT",
        f"{1.0 / scene.statics.steps:.12g}, 1.0",
        "*DLOAD",
        *(f"{name.upper()}, CENTRIF, {scene.statics.rotation_speed**2:.12e}, {axis}" for name in bodies),
        "*NODE PRINT, NSET=ALL, FREQUENCY=1000",
        "U",
        "*CONTACT FILE, FREQUENCY=1000",
        "CDISP, CSTRESS",
    ]
    for flank in FLANKS:
        lines += [f"*CONTACT PRINT, SLAVE=BLADE_ROOT_{flank}, MASTER=DISC_SLOT_{flank}, FREQUENCY=1000".upper(), "CF, CFN, CFS"]
    return [*lines, "*END STEP"]


def surface_lines(body: Body, name: str, n_before: int) -> list[str]:
    """Return the surfaces of the two flanks, as element faces."""
    place = {
        tuple(sorted(element[list(corners)])): (i, side)
        for i, element in enumerate(body.elements, n_before + 1)
        for side, corners in enumerate(FACES, 1)
    }
    faces = np.concatenate(body.faces[name])[:, :4]
    which = flank_of(body.points[faces, 0].mean(axis=1))
    lines = []
    for k, flank in enumerate(FLANKS):
        sides = [place[tuple(sorted(face))] for face in faces[which == k]]
        lines += [f"*SURFACE, NAME={name}_{flank}".upper(), *(f"{i}, S{side}" for i, side in sides)]
    return lines


def rigid(blade: Body, u: np.ndarray) -> tuple[float, float]:
    """Return the mean radial displacement [m] of the blade's flanks, and their rotation about y [rad], from the motion of all nodes."""
    nodes = blade.face_nodes("blade_root")
    x, z = (blade.points[nodes] - blade.points[nodes].mean(axis=0))[:, [0, 2]].T
    mean = u[nodes].mean(axis=0)
    u = u[nodes] - mean
    return float(mean[2]), float((z @ u[:, 0] - x @ u[:, 2]) / (x @ x + z @ z))


def calculix(ccx: str, folder: Path, text: str, bodies: dict[str, Body]) -> Contact:
    """Run CalculiX and return its contact results."""
    (folder / "fan.inp").write_text(text)
    start = time.perf_counter()
    with open(folder / "fan.log", "w") as log:
        subprocess.run([ccx, "fan"], cwd=folder, check=True, stdout=log, stderr=subprocess.STDOUT)
    seconds = time.perf_counter() - start
    data = (folder / "fan.dat").read_text()
    number = r"\s+(-?\d\.\d+E[+-]\d+)"
    u = np.array(re.findall(r"^\s+\d+" + 3 * number + "$", data, re.MULTILINE), dtype=float)
    totals = re.findall(r"about the origin \(mx,my,mz\)\n" + 6 * number, data)
    if len(u) != sum(len(body.points) for body in bodies.values()) or len(totals) != 6:
        sys.exit(f"{folder}: ccx ended without the results that were requested; fan.log there says why")
    sums = np.array(totals, dtype=float).reshape(2, 3, 2, 3)  # flank; all, normal, friction; force, moment
    of_sums, pressure = (sums[:, 1, 0], sums[:, 2, 0], sums[:, 1, 1]), largest_pressure(folder / "fan.frd")
    return Contact(*of_sums, pressure, *rigid(bodies["blade"], u), seconds)


def largest_pressure(path: Path) -> float:
    """Return the largest contact pressure at nodes [Pa] of a CalculiX result file: the fourth value of block CONTACT."""
    block = path.read_text().split(" -4  CONTACT", 1)[1].split("\n -3", 1)[0]
    return max(float(line[49:61]) for line in block.splitlines() if line.startswith(" -1"))


def ours(scene, blade: Body) -> Contact:
    """Return the contact results of the statics of a scene, on one rank."""
    start, comm, settings = time.perf_counter(), MPI.COMM_SELF, scene
    mesh = read_mesh(settings)
    pairs = pair_contacts(mesh, settings.joints)
    shares = distribute(mesh, settings, comm)
    system = assemble(shares, mesh, pairs, settings)
    forces = constant_forces(shares, mesh, settings, system)
    linearised = linearise(system, pairs, str(scene.path))
    rest = equilibrium(Flexibility(linearised), pairs, forces, settings.statics.steps)
    linearised.destroy()
    on_blade = -rest.force  # the force of a pair acts on body 2
    normal = on_blade[:, 2:] * pairs.frame[:, 2]
    friction = np.einsum("pt,ptx->px", on_blade[:, :2], pairs.frame[:, :2])
    own = np.stack([flank_of(pairs.position[:, 0]) == k for k in (0, 1)]).astype(float)
    return Contact(
        own @ normal,
        own @ friction,
        own @ np.cross(pairs.position, normal),
        float((rest.N / pairs.area).max()),
        *rigid(blade, system.at_nodes(rest.u_owned)),
        time.perf_counter() - start,
    )


def row(name: str, computed: Contact, reference: Contact) -> str:
    """Return a row of the table: both flanks, and the differences from the reference."""

    def sizes(of, to):
        size, exact = np.linalg.norm(of, axis=1), np.linalg.norm(to, axis=1)
        return ", ".join(f"{s:.0f} ({100.0 * (s / e - 1.0):+.2f} %)" for s, e in zip(size, exact))

    distance = 1e3 * np.linalg.norm(computed.line - reference.line, axis=1)
    return (
        f"| {name} | {sizes(computed.normal, reference.normal)} | {sizes(computed.friction, reference.friction)} | {distance[0]:.2f}, {distance[1]:.2f} mm "
        f"| {1e-6 * computed.pressure:.0f} MPa | {1e6 * computed.radial:.1f} um | {1e3 * computed.turn:.2f} mrad | {computed.seconds:.1f} s |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--flank", type=int, help="elements across a flank, if not those of the size")
    parser.add_argument("--reduced", action="store_true", help="2 x 2 x 2 points in each element, C3D20R")
    parser.add_argument("--ccx", default=shutil.which("ccx"), help="the program")
    given = parser.parse_args()
    if not given.ccx or not shutil.which(given.ccx):
        sys.exit("ccx not found: install CalculiX (Debian: calculix-ccx) or give its path with --ccx")
    divisions = SIZES[given.size]
    bodies = fan_sector(Shape(), divisions if given.flank is None else replace(divisions, flank=given.flank))
    integration = {"integration": "reduced-both" if given.reduced else "full"}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_msh(str(folder / "fan.msh"), bodies)
        scene = changed(microslip.read(JOBS / "fan_speed.toml"), {"model": {"mesh": str(folder / "fan.msh")}})
        scene = scene.model_copy(update={"bodies": {k: v.model_copy(update=integration) for k, v in scene.bodies.items()}})
        text = deck(bodies, scene, "C3D20R" if given.reduced else "C3D20")
        reference = calculix(given.ccx, folder, text, bodies)
        print("| contact | normal force of the flanks [N] | friction [N] | distance of lines | pressure | radial | turn | time |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- |")
        print(row("CalculiX", reference, reference), flush=True)
        joint = scene.joints[0].name
        for pairing, words in (("nodes", "nodes in pairs"), ("mortar", "mortars"), ("points", "cells")):
            print(row(words, ours(changed(scene, {}, {joint: {"pairing": pairing}}), bodies["blade"]), reference), flush=True)


if __name__ == "__main__":
    main()
