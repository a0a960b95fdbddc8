"""Rotation against theory: a spinning bar, frequencies of a stretched bar and of a spinning beam; on one or several ranks."""

import numpy as np
import pytest
from blocks import box
from msh import write_msh
from scene_text import driven, response, steel, support, table

import microslip
from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces
from microslip.linear.joint_springs import linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.parallel.agree import on_root

YOUNG, DENSITY, LENGTH, SIDE = 2.0e11, 8000.0, 1.0, 0.02
SIDES = ('fix = ["x", "y", "z"]', 'fix = ["x", "y", "z"]\n[[supports]]\ngroup = "beam"\nfix = ["y", "z"]')
END = ("[0.0, 0.0, 1.0]\n[", "[1.0, 0.0, 0.0]\n[")
OMEGA_1 = np.sqrt(YOUNG * SIDE**2 / 12.0 / DENSITY) / LENGTH**2  # rad/s, unit of a beam's frequencies
SCENE = (
    table("model", mesh="beam.msh", axis=[0.0, 0.0, 1.0])
    + steel("beam", young=YOUNG, poisson=0.0, density=DENSITY)
    + support("hub")
    + "[statics]\nSTATICS\n"
    + driven([[LENGTH, 0.0, 0.0]], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], "tip")
    + response(1.0)
    + table("solver", modes=4)
)


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    path = comm.bcast(tmp_path_factory.mktemp("beam"))

    def write():
        beam = box("hex20", (LENGTH, SIDE, SIDE), (24, 1, 1), (0.0, -0.5 * SIDE, -0.5 * SIDE), {"x0": "hub", "x1": "tip"})
        write_msh(str(path / "beam.msh"), {"beam": beam})

    on_root(comm, write)
    return path


def scene_of(comm, folder, statics, changes=()):
    text = SCENE
    for old, new in changes:
        text = text.replace(old, new)
    path = folder / "beam.toml"
    on_root(comm, lambda: path.write_text(text.replace("STATICS", statics)))
    return microslip.read(path)


def turning(speed):
    return f"rotation_speed = {float(speed)!r}"


def test_a_spinning_bar_has_the_elongation_of_theory(comm, folder):
    """u(L) = rho Omega^2 L^3 / (3 E) of a radial bar with Poisson's ratio 0."""
    speed = 100.0
    settings = scene_of(comm, folder, turning(speed))
    mesh = on_root(comm, read_mesh, settings, share=False)
    pairs = on_root(comm, pair_contacts, mesh, settings.joints)
    shares = distribute(mesh, settings, comm)
    system = assemble(shares, mesh, pairs, settings)
    forces = constant_forces(shares, mesh, settings, system)
    linearised = linearise(system, pairs)
    u = np.concatenate(comm.allgather(linearised.factor.solve(forces[:, None])[:, 0]))
    linearised.destroy()

    def tip():
        node = int(np.argmax(mesh.points[:, 0]))
        return u[system.dof[node, 0]]

    assert on_root(comm, tip) == pytest.approx(DENSITY * speed**2 * LENGTH**3 / (3.0 * YOUNG), rel=1e-3)


@pytest.mark.parametrize("deformed", [True, False])
def test_a_stretched_bar_has_the_axial_frequency_of_theory(comm, folder, deformed):
    """omega = pi / (2 L) sqrt(E / rho) sqrt(l^2 + l - 1) at stretch l: l^2 by the deformed shape, else 1, and l - 1 by the stress."""
    stretch = 1.02
    statics = f"""deformed_shape = {str(deformed).lower()}
[[statics.pressures]]
group = "tip"
pressure = {-(stretch - 1.0) * YOUNG}
"""
    scene = scene_of(comm, folder, statics, (SIDES, END))
    with microslip.build(scene, comm) as structure:
        omega = structure.modes.omega_n[0]
    expected = stretch**2 if deformed else 1.0
    assert omega == pytest.approx(0.5 * np.pi / LENGTH * np.sqrt(YOUNG / DENSITY * (expected + stretch - 1.0)), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("eta, flap", [(0.0, 3.5160), (3.0, 4.7973), (6.0, 7.3604), (12.0, 13.1702)])
def test_a_spinning_beam_has_the_frequencies_of_theory(comm, folder, eta, flap):
    """A. D. Wright and others, Journal of Applied Mechanics 49 (1982) 197: flap of a beam clamped on the axis; in the plane
    omega^2 is smaller by Omega^2."""
    with microslip.build(scene_of(comm, folder, turning(eta * OMEGA_1 or 1e-6)), comm) as structure:
        computed = np.sort(structure.modes.omega_n)[:2] / OMEGA_1
    assert computed == pytest.approx([np.sqrt(flap**2 - eta**2), flap], rel=5e-3)
