"""Supports on the two cyclic faces of a sector with different meshes."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from microslip.mesh.cyclic import CyclicFaces, followers
from microslip.messages.errors import MeshError

pytestmark = pytest.mark.ranks(1)
WEIGHTS = np.array(
    [[1.0, 0.0], [0.6, 0.4], [0.0, 1.0]]
)  # weights of the low nodes 0 and 1 in the motion of the high nodes 2, 3 and 4


def follow(fixed):
    """Return the dependent degrees of freedom where some nodes are fixed in all directions."""
    mesh = SimpleNamespace(path="sector.msh", numbers=np.arange(1, 6), points=np.zeros((5, 3)))
    weights = sp.csr_matrix(np.kron(np.hstack([WEIGHTS, np.zeros((3, 3))]), np.eye(3)))
    faces = CyclicFaces(np.arange(2, 5), weights, np.zeros((2, 0), dtype=int), np.eye(3), is_matched=False, note="")
    is_fixed = np.zeros((5, 3), dtype=bool)
    is_fixed[fixed] = True
    return followers(mesh, faces, is_fixed, np.zeros(0, dtype=int), sp.csr_matrix((0, 15)))[0]


def test_a_free_node_may_be_next_to_a_supported_node():
    assert list(follow([0, 2])) == list(range(9, 15))


@pytest.mark.parametrize(
    ("fixed", "low", "high"),
    [
        ([0], "1 at (0, 0, 0) m is fixed along xyz", "3 along nothing"),
        ([2], "1 at (0, 0, 0) m is fixed along nothing", "3 along xyz"),
        ([0, 2, 3], "2 at (0, 0, 0) m is fixed along nothing", "4 along xyz"),
        ([0, 1, 2], "1 at (0, 0, 0) m is fixed along xyz", "4 along nothing"),
    ],
    ids=["low only", "high only", "beyond", "too few"],
)
def test_supports_of_only_one_face_are_refused(fixed, low, high):
    with pytest.raises(MeshError, match=re.escape(f"node {low}, and, on a facet with it, {high}; fix both")):
        follow(fixed)
