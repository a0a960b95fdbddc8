"""A heated block of orthotropic material against its free expansion; on one rank and on several."""

import numpy as np
import pytest
from box_meshes import STEEL, box, made_of, mesh_of, settings

from microslip import elements
from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces, stiffness_at_rest
from microslip.linear.joint_springs import linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.parallel.agree import on_root
from microslip.statics.equilibrium import Flexibility, equilibrium
from microslip.tables.constant_loads import Statics, Temperature
from microslip.tables.structure import Material, Orientation

ALPHA, TEMPERATURE_RISE = (-1e-6, 3e-5, 2e-5), 150.0
AXES = Orientation(directions=((1.0, 0.4, -0.3), (0.2, 1.0, 0.7)))
CORNERS = {  # six statically determinate supports, which allow expansion with a rotation about the first corner
    "origin": lambda x: (x == 0.0).all(axis=1),
    "along_x": lambda x: (x[:, 1:] == 0.0).all(axis=1) & (x[:, 0] == 1.0),
    "along_y": lambda x: (x[:, [0, 2]] == 0.0).all(axis=1) & (x[:, 1] == 1.0),
}


def heated(kind):
    """Return the settings of a block of fibres with statically determinate supports at three corners."""
    material = Material(
        young=(1.4e11, 1e10, 2e10), poisson=(0.28, 0.31, 0.4), shear=(5e9, 6e9, 3.5e9), density=STEEL.density, expansion=ALPHA
    )
    supported = settings({"block": "block"}, [("origin", "xyz"), ("along_x", "yz"), ("along_y", "z")])
    statics = Statics(temperatures=(Temperature(group="block", temperature=TEMPERATURE_RISE),), steps=1)
    return made_of(supported, material, AXES).with_keys(statics=statics)


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_a_heated_block_has_the_strain_of_its_fibres_and_no_stress(comm, kind):
    """u = (alpha dT + rotation) x with the rotation that the supports allow; the stiffness at rest equals that without stress."""
    mesh = on_root(comm, lambda: mesh_of(("block", kind, *box(kind, (2, 2, 2), (1.0, 1.0, 1.0))), groups=CORNERS), share=False)
    given = heated(kind)
    shares, pairs = distribute(mesh, given, comm), on_root(comm, pair_contacts, mesh, ())
    system = assemble(shares, mesh, pairs, given)
    linearised = linearise(system, pairs)
    rest = equilibrium(Flexibility(linearised), pairs, constant_forces(shares, mesh, given, system), 1)
    linearised.destroy()
    u_all = np.concatenate(comm.allgather(rest.u_owned))
    u = np.where(system.dof >= 0, u_all[system.dof], 0.0)
    a = elements.Directions(*AXES.directions).at(np.zeros(3))
    E = TEMPERATURE_RISE * (a.T * ALPHA) @ a
    H = E + np.array([[0.0, E[0, 1], E[0, 2]], [-E[0, 1], 0.0, E[1, 2]], [-E[0, 2], -E[1, 2], 0.0]])  # zero below the diagonal

    def largest_error():
        return np.abs(u - mesh.points @ H.T).max()

    assert on_root(comm, largest_error) < 1e-9 * np.abs(E).max()
    K = stiffness_at_rest(shares, given, system, rest.u_owned).K
    K.axpy(-1.0, system.K)
    assert K.norm() < 1e-9 * system.K.norm()
    K.destroy()
