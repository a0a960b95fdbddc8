"""Distribution of the mesh: every node has one owner, and every rank has all elements with a node that it owns."""

import numpy as np
import pytest
from box_meshes import KINDS, box, mesh_of, settings
from mpi4py import MPI

from microslip.mesh.partition import distribute

comm = MPI.COMM_WORLD
CASE = settings({"left": "low", "right": "high"})


def two_kinds():
    high = box("tet4", (2, 2, 2), origin=(2, 0, 0))
    return mesh_of(("low", "hex20", *box("hex20", (3, 2, 2))), ("high", "tet4", *high))


@pytest.mark.parametrize("mesh", [two_kinds()] + [mesh_of(("low", kind, *box(kind, (3, 2, 1)))) for kind in KINDS])
def test_every_node_has_one_owner_and_ranks_have_the_elements_of_their_nodes(mesh):
    dmesh = distribute(mesh if comm.rank == 0 else None, CASE, comm)
    assert dmesh.node_ranges[0] == 0 and dmesh.node_ranges[-1] == len(mesh.points)
    assert (np.diff(dmesh.node_ranges) > 0).all()
    np.testing.assert_array_equal(np.sort(dmesh.rank_order), np.arange(len(mesh.points)))
    first, last = dmesh.node_ranges[comm.rank : comm.rank + 2]
    body_of = {"low": "left", "high": "right"}
    expected = {
        (body_of[block.group], number)
        for block in mesh.elements
        for number, nodes in zip(block.numbers, dmesh.rank_order[block.nodes], strict=True)
        if ((nodes >= first) & (nodes < last)).any()
    }
    assert expected == {(block.body, number) for block in dmesh.blocks for number in block.numbers}
    ranked_points = np.empty_like(mesh.points)
    ranked_points[dmesh.rank_order] = mesh.points
    for block in dmesh.blocks:
        np.testing.assert_array_equal(block.points, ranked_points[block.nodes])


def test_nodes_are_balanced():
    mesh = mesh_of(("low", "hex20", *box("hex20", (12, 4, 4))))
    dmesh = distribute(mesh if comm.rank == 0 else None, CASE, comm)
    load = np.diff(dmesh.node_ranges) * comm.size / len(mesh.points)
    assert load.max() < 1.15 and load.min() > 0.7


def test_ranks_without_elements_are_possible():
    mesh = mesh_of(("low", "hex8", *box("hex8", (1, 1, 1))))
    dmesh = distribute(mesh if comm.rank == 0 else None, CASE, comm)
    assert dmesh.node_ranges.tolist() == [0] + [8] * comm.size
    assert sum(len(block.nodes) for block in dmesh.blocks) == (1 if comm.rank == 0 else 0)
