"""Stress, stress stiffness, thermal and pressure forces of every element kind against exact integrals."""

import numpy as np
import pytest
import small_fe
from box_meshes import KINDS, box

from microslip import elements
from microslip.elements import Solids

YOUNG, POISSON = 2.0e11, 0.3
STEEL = elements.Isotropic(YOUNG, POISSON, expansion=1e-5)
TEMPERATURE_RISE = 20.0  # K


def bent_box(kind):
    points, nodes = box(kind, (1, 1, 2), (1.0, 1.5, 4.0))
    return points @ skewed(), nodes


def skewed():
    """Return an affine map: edges remain straight and faces parallel, so that linear fields are integrated exactly."""
    return np.array([[1.0, 0.2, 0.1], [0.0, 0.9, -0.2], [0.3, 0.0, 1.1]])


def hooke(H, free_strain=0.0):
    lam, mu = STEEL.lam, STEEL.mu
    strain = 0.5 * (H + H.T) - free_strain * np.eye(3)
    return lam * np.trace(strain) * np.eye(3) + 2.0 * mu * strain


@pytest.mark.parametrize("kind", KINDS)
def test_stress_of_a_linear_motion_is_that_of_hooke(kind):
    points, nodes = bent_box(kind)
    H = 1e-3 * np.random.default_rng(1).standard_normal((3, 3))
    u = points[nodes] @ H.T
    computed = elements.stress(Solids(kind, points[nodes], STEEL, temperature_rise=TEMPERATURE_RISE), u)
    assert computed == pytest.approx(
        np.broadcast_to(hooke(H, STEEL.expansion * TEMPERATURE_RISE), computed.shape), abs=1e-9 * np.abs(computed).max()
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_body_free_to_expand_has_no_stress_and_its_forces_are_in_balance(kind):
    points, nodes = bent_box(kind)
    strain = STEEL.expansion * TEMPERATURE_RISE
    K, _ = small_fe.assemble(kind, points, nodes, YOUNG, POISSON, 1.0)
    forces = np.zeros_like(points)
    np.add.at(forces, nodes, elements.thermal_forces(Solids(kind, points[nodes], STEEL, temperature_rise=TEMPERATURE_RISE)))
    u = strain * points
    assert K @ u.ravel() == pytest.approx(forces.ravel(), abs=1e-9 * np.abs(forces).max())
    stress = elements.stress(Solids(kind, points[nodes], STEEL, temperature_rise=TEMPERATURE_RISE), u[nodes])
    assert np.abs(stress).max() < 1e-9 * YOUNG * strain
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()


EXACT = ("tet10", "hex8", "hex20", "wedge15", "pyramid13")  # contain all quadratic motions; hex8 by its incompatible modes


@pytest.mark.parametrize("kind", EXACT)
@pytest.mark.parametrize("is_large", [False, True])
def test_a_linear_temperature_causes_no_stress(kind, is_large):
    """For theta = g . x the motion u = alpha ((g . x) x - g |x|^2 / 2) has the strain alpha theta 1."""
    points, nodes = bent_box(kind)
    g = np.array([3.0, -2.0, 5.0])
    theta = points @ g
    u = STEEL.expansion * (theta[:, None] * points - 0.5 * g * (points**2).sum(axis=1)[:, None])
    heated, forces = Solids(kind, points[nodes], STEEL, temperature_rise=theta[nodes]), np.zeros_like(points)
    np.add.at(forces, nodes, elements.thermal_forces(heated))
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()
    stress = elements.stress(heated, u[nodes])
    assert np.abs(stress).max() < 1e-9 * YOUNG * STEEL.expansion * np.abs(theta).max()
    if is_large:  # the remainder is quadratic in the small strains
        f, _ = elements.large_displacements(heated, u[nodes])
        f_fixed, _ = elements.large_displacements(heated, 0.0 * u[nodes])
        assert np.abs(f).max() < 1e-2 * np.abs(f_fixed).max()
    else:
        K, _ = small_fe.assemble(kind, points, nodes, YOUNG, POISSON, 1.0)
        assert K @ u.ravel() == pytest.approx(forces.ravel(), abs=1e-9 * np.abs(forces).max())


@pytest.mark.parametrize("kind", KINDS)
def test_equal_temperatures_at_all_nodes_equal_that_of_the_body(kind):
    points, nodes = bent_box(kind)
    u, heated = 1e-3 * np.random.default_rng(7).standard_normal(points[nodes].shape), np.full(nodes.shape, TEMPERATURE_RISE)
    for function, arguments in ((elements.stress, (u,)), (elements.thermal_forces, ())):
        uniform, by_node = (
            function(Solids(kind, points[nodes], STEEL, temperature_rise=temperature_rise), *arguments)
            for temperature_rise in (TEMPERATURE_RISE, heated)
        )
        assert by_node == pytest.approx(uniform, abs=1e-9 * np.abs(uniform).max())


@pytest.mark.parametrize("kind", KINDS)
def test_energy_of_the_stress_stiffness_is_that_of_a_linear_motion(kind):
    """u K_sigma u = V tr(H S H^T) for u = H x under a constant stress S."""
    points, nodes = bent_box(kind)
    rng = np.random.default_rng(2)
    S, H = rng.standard_normal((2, 3, 3))
    S = S + S.T
    n_q = elements.stress(Solids(kind, points[nodes], STEEL), np.zeros_like(points[nodes])).shape[1]
    K = elements.stress_stiffness(Solids(kind, points[nodes], STEEL), np.broadcast_to(S, (len(nodes), n_q, 3, 3)))
    assert pytest.approx(K.swapaxes(1, 2)) == K
    u = points[nodes] @ H.T
    volume = 1.0 * 1.5 * 4.0 * abs(np.linalg.det(skewed()))
    assert np.einsum("eai,eab,ebi->", u, K, u) == pytest.approx(volume * np.trace(H @ S @ H.T), rel=1e-10)
    assert np.abs(K.sum(axis=2)).max() < 1e-10 * np.abs(K).max()  # a translation has no force


@pytest.mark.parametrize("kind", KINDS)
def test_a_finite_rotation_rotates_the_stiffness(kind):
    """At u = (Q - 1) x, v^T K_F v is the energy of the motion rotated back, Q^T v."""
    points, nodes = bent_box(kind)
    rng = np.random.default_rng(3)
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    Q *= np.linalg.det(Q)
    K = elements.stiffness(Solids(kind, points[nodes], STEEL))
    turned = elements.deformed_stiffness(Solids(kind, points[nodes], STEEL), points[nodes] @ (Q - np.eye(3)).T)
    v = rng.standard_normal(points[nodes].shape)
    energy = np.einsum("em,emn,en->e", v.reshape(len(v), -1), turned, v.reshape(len(v), -1))
    back = (v @ Q).reshape(len(v), -1)
    assert energy == pytest.approx(np.einsum("em,emn,en->e", back, K, back), rel=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_energy_about_a_deformed_shape_is_that_of_a_linear_motion(kind):
    """With u = H x and v = G x the strain is sym((1 + H)^T G) everywhere; K_F is symmetric, and equals K for u = 0."""
    points, nodes = bent_box(kind)
    H, G = 0.3 * np.random.default_rng(4).standard_normal((2, 3, 3))
    K = elements.deformed_stiffness(Solids(kind, points[nodes], STEEL), points[nodes] @ H.T)
    assert pytest.approx(K.swapaxes(1, 2), abs=1e-10 * np.abs(K).max()) == K
    v = (points[nodes] @ G.T).reshape(len(nodes), -1)
    strain = (np.eye(3) + H).T @ G
    volume = 1.0 * 1.5 * 4.0 * abs(np.linalg.det(skewed()))
    energy = volume * np.sum(hooke(strain) * 0.5 * (strain + strain.T))
    assert np.einsum("em,emn,en->", v, K, v) == pytest.approx(energy, rel=1e-9)
    at_rest = elements.deformed_stiffness(Solids(kind, points[nodes], STEEL), np.zeros_like(points[nodes]))
    assert at_rest == pytest.approx(elements.stiffness(Solids(kind, points[nodes], STEEL)), abs=1e-10 * np.abs(at_rest).max())


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad4", "quad8"])
def test_a_pressure_has_its_resultant_against_the_outward_normal_at_the_centroid(kind):
    corners = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]])[: 3 if "tri" in kind else 4]
    middle = 0.5 * (corners + np.roll(corners, -1, axis=0))
    points = np.concatenate([corners, middle])[None, : int(kind[-1])]
    forces = elements.pressure_forces(kind, points)[0]
    area, centre = (1.0, corners.mean(axis=0)) if "tri" in kind else (2.0, corners.mean(axis=0))
    assert forces.sum(axis=0) == pytest.approx([0.0, 0.0, -area])
    assert np.cross(points[0], forces).sum(axis=0) == pytest.approx(np.cross(centre, [0.0, 0.0, -area]))


@pytest.mark.parametrize("kind", KINDS)
def test_forces_of_large_displacements_are_those_of_their_stress(kind):
    """f . v = V tr((F S)^T H) for v = H x under a constant F, S = lam tr(E) 1 + 2 mu E; a rotation causes no forces."""
    points, nodes = bent_box(kind)
    rng = np.random.default_rng(5)
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    Q *= np.linalg.det(Q)
    F = Q @ (np.eye(3) + 0.05 * rng.standard_normal((3, 3)))
    lam, mu = STEEL.lam, STEEL.mu
    E = 0.5 * (F.T @ F - np.eye(3))
    S = lam * np.trace(E) * np.eye(3) + 2.0 * mu * E
    H = rng.standard_normal((3, 3))
    f, K = elements.large_displacements(Solids(kind, points[nodes], STEEL), points[nodes] @ (F - np.eye(3)).T)
    volume = 1.0 * 1.5 * 4.0 * abs(np.linalg.det(skewed()))
    assert (f * (points[nodes] @ H.T)).sum() == pytest.approx(volume * np.trace((F @ S).T @ H), rel=1e-9)
    assert pytest.approx(K.swapaxes(1, 2), abs=1e-9 * np.abs(K).max()) == K
    turned, _ = elements.large_displacements(Solids(kind, points[nodes], STEEL), points[nodes] @ (Q - np.eye(3)).T)
    assert np.abs(turned).max() < 1e-12 * np.abs(K).max()


@pytest.mark.parametrize("kind", KINDS)
def test_the_tangent_is_the_derivative_of_the_forces(kind):
    points, nodes = bent_box(kind)
    rng = np.random.default_rng(6)
    u, v = 0.05 * rng.standard_normal((2, *points[nodes].shape))
    of = Solids(kind, points[nodes], STEEL, temperature_rise=100.0)
    _, K = elements.large_displacements(of, u)
    h = 1e-5
    ahead, behind = (elements.large_displacements(of, u + sign * h * v)[0] for sign in (1.0, -1.0))
    slope = (K @ v.reshape(len(v), -1, 1)).reshape(v.shape)
    assert (ahead - behind) / (2.0 * h) == pytest.approx(slope, abs=1e-7 * np.abs(slope).max())
