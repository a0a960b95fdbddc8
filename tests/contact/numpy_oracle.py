"""The contact force of one pair and its derivative, sample by sample, straight from DESIGN's section on the contact element.

Shares nothing with the program: own Fourier sums, force T as the state (not the slider), values carried with gradients.
"""

import numpy as np


def rows(H, N_t):
    """Rows of the synthesis (N_t, N_H) by plain sums."""
    theta = 2.0 * np.pi * np.arange(N_t) / N_t
    columns = [np.ones(N_t)]
    for n in range(1, H + 1):
        columns += [np.cos(n * theta), np.sin(n * theta)]
    return np.column_stack(columns)


def pair_harmonics(U, mu, N0, k_t, k_n, separate, N_t):
    """Return p (3, N_H), P (3 N_H, 3 N_H), state, T (N_t, 2) and N (N_t,) of the kept period for U (3, N_H)."""
    N_H = U.shape[1]
    E = rows(N_H // 2, N_t)
    du = E @ U.T
    gradient = [np.kron(np.eye(3), E[j]) for j in range(N_t)]        # (3, 3 N_H) of du at sample j
    T, dT = k_t * du[0, :2], k_t * gradient[0][:2]
    slips, opens, forces, slopes, normals = False, False, [], [], []
    for sample in range(1, 2 * N_t):
        j, before, kept = sample % N_t, (sample - 1) % N_t, sample >= N_t
        N, dN = N0 - k_n * du[j, 2], -k_n * gradient[j][2]
        if not N > 0.0:
            N, dN = 0.0, 0.0 * dN
        T = T + k_t * (du[j, :2] - du[before, :2])
        dT = dT + k_t * (gradient[j][:2] - gradient[before][:2])
        if separate:
            over = np.abs(T) > mu * N
            dT = np.where(over[:, None], np.sign(T)[:, None] * mu * dN, dT)
            T = np.where(over, np.sign(T) * mu * N, T)
            slipped = over.any()
        else:
            size = np.hypot(*T)
            slipped = size > mu * N
            if slipped:
                d = T / size
                dT = mu * np.outer(d, dN) + mu * N / size * (dT - np.outer(d, d @ dT))
                T = mu * N * d
        if N == 0.0 or (mu == 0.0 and k_t > 0.0):                    # no friction: T is zero, whatever happens
            T, dT = np.zeros(2), np.zeros_like(dT)
            slipped = slipped or k_t > 0.0
        if kept:
            slips, opens = slips or slipped, opens or N == 0.0
            forces.append([*T, max(N0, 0.0) - N])
            slopes.append(np.vstack([dT, -dN]))
            normals.append(N)
    f_nl, df_nl, order = np.array(forces), np.array(slopes), np.arange(N_t)
    K_J = np.diag([k_t, k_t, k_n])
    beyond = f_nl - du[order] @ K_J
    d_beyond = df_nl - np.einsum("ab,jbh->jah", K_J, np.array(gradient))
    F = 2.0 / N_t * E.T
    F[0] /= 2.0
    p = np.einsum("cj,ja->ac", F, beyond)
    P = np.einsum("cj,jah->ach", F, d_beyond).reshape(3 * N_H, 3 * N_H)
    return p, P, 2 if opens else 1 if slips else 0, f_nl[:, :2], np.array(normals)
