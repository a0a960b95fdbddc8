"""Anisotropic materials: patch tests against the rotated compliance, free expansion, a tube, waves in a bar."""

import numpy as np
import pytest
import scipy.sparse.linalg as sla
from box_meshes import KINDS, box
from small_fe import assemble_of

from microslip import elements
from microslip.elements import Solids
from microslip.elements.materials import COMPONENTS, strain_transformation

YOUNG, POISSON, SHEAR = (1.4e11, 1.0e10, 2.0e10), (0.28, 0.31, 0.4), (5.0e9, 6.0e9, 3.5e9)
C = elements.orthotropic(YOUNG, POISSON, SHEAR)
ALPHA, TEMPERATURE_RISE, DENSITY = (-1e-6, 3e-5, 2e-5), 40.0, 1600.0
AXES = elements.Directions((1.0, 0.4, -0.3), (0.2, 1.0, 0.7))
PLY = elements.Anisotropic(tuple(map(tuple, C.tolist())), ALPHA, AXES)


def skewed_box(kind):
    """Return a skewed box of 2 x 2 x 2 elements with straight edges."""
    points, nodes = box(kind, (2, 2, 2), (1.0, 1.5, 0.8))
    return points @ np.array([[1.0, 0.2, 0.1], [0.0, 0.9, -0.2], [0.3, 0.0, 1.1]]), nodes


def tensor(C):
    """Return C as a tensor (3, 3, 3, 3)."""
    computed = np.zeros((3, 3, 3, 3))
    for row, (i, j) in enumerate(COMPONENTS):
        for column, (k, m) in enumerate(COMPONENTS):
            computed[i, j, k, m] = computed[j, i, k, m] = computed[i, j, m, k] = computed[j, i, m, k] = C[row, column]
    return computed


def exact_stress(strain):
    a = AXES.at(np.zeros(3))
    rotated = np.einsum("pi,qj,rk,sm,pqrs->ijkm", a, a, a, a, tensor(C))
    return np.einsum("ijkm,km->ij", rotated, strain)


def exact_strain(stress):
    """Return the strain of a stress by the rotated compliance of engineering constants."""
    a = AXES.at(np.zeros(3))
    in_axes = a @ stress @ a.T
    strain = np.zeros((3, 3))
    nu = {(0, 1): POISSON[0], (0, 2): POISSON[1], (1, 2): POISSON[2]}
    for i in range(3):
        strain[i, i] = in_axes[i, i] / YOUNG[i]
    for (i, j), value in nu.items():
        strain[i, i] -= value / YOUNG[i] * in_axes[j, j]
        strain[j, j] -= value / YOUNG[i] * in_axes[i, i]
        strain[i, j] = strain[j, i] = in_axes[i, j] / (2.0 * SHEAR[i + j - 1])
    return a.T @ strain @ a


def test_axes_are_right_handed_and_the_second_direction_is_in_their_plane():
    a = AXES.at(np.zeros(3))
    assert a @ a.T == pytest.approx(np.eye(3), abs=1e-15) and np.linalg.det(a) == pytest.approx(1.0)
    assert a[0] == pytest.approx(np.array(AXES.first) / np.linalg.norm(AXES.first))
    assert a[2] @ np.array(AXES.second) == pytest.approx(0.0, abs=1e-15) and a[1] @ np.array(AXES.second) > 0.0


def test_six_strains_transform_like_the_tensor():
    strain = np.random.default_rng(1).standard_normal((3, 3))
    strain = strain + strain.T
    a = AXES.at(np.zeros(3))
    six = {
        name: [e[i, j] * (1 if i == j else 2) for i, j in COMPONENTS] for name, e in (("old", strain), ("new", a @ strain @ a.T))
    }
    assert strain_transformation(a) @ six["old"] == pytest.approx(six["new"], abs=1e-14)


TENSION, SHEARED = np.diag([1e6, 0.0, 0.0]), np.array([[0.0, 1e6, 0.0], [1e6, 0.0, 0.0], [0.0, 0.0, 0.0]])  # Pa


@pytest.mark.parametrize("stress", [TENSION, SHEARED], ids=["tension", "shear"])
@pytest.mark.parametrize("kind", KINDS)
def test_tension_and_shear_give_the_motion_of_the_rotated_compliance(kind, stress):
    """Tractions sigma n on the outside and six fixed displacements give u = S sigma x and the stress sigma everywhere."""
    points, nodes = skewed_box(kind)
    K, _ = assemble_of(PLY, kind, points, nodes, DENSITY)
    f = np.zeros_like(points)
    for face_kind, face in elements.KINDS[kind].faces:  # contributions of inner faces cancel
        np.add.at(f, nodes[:, face], -elements.pressure_forces(face_kind, points[nodes[:, face]]) @ stress)
    strain = exact_strain(stress)
    exact = (points @ strain).ravel()
    fixed = np.array([0, 1, 2, *(3 * points[:, 0].argmax() + [1, 2]), 3 * points[:, 1].argmax() + 2])
    free = np.setdiff1d(np.arange(len(exact)), fixed)
    computed = exact.copy()
    computed[free] = sla.spsolve(K[free][:, free].tocsc(), f.ravel()[free] - K[free][:, fixed] @ exact[fixed])
    assert computed == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())
    sigma = elements.stress(Solids(kind, points[nodes], PLY), computed.reshape(-1, 3)[nodes])
    assert sigma == pytest.approx(np.broadcast_to(stress, sigma.shape), abs=1e-9 * np.abs(stress).max())
    assert exact_stress(strain) == pytest.approx(stress, abs=1e-10 * np.abs(stress).max())


@pytest.mark.parametrize("kind", KINDS)
def test_a_body_free_to_expand_has_no_stress(kind):
    points, nodes = skewed_box(kind)
    K, _ = assemble_of(PLY, kind, points, nodes, DENSITY)
    a = AXES.at(np.zeros(3))
    u = TEMPERATURE_RISE * points @ (a.T * ALPHA @ a)
    forces = np.zeros_like(points)
    np.add.at(forces, nodes, elements.thermal_forces(Solids(kind, points[nodes], PLY, temperature_rise=TEMPERATURE_RISE)))
    assert K @ u.ravel() == pytest.approx(forces.ravel(), abs=1e-9 * np.abs(forces).max())
    stress = elements.stress(Solids(kind, points[nodes], PLY, temperature_rise=TEMPERATURE_RISE), u[nodes])
    assert np.abs(stress).max() < 1e-9 * YOUNG[0] * ALPHA[1] * TEMPERATURE_RISE


@pytest.mark.parametrize("kind", KINDS)
def test_equal_constants_along_all_axes_are_isotropic(kind):
    """In any orientation stiffness, K_F, forces and tangent of large displacements equal those of (2.1)."""
    points, nodes = skewed_box(kind)
    steel = elements.Isotropic(2e11, 0.3, 1e-5)
    C = elements.orthotropic((2e11,) * 3, (0.3,) * 3, (steel.mu,) * 3)
    same = elements.Anisotropic(tuple(map(tuple, C.tolist())), (1e-5,) * 3, elements.Cylindrical((0.2, -1.0, 3.0)))
    u = 0.02 * np.random.default_rng(2).standard_normal(points[nodes].shape)
    for result in (
        lambda material: elements.stiffness(Solids(kind, points[nodes], material)),
        lambda material: elements.deformed_stiffness(Solids(kind, points[nodes], material), u),
        lambda material: elements.large_displacements(
            Solids(kind, points[nodes], material, temperature_rise=TEMPERATURE_RISE), u
        )[0],
        lambda material: elements.large_displacements(
            Solids(kind, points[nodes], material, temperature_rise=TEMPERATURE_RISE), u
        )[1],
        lambda material: elements.thermal_forces(Solids(kind, points[nodes], material, temperature_rise=TEMPERATURE_RISE)),
    ):
        expected = result(steel)
        assert np.abs(result(same) - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_the_tangent_is_the_derivative_of_the_forces(kind):
    points, nodes = skewed_box(kind)
    around = elements.Anisotropic(PLY.elasticity, ALPHA, elements.Cylindrical((0.0, 0.1, 1.0), (-2.0, 0.3, 0.0)))
    u, v = 0.02 * np.random.default_rng(6).standard_normal((2, *points[nodes].shape))
    _, K = elements.large_displacements(Solids(kind, points[nodes], around, temperature_rise=TEMPERATURE_RISE), u)
    h = 1e-5
    ahead, behind = (
        elements.large_displacements(Solids(kind, points[nodes], around, temperature_rise=TEMPERATURE_RISE), u + sign * h * v)[0]
        for sign in (1.0, -1.0)
    )
    slope = (K @ v.reshape(len(v), -1, 1)).reshape(v.shape)
    assert (ahead - behind) / (2.0 * h) == pytest.approx(slope, abs=1e-7 * np.abs(slope).max())


def test_a_wound_tube_has_the_motion_of_lekhnitskii():
    """Plane strain with u_r = 1 at the inner radius: u_r = A r^k + B r^-k, k^2 = C_22 / C_11; the error decreases as h^4."""
    inner, outer, k = 1.0, 2.0, np.sqrt(C[1, 1] / C[0, 0])
    A, B = np.linalg.solve([[inner**k, inner**-k], [outer**k, outer**-k]], [1.0, 0.0])
    material = elements.Anisotropic(PLY.elasticity, ALPHA, elements.Cylindrical((0.0, 0.0, 1.0)))
    errors = []
    for n in (2, 4):
        points, nodes = box("hex20", (n, n, 1), (outer - inner, 0.4, 0.1))
        r, angle = inner + points[:, 0], points[:, 1]
        points = np.column_stack([r * np.cos(angle), r * np.sin(angle), points[:, 2]])
        outward = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * r])
        across = np.column_stack([-np.sin(angle), np.cos(angle), 0.0 * r])
        K, _ = assemble_of(material, "hex20", points, nodes, DENSITY)
        Q = np.stack([outward, across, np.tile([0.0, 0.0, 1.0], (len(r), 1))], axis=1)  # cylinder axes of each node
        exact = A * r**k + B * r**-k
        inside = np.flatnonzero((r > inner + 1e-9) & (r < outer - 1e-9))
        # radial motion only, by symmetry
        turn = np.zeros((3 * len(r), len(r)))
        turn[np.arange(3 * len(r)), np.repeat(np.arange(len(r)), 3)] = Q[:, 0].ravel()
        K_r = turn.T @ (K @ turn)
        ends = np.setdiff1d(np.arange(len(r)), inside)
        computed = np.linalg.solve(K_r[np.ix_(inside, inside)], -K_r[np.ix_(inside, ends)] @ exact[ends])
        errors.append(np.abs(computed - exact[inside]).max())
    assert errors[0] < 5e-3 and errors[1] < errors[0] / 8.0


@pytest.mark.parametrize("degrees", [0.0, 25.0, 90.0])
def test_waves_along_a_bar_have_the_speed_of_its_axial_modulus(degrees):
    """Free ends, fibres rotated about z by an angle: f = sqrt(E_x / rho) / 2 L, E_x = 1 / S_xx of the rotated compliance."""
    length, side, t = 1.0, 0.01, np.deg2rad(degrees)
    c, s = np.cos(t), np.sin(t)
    E = 1.0 / (c**4 / YOUNG[0] + s**4 / YOUNG[1] + c**2 * s**2 * (1.0 / SHEAR[0] - 2.0 * POISSON[0] / YOUNG[0]))
    ply = elements.Anisotropic(PLY.elasticity, axes=elements.Directions((c, s, 0.0), (-s, c, 0.0)))
    points, nodes = box("hex20", (16, 1, 1), (length, side, side))
    K, M = assemble_of(ply, "hex20", points, nodes, DENSITY)
    expected = np.sqrt(E / DENSITY) / (2.0 * length)
    near = sla.eigsh(K.tocsc(), 3, M.tocsc(), sigma=(2.0 * np.pi * expected) ** 2, v0=np.ones(K.shape[0]))
    along = np.abs(near[1].reshape(-1, 3, 3)[:, 0]).sum(axis=0) / np.abs(near[1].reshape(-1, 3, 3)[:, 1:]).sum(axis=(0, 1))
    computed = np.sqrt(near[0][along.argmax()]) / (2.0 * np.pi)
    assert computed == pytest.approx(expected, rel=2e-4)
