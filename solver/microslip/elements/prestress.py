"""Stress in isotropic solids, stiffness about a state that has it, and the forces of warm ones (docs/theory.md, section 12)."""

from __future__ import annotations

import numpy as np

from .kinds import KINDS
from .quadrature import Rule, rules
from .solid import _chunks, _condense, _gradients, _incompatible_gradients, _isotropic


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
    found = np.empty((len(points), len(rule.weights), 3, 3))
    for chunk in _chunks(len(points), 9 * (points.shape[1] + 3) ** 2):
        dN, volumes = _functions(kind, points[chunk], rule, incompatible_modes)
        slopes = dN @ _amplitudes(dN, volumes, u[chunk], lam, mu)[:, None]  # (n_elements, n_q, 3, 3): d u_j / d x_i
        strain = 0.5 * (slopes + slopes.swapaxes(-1, -2))
        mean = lam * np.trace(strain, axis1=-2, axis2=-1) - (3.0 * lam + 2.0 * mu) * free_strain
        found[chunk] = 2.0 * mu * strain + mean[..., None, None] * np.eye(3)
    return found


def _functions(kind: str, points: np.ndarray, rule: Rule, incompatible_modes: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients of shape functions and, in hex8, of the bubbles behind them, and w det J."""
    dN, volumes = _gradients(KINDS[kind], points, rule)
    if incompatible_modes and kind == "hex8":
        dN = np.concatenate([dN, _incompatible_gradients(KINDS[kind], points, rule, volumes)], axis=-1)
    return dN, volumes


def _amplitudes(dN: np.ndarray, volumes: np.ndarray, u: np.ndarray, lam: float, mu: float) -> np.ndarray:
    """Return the amplitudes of all functions, (n_elements, m, 3), under displacements of the nodes: no force acts on bubbles."""
    n = 3 * u.shape[1]
    if n == 3 * dN.shape[-1]:
        return u
    K = _isotropic(dN, volumes, lam, mu)
    right = -K[:, n:, :n] @ u.reshape(len(u), n, 1)
    return np.concatenate([u, np.linalg.solve(K[:, n:, n:], right).reshape(len(u), -1, 3)], axis=1)


def deformed_stiffness(
    kind: str,
    points: np.ndarray,
    u: np.ndarray,
    young: float,
    poisson: float,
    integration: str = "full",
    incompatible_modes: bool = True,
) -> np.ndarray:
    """Return the stiffness of elements about a displaced state, without that of its stress, (n_elements, 3 n, 3 n) [N/m].

    Local.  docs/theory.md, eq. (12.11): with F = 1 + du/dx the strain of a small motion v is sym(F^T dv/dx), so that gradients
    become g_ai = F_ik dN_a/dx_k, and ``K_ai,bj = integral of lam g_ai g_bj + mu g_aj g_bi + mu (F F^T)_ij dN_a/dx_k dN_b/dx_k``.

    Parameters
    ----------
    u : (n_elements, n, 3) displacements of the nodes [m]
    others : as in :func:`microslip.elements.stiffness`
    """
    lam, mu = lame(young, poisson)
    rule = rules(kind, integration)[0]
    n = 3 * points.shape[1]
    K = np.empty((len(points), n, n))
    for chunk in _chunks(len(points), 9 * (points.shape[1] + 3) ** 2):
        dN, volumes = _functions(kind, points[chunk], rule, incompatible_modes)
        slopes = dN @ _amplitudes(dN, volumes, u[chunk], lam, mu)[:, None]
        whole = _about(dN, np.eye(3) + slopes.swapaxes(-1, -2), volumes, lam, mu)
        K[chunk] = _condense(whole, n) if whole.shape[-1] > n else whole
    return K


def _about(dN: np.ndarray, F: np.ndarray, volumes: np.ndarray, lam: float, mu: float) -> np.ndarray:
    """Return K (n_elements, 3 m, 3 m) of m functions about the deformation gradient F (n_elements, n_q, 3, 3)."""
    n_elements, n_q, _, m = dN.shape
    g = (F @ dN).reshape(n_elements, n_q, 3 * m)
    G = (g.swapaxes(-1, -2) @ (g * volumes[..., None])).reshape(n_elements, 3, m, 3, m)
    left = mu * volumes[..., None, None] * (F @ F.swapaxes(-1, -2))
    K = np.empty((n_elements, m, 3, m, 3))
    for i in range(3):
        for j in range(3):
            trace = (dN.swapaxes(-1, -2) @ (left[:, :, i, j, None, None] * dN)).sum(axis=1)
            K[:, :, i, :, j] = lam * G[:, i, :, j] + mu * G[:, j, :, i] + trace
    return K.reshape(n_elements, 3 * m, 3 * m)


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
