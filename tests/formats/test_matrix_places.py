"""Mistakes in scenes with matrices and nodes give a message each; notes describe the matrices."""

import re

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from block_scenes import NODE_PAIRS, OF_CALCULIX, SURFACES, calculix_blocks, in_format, positions, write_scene, write_superelement
from matrix_files import write_dmig
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.assembly.matrices import read_structure
from microslip.assembly.matrix_checks import definiteness, messages_on_matrices, negative_pivots
from microslip.assembly.matrix_places import Places
from microslip.mesh.data import Mesh
from microslip.messages.errors import CaseError, MeshError
from microslip.scene.read import read_scene


def structure(path):
    return read_structure(read_scene(path))


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def text_of(folder, name, text):
    (folder / name).write_text(text)


@pytest.mark.parametrize(
    "file, old, new, message",
    [
        (
            "scene.toml",
            "node = 17",
            "node = 19",
            "[[loads]] 1 node = 19: the model has no such node; node numbers run from 5 to 18",
        ),
        ("scene.toml", "node = 17", "group = 'FOOT'", "[[loads]] 1 group = 'FOOT': there is no such group"),
        (
            "scene.toml",
            "node = 18",
            "position = [0.0, 0.0, 0.2]",
            "position: the positions of the nodes are unknown; state [model] nodes",
        ),
        ("scene.toml", "node = 18\ndirection = [1.0, 0.0, 0.0]", "dof = 36", "dof = 36: the matrices have DOFs 0 to 35"),
        ("scene.toml", "node = 18", 'point = "a"', "a model given as matrices has no nodes"),
        ("scene.toml", "[model]", '[model]\ndofs = "pairs.csv"', "the file of the matrix states node and direction of its rows"),
        ("scene.toml", NODE_PAIRS, SURFACES, "surfaces: belongs to a mesh; with matrices, give pairs"),
        (
            "scene.toml",
            NODE_PAIRS,
            NODE_PAIRS + 'pairing = "nodes"\n',
            "pairing belongs to a joint of surfaces; node_pairs lists",
        ),
        ("scene.toml", "preload = 1.0e6", 'preload = "static"', "a joint of node_pairs states gap and preload as numbers"),
        ("scene.toml", NODE_PAIRS, NODE_PAIRS + 'pairs = "pairs.csv"\n', "exactly one of surfaces, pairs, node_pairs is needed"),
        ("scene.toml", "friction = 0.3\n", "", "friction is missing"),
        ("scene.toml", "calculix_blocks.mas", "calculix_blocks.inp", "ending '.inp' is not one of"),
        ("scene.toml", "[model]", '[model]\nrecovery_dofs = "pairs.csv"', "recovery_dofs names the rows of a recovery matrix"),
        ("pairs.csv", "11,5,0,0,2,0.0025", "11,99,0,0,2,0.0025", "pairs.csv, line 2: node2 = 99: there is no such node"),
        ("pairs.csv", "11,5,0,0,2,0.0025", "-1,5,0,0,2,0.0025", "pairs.csv, line 2: node1 = -1: there is no such node"),
        ("pairs.csv", "11,5,0,0,2,0.0025", "11,5,0,0,0,0.0025", "pairs.csv, line 2: the normal nx, ny, nz is zero"),
        ("pairs.csv", "11,5,0,0,2,0.0025", "11,5,0,0,1,0.0", "pairs.csv, line 2: area must be above 0"),
        ("pairs.csv", "11,5,0,0,2,0.0025", "11,11,0,0,1,1.0", "pairs.csv, line 2: node1 and node2 are the same node"),
        ("pairs.csv", "node1,node2", "node1,nodes2", "node2 is missing"),
        ("calculix_blocks.dof", "5.1\n", "", "names 35 rows; "),
        ("calculix_blocks.dof", "5.1\n", "5,1\n", "'5,1' is not a node and its direction, as 12.3"),
        ("calculix_blocks.dof", "5.1\n5.2\n", "5.1\n5.1\n", "rows 0 and 1, counted from 0, are both node 5 x"),
    ],
)
def test_a_mistake_gives_one_message(tmp_path, file, old, new, message):
    path = write_scene(tmp_path, OF_CALCULIX)
    change(tmp_path / file, old, new)
    with pytest.raises((CaseError, MeshError), match=re.escape(message)) as caught:
        structure(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "table, message",
    [
        ("node,direction\n1,1\n", "dofs.csv: [model] dofs has 1 row, and the matrix has 36"),
        ("node,direction\n1,7\n", "dofs.csv, line 2: a node number and a direction from 1 (x) to 6"),
        ("node,axis\n1,1\n", "direction is missing"),
    ],
)
def test_a_table_of_rows_that_does_not_fit_is_refused(tmp_path, table, message):
    path = write_scene(tmp_path, in_format(tmp_path, "npz"))
    text_of(tmp_path, "dofs.csv", table)
    with pytest.raises(CaseError, match=re.escape(message)):
        structure(path)


def test_nodes_without_rows_and_repeated_nodes_are_refused(tmp_path):
    path = write_scene(tmp_path, in_format(tmp_path, "npz").replace('dofs = "dofs.csv"', 'nodes = "nodes.csv"'))
    text_of(tmp_path, "nodes.csv", "node,x,y,z\n5,0,0,0\n5,0,0,0\n")
    change(path, NODE_PAIRS, 'pairs = "none.csv"\n')
    change(path, "friction = 0.3\ntangential_stiffness = 2.0e12\nnormal_stiffness = 4.0e12\npreload = 1.0e6\n", "")
    text_of(tmp_path, "none.csv", "x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n12,13,14,0,1,2,0.3,1.0,0.0,1.0,1.0\n")
    change(path, "node = 17\ndirection = [1.0, 0.2, 0.0]", "dof = 0")
    change(path, "node = 18\ndirection = [1.0, 0.0, 0.0]", "dof = 1")
    with pytest.raises(CaseError, match="the nodes of the rows are unknown; state \\[model\\] dofs"):
        structure(path)
    change(path, "nodes = ", 'dofs = "dofs.csv"\nnodes = ')
    with pytest.raises(CaseError, match="nodes.csv, line 3: node 5 appears twice"):
        structure(path)


def test_a_load_along_a_direction_without_a_row_is_refused(tmp_path):
    """The load acts along z, whose rows belong to no node."""
    path = write_scene(tmp_path, in_format(tmp_path, "npz"))
    lines = (tmp_path / "dofs.csv").read_text().splitlines()
    text_of(tmp_path, "dofs.csv", "\n".join("0,0" if line == "17,3" else line for line in lines) + "\n")
    assert structure(path).loads.nnz == 2
    change(path, "[1.0, 0.2, 0.0]", "[0.0, 0.0, 1.0]")
    with pytest.raises(CaseError, match=re.escape("[[loads]] 1: the matrices have no row for node 17 along z")):
        structure(path)


@pytest.mark.parametrize(
    "recovery, message",
    [
        (np.ones((12, 30)), "[model] recovery is 12 x 30: u = T q needs a column for each of 36 rows"),
        (np.full((12, 36), np.nan), "[model] recovery has an entry that is not a finite number"),
        (np.ones((11, 36)), "[model] recovery_dofs has 12 rows, and the matrix has 11"),
    ],
)
def test_a_recovery_matrix_that_does_not_fit_is_refused(tmp_path, recovery, message):
    path = write_superelement(tmp_path)
    content = scipy.io.loadmat(tmp_path / "cb.mat")
    scipy.io.savemat(tmp_path / "cb.mat", {"K": content["K"], "M": content["M"], "T": recovery})
    with pytest.raises(CaseError, match=re.escape(message)):
        structure(path)


def test_pairs_by_rows_and_pairs_by_nodes_may_be_combined(tmp_path):
    path = write_scene(tmp_path, OF_CALCULIX)
    text_of(tmp_path, "rows.csv", "x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n24,25,26,-1,-1,-1,0.3,1.0,0.0,1.0,2.0\n")
    change(path, "[[loads]]", '[[joints]]\nname = "stop"\npairs = "rows.csv"\n[[loads]]')
    given = structure(path)
    assert given.pairs.joint == ("stop", *["joint"] * 4) and given.R.shape == (15, 36)
    np.testing.assert_array_equal(given.R[:3].toarray()[:, 24:27], np.eye(3))
    np.testing.assert_allclose(given.pairs.k_t[1:], 2.0e12 * 0.0025)
    rigid = np.tile([0.3, -0.2, 0.9], 12)
    np.testing.assert_allclose(given.R[3:] @ rigid, 0.0, atol=1e-15)


def test_matrices_with_different_rows_are_reordered(tmp_path):
    """The mass matrix has its rows in another order, and no massless rows."""
    K, M, dofs = calculix_blocks()
    write_dmig(tmp_path / "K.pch", K, dofs)
    order = np.random.default_rng(1).permutation(36)[3:]
    write_dmig(tmp_path / "M.pch", sp.diags(M.sum(axis=1).A1[order]).tocsr(), dofs[order])
    given = structure(write_scene(tmp_path, '[model]\nstiffness = "K.pch"\nmass = "M.pch"\n'))
    expected = M.sum(axis=1).A1.copy()
    expected[np.setdiff1d(np.arange(36), order)] = 0.0
    np.testing.assert_allclose(given.M.diagonal(), expected, rtol=1e-8)
    assert given.n_massless == 3


def test_scenes_without_nodes_have_notes_on_symmetry_and_definiteness(tmp_path):
    path = write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.4], (0.8, 2.4), outputs=[2])
    given = structure(path)
    assert given.places is None and given.mesh is None
    assert given.notes == ("symmetry: stiffness 0.0e+00, mass 0.0e+00 of the largest entry", "stiffness: no negative eigenvalue")


# -- notes on the matrices ---------------------------------------------------------------------------------


def upper_block(scale=1.0):
    """Return K, M and places of the upper block, which has no supports."""
    K, M, dofs = calculix_blocks()
    rows = np.flatnonzero(dofs.nodes > 10)
    place = positions()
    numbers = np.arange(11, 19)
    mesh = Mesh("", scale * np.array([place[number] for number in numbers]), numbers, (), (), {})
    table = np.arange(24).reshape(8, 3)
    return K[rows][:, rows], M[rows][:, rows], Places(mesh, table, sp.identity(24, format="csr"))


def test_notes_on_a_free_block_state_six_rigid_motions_and_its_mass():
    notes = messages_on_matrices(*upper_block()[:2], {"stiffness": 0.0}, upper_block()[2])
    assert notes[1:] == [
        "stiffness: no negative eigenvalue",
        "stiffness: 6 of 6 rigid motions strain nothing (along x, along y, along z, about x, about y, about z)",
        "mass: 7.8, 7.8, 7.8 kg along x, y, z (of rows with a node)",
    ]


def test_each_disconnected_part_has_a_note(tmp_path):
    given = structure(write_scene(tmp_path, OF_CALCULIX + 'nodes = "calculix_blocks.inp"\n'))
    assert given.notes[2:4] == (
        "stiffness: part of 12 rows with node 5: it is held",
        "stiffness: part of 24 rows with node 11: 6 of 6 rigid motions strain nothing (along x, along y, along z, about x, about y, "
        "about z)",
    )


def test_a_supported_block_has_no_rigid_motion_and_millimetres_are_suspected():
    K, M, places = upper_block(1000.0)
    notes = messages_on_matrices(K + 1e9 * sp.identity(24), M, {"stiffness": 0.0}, places)
    assert notes[2] == "stiffness: it is held"
    assert notes[4].startswith("units: 7.8 kg in a box of 1e+06 m3 is 7.8e-06 kg/m3")


@pytest.mark.parametrize("shift", [0.0, 1e8, 1e10, 3e10])
def test_negative_eigenvalues_are_counted(shift):
    K = (upper_block()[0] - shift * sp.identity(24)).tocsr()
    n = int((np.linalg.eigvalsh(K.toarray()) < -1.0).sum())
    assert negative_pivots(K + 1.0 * sp.identity(24)) == n
    if n and (K.diagonal() > 0.0).all():
        assert definiteness(K) == f"stiffness: {n} negative eigenvalues, not positive semi-definite"
