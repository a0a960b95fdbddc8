"""Strain and stress of solids, their stiffness about a stressed state, and thermal forces (docs/theory.md, section 12)."""

import numpy as np

from .materials import Elastic
from .solid import Solids, condensed


def stress(of: Solids, u: np.ndarray) -> np.ndarray:
    """Return the stress at the quadrature points of the stiffness, (n_elements, n_q, 3, 3) [Pa].

    Local.  The elasticity times eps - alpha dT, of the displacements ``u`` (n_elements, n, 3) [m] of the nodes.  The bubbles of
    hex8 follow from these, as in its stiffness.
    """
    sigma = strain(of, u)
    for chunk, part in of.parts(9 * (of.n + 3) ** 2):
        sigma[chunk] = part.elastic().stress(sigma[chunk], part.rise_at_points())
    return sigma


def strain(of: Solids, u: np.ndarray) -> np.ndarray:
    """Return the strain at the quadrature points of the stiffness, (n_elements, n_q, 3, 3) [-].  Local; as :func:`stress`."""
    eps = np.empty((len(of.points), len(of.rule.weights), 3, 3))
    for chunk, part in of.parts(9 * (of.n + 3) ** 2):
        dN, volumes = part.functions()
        amplitudes = _amplitudes(dN, volumes, u[chunk], part.elastic(), part.rise_at_points())
        slopes = dN @ amplitudes[:, None]  # (n_elements, n_q, 3, 3): d u_j / d x_i
        eps[chunk] = 0.5 * (slopes + slopes.swapaxes(-1, -2))
    return eps


def _amplitudes(dN: np.ndarray, volumes: np.ndarray, u: np.ndarray, local: Elastic, rise: float | np.ndarray) -> np.ndarray:
    """Return the amplitudes of all functions, (n_elements, m, 3), under displacements of the nodes: no force acts on bubbles."""
    n = 3 * u.shape[1]
    if n == 3 * dN.shape[-1]:
        return u
    K = local.stiffness(dN, volumes)
    right = -K[:, n:, :n] @ u.reshape(len(u), n, 1)
    if isinstance(rise, np.ndarray):  # a uniform temperature moves no bubble
        right += _expansion_forces(dN, volumes, local, rise)[:, n // 3 :].reshape(len(u), -1, 1)
    return np.concatenate([u, np.linalg.solve(K[:, n:, n:], right).reshape(len(u), -1, 3)], axis=1)


def deformed_stiffness(of: Solids, u: np.ndarray) -> np.ndarray:
    """Return the stiffness of elements about a displaced state, without that of its stress, (n_elements, 3 n, 3 n) [N/m].

    Local.  docs/theory.md, eq. (12.11): with F = 1 + du/dx the strain of a small motion v is sym(F^T dv/dx).
    ``u`` (n_elements, n, 3) are the displacements of the nodes [m].
    """
    K = np.empty((len(of.points), 3 * of.n, 3 * of.n))
    for chunk, part in of.parts(9 * (of.n + 3) ** 2):
        (dN, volumes), local = part.functions(), part.elastic()
        slopes = dN @ _amplitudes(dN, volumes, u[chunk], local, part.rise_at_points())[:, None]
        K[chunk] = condensed(local.stiffness_about(dN, np.eye(3) + slopes.swapaxes(-1, -2), volumes), 3 * of.n)
    return K


def stress_stiffness(of: Solids, stress: np.ndarray) -> np.ndarray:
    """Return the stiffness K_sigma of a stress (n_elements, n_q, 3, 3) [Pa], (n_elements, n, n) [N/m].

    Local.  docs/theory.md, eq. (12.5): entry a, b couples u_x of a and b, u_y, u_z alike.  ``stress`` is that of :func:`stress`.
    """
    K_sigma = np.empty((len(of.points), of.n, of.n))
    for chunk, part in of.parts(9 * of.n**2):
        dN, volumes = part.gradients()
        weighted = (stress[chunk] * volumes[..., None, None]) @ dN
        K_sigma[chunk] = (dN.swapaxes(-1, -2) @ weighted).sum(axis=1)
    return K_sigma


def thermal_forces(of: Solids) -> np.ndarray:
    """Return the nodal forces by which elements expand, (n_elements, n, 3) [N]: minus those that suppress the expansion.

    Local.  docs/theory.md, eq. (12.2).  Bubbles of hex8 are condensed under temperatures of nodes.
    """
    n, f = of.n, np.empty(of.points.shape)
    for chunk, part in of.parts(9 * (n + 3) ** 2):
        local, rise = part.elastic(), part.rise_at_points()
        dN, volumes = part.functions() if isinstance(rise, np.ndarray) else part.gradients()
        forces = _expansion_forces(dN, volumes, local, rise)
        if dN.shape[-1] > n:
            K, on_bubbles = local.stiffness(dN, volumes), forces[:, n:].reshape(len(forces), -1, 1)
            K_kb, K_bb = K[:, : 3 * n, 3 * n :], K[:, 3 * n :, 3 * n :]
            forces = forces[:, :n] - (K_kb @ np.linalg.solve(K_bb, on_bubbles)).reshape(-1, n, 3)
        f[chunk] = forces
    return f


def _expansion_forces(dN: np.ndarray, volumes: np.ndarray, local: Elastic, rise: float | np.ndarray) -> np.ndarray:
    """Return the forces of suppressed expansion on functions of gradients (n_elements, n_q, 3, m), (n_elements, m, 3) [N]."""
    suppressed = local.stress(np.zeros((3, 3)), rise)
    return -((volumes[..., None, None] * (suppressed @ dN)).sum(axis=1)).swapaxes(-1, -2)
