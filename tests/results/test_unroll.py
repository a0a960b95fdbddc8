"""Contact surfaces unrolled to a plane: lengths and areas are preserved, cells cover the faces once, patches are separated."""

import numpy as np
import pytest
from synthetic_results import pairs_of, two_flanks

from microslip.results.record import joint_of
from microslip.results.unroll import patches

FACES = {  # nodes of one face of unit side, VTK order
    "quad4": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "quad8": [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5)],
    "tri3": [(0, 0), (1, 0), (0, 1)],
    "tri6": [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)],
}


def area(polygon):
    x, y = polygon.T
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


def frames(normal):
    """Return right-handed frames of normals (n, 3)."""
    side = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x = np.cross(side, normal)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def joint(points, normal, faces, names=None):
    n = len(points)
    return joint_of(pairs_of(points, frames(normal), np.ones(n), names or ("joint",) * n, faces))


def rotation():
    return np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


@pytest.mark.parametrize("kind", FACES)
def test_cells_of_a_face_cover_it_once(kind):
    flat = np.array([(x, y, 0.0) for x, y in FACES[kind]]) @ rotation().T
    normal = np.tile(rotation() @ [0.0, 0.0, 1.0], (len(flat), 1))
    (patch,) = patches(joint(flat, normal, (np.arange(len(flat))[None],)))
    total = 0.5 if kind.startswith("tri") else 1.0
    assert abs(area(patch.outlines[0])) == pytest.approx(total)
    areas = [area(cell) for cell in patch.cells]
    assert np.abs(areas).sum() == pytest.approx(total) and abs(np.sum(areas)) == pytest.approx(total)
    assert sorted(patch.cell_pair) == list(range(len(flat)))
    for cell, pair in zip(patch.cells, patch.cell_pair):
        assert cell[0] == pytest.approx(patch.points[pair])


def test_distances_on_a_plane_are_preserved_and_viewed_from_body_1():
    grid = np.stack(np.meshgrid(np.linspace(0, 3, 7), np.linspace(0, 1, 3), indexing="ij"), axis=-1).reshape(-1, 2)
    turn = rotation()
    points = np.column_stack([grid, np.zeros(len(grid))]) @ turn.T
    (patch,) = patches(joint(points, np.tile(turn[:, 2], (len(grid), 1)), ()))
    for i in (0, 5, 11):
        assert np.linalg.norm(patch.points - patch.points[i], axis=1) == pytest.approx(np.linalg.norm(grid - grid[i], axis=1))
    assert np.ptp(patch.points, axis=0) == pytest.approx([3.0, 1.0])  # the longer side along x
    # x cross y points along the normal, towards the viewer
    a, b = patch.points[20] - patch.points[0], patch.points[2] - patch.points[0]
    side = np.cross(points[20] - points[0], points[2] - points[0]) @ turn[:, 2]
    assert np.sign(a[0] * b[1] - a[1] * b[0]) == np.sign(side)


@pytest.mark.parametrize("n_around, reach", [(24, 2.0 * np.pi), (16, 1.2 * np.pi)])
def test_a_cylinder_is_unrolled(n_around, reach):
    radius, length, is_closed = 0.005, 0.02, reach > 6.28
    angle = np.arange(n_around) * reach / (n_around if is_closed else n_around - 1) + 0.4
    T, Z = (a.ravel() for a in np.meshgrid(angle, np.linspace(0.0, length, 5), indexing="ij"))
    normal = np.column_stack([np.cos(T), np.sin(T), 0 * T])
    points = radius * normal + np.column_stack([0 * T, 0 * T, Z]) + [0.3, -0.2, 0.1]
    n_strips = n_around if is_closed else n_around - 1
    faces = np.array(
        [
            [i * 5 + j, (i + 1) % n_around * 5 + j, (i + 1) % n_around * 5 + j + 1, i * 5 + j + 1]
            for i in range(n_strips)
            for j in range(4)
        ]
    )
    turn = rotation()
    (patch,) = patches(joint(points @ turn.T, normal @ turn.T, (faces,)))
    assert patch.size == pytest.approx([reach * radius, length])
    assert np.abs([area(ring) for ring in patch.outlines]).sum() == pytest.approx(reach * radius * length)


def test_flanks_are_separate_patches_with_their_position_in_the_label():
    surfaces = patches(joint_of(two_flanks(6, 2)))
    assert [len(patch.pairs) for patch in surfaces] == [len(two_flanks(6, 2).mu) // 2] * 2
    x = [1e3 * two_flanks(6, 2).position[patch.pairs, 0].mean() for patch in surfaces]
    assert [patch.label for patch in surfaces] == [f"dovetail at x = \u2212{-x[0]:.1f} mm", f"dovetail at x = {x[1]:.1f} mm"]
    assert {patch.x_label for patch in surfaces} == {"y"}
    # the flank is a strip 66 mm by 9 mm on a cone: the plane shortens it by less than 1 %
    faces = np.abs([area(ring) for ring in surfaces[0].outlines]).sum()
    assert faces == pytest.approx(0.066 * 0.009, rel=0.02)


def test_patches_in_a_ring_have_distinct_labels():
    angle = np.arange(8) * np.pi / 4.0
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
    corners = np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01], [0.0, 0.01]])
    across = np.cross([0.0, 0.0, 1.0], radial)
    points = 0.2 * radial[:, None] + corners[:, :1] * across[:, None] + corners[:, 1:] * [0.0, 0.0, 1.0]
    points -= points.mean(axis=1, keepdims=True) - 0.2 * radial[:, None]
    faces = (np.arange(32).reshape(8, 4),)
    labels = [patch.label for patch in patches(joint(points.reshape(-1, 3), np.repeat(radial, 4, axis=0), faces))]
    assert labels[:3] == ["joint at x = 200, y = 0 mm", "joint at x = 141, y = 141 mm", "joint at x = 0, y = 200 mm"]
    assert len(set(labels)) == 8 and not any("e" in label for label in labels)


def test_patches_of_several_sectors_are_named_by_their_position_in_sector_0():
    one = two_flanks(6, 2)
    n, turn = one.n_pairs, np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    position = np.concatenate([one.position, one.position @ turn.T])
    frame = np.concatenate([one.frame, one.frame @ turn.T])
    (faces,) = one.faces
    both = pairs_of(position, frame, np.tile(one.area, 2), one.joint * 2, (np.concatenate([faces, faces + n]),))
    of_sector = [patch.label for patch in patches(joint_of(one))]
    labels = [patch.label for patch in patches(joint_of(both), 2)]
    assert labels == [f"{label}, sector {sector}" for sector in (0, 1) for label in of_sector]


def test_joints_are_separate_patches_even_without_faces():
    surfaces = patches(joint_of(two_flanks(4, 1, names=("left", "right"))))
    assert [patch.label for patch in surfaces] == ["left", "right"]
    points = np.random.default_rng(0).normal(size=(6, 3)) * [1, 1, 0]
    surfaces = patches(joint(points, np.tile([0.0, 0.0, 1.0], (6, 1)), (), ("a",) * 2 + ("b",) * 4))
    assert [(patch.label, list(patch.pairs)) for patch in surfaces] == [("a", [0, 1]), ("b", [2, 3, 4, 5])]


def test_pairs_without_a_position_are_placed_by_number():
    nowhere = np.full((10, 3), np.nan)
    (patch,) = patches(joint(nowhere, np.tile([0.0, 0.0, 1.0], (10, 1)), ()))
    assert not patch.to_scale and len(np.unique(patch.points, axis=0)) == 10
    assert patch.points[1, 0] > patch.points[0, 0]


def test_one_pair_and_no_pair():
    (patch,) = patches(joint(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), ()))
    assert len(patch.points) == 1 and (patch.size > 0.0).all()
    assert patches(joint(np.zeros((0, 3)), np.zeros((0, 3)), ())) == []


def test_few_pairs_without_positions_form_a_row():
    nowhere = np.full((3, 3), np.nan)
    (patch,) = patches(joint(nowhere, np.tile([0.0, 0.0, 1.0], (3, 1)), ()))
    assert patch.size == pytest.approx([20.0, 1.0])
