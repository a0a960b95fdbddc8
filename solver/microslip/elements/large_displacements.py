"""Forces and tangent stiffness of solids under large displacements and small strains (docs/theory.md, section 12)."""

import numpy as np

from .materials import Elastic
from .solid import Solids, condensed

_BUBBLE_STEPS = 20  # of Newton's method for the bubbles of hex8
_BUBBLES_REST = 1e-13  # their forces, over the largest of the elements


def large_displacements(of: Solids, u: np.ndarray, with_stress: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces by which elements resist a displacement, (n_elements, n, 3) [N], and their derivative by it.

    Local.  docs/theory.md, eq. (12.13): with F = 1 + du/dx and E = (F^T F - 1) / 2 the stress S is that of E, and
    ``f_ai = integral of F_ik S_kl dN_a/dx_l``. Bubbles of hex8 move until no force acts on them.

    Parameters
    ----------
    u : (n_elements, n, 3) displacements of the nodes [m]
    with_stress : whether K has K_sigma in it; without, it is positive in any case

    Returns
    -------
    f : (n_elements, n, 3) [N]
    K : (n_elements, 3 n, 3 n) [N/m], symmetric: K_F + K_sigma, with the stress S
    """
    n = of.n
    f, K = np.empty(of.points.shape), np.empty((len(of.points), 3 * n, 3 * n))
    for chunk, part in of.parts(9 * (n + 3) ** 2):
        dN, volumes = part.functions()
        state = (part.elastic(), part.rise_at_points(), with_stress)
        bubbles = np.zeros((len(volumes), dN.shape[-1] - n, 3))
        forces, whole = _forces_and_tangent(dN, volumes, np.concatenate([u[chunk], bubbles], axis=1), *state)
        for _ in range(_BUBBLE_STEPS if bubbles.size else 0):
            residual = forces[:, n:]
            if np.abs(residual).max() <= _BUBBLES_REST * np.abs(forces).max():
                break
            step = np.linalg.solve(whole[:, 3 * n :, 3 * n :], residual.reshape(len(residual), -1, 1))
            bubbles = bubbles - step.reshape(residual.shape)
            forces, whole = _forces_and_tangent(dN, volumes, np.concatenate([u[chunk], bubbles], axis=1), *state)
        f[chunk], K[chunk] = forces[:, :n], condensed(whole, 3 * n)
    return f, K


def _forces_and_tangent(
    dN: np.ndarray,
    volumes: np.ndarray,
    moved: np.ndarray,
    local: Elastic,
    temperature_rise: float | np.ndarray,
    with_stress: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (n_elements, m, 3) and tangent (n_elements, 3 m, 3 m) of m functions with amplitudes ``moved`` [m]."""
    F = np.eye(3) + (dN @ moved[:, None]).swapaxes(-1, -2)
    E = 0.5 * (F.swapaxes(-1, -2) @ F - np.eye(3))
    weighted = volumes[..., None, None] * (local.stress(E, temperature_rise) @ dN)
    f = (weighted.swapaxes(-1, -2) @ F.swapaxes(-1, -2)).sum(axis=1)
    K = local.stiffness_about(dN, F, volumes)
    sigma = (dN.swapaxes(-1, -2) @ weighted).sum(axis=1) * with_stress
    m = dN.shape[-1]
    for i in range(3):
        K.reshape(len(K), m, 3, m, 3)[:, :, i, :, i] += sigma
    return f, K
