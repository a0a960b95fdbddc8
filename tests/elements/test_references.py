"""Matrices and frequencies of other programs, each with its quadrature.

Sources: Ansys, see tests/data/README.md; NAFEMS FV52 (a simply supported thick plate, Selected Benchmarks for Natural
Frequency Analysis, 1987) on its 4 x 4 x 1 mesh as CalculiX solves it; CalculiX' own test decks beam8f, beamf and
dloadlin20f, meshes regenerated from their dimensions (mm, N, t); and CalculiX 2.20 on the bar of
tests/verification/calculix.py, which runs that comparison.
"""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from box_meshes import box
from small_fe import assemble, bent, dofs, frequencies

ANSYS = (16.9e6, 0.31, 4.1408e-4)


@pytest.fixture(scope="module")
def ansys():
    with np.load(Path(__file__).parents[1] / "data" / "ansys_hex_beam.npz") as data:
        return dict(data)


def symmetric(data, name, n):
    upper = sp.csr_matrix((data[f"{name}_data"], data[f"{name}_indices"], data[f"{name}_indptr"]), (n, n))
    return upper + sp.triu(upper, 1).T


def test_every_entry_of_stiffness_and_mass_equals_ansys(ansys):
    K, M = assemble("hex20", ansys["points"], ansys["elements"].astype(int), *ANSYS, "reduced")
    rows = ansys["rows"]
    K_ansys, M_ansys = symmetric(ansys, "K", 900), sp.kron(symmetric(ansys, "M", 300), sp.eye(3))
    assert abs(K[rows][:, rows] - K_ansys).max() < 1e-12 * abs(K_ansys).max()
    assert abs(M[rows][:, rows] - M_ansys).max() < 5e-12 * abs(M_ansys).max()


@pytest.mark.parametrize(
    "integration, clamped, tolerance",
    [
        ("reduced", [1283.20036921, 1283.20036921, 5781.97486169, 6919.39887714, 6919.39887714, 10172.61497694], 1e-11),
        ("full", [1284.975, 1284.975, 5807.23, 6929.48, 6929.48, 10177.09], 1e-6),
    ],
)
def test_frequencies_of_a_clamped_beam_equal_ansys(ansys, integration, clamped, tolerance):
    K, M = assemble("hex20", ansys["points"], ansys["elements"].astype(int), *ANSYS, integration)
    computed = frequencies(K, M, dofs(ansys["points"][:, 2] == 0.0), 6)
    assert computed == pytest.approx(clamped, rel=tolerance)


def test_frequencies_of_a_free_beam_equal_ansys(ansys):
    K, M = assemble("hex20", ansys["points"], ansys["elements"].astype(int), *ANSYS, "reduced")
    computed = frequencies(K, M, [], 6, n_rigid=6)
    free = [7366.49503969, 7366.49503969, 11504.89523664, 17285.70459456, 17285.70459456, 20137.19299035]
    assert computed == pytest.approx(free, rel=1e-10)


def test_frequencies_of_the_thick_plate_fv52_equal_nafems():
    """10 x 10 x 1 m; w = 0 along the bottom edges, free in the plane."""
    points, nodes = box("hex20", (4, 4, 1), (10.0, 10.0, 1.0))
    at_edge = (points[:, 2] == 0.0) & ((points[:, :2] == 0.0) | (points[:, :2] == 10.0)).any(axis=1)
    computed = frequencies(*assemble("hex20", points, nodes, 200e9, 0.3, 8000.0), dofs(at_edge, "z"), 7, n_rigid=3)
    expected = [44.7963, 110.5427, 110.5427, 169.0955, 193.9247, 206.6378, 206.6378]
    assert computed == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize(
    "kind, integration, cells, size, clamped_axis, young, density, expected",
    [
        (
            "hex8",
            "full",
            (4, 4, 16),
            (1.0, 1.5, 8.0),
            2,
            210e3,
            7.8e-9,  # beam8f: C3D8
            [13798.13, 19852.05, 81356.76, 88787.12, 109446.1, 163403.6, 211154.3],
        ),
        (
            "hex20",
            "reduced-both",
            (2, 2, 8),
            (1.0, 1.5, 8.0),
            2,
            210e3,
            7.8e-9,  # beamf: C3D20R
            [13096.03, 19319.52, 76839.71, 86955.23, 105963.6, 162998.5, 197645.0],
        ),
        (
            "hex20",
            "full",
            (15, 1, 1),
            (300.0, 30.0, 1.0),
            0,
            209e3,
            7.85e-9,  # dloadlin20f: C3D20
            [9.482967, 59.57710, 168.5564, 183.5669, 277.7554, 336.6766, 554.0336],
        ),
    ],
)
def test_frequencies_of_beams_of_its_test_set_equal_calculix(
    kind, integration, cells, size, clamped_axis, young, density, expected
):
    points, nodes = box(kind, cells, size)
    K, M = assemble(kind, points, nodes, young, 0.3, density, integration, incompatible_modes=False)
    computed = frequencies(K, M, dofs(points[:, clamped_axis] == 0.0), len(expected))
    # dloadlin20f: the first frequency of this very thin plate differs by 7e-6 to 9e-6 from CalculiX; rounding changes
    # it by some 2e-6 (9.48304 and 9.48306 in two runs); all others agree to seven digits.
    assert computed[0] == pytest.approx(expected[0], rel=2e-5 if size[0] == 300.0 else 3e-7)
    assert computed[1:] == pytest.approx(expected[1:], rel=3e-7)


@pytest.mark.parametrize(
    "kind, integration, expected",
    [
        ("hex8", "full", [71.70729, 92.76236, 247.1821, 328.8789, 383.7459, 389.2037]),  # C3D8
        ("hex20", "full", [58.23373, 82.68278, 227.1654, 251.1924, 318.9250, 374.9176]),  # C3D20
        ("hex20", "reduced-both", [57.93813, 82.30199, 225.8158, 249.4178, 317.5295, 374.0730]),  # C3D20R
        ("tet4", "reduced-both", [99.69866, 122.5547, 370.8912, 431.9456, 457.2480, 516.1528]),  # C3D4
        ("tet10", "reduced-both", [58.50963, 82.97337, 231.0202, 254.1173, 321.3827, 375.4241]),  # C3D10
        ("wedge6", "reduced-both", [67.28984, 87.13971, 249.8312, 318.4347, 373.2833, 388.0537]),  # C3D6
        ("wedge15", "reduced-both", [58.31414, 82.75722, 229.2993, 251.4401, 318.8106, 374.9191]),  # C3D15
    ],
)
def test_frequencies_of_a_curved_bar_of_every_kind_equal_calculix(kind, integration, expected):
    points, nodes = box(kind, (2, 2, 4), (1.0, 1.5, 4.0))
    points = bent(points)
    K, M = assemble(kind, points, nodes, 2.1e11, 0.3, 7800.0, integration, incompatible_modes=False)
    assert frequencies(K, M, dofs(points[:, 2] == 0.0), 6) == pytest.approx(expected, rel=3e-7)
    if kind == "tet10":  # difference of the exact mass of "full" from the 4 points of CalculiX
        K, M = assemble(kind, points, nodes, 2.1e11, 0.3, 7800.0)
        assert frequencies(K, M, dofs(points[:, 2] == 0.0), 6) == pytest.approx(expected, rel=6e-4)


def test_tip_displacement_of_c3d8i_equals_calculix():
    """Cuboids with incompatible modes under (1, 2, 3) MN at a corner of the tip."""
    points, nodes = box("hex8", (2, 2, 4), (1.0, 1.5, 4.0))
    K, _ = assemble("hex8", points, nodes, 2.1e11, 0.3, 7800.0)
    tip = int(np.flatnonzero((points == [1.0, 1.5, 4.0]).all(axis=1))[0])
    free = np.setdiff1d(np.arange(K.shape[0]), dofs(points[:, 2] == 0.0))
    force, u = np.zeros(K.shape[0]), np.zeros(K.shape[0])
    force[3 * tip : 3 * tip + 3] = [1e6, 2e6, 3e6]
    u[free] = np.linalg.solve(K[free][:, free].toarray(), force[free])
    assert u[3 * tip : 3 * tip + 3] == pytest.approx([3.062439e-4, 5.134145e-4, -3.599535e-6], rel=3e-7)
