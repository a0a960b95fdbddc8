"""Stress and strain at nodes are exact for displacement fields that the element contains."""

import numpy as np
import pytest
from box_meshes import KINDS, box

from microslip import elements
from microslip.elements import Solids
from microslip.elements.recovery import fit

YOUNG, POISSON = 2.1e11, 0.3
STEEL = elements.Isotropic(YOUNG, POISSON)
LAM, MU = STEEL.lam, STEEL.mu


def hooke(strain):
    return LAM * np.trace(strain, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) + 2.0 * MU * strain


def distorted(kind):
    """Return the nodes of a skewed element of a box, with straight edges."""
    points, nodes = box(kind, (1, 1, 1), (1.0, 1.4, 0.8))
    skew = np.array([[1.0, 0.2, -0.1], [0.1, 1.1, 0.3], [-0.2, 0.1, 0.9]])
    return points[nodes[0]] @ skew.T


def applied(rows, u):
    """Return the stress (n, 3, 3) at the nodes under displacements (n, 3)."""
    return np.einsum("aijbk,bk->aij", rows, u)


@pytest.mark.parametrize("integration", elements.INTEGRATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_constant_stress_is_exact(kind, integration):
    points, slope = distorted(kind), 1e-3 * np.random.default_rng(1).standard_normal((3, 3))
    rows = elements.nodal_stress(Solids(kind, points[None], STEEL, integration))
    strain = 0.5 * (slope + slope.T)
    computed = applied(rows, points @ slope.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(computed, np.broadcast_to(hooke(strain), computed.shape), atol=1e-9 * YOUNG * 1e-3)
    rows = elements.nodal_strain(Solids(kind, points[None], STEEL, integration))
    computed = applied(rows, points @ slope.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(computed, np.broadcast_to(strain, computed.shape), atol=1e-12)


@pytest.mark.parametrize("kind", ["hex20", "tet10", "wedge15"])
@pytest.mark.parametrize("integration", ["full", "reduced"])
def test_linear_stress_is_exact_in_quadratic_elements(kind, integration):
    points, bend = distorted(kind), np.random.default_rng(2).standard_normal((3, 3, 3))
    bend = bend + bend.swapaxes(1, 2)
    u = np.einsum("kij,ni,nj->nk", bend, points, points)
    slopes = 2.0 * np.einsum("kij,nj->nki", bend, points)
    exact = hooke(0.5 * (slopes + slopes.swapaxes(1, 2)))
    computed = applied(elements.nodal_stress(Solids(kind, points[None], STEEL, integration)), u)
    np.testing.assert_allclose(computed, exact, atol=1e-10 * np.abs(exact).max())


def test_incompatible_modes_of_hex8_give_exact_bending_stress():
    """Pure bending of a brick has sigma_xx = E y and all else 0; without incompatible modes the stress is wrong."""
    points, nodes = box("hex8", (1, 1, 1), (1.0, 0.5, 0.25), (0.0, -0.25, -0.125))
    x, y, z = points[nodes[0]].T
    u = np.column_stack([x * y, -0.5 * (x**2 + POISSON * (y**2 - z**2)), -POISSON * y * z])
    computed = applied(elements.nodal_stress(Solids("hex8", points[nodes[:1]], STEEL)), u)
    exact = np.zeros((8, 3, 3))
    exact[:, 0, 0] = YOUNG * y
    np.testing.assert_allclose(computed, exact, atol=1e-10 * YOUNG)
    without = applied(elements.nodal_stress(Solids("hex8", points[nodes[:1]], STEEL, incompatible_modes=False)), u)
    assert np.abs(without - exact).max() > 0.1 * YOUNG * 0.25


@pytest.mark.parametrize("kind", KINDS)
def test_the_weights_of_the_fit_add_up_to_one(kind):
    for integration in elements.INTEGRATIONS:
        np.testing.assert_allclose(fit(kind, integration).sum(axis=1), 1.0, atol=1e-12)
