"""Matrices of every format give the response of the original mesh, with joints, loads and outputs by nodes."""

import numpy as np
import pytest
from block_scenes import (
    OF_CALCULIX,
    OF_MESH,
    REST,
    SURFACES,
    calculix_blocks,
    in_format,
    positions,
    write_scene,
    write_superelement,
)
from box_meshes import box
from matrix_files import WRITERS
from matrix_scenes import branches_of, requested
from mpi4py import MPI
from small_fe import assemble

from microslip.parallel.agree import on_root

pytestmark = pytest.mark.ranks(1, 2)
ON_RANKS = ("mtx", "full")  # formats also tested on several ranks: a format that SciPy reads, and a binary format of Ansys
COMM = MPI.COMM_WORLD
_reference: list = []  # computed by the first test; tests share a communicator, not a folder


def response(folder, write):
    """Return the point at 2100 Hz of the scene that ``write(folder)`` makes.  Collective."""
    path = on_root(COMM, write, folder)
    (branch,) = branches_of(path, COMM)
    (point,) = requested(branch)
    return point


@pytest.fixture
def reference(tmp_path_factory, shared_path):
    """Return the same point of the scene with the mesh: two of its four pairs slip."""
    if not _reference:
        folder = on_root(COMM, lambda: (shared_path / "mesh").mkdir() or shared_path / "mesh")
        _reference.append(response(folder, lambda folder: write_scene(folder, OF_MESH, SURFACES)))
    return _reference[0]


def assert_same(point, reference, tolerance):
    assert reference.state.any() and reference.friction > 0.1 * reference.input
    scale = np.abs(reference.response).max()
    np.testing.assert_allclose(point.response, reference.response, rtol=0.0, atol=tolerance * scale)
    assert point.friction == pytest.approx(reference.friction, rel=10.0 * tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [pytest.param(end, marks=() if end in ON_RANKS else pytest.mark.ranks(1)) for end in WRITERS])
def test_matrices_of_a_format_give_the_response_of_the_mesh(shared_path, reference, ending):
    point = response(shared_path, lambda folder: write_scene(folder, in_format(folder, ending)))
    assert_same(point, reference, 1e-6 if ending == "pch" else 1e-8)


def test_calculix_matrices_with_the_surfaces_and_positions_of_their_mesh(shared_path, reference):
    """The joint is by surfaces and the output by position, from the .inp file of the matrices."""
    model = OF_CALCULIX + 'nodes = "calculix_blocks.inp"\n'
    point = response(shared_path, lambda folder: write_scene(folder, model, SURFACES, "position = [0.0, 0.1, 0.2]"))
    assert_same(point, reference, 1e-8)


def test_a_table_of_nodes_has_the_positions_and_forces_may_name_nodes(shared_path, reference):
    def write(folder):
        rows = [",".join(map(repr, [node, *map(float, x)])) for node, x in positions().items()]
        (folder / "nodes.csv").write_text("\n".join(["node,x,y,z", *rows]) + "\n")
        (folder / "forces.csv").write_text("node,fx,fy,fz\n17,1.0,0.2,0.0\n")
        rest = REST.replace("node = 17\ndirection = [1.0, 0.2, 0.0]\n", 'forces = "forces.csv"\n')
        return write_scene(folder, OF_CALCULIX + 'nodes = "nodes.csv"\n', rest=rest)

    assert_same(response(shared_path, write), reference, 1e-8)


def test_a_superelement_with_all_its_modes_is_exact(shared_path, reference):
    assert_same(response(shared_path, write_superelement), reference, 1e-8)


def test_the_stored_matrices_are_those_of_this_program():
    points, nodes = box("hex8", (1, 1, 1), (0.1, 0.1, 0.1))
    K, M = assemble("hex8", points, nodes, 2.1e11, 0.3, 7800.0, "full", False)
    place = positions()
    order = [int(np.argmin(np.linalg.norm(points + [0.0, 0.0, 0.1] - place[node], axis=1))) for node in range(11, 19)]
    at = (3 * np.array(order)[:, None] + np.arange(3)).ravel()
    K_stored, M_stored, rows = calculix_blocks()
    upper = np.flatnonzero(rows.nodes > 10)
    for matrix, stored in ((K, K_stored), (M, M_stored)):
        block, stored_block = matrix.tocsr()[at][:, at].toarray(), stored[upper][:, upper].toarray()
        np.testing.assert_allclose(block, stored_block, rtol=0.0, atol=1e-12 * np.abs(stored_block).max())
