"""The contact law over one step of time, and its exact derivative (docs/theory.md, eq. 3.1 to 3.4 and 6.2).

Written for many points at once, in terms of p = f_nl - K_J du: sliders stand at w = -p_t / k_t, so that p is all that the law
remembers, and p of a pair that sticks stays what it was, to the bit.
"""

from __future__ import annotations

import numpy as np

from .law import OPEN, SLIP, STICK, ContactParameters


def return_map(du: np.ndarray, p_before: np.ndarray, of: ContactParameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return p after a step that ends at ``du``, its derivative and the states.

    Local.

    Parameters
    ----------
    du : (..., n, 3) relative displacement at the end of the step [m]
    p_before : (..., n, 3) p at its beginning [N]
    of : parameters of the n pairs

    Returns
    -------
    p : (..., n, 3) [N]
    L : (..., n, 3, 3) d p / d du [N/m]; zero where a pair sticks
    state : (..., n) uint8, STICK, SLIP or OPEN during the step
    """
    closing = of.N0 - of.k_n * du[..., 2]
    is_open = closing <= 0.0
    N = np.where(is_open, 0.0, closing)
    T_pred = of.k_t[:, None] * du[..., :2] + p_before[..., :2]
    limit = (of.mu * N)[..., None]
    length = np.sqrt(T_pred[..., :1] ** 2 + T_pred[..., 1:] ** 2)
    size = np.where(of.separate[:, None], np.abs(T_pred), length)  # (..., n, 2): of the two directions
    slides = (size > limit) | (is_open & (of.k_t > 0.0))[..., None]
    safe = np.where(size > 0.0, size, 1.0)
    t = T_pred / safe
    p = np.empty(du.shape)
    p[..., :2] = np.where(slides, limit * t - of.k_t[:, None] * du[..., :2], p_before[..., :2])
    p[..., 2] = np.where(is_open, np.maximum(of.N0, 0.0) - of.k_n * du[..., 2], np.maximum(-of.N0, 0.0))
    L = np.zeros((*du.shape, 3))
    turn = np.where(slides & ~of.separate[:, None], limit / safe * of.k_t[:, None], 0.0)
    for i in (0, 1):
        for j in (0, 1):
            L[..., i, j] = turn[..., i] * ((i == j) - t[..., i] * t[..., j])
        L[..., i, i] -= np.where(slides[..., i], of.k_t, 0.0)
        L[..., i, 2] = np.where(slides[..., i] & ~is_open, -of.mu * of.k_n * t[..., i], 0.0)
    L[..., 2, 2] = np.where(is_open, -of.k_n, 0.0)
    state = np.where(is_open, OPEN, np.where(slides.any(axis=-1), SLIP, STICK)).astype(np.uint8)
    return p, L, state
