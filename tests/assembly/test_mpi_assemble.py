"""K, M and the maps equal a serial dense assembly on any number of ranks, and satisfy mechanics."""

import numpy as np
import pytest
import scipy.sparse as sp
from box_meshes import KINDS, STEEL, box, joint, made_of, mesh_of, settings
from mpi4py import MPI
from petsc4py import PETSc

from microslip import elements
from microslip.assembly import node_blocks as blocks_module
from microslip.assembly.assemble import assemble
from microslip.linear.dense import diagonal_owned, multiply
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.messages.errors import CaseError, MeshError
from microslip.tables.structure import Material, Orientation

comm = MPI.COMM_WORLD
BOTTOM = {"base": lambda x: x[:, 2] == 0.0}
STACK = {
    **BOTTOM,
    "lower_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < len(x) / 2),
    "upper_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= len(x) / 2),
}


def bend(mesh):
    """Distort the mesh smoothly, so that no element is a brick."""
    x, y, z = mesh.points.T.copy()
    mesh.points[:] = np.stack([x + 0.1 * y * z, y + 0.1 * np.sin(x), z + 0.05 * x * y], axis=1)
    return mesh


def single_body(kind, n=(2, 2, 2)):
    return bend(mesh_of(("block", kind, *box(kind, n)), groups=BOTTOM))


def stack(kind="hex20"):
    return bend(mesh_of(("low", kind, *box(kind)), ("high", kind, *box(kind, origin=(0, 0, 1))), groups=STACK))


def system_of(mesh, case):
    """Return system and pairs as in run.py; every rank has the mesh, but only rank 0 passes it on."""
    pairs = pair_contacts(mesh, case.joints)
    on_root = mesh if comm.rank == 0 else None
    return assemble(distribute(on_root, case, comm), on_root, pairs, case), pairs


def gathered(matrix):
    """Return a PETSc matrix as a SciPy matrix on every rank."""
    indptr, columns, values = matrix.getValuesCSR()
    shape = (len(indptr) - 1, matrix.getSize()[1])
    return sp.vstack(comm.allgather(sp.csr_matrix((values, columns, indptr), shape))).tocsr()


def serial(mesh, case):
    """Return K and M of all DOFs in the order of Mesh.points, element by element."""
    n = 3 * len(mesh.points)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    steel = next(iter(case.sections.values()))
    for block in mesh.elements:
        stiffness = elements.stiffness(steel.solids(block.kind, mesh.points[block.nodes]))
        mass = elements.mass(block.kind, mesh.points[block.nodes], steel.density)
        for nodes, k, m in zip(block.nodes, stiffness, mass, strict=True):
            rows = (3 * nodes[:, None] + np.arange(3)).ravel()
            K[np.ix_(rows, rows)] += k
            M[np.ix_(rows, rows)] += np.kron(m, np.eye(3))
    return sp.csr_matrix(K), sp.csr_matrix(M)


def assert_equal_matrices(system, mesh, case):
    is_free = system.dof.ravel() >= 0
    order = system.dof.ravel()[is_free]
    for matrix, reference in zip((system.K, system.M), serial(mesh, case), strict=True):
        expected = reference[is_free][:, is_free]
        difference = gathered(matrix)[order][:, order] - expected
        assert abs(difference).max() <= 1e-12 * abs(expected).max()


@pytest.mark.parametrize("kind", KINDS)
def test_equals_serial_assembly(kind):
    mesh, case = single_body(kind), settings({"block": "block"}, [("base", ["x", "z"])])
    system, _ = system_of(mesh, case)
    assert system.n_dof == 3 * len(mesh.points) - 2 * len(mesh.node_groups["base"])
    assert_equal_matrices(system, mesh, case)
    assert gathered(system.M).nnz < 0.4 * gathered(system.K).nnz


def of_fibres(mesh, supports=()):
    """Return settings of a body whose fibres are wound around an axis."""
    wound = Material(
        young=(1.4e11, 1e10, 2e10),
        poisson=(0.28, 0.31, 0.4),
        shear=(5e9, 6e9, 3.5e9),
        density=STEEL.density,
        expansion=(-1e-6, 3e-5, 2e-5),
    )
    axes = Orientation(axis=(0.1, 0.2, 1.0), axis_point=(-2.0, 0.5, 0.0))
    return made_of(settings({"block": "block"}, supports), wound, axes)


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_an_anisotropic_material_equals_serial_assembly(kind):
    mesh = single_body(kind)
    case = of_fibres(mesh, [("base", ["x", "z"])])
    assert_equal_matrices(system_of(mesh, case)[0], mesh, case)


def test_assembly_in_small_chunks_gives_the_same_matrices(monkeypatch):
    monkeypatch.setattr(blocks_module, "_CHUNK_BYTES", 1e5)  # 3 elements at a time
    mesh, case = single_body("hex20"), settings({"block": "block"}, [("base", ["x", "z"])])
    assert_equal_matrices(system_of(mesh, case)[0], mesh, case)


def test_mixed_kinds_and_several_supports_equal_serial_assembly():
    mesh = bend(
        mesh_of(
            ("low", "hex20", *box("hex20")),
            ("high", "hex20", *box("hex20", origin=(0, 0, 1))),
            ("side", "tet10", *box("tet10", (1, 1, 2), origin=(3, 0, 0))),
            groups=STACK,
        )
    )
    mesh.node_groups["lower_top"] = np.flatnonzero(
        (np.arange(len(mesh.points)) < 81)
        & np.isin(np.arange(len(mesh.points)), mesh.elements[0].nodes[:, [4, 5, 6, 7, 12, 13, 14, 15]][1::2])
    )
    case = settings(
        {"low": "low", "high": "high", "side": "side"}, [("low", ["x", "y", "z"]), ("base", ["x", "y"]), ("high", ["z"])]
    )
    system, _ = system_of(mesh, case)
    assert (system.dof[mesh.node_groups["low"]] == -1).all()
    assert_equal_matrices(system, mesh, case)


def test_rows_are_contiguous_on_each_rank_and_ordered_by_node():
    mesh, case = single_body("hex20"), settings({"block": "block"}, [("base", ["y"])])
    system, _ = system_of(mesh, case)
    dof = system.dof[system.dof >= 0]
    np.testing.assert_array_equal(np.sort(dof), np.arange(system.n_dof))
    free = system.dof[(system.dof >= 0).all(axis=1)]
    np.testing.assert_array_equal(free - free[:, :1], np.tile([0, 1, 2], (len(free), 1)))
    assert system.K.getOwnershipRange() == system.M.getOwnershipRange()
    assert len(system.parts) == np.diff(system.K.getOwnershipRange())[0]


def rigid_modes(mesh, system):
    """Return the six rigid motions in the free rows, (n_dof, 6)."""
    x, y, z = mesh.points.T
    ones, zeros = np.ones(len(x)), np.zeros(len(x))
    motions = [(ones, zeros, zeros), (zeros, ones, zeros), (zeros, zeros, ones), (zeros, -z, y), (z, zeros, -x), (-y, x, zeros)]
    modes = np.zeros((system.n_dof, 6))
    for column, motion in enumerate(motions):
        field = np.stack(motion, axis=1)
        modes[system.dof[system.dof >= 0], column] = field[system.dof >= 0]
    return modes


@pytest.mark.parametrize("kind", KINDS)
def test_rigid_motion_has_no_forces_and_the_mass_of_the_body(kind):
    """A single node is fixed, so that the scene is valid; rows without coupling to it have the complete motion."""
    mesh, case = single_body(kind), settings({"block": "block"}, [("base", ["x"])])
    mesh.node_groups["base"] = np.array([0])
    system, _ = system_of(mesh, case)
    K, modes = gathered(system.K), rigid_modes(mesh, system)
    touching = np.unique(np.concatenate([b.nodes[(b.nodes == 0).any(axis=1)].ravel() for b in mesh.elements]))
    far = np.setdiff1d(np.arange(len(mesh.points)), touching)
    rows = system.dof[far].ravel()
    assert abs(K @ modes)[rows].max() <= 1e-12 * abs(K).max() * abs(modes).max()
    mass = modes[:, 1] @ gathered(system.M) @ modes[:, 1]
    steel = next(iter(case.sections.values()))
    volume = sum(elements.mass(b.kind, mesh.points[b.nodes], 1.0).sum() for b in mesh.elements)
    assert mass == pytest.approx(steel.density * volume, rel=1e-12)


def test_R_gives_the_relative_motion_of_the_pairs():
    mesh = stack()
    case = settings({"low": "low", "high": "high"}, [("base", ["x", "y", "z"])], [joint()])
    system, pairs = system_of(mesh, case)
    assert system.R.shape == (3 * pairs.n_pairs, system.n_dof)
    assert abs(system.R @ rigid_modes(mesh, system)[:, :3]).max() <= 1e-13
    u = np.random.default_rng(3).normal(size=mesh.points.shape)
    owned = np.zeros(system.n_dof)
    owned[system.dof[system.dof >= 0]] = u[system.dof >= 0]
    du = np.einsum("pij,pj->pi", pairs.frame, u[pairs.node1] - u[pairs.node2])
    np.testing.assert_allclose(system.R @ owned, du.ravel(), atol=1e-13)
    opens = np.zeros(system.n_dof)  # body 1 is the lower one: pushed down it opens the contact
    rows = system.dof[mesh.node_groups["low"], 2]
    opens[rows[rows >= 0]] = -1.0
    assert ((system.R @ opens)[2::3] > 0.9).all()


def test_fixed_partners_have_no_entries_in_R():
    mesh = stack()
    case = settings({"low": "low", "high": "high"}, [("low", ["x", "y", "z"])], [joint()])
    system, pairs = system_of(mesh, case)
    assert system.R.getnnz() <= 9 * pairs.n_pairs
    u = rigid_modes(mesh, system)[:, 2]
    np.testing.assert_allclose((system.R @ u).reshape(-1, 3), -pairs.frame[:, :, 2], atol=1e-13)


def test_a_joint_with_both_sides_fixed_is_refused():
    mesh = stack()
    bodies, sides = {"low": "low", "high": "high"}, [("lower_top", "xyz"), ("upper_bottom", "xyz")]
    with pytest.raises(CaseError, match=r"joint 'joint': .*both sides of all its \d+ pairs"):
        system_of(mesh, settings(bodies, sides, [joint()]))
    system, _ = system_of(mesh, settings(bodies, [("lower_top", "xyz"), ("upper_bottom", "xy")], [joint()]))
    assert not system.notes


def test_pairs_fixed_on_both_sides_are_reported():
    mesh = stack()
    for name in ("lower_top", "upper_bottom"):
        side = mesh.node_groups[name]
        mesh.node_groups[f"fixed_{name}"] = side[np.argsort(mesh.points[side, 0])[:3]]
    supports = [("fixed_lower_top", "xyz"), ("fixed_upper_bottom", "xyz")]
    system, pairs = system_of(mesh, settings({"low": "low", "high": "high"}, supports, [joint()]))
    immobile = np.flatnonzero(np.diff(system.R.indptr).reshape(-1, 3).sum(axis=1) == 0)
    assert len(immobile) == 3 and f"both sides of 3 of its {pairs.n_pairs} pairs" in system.notes[0]


def test_loads_and_outputs_on_free_and_fixed_nodes():
    mesh = stack()
    tip = int(mesh.numbers[-1])
    case = settings(
        {"low": "low", "high": "high"},
        [("base", ["x", "y"])],
        [joint()],
        loads=[{"node": tip, "direction": (0.0, 3.0, 4.0)}, {"group": "base", "direction": (5.0, 0.0, 2.0)}],
        outputs=[
            {"name": "tip", "position": tuple(mesh.points[-1] + 1e-3), "direction": (0.0, 1.0, 0.0)},
            {"name": "fixed", "node": 1001, "direction": (1.0, 0.0, 0.0)},
        ],
    )
    mesh_with_support = mesh
    mesh_with_support.node_groups["base"] = np.flatnonzero(mesh.points[:, 2] < 0.06)
    system, _ = system_of(mesh, case)
    loads = system.loads.toarray()
    assert loads.shape == (system.n_dof, 2)
    np.testing.assert_allclose(loads[system.dof[-1], 0], (0.0, 3.0, 4.0))
    assert loads[:, 0].sum() == 7.0 and loads[:, 1].sum() == pytest.approx(2.0)
    outputs = system.outputs.toarray()
    assert outputs[0, system.dof[-1, 1]] == 1.0 and abs(outputs[0]).sum() == 1.0
    assert not outputs[1].any()


def test_rows_have_the_part_of_their_body():
    mesh = stack()
    case = settings({"disc": "low", "blade": "high"}, [("base", ["x", "y", "z"])], [joint()])
    system, _ = system_of(mesh, case)
    assert system.part_names == ("body 'disc'", "body 'blade'")
    parts = np.concatenate(comm.allgather(system.parts))
    rows = system.dof[mesh.node_groups["high"]].ravel()
    assert (parts[rows] == 1).all() and np.count_nonzero(parts) == len(rows)


def test_a_rank_may_own_no_rows():
    mesh, case = single_body("hex8", (1, 1, 1)), settings({"block": "block"}, [("base", ["x", "y", "z"])])
    system, _ = system_of(mesh, case)
    assert system.K.getLocalSize()[0] == (12 if comm.rank == 0 else 0)
    assert_equal_matrices(system, mesh, case)
    x, y = system.K.createVecs()
    x.set(1.0)
    system.K.mult(x, y)
    assert np.isfinite(y.norm())


def test_matrices_are_marked_as_symmetric():
    system, _ = system_of(single_body("tet4"), settings({"block": "block"}, [("base", ["x", "y", "z"])]))
    assert system.K.isSymmetricKnown() == (True, True) and system.M.isSymmetricKnown() == (True, True)
    assert PETSc.Mat.Type.SEQAIJ in system.K.getType() or PETSc.Mat.Type.MPIAIJ in system.K.getType()


def test_inverted_elements_are_counted_and_named():
    mesh = single_body("hex8", (3, 2, 2))
    for row in (1, 7):
        mesh.elements[0].nodes[row] = mesh.elements[0].nodes[row][[4, 5, 6, 7, 0, 1, 2, 3]]
    case = settings({"blade": "block"}, [("base", ["x", "y", "z"])])
    named = r"2 elements are inverted .*elements (2, 8|8, 2).* hex8 element [28] of body 'blade'"
    with pytest.raises(MeshError, match=named):
        system_of(mesh, case)


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_a_structure_without_supports_has_six_rigid_motions(kind):
    """They cause no forces; a base supported along x leaves three of them."""
    system, _ = system_of(single_body(kind), settings({"blade": "block"}))
    force, size = np.abs(multiply(system.K, system.rigid_owned)).max(initial=0.0), diagonal_owned(system.K).max(initial=0.0)
    assert system.rigid_owned.shape == (system.K.getLocalSize()[0], 6) and force <= 1e-12 * max(comm.allgather(size))
    assert any("is free" in note for note in system.notes)
    supported, _ = system_of(single_body(kind), settings({"blade": "block"}, [("base", ["x"])]))
    force = np.abs(multiply(supported.K, supported.rigid_owned)).max(initial=0.0)
    assert supported.rigid_owned.shape[1] == 3 and force <= 1e-12 * max(comm.allgather(size))
    assert any("2 translations and 1 turning motion" in note for note in supported.notes)


@pytest.mark.parametrize(
    "supports, loads, error, message",
    [
        ([("base", ["x", "y", "z"])], [{"group": "base", "direction": (1, 0, 0)}], CaseError, "1 acts only on degrees"),
        ([("block", ["x", "y", "z"])], [], CaseError, "fix every degree of freedom"),
        ([("base", ["x"])], [{"node": 5, "direction": (1, 0, 0)}], MeshError, r"\[\[loads\]\] 1 node = 5: no element"),
    ],
)
def test_loads_on_fixed_or_missing_nodes_and_fully_fixed_structures_are_refused(supports, loads, error, message):
    with pytest.raises(error, match=message):
        system_of(single_body("hex8"), settings({"blade": "block"}, supports, loads=loads))
