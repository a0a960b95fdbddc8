"""The error of a tie between different meshes: a column pulled along its axis.

python tests/verification/tied_column.py prints the table of docs/validation.md.
"""

import numpy as np
import scipy.sparse as sp
from box_meshes import box, mesh_of, settings
from mpi4py import MPI
from scipy.sparse.linalg import spsolve

from microslip.parallel.petsc import initialise

initialise()

from microslip import elements
from microslip.assembly.assemble import assemble
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.surface import outward_faces
from microslip.tables.structure import Tie

YOUNG, POISSON, PULL = 2.1e11, 0.3, 1e6  # Pa, -, Pa
GLUE = Tie(name="glue", surfaces=("high_bottom", "low_top"))
MESHES = [
    ("hex8", (2, 2, 1), "hex8", (3, 3, 2)),
    ("hex8", (4, 4, 2), "hex8", (6, 6, 3)),
    ("hex8", (8, 8, 4), "hex8", (12, 12, 6)),
    ("hex8", (3, 3, 2), "hex8", (2, 2, 1)),
    ("hex8", (6, 6, 3), "hex8", (4, 4, 2)),
    ("hex8", (12, 12, 6), "hex8", (8, 8, 4)),
    ("hex8", (4, 4, 2), "hex8", (8, 8, 4)),
    ("hex20", (2, 2, 1), "hex20", (3, 3, 2)),
    ("hex20", (4, 4, 2), "hex20", (6, 6, 3)),
    ("hex20", (4, 4, 2), "tet10", (6, 6, 3)),
]


def column(low, n_low, high, n_high):
    """Return two unit boxes stacked along z, with the two surfaces of a tie."""
    lower, upper = box(low, n_low), box(high, n_high, origin=(0.0, 0.0, 1.0))
    n = len(lower[0])
    groups = {
        "base": lambda x: x[:, 2] == 0.0,
        "low_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < n),
        "high_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= n),
        "top": lambda x: x[:, 2] == 2.0,
        "corner": lambda x: (x == 0.0).all(axis=1),
        "edge": lambda x: (x == [1.0, 0.0, 0.0]).all(axis=1),
    }
    return mesh_of(("low", low, *lower), ("high", high, *upper), groups=groups)


def pulled(mesh):
    """Return the largest relative errors of the stress along z, in the elements at the tie and beyond, and of the elongation."""
    case = settings({"low": "low", "high": "high"}, [("base", "z"), ("corner", "xy"), ("edge", "y")], ties=(GLUE,))
    system = assemble(distribute(mesh, case, MPI.COMM_SELF), mesh, pair_contacts(mesh, ()), case)
    forces = np.zeros((len(mesh.points), 3))
    for kind, faces in outward_faces(mesh, "top").items():
        np.add.at(forces, faces, -PULL * elements.pressure_forces(kind, mesh.points[faces]))
    constraints = system.constraints
    own = constraints.dof >= 0
    f = np.zeros(constraints.T.shape[0])
    f[constraints.dof[own]] = forces[own]
    indptr, columns, values = system.K.getValuesCSR()
    K = sp.csr_matrix((values, columns, indptr))
    u = system.at_nodes(spsolve(K.tocsc(), constraints.T.T @ f))
    at_tie, beyond = [], []
    for block in mesh.elements:
        points = mesh.points[block.nodes]
        stress = elements.stress(elements.Solids(block.kind, points, elements.Isotropic(YOUNG, POISSON)), u[block.nodes])
        error = np.abs(stress[..., 2, 2] / PULL - 1.0).max(axis=1)
        touches = (np.abs(points[:, :, 2] - 1.0) < 1e-9).any(axis=1)
        at_tie.append(error[touches].max())
        beyond += [error[~touches].max()] if (~touches).any() else []
    return max(at_tie), max(beyond, default=np.nan), u[mesh.node_groups["top"], 2].mean() / (2.0 * PULL / YOUNG) - 1.0


if __name__ == "__main__":
    print(
        "| leads | follows | stress beside the tie | in the next elements and beyond | elongation |\n| --- | --- | --- | --- | --- |"
    )
    for low, n_low, high, n_high in MESHES:
        at_tie, beyond, longer = pulled(column(low, n_low, high, n_high))
        shapes = [f"{kind} {' x '.join(map(str, n))}" for kind, n in ((low, n_low), (high, n_high))]
        print(f"| {shapes[0]} | {shapes[1]} | {100 * at_tie:.2g} % | {100 * beyond:.2g} % | {longer:.1e} |")
