"""Reference for the contact force of a pair and its derivative: the plain return map, sample by sample.

    T = T0 + k_t du_t at the first sample, T0 = -k_t w0; from there
    N = max(0, N0 - k_n du_z);  T_pred = T + k_t d(du_t);  |T_pred| <= mu N: stick, else T = mu N T_pred / |T_pred|

Independent of the program: separate Fourier sums, the force T as state (not the slider), values carried with their gradients.
"""

from dataclasses import dataclass

import numpy as np

MOST = 60  # largest number of periods


def rows(H, N_t):
    """Rows of the synthesis (N_t, N_H) by plain sums."""
    theta = 2.0 * np.pi * np.arange(N_t) / N_t
    columns = [np.ones(N_t)]
    for n in range(1, H + 1):
        columns += [np.cos(n * theta), np.sin(n * theta)]
    return np.column_stack(columns)


@dataclass(frozen=True)
class Marched:
    """The recorded period of one pair."""

    p: np.ndarray  # (3, N_H)
    P: np.ndarray  # (3 N_H, 3 N_H)
    T: np.ndarray  # (N_t, 2)
    N: np.ndarray  # (N_t,)
    pattern: tuple  # state of each sample of every period: slip in x, slip in y (or in the circle), open
    margin: float  # least distance from a change of any of these, relative to the forces
    is_settled: bool  # the recorded period repeats the previous one

    @property
    def state(self):
        period = self.pattern[-len(self.N) :]
        return 2 if any(open_ for _, _, open_ in period) else 1 if any(x or y for x, y, _ in period) else 0


def pair_harmonics(U, mu, N0, k_t, k_n, separate, N_t, w0=(0.0, 0.0)):
    """March the pair with harmonics U (3, N_H) through at least two periods of N_t samples, until one repeats."""
    N_H = U.shape[1]
    E = rows(N_H // 2, N_t)
    du = E @ U.T
    gradient = [np.kron(np.eye(3), E[j]) for j in range(N_t)]  # (3, 3 N_H) of du at sample j
    scale = np.abs(N0) + max(k_t, k_n) * (np.abs(U).sum() + np.abs(w0).sum()) + 1e-300
    T0 = -k_t * np.array(w0)
    T, dT = T0 + k_t * du[0, :2], k_t * gradient[0][:2]
    pattern, margin, forces, slopes, last, is_settled = [], 1.0, [], [], None, N_t == 1
    for sample in range(1, 2 * N_t if N_t == 1 else MOST * N_t):
        j, before = sample % N_t, (sample - 1) % N_t
        if j == 0:
            if last is not None:
                stays = np.abs(T - last[0]).max() <= 1e-14 * scale and np.abs(dT - last[1]).max() <= 1e-14 * (1.0 + mu) * max(
                    k_t, k_n
                )
                is_settled = is_settled or stays
            last = T, dT
            if is_settled and len(forces) == N_t:
                break
            forces, slopes = [], []
        N, dN = N0 - k_n * du[j, 2], -k_n * gradient[j][2]
        margin = min(margin, abs(N) / scale if k_n > 0.0 else 1.0)
        is_open = not N > 0.0
        if is_open:
            N, dN = 0.0, 0.0 * dN
        T = T + k_t * (du[j, :2] - du[before, :2])
        dT = dT + k_t * (gradient[j][:2] - gradient[before][:2])
        limit, size = mu * N, np.abs(T) if separate else np.full(2, np.hypot(*T))
        free = limit == 0.0 and k_t > 0.0  # no friction: T is zero in any case
        slips = (size > limit) | free
        margin = margin if free else min(margin, *np.abs(size - limit) / scale)
        if free:
            T, dT = np.zeros(2), np.zeros_like(dT)
        elif separate:
            T, dT = np.where(slips, np.sign(T) * limit, T), np.where(slips[:, None], np.outer(np.sign(T), mu * dN), dT)
        elif slips[0]:
            d = T / size
            T, dT = limit * d, np.outer(d, mu * dN) + limit / size[0] * (dT - np.outer(d, d @ dT))
        pattern.append((bool(slips[0]), bool(slips[1]), bool(is_open)))
        forces.append([*(T - T0), max(N0, 0.0) - N])
        slopes.append(np.vstack([dT, -dN]))
    f_nl, df_nl = np.array(forces), np.array(slopes)
    K_J = np.diag([k_t, k_t, k_n])
    F = 2.0 / N_t * E.T
    F[0] /= 2.0
    p = np.einsum("cj,ja->ac", F, f_nl - du @ K_J)
    P = np.einsum("cj,jah->ach", F, df_nl - np.einsum("ab,jbh->jah", K_J, np.array(gradient)))
    N = max(N0, 0.0) - f_nl[:, 2]
    return Marched(p, P.reshape(3 * N_H, 3 * N_H), T0 + f_nl[:, :2], N, tuple(pattern), margin, is_settled)
