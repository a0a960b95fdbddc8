"""Harmonics of the contact forces by alternating frequency and time, with the exact derivative of the sampled law.

docs/theory.md, section 6.  Local and NumPy only; the march itself is compiled (aft_kernel.c).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..fourier.coefficients import analysis_matrix, cycle_work, synthesis_matrix
from ..fourier.harmonics import Harmonics
from ._aft import Pairs, Sampling, leaves, march
from .law import ContactParameters


@dataclass(frozen=True)
class AftResult:
    """Harmonics of p = f_nl - K_J du for n pairs, m of which are active."""

    p: np.ndarray  # (n, 3, N_H) N; exactly 0 for pairs that are not active
    state: np.ndarray  # (n,) uint8, in the kept period: STICK, SLIP, OPEN of contact/law.py
    active: np.ndarray  # (m,) pairs with p or dp/dU not identically zero, ascending
    P: np.ndarray | None  # (m, 3 N_H, 3 N_H) dp/dU [N/m], row and column = direction * N_H + coefficient


def contact_harmonics(
    U: np.ndarray, parameters: ContactParameters, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None
) -> AftResult:
    """Return the harmonics of the contact forces beyond the stuck springs under the periodic motion ``U``.

    Local.  Marches the law (docs/theory.md, section 3) through two periods of ``n_samples`` each, from T = k_t du_t at the
    first sample, and keeps the second.

    Parameters
    ----------
    U : (n, 3, N_H) coefficients of ``du`` in each pair's frame [m]; n may be 0
    parameters : of the same n pairs
    n_samples : N_t >= 2 H + 1, H the highest harmonic
    tangents : False leaves P out
    harmonics : whose coefficients ``U`` and p are; 0 to H unless given

    Notes
    -----
    P is the derivative of the sampled law through both periods.  It jumps where a sample passes from stick to slip,
    or from closed to open; there it is the derivative from one side.  A pair is active if it leaves sticking in either
    period, if it opens, or if it starts with a gap.  A pair that only slid while the cycle settled is active and in
    state STICK: it carries a constant p.  A pair with NaN in ``U`` or in a parameter is active; its p and P are NaN.
    """
    n, _, N_H = U.shape
    if parameters.n_pairs != n:
        raise ValueError(f"harmonics of {n} pairs with parameters of {parameters.n_pairs}")
    sampling = _sampling(harmonics or Harmonics.full(N_H), n_samples)
    if sampling.n_coefficients != N_H:
        raise ValueError(f"{N_H} coefficients for the harmonics {harmonics}, which have {sampling.n_coefficients}")
    p, state = np.zeros((n, 3, N_H)), np.zeros(n, dtype=np.uint8)
    active = np.empty(0, dtype=np.intp)
    if n > 0:
        pairs = Pairs(
            np.ascontiguousarray(U, dtype=np.float64),
            parameters.mu,
            parameters.N0,
            parameters.k_t,
            parameters.k_n,
            parameters.separate.view(np.uint8),
        )
        leaves(sampling, pairs, state)
        active = np.flatnonzero(state)
    P = np.empty((len(active), 3 * N_H, 3 * N_H)) if tangents else None
    if len(active) > 0:
        march(sampling, pairs, active, p, state, P)
    return AftResult(p, state, active, P)


@lru_cache(maxsize=16)
def _sampling(harmonics: Harmonics, N_t: int) -> Sampling:
    """Return the kernel's tables, rows padded with zeros to a multiple of four."""
    N_H = harmonics.n_coefficients
    stride = 4 * -(-N_H // 4)
    E, F, S = np.zeros((N_t, stride)), np.zeros((N_t, stride)), np.zeros((N_t + 1, stride))
    E[:, :N_H] = synthesis_matrix(harmonics, N_t)
    F[:, :N_H] = analysis_matrix(harmonics, N_t).T
    S[1:] = np.cumsum(F, axis=0)
    S[N_t] = 0.0  # what the sum is without roundoff
    S[N_t, harmonics.mean] = 1.0
    return Sampling(E, np.ascontiguousarray(synthesis_matrix(harmonics, N_t).T), F, S)


def pair_energy(U: np.ndarray, p: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the friction loss per cycle e_i, the closed integral of T . d(du_t), (n,) [J], for (n, 3, N_H) of both.

    docs/theory.md, eq. (6.3).  Positive where energy is lost.  ``p`` may stand for T: the springs k_t do no work in
    a cycle.
    """
    return cycle_work(p[:, :2], U[:, :2], harmonics).sum(axis=1)


def contact_work(U: np.ndarray, p: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the work per cycle into the pairs, normal direction included, (n,) [J].

    The normal spring loses nothing; its part, the sampling error of one-sided contact, closes the energy balance.
    """
    return cycle_work(p, U, harmonics).sum(axis=1)
