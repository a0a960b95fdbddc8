"""Stiffness and mass against mechanics: rigid motion, patch test, inertia, rotation, bending."""

import numpy as np
import pytest
from box_meshes import EDGES, KINDS, add_mid_sides, box
from small_fe import assemble, bent, dofs

from microslip import elements
from microslip.elements import Solids, solid

YOUNG, POISSON, DENSITY = 2.0e11, 0.3, 7800.0
STEEL = elements.Isotropic(YOUNG, POISSON)
MASS_RANK = {
    "hex8": 8,
    "hex20": 8,
    "tet4": 1,
    "tet10": 4,
    "wedge6": 2,
    "wedge15": 9,
    "pyramid5": 5,
    "pyramid13": 13,
}  # with the integration points of K
WITH_MODES = [(kind, True) for kind in KINDS] + [("hex8", False)]  # kind, incompatible_modes: only hex8 has them


def distorted(kind):
    """Return the nodes (1, n, 3) of an element with curved edges, some 0.1 m in size."""
    nodes = elements.KINDS[kind].nodes
    return 0.1 * (nodes + 0.06 * np.random.default_rng(3).uniform(-1.0, 1.0, nodes.shape))[None]


def rigid_motions(points):
    """Return (3 n_points, 6): three translations, three rotations."""
    turns = [np.cross(axis, points) for axis in np.eye(3)]
    shifts = [np.tile(axis, (len(points), 1)) for axis in np.eye(3)]
    return np.stack([motion.ravel() for motion in shifts + turns], axis=1)


def rotation():
    Q = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    return Q * np.linalg.det(Q)


@pytest.mark.parametrize("integration", elements.INTEGRATIONS)
@pytest.mark.parametrize("kind, incompatible_modes", WITH_MODES)
def test_stiffness_is_symmetric_and_only_rigid_motion_is_free(kind, integration, incompatible_modes):
    points = distorted(kind)
    K = elements.stiffness(Solids(kind, points, STEEL, integration, incompatible_modes))[0]
    scale = abs(K).max()
    assert abs(K - K.T).max() < 1e-14 * scale
    assert abs(K @ rigid_motions(points[0])).max() < 1e-13 * scale
    # hex20 by 2x2x2 has 8 points with 6 strains: six mechanisms of a single element, but none of a mesh.
    # wedge6 by two points has one mechanism of a single element, but none of two elements.
    rank = {("hex20", "reduced"): 48, ("hex20", "reduced-both"): 48, ("wedge6", "reduced-both"): 11}.get(
        (kind, integration), len(K) - 6
    )
    values = np.linalg.eigvalsh(K) / scale
    assert abs(values[: len(K) - rank]).max() < 1e-12
    assert values[len(K) - rank] > 1e-4


@pytest.mark.parametrize("kind", KINDS)
def test_mass_is_positive_definite_with_full_integration_and_else_has_the_rank_of_its_points(kind):
    points = distorted(kind)
    for integration in elements.INTEGRATIONS:
        values = np.linalg.eigvalsh(elements.mass(kind, points, DENSITY, integration)[0])
        rank = {"full": len(values), "reduced": 14 if kind == "hex20" else len(values), "reduced-both": MASS_RANK[kind]}[
            integration
        ]
        assert np.count_nonzero(values > 1e-4 * values[-1]) == rank
        assert abs(values[: len(values) - rank]).max(initial=0.0) < 1e-13 * values[-1]


@pytest.mark.parametrize("integration", elements.INTEGRATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_mass_and_its_moments_are_exact(kind, integration):
    """A straight element, the reference element scaled by 1, 2 and 3, has the exact mass, centre and second moments."""
    reference = elements.KINDS[kind].nodes * [1.0, 2.0, 3.0]
    M = elements.mass(kind, reference[None], DENSITY, integration)[0]
    shape = kind.rstrip("0123456789")
    volume = {"hex": 8.0, "tet": 1.0 / 6.0, "wedge": 1.0, "pyramid": 4.0 / 3.0}[shape] * 6.0
    centre = {
        "hex": [0.0, 0.0, 0.0],
        "tet": [0.25, 0.25, 0.25],
        "wedge": [1.0 / 3.0, 1.0 / 3.0, 0.0],
        "pyramid": [0.0, 0.0, 0.25],
    }[shape]
    centre = np.array(centre) * [1.0, 2.0, 3.0]
    squares = {"hex": [1.0 / 3.0] * 3, "tet": [0.1] * 3, "wedge": [1.0 / 6.0, 1.0 / 6.0, 1.0 / 3.0], "pyramid": [0.2, 0.2, 0.1]}[
        shape
    ]
    assert M.sum() == pytest.approx(DENSITY * volume, rel=1e-14)
    assert M.sum(axis=0) @ reference == pytest.approx(DENSITY * volume * centre, rel=1e-13, abs=1e-9)
    if kind not in ("tet4", "wedge6") or integration != "reduced-both":  # a single point has no second moment
        second = np.diag(reference.T @ M @ reference)
        assert second == pytest.approx(DENSITY * volume * np.array(squares) * [1.0, 4.0, 9.0], rel=1e-13)


@pytest.mark.parametrize("kind, incompatible_modes", WITH_MODES)
def test_stiffness_rotates_with_the_element(kind, incompatible_modes):
    points, Q = distorted(kind), rotation()
    K = elements.stiffness(Solids(kind, points, STEEL, incompatible_modes=incompatible_modes))[0]
    turned = elements.stiffness(Solids(kind, points @ Q.T, STEEL, incompatible_modes=incompatible_modes))[0]
    T = np.kron(np.eye(len(points[0])), Q)
    assert abs(turned - T @ K @ T.T).max() < 1e-13 * abs(K).max()


@pytest.mark.parametrize("integration", elements.INTEGRATIONS)
@pytest.mark.parametrize("kind, incompatible_modes", WITH_MODES)
def test_patch_of_distorted_elements_has_constant_strain(kind, integration, incompatible_modes):
    points, nodes = box(kind.replace("20", "8").replace("10", "4").replace("15", "6").replace("13", "5"))
    inside = ((points > 0.0) & (points < 1.0)).all(axis=1)
    points[inside] += [0.11, -0.07, 0.09]
    on_faces = np.count_nonzero((points > 0.0) & (points < 1.0), axis=1) == 2
    points[on_faces] += 0.08 * np.random.default_rng(2).uniform(-1.0, 1.0, (on_faces.sum(), 3))
    if kind in EDGES:
        points, nodes = add_mid_sides(points, nodes, EDGES[kind])
    K, _ = assemble(kind, points, nodes, YOUNG, POISSON, DENSITY, integration, incompatible_modes)
    gradient = 1e-3 * np.array([[1.0, 0.4, -0.3], [0.2, -0.6, 0.5], [-0.1, 0.7, 0.8]])
    exact = points @ gradient.T
    free = dofs(_is_inner(points, nodes, kind))
    u = exact.ravel().copy()
    fixed = np.setdiff1d(np.arange(len(u)), free)
    u[free] = np.linalg.solve(K[free][:, free].toarray(), -K[free][:, fixed] @ u[fixed])
    assert abs(u - exact.ravel()).max() < 1e-12 * abs(exact).max()
    strain = (gradient + gradient.T) / 2.0
    lam, mu = YOUNG * POISSON / (1.0 + POISSON) / (1.0 - 2.0 * POISSON), YOUNG / 2.0 / (1.0 + POISSON)
    stress = lam * np.trace(strain) * np.eye(3) + 2.0 * mu * strain
    volume = elements.mass(kind, points[nodes], 1.0).sum()
    assert u @ (K @ u) == pytest.approx(volume * np.sum(stress * strain), rel=1e-12)


def _is_inner(points, nodes, kind):
    """Return (n_points,) bool: the point is on no face that belongs to only one element."""
    rows = [row for _, local in elements.KINDS[kind].faces for row in nodes[:, local]]
    keys = [tuple(sorted(row)) for row in rows]
    counts = {key: keys.count(key) for key in set(keys)}
    outer = np.unique(np.concatenate([row for row, key in zip(rows, keys) if counts[key] == 1]))
    return ~np.isin(np.arange(len(points)), outer)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_blocks_of_elements_give_the_matrices_of_single_elements(kind):
    points, nodes = box(kind, (3, 3, 4), (1.0, 1.5, 4.0))
    x = bent(points)[nodes]
    K, M = elements.stiffness(Solids(kind, x, STEEL)), elements.mass(kind, x, DENSITY)
    least = elements.jacobian_minimum(kind, x)
    for i in range(0, len(x), 7):
        single = x[i : i + 1]
        assert K[i] == pytest.approx(elements.stiffness(Solids(kind, single, STEEL))[0], rel=1e-13, abs=1e-14 * K.max())
        assert M[i] == pytest.approx(elements.mass(kind, single, DENSITY)[0], rel=1e-13)
        assert least[i] == pytest.approx(elements.jacobian_minimum(kind, single)[0], rel=1e-13)


def test_chunks_give_the_same_matrices(monkeypatch):
    points, nodes = box("hex20", (2, 2, 3))
    x = points[nodes]
    unchunked = elements.stiffness(Solids("hex20", x, STEEL)), elements.mass("hex20", x, DENSITY)
    monkeypatch.setattr(solid, "_CHUNK_ENTRIES", 5 * 9 * 20**2)
    chunked = elements.stiffness(Solids("hex20", x, STEEL)), elements.mass("hex20", x, DENSITY)
    assert all(np.allclose(a, b, rtol=1e-13, atol=0.0) for a, b in zip(chunked[1:], unchunked[1:]))
    assert abs(chunked[0] - unchunked[0]).max() < 1e-14 * unchunked[0].max()
    assert elements.stiffness(Solids("hex20", x[:0], STEEL)).shape == (0, 60, 60)
    assert elements.mass("hex20", x[:0], DENSITY).shape == (0, 20, 20)
    assert elements.jacobian_minimum("hex20", x[:0]).shape == (0,)


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_minimum_is_the_volume_ratio_and_negative_for_inverted_elements(kind):
    nodes = elements.KINDS[kind].nodes
    stretched = (nodes * [1.0, 2.0, 3.0])[None]
    assert elements.jacobian_minimum(kind, stretched)[0] == pytest.approx(6.0, rel=1e-13)
    inverted = stretched * [1.0, 1.0, -1.0]
    assert elements.jacobian_minimum(kind, inverted)[0] == pytest.approx(-6.0, rel=1e-13)
    with pytest.raises(ValueError, match="1 of 1 elements have det J <= 0"):
        elements.stiffness(Solids(kind, inverted, STEEL))
    with pytest.raises(ValueError, match="1 of 1 elements have det J <= 0"):
        elements.mass(kind, inverted, DENSITY)


def test_jacobian_minimum_includes_the_nodes():
    """With a corner moved inwards det J is positive at every quadrature point and negative only at that corner."""
    points = elements.KINDS["hex8"].nodes.copy()
    points[6] = [0.1, 0.1, 0.1]
    assert elements.jacobian_minimum("hex8", points[None])[0] < 0.0
    assert elements.stiffness(Solids("hex8", points[None], STEEL)).shape == (1, 24, 24)


@pytest.mark.parametrize("incompatible_modes", [True, False])
def test_one_layer_of_hex8_bends_exactly_with_incompatible_modes_and_locks_without(incompatible_modes):
    """A bar 10 x 1 x 1 of five elements under end moments: w = M x^2 / (2 E I); nu = 0 without the modes."""
    points, nodes = box("hex8", (5, 1, 1), (10.0, 1.0, 1.0))
    poisson = 0.3 if incompatible_modes else 0.0
    K, _ = assemble("hex8", points, nodes, YOUNG, poisson, DENSITY, "full", incompatible_modes)
    force = np.zeros(len(points) * 3)
    end = points[:, 0] == 10.0
    force[dofs(end, "x")] = np.where(points[end, 2] > 0.5, 0.5, -0.5)  # moment 1 N m about y, from z = 0 to 1
    fixed = np.concatenate(
        [
            dofs(points[:, 0] == 0.0, "x"),
            dofs((points[:, 0] == 0.0) & (points[:, 2] == 0.0), "z"),
            dofs((points == 0.0).all(axis=1), "y"),
        ]
    )
    free = np.setdiff1d(np.arange(len(force)), fixed)
    w = np.zeros(len(force))
    w[free] = np.linalg.solve(K[free][:, free].toarray(), force[free])
    deflection = -w[dofs(end & (points[:, 2] == 0.0), "z")].mean()
    exact = 10.0**2 / (2.0 * YOUNG / 12.0)
    # Without the modes an element of side ratio 2 is 1 + 2^2 / 2 = 3 times too stiff (parasitic shear).
    assert deflection == pytest.approx(exact if incompatible_modes else exact / 3.0, rel=1e-9)


def test_a_mesh_of_wedges_by_two_points_has_no_mechanism():
    """A single element has a mechanism; two elements have only the six rigid motions."""
    points, nodes = box("wedge6", (1, 1, 1), (1.0, 1.5, 2.0))
    K = np.zeros((3 * len(points), 3 * len(points)))
    for element, matrix in zip(nodes, elements.stiffness(Solids("wedge6", points[nodes], STEEL, "reduced-both")), strict=True):
        at = (3 * element[:, None] + np.arange(3)).ravel()
        K[np.ix_(at, at)] += matrix
    values = np.linalg.eigvalsh(K)
    assert abs(values[:6]).max() < 1e-12 * values[-1] and values[6] > 1e-3 * values[-1]
