"""A rotating ring against theory: hoop stress, and the frequency of out-of-plane bending; on one rank and on several."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import block, join
from box_meshes import made_of, mesh_of, settings

from microslip import elements
from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces, stiffness_at_rest
from microslip.linear.joint_springs import linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.modes.eigen import lowest_modes
from microslip.parallel.agree import on_root
from microslip.reduction.expand import node_fields
from microslip.statics.equilibrium import Flexibility, equilibrium
from microslip.tables.constant_loads import Statics
from microslip.tables.structure import Material

YOUNG, DENSITY, RADIUS, SIDE = 2.0e11, 8000.0, 0.2, 0.004  # of a square section
STEEL = Material(young=YOUNG, poisson=0.3, density=DENSITY)


def ring():
    """Return a ring about z with groups of inner nodes for supports that allow expansion and bending in cos 2 theta."""

    def quarter(k):
        def mapping(u, v, w):
            angle, radius = 0.5 * np.pi * (k + u), RADIUS - SIDE * (v - 0.5)
            return np.stack([radius * np.cos(angle), radius * np.sin(angle), SIDE * (w - 0.5)], axis=-1)

        return block("hex20", mapping, (8, 1, 1))

    body = join([quarter(k) for k in range(4)])
    x, y, z = body.points.T
    inner = (np.abs(np.hypot(x, y) - (RADIUS - 0.5 * SIDE)) < 1e-9) & (np.abs(z) < 1e-9)
    groups = {
        "on_x": inner & (np.abs(y) < 1e-9),
        "on_y": inner & (np.abs(x) < 1e-9),
        "between": inner & np.isclose(np.abs(x), np.abs(y)),
    }
    return mesh_of(
        ("ring", "hex20", body.points, body.elements), groups={name: lambda _, at=at: at for name, at in groups.items()}
    )


def turning(speed):
    supported = settings({"ring": "ring"}, supports=[("on_x", "y"), ("on_y", "x"), ("between", "z")])
    statics = Statics(rotation_speed=speed, steps=1)
    return made_of(supported, STEEL).with_keys(statics=statics)


def at_speed(comm, mesh, speed):
    """Return mesh and pairs, the structure with its stiffness at rest, and the displacement of all nodes.  Collective."""
    given = turning(speed)
    shares, pairs = distribute(mesh, given, comm), on_root(comm, pair_contacts, mesh, ())
    system = assemble(shares, mesh, pairs, given)
    linearised = linearise(system, pairs)
    rest = equilibrium(Flexibility(linearised), pairs, constant_forces(shares, mesh, given, system), 1)
    linearised.destroy()
    u_all = np.concatenate(comm.allgather(rest.u_owned))
    u = np.where(system.dof >= 0, u_all[system.dof], 0.0)
    K = stiffness_at_rest(shares, given, system, rest.u_owned).K
    return shares, pairs, replace(system, K=K), u


def test_the_hoop_stress_is_that_of_theory(comm):
    """sigma = rho Omega^2 r^2 within 1 % in every section of a ring of r / h = 50; the radius grows by r sigma / E."""
    mesh = on_root(comm, ring, share=False)
    speed = 500.0
    shares, _, _, u = at_speed(comm, mesh, speed)
    expected = DENSITY * speed**2 * RADIUS**2
    u_by_rank = u[np.argsort(shares.rank_order)]
    for cells in shares.blocks:
        stress = elements.stress(turning(speed).sections[cells.body].solids(cells.kind, cells.points), u_by_rank[cells.nodes])
        middle = cells.points.mean(axis=1)
        along = np.stack([-middle[:, 1], middle[:, 0], 0.0 * middle[:, 2]], axis=1) / np.linalg.norm(middle, axis=1)[:, None]
        hoop = np.einsum("ei,eqij,ej->eq", along, stress, along)
        assert hoop.mean(axis=1) == pytest.approx(np.full(len(hoop), expected), rel=0.01)  # over the section
        assert np.abs(np.trace(stress, axis1=-2, axis2=-1) - hoop).max() < 0.02 * expected  # no other stress

    def growth():
        return np.einsum("ai,ai->a", u[:, :2], mesh.points[:, :2]) / np.linalg.norm(mesh.points[:, :2], axis=1)

    assert on_root(comm, growth).mean() == pytest.approx(RADIUS * expected / YOUNG, rel=0.01)


def bending(comm, mesh, speed):
    """Return omega of the out-of-plane mode with n = 2 nodal diameters [rad/s]."""
    _, pairs, system, _ = at_speed(comm, mesh, speed)
    linearised = linearise(system, pairs)
    modes = lowest_modes(linearised, 12)
    linearised.destroy()
    shapes = node_fields(system, modes.phi_owned)

    def number():
        shape = np.cos(2.0 * np.arctan2(mesh.points[:, 1], mesh.points[:, 0]))
        across = shapes[:, 2]
        return int(np.argmax(np.abs(shape @ across) / np.sqrt((shapes**2).sum(axis=(0, 1)))))

    return modes.omega_n[on_root(comm, number)]


def test_the_ring_stiffens_as_in_theory(comm):
    """omega^2 = omega_0^2 + n^2 Omega^2 by the tension rho A Omega^2 r^2 on slopes n w / r, without spin softening."""
    mesh = on_root(comm, ring, share=False)
    at_rest = bending(comm, mesh, 1e-6)
    speed = 0.7 * at_rest
    assert bending(comm, mesh, speed) == pytest.approx(np.sqrt(at_rest**2 + 4.0 * speed**2), rel=0.01)
