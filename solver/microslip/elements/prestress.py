"""Stress in isotropic solids, what it adds to their stiffness, and the forces of warm ones (docs/theory.md, section 12)."""

from __future__ import annotations

import numpy as np

from .kinds import KINDS
from .quadrature import rules
from .solid import _chunks, _gradients, _incompatible_gradients, _isotropic


def stress(
    kind: str,
    points: np.ndarray,
    u: np.ndarray,
    young: float,
    poisson: float,
    free_strain: float = 0.0,
    integration: str = "full",
    incompatible_modes: bool = True,
) -> np.ndarray:
    """Return the stress at the quadrature points of the stiffness, (n_elements, n_q, 3, 3) [Pa].

    Local.

    Parameters
    ----------
    u : (n_elements, n, 3) displacements of the nodes [m]
    free_strain : expansion times temperature [-], which stresses nothing by itself
    others : as in :func:`microslip.elements.stiffness`

    Notes
    -----
    sigma = lam tr(eps) 1 + 2 mu eps - (3 lam + 2 mu) alpha dT 1.  The bubbles of hex8 follow from the nodes, as in its stiffness.
    """
    lam, mu = lame(young, poisson)
    rule = rules(kind, integration)[0]
    with_modes = incompatible_modes and kind == "hex8"
    found = np.empty((len(points), len(rule.weights), 3, 3))
    for chunk in _chunks(len(points), 9 * (points.shape[1] + 3) ** 2):
        dN, volumes = _gradients(KINDS[kind], points[chunk], rule)
        slopes = dN @ u[chunk][:, None]  # (n_elements, n_q, 3, 3): d u_j / d x_i
        if with_modes:
            bubbles = _incompatible_gradients(KINDS[kind], points[chunk], rule, volumes)
            slopes = slopes + bubbles @ _bubbles(dN, bubbles, volumes, u[chunk], lam, mu)[:, None]
        strain = 0.5 * (slopes + slopes.swapaxes(-1, -2))
        mean = lam * np.trace(strain, axis1=-2, axis2=-1) - (3.0 * lam + 2.0 * mu) * free_strain
        found[chunk] = 2.0 * mu * strain + mean[..., None, None] * np.eye(3)
    return found


def _bubbles(dN, bubbles, volumes, u, lam: float, mu: float) -> np.ndarray:
    """Return the amplitudes (n_elements, 3, 3) of the incompatible modes under nodal displacements: no force acts on them."""
    K = _isotropic(np.concatenate([dN, bubbles], axis=-1), volumes, lam, mu)
    n = 3 * dN.shape[-1]
    right = -K[:, n:, :n] @ u.reshape(len(u), n, 1)
    return np.linalg.solve(K[:, n:, n:], right).reshape(len(u), 3, 3)


def stress_stiffness(kind: str, points: np.ndarray, stress: np.ndarray, integration: str = "full") -> np.ndarray:
    """Return what a stress (n_elements, n_q, 3, 3) [Pa] adds to the stiffness, (n_elements, n, n) [N/m].

    Local.  docs/theory.md, eq. (12.5): entry a, b couples u_x of a and b, u_y, u_z alike.  ``stress`` is that of :func:`stress`.
    """
    rule = rules(kind, integration)[0]
    found = np.empty((len(points), points.shape[1], points.shape[1]))
    for chunk in _chunks(len(points), 9 * points.shape[1] ** 2):
        dN, volumes = _gradients(KINDS[kind], points[chunk], rule)
        weighted = (stress[chunk] * volumes[..., None, None]) @ dN
        found[chunk] = (dN.swapaxes(-1, -2) @ weighted).sum(axis=1)
    return found


def thermal_forces(
    kind: str, points: np.ndarray, young: float, poisson: float, free_strain: float, integration: str = "full"
) -> np.ndarray:
    """Return the nodal forces of elements that are held while they are warm, turned round, (n_elements, n, 3) [N].

    Local.  docs/theory.md, eq. (12.2).
    """
    lam, mu = lame(young, poisson)
    rule = rules(kind, integration)[0]
    found = np.empty(points.shape)
    for chunk in _chunks(len(points), 9 * points.shape[1] ** 2):
        dN, volumes = _gradients(KINDS[kind], points[chunk], rule)
        found[chunk] = np.einsum("eq,eqia->eai", volumes, dN)
    return (3.0 * lam + 2.0 * mu) * free_strain * found


def lame(young: float, poisson: float) -> tuple[float, float]:
    """Return Lame's constants lambda and mu [Pa]."""
    return young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)), young / (2.0 * (1.0 + poisson))
