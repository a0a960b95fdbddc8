"""The outer surface of a mesh: closed, oriented outward, and still that of the body after coarsening."""

import numpy as np
import pytest
from box_meshes import KINDS, box, mesh_of

from microslip.results.skin_triangles import outer_triangles


def volume(points, triangles):
    """Return the volume enclosed by triangles, by the divergence theorem."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return np.einsum("ni,ni->", a, np.cross(b, c)) / 6.0


@pytest.mark.parametrize("kind", KINDS)
def test_skin_of_a_box_is_closed_and_encloses_it(kind):
    mesh = mesh_of(("a", kind, *box(kind, n=(2, 2, 2), size=(1.0, 2.0, 3.0))))
    triangles = outer_triangles(mesh, 10_000)
    assert volume(mesh.points[triangles.nodes], triangles.triangles) == pytest.approx(6.0)
    assert triangles.n_outer == len(triangles.nodes) == 26
    sides = np.concatenate([triangles.triangles[:, [i, j]] for i, j in ((0, 1), (1, 2), (2, 0))])
    assert len(np.unique(sides, axis=0)) == len(sides)  # each side once in each direction: closed
    assert np.array_equal(np.unique(sides, axis=0), np.unique(sides[:, ::-1], axis=0))


def test_a_coarser_skin_preserves_bodies_and_shape():
    mesh = mesh_of(
        ("a", "hex8", *box("hex8", (20, 20, 2), (1.0, 1.0, 0.1))),
        ("b", "hex8", *box("hex8", (20, 20, 2), (1.0, 1.0, 0.1), (0, 0, 1.0))),
    )
    triangles = outer_triangles(mesh, 300)
    assert 150 < len(triangles.nodes) <= 300 and triangles.n_outer > 1000
    assert set(triangles.body) == {0, 1} and triangles.names == ("a", "b") and len(triangles.edges) == 0
    assert np.ptp(mesh.points[triangles.nodes], axis=0) == pytest.approx([1.0, 1.0, 1.1], abs=0.12)
    assert triangles.triangles.max() < len(triangles.nodes) and (np.diff(np.sort(triangles.triangles, axis=1), axis=1) > 0).all()
