"""The contact law over one step, vectorised over pairs, after docs/theory.md, section 3: the reference of the compiled code."""

from __future__ import annotations

import numpy as np


def normal_force(du_z, N0, k_n):
    """Return N = max(0, N0 - k_n du_z) [N], compression positive, (n,) each.  Local.

    docs/theory.md, eq. (3.1).
    """
    return np.maximum(0.0, N0 - k_n * du_z)


def normal_contact_force(N, N0):
    """Return the normal component of f_nl, max(N0, 0) - N [N]: zero at rest, also with a gap (N0 < 0).  Local.

    docs/theory.md, eq. (3.2).
    """
    return np.maximum(N0, 0.0) - N


def friction_step(w, du_t, N, k_t, mu, separate):
    """Return friction force and slider position after a move of the pairs to ``du_t``.

    Local.

    Parameters
    ----------
    w : (n, 2) slider position before the move [m]
    du_t : (n, 2) tangential relative displacement after the move [m]
    N : (n,) normal force after the move, 0 where open [N]
    k_t, mu : (n,) tangential stiffness [N/m], friction coefficient [-]
    separate : (n,) bool, True where each direction has its own limit

    Returns
    -------
    T : (n, 2) friction force on the pair [N]
    w : (n, 2) slider position [m]
    slips : (n,) bool, True where the friction limit is reached by sliding

    Notes
    -----
    docs/theory.md, eq. (3.3): stick predictor, then return to the circle |T| = mu N, or per direction to +-mu N.
    """
    T_pred = k_t[:, None] * (du_t - w)
    limit = np.broadcast_to((mu * N)[:, None], T_pred.shape)
    size = np.where(separate[:, None], np.abs(T_pred), np.linalg.norm(T_pred, axis=1, keepdims=True))
    leaves = size > limit
    alpha = np.divide(limit, size, out=np.ones_like(T_pred), where=leaves)
    return alpha * T_pred, np.where(leaves, du_t - alpha * (du_t - w), w), leaves.any(axis=1)


def beyond_stuck_springs(f_nl, du, k_t, k_n):
    """Return p = f_nl - K_J du, (n, 3) [N], for the contact force and relative displacement (n, 3).  Local.

    docs/theory.md, eq. (3.4).  Zero while a pair sticks; :func:`friction_step` gives its tangential part as -k_t w.
    """
    return f_nl - np.stack([k_t, k_t, k_n], axis=1) * du
