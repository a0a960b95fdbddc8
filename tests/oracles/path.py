"""The contact law along the straight line between samples, and its steady cycle: docs/theory.md, eq. (3.6) and (3.7).

In the friction force T and in angles, vectorised over pairs; the program moves sliders, by formulas without angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PLAIN, JUMPS = 12, 40  # periods marched one by one, and jumps beyond them
REPEATS = 1e-14  # change of T in a period, over the pair's forces, of a cycle that repeats


def line_step(T, q, N_i, N_j, mu, separate):
    """Return T after a step, the mean of p - its straight line over the step, and how much of T its slip took.

    ``T`` (n, 2) before the step; ``q`` (n, 2) = k_t d(du_t) along it; N_i, N_j (n,) = N0 - k_n du_z at its ends, open where not
    positive [N].  Exact for the line, but for the turning of T while it slips, of second order in the step.
    """
    L_i, L_j = (mu * np.maximum(N, 0.0) for N in (N_i, N_j))
    with np.errstate(all="ignore"):
        crossing = np.where((L_i > 0.0) != (L_j > 0.0), N_i / (N_i - N_j), 0.0)
    begin = np.where((L_i <= 0.0) & (L_j > 0.0), crossing, 0.0)[:, None]
    end = np.where((L_j <= 0.0) & (L_i > 0.0), crossing, 1.0)[:, None]
    T_a, chord = np.where(L_i[:, None] > 0.0, T, 0.0), (end - begin) * q
    T_b, sigma = _slid(T_a, chord, L_i, L_j, separate)
    never = ((L_i <= 0.0) & (L_j <= 0.0))[:, None]
    T_j = np.where((L_j > 0.0)[:, None], T_b, 0.0)
    # p from its value before the step: at the begin of contact, where slip sets in, at the end of contact, after the step
    p_a, p_b, p_j = T_a - T - begin * q, T_b - T - end * q, T_j - T - q
    onset = begin + sigma * (end - begin)
    area = 0.5 * (begin * p_a + (end - onset) * (p_a + p_b) + (1.0 - end) * (p_b + p_j)) + (onset - begin) * p_a - 0.5 * p_j
    return T_j, np.where(never, 0.0, area), np.abs(p_j).max(axis=1)


def _slid(T, q, L_i, L_j, separate):
    """Return T at the end of contact and the share of the way at which slip sets in, by the limit that each pair has."""
    if separate.all():
        return _in_line(T, q, L_i, L_j)
    if not separate.any():
        return _on_circle(T, q, L_i, L_j)
    by_limit = zip(_in_line(T, q, L_i, L_j), _on_circle(T, q, L_i, L_j))
    return tuple(np.where(separate[:, None], *pair) for pair in by_limit)


def _in_line(T, q, L_i, L_j):
    """Return T at the end of contact and the share of the way at which slip sets in, each direction by itself."""
    trial = T + q
    sign, limit, first = np.sign(trial), L_j[:, None], L_i[:, None]
    slips, room = np.abs(trial) > limit, first - sign * T
    over = np.abs(trial) - limit
    with np.errstate(all="ignore"):
        onset = np.where(room > 1e-12 * first, room / (room + over), 0.0)
    return np.where(slips, sign * limit, trial), np.where(slips, onset, 1.0)


def _on_circle(T, q, L_i, L_j):
    """Return the same for a friction circle."""
    trial, dL = T + q, L_j - L_i
    slips = np.linalg.norm(trial, axis=1) > L_j
    c, b = (T**2).sum(axis=1) - L_i**2, (T * q).sum(axis=1) - L_i * dL
    a, at_limit = (q**2).sum(axis=1) - dL**2, 1e-12 * L_i**2
    with np.errstate(all="ignore"):
        S = np.sqrt(np.maximum(b**2 - a * c, 0.0))
        onset = np.minimum(np.maximum(np.where(b > 0.0, -c / (b + S), (S - b) / a), 0.0), 1.0)
    onset = np.where((c >= -at_limit) & ((c > at_limit) | (b > 0.0) | (a <= 0.0)), 0.0, onset)
    onset = np.where(slips, onset, 1.0)
    start, rest = T + onset[:, None] * q, (1.0 - onset)[:, None] * q
    length = np.linalg.norm(rest, axis=1)
    towards = np.arctan2(rest[:, 1], rest[:, 0])
    at = np.where(np.abs(start).max(axis=1) > 0.0, np.arctan2(start[:, 1], start[:, 0]), towards)
    with np.errstate(all="ignore"):
        x = length / (0.5 * (L_i + onset * dL + L_j))
        shrink = np.where(np.isfinite(x), 1.0 / (1.0 + x + 0.5 * x**2), 0.0)
    half = 0.5 * np.where(length > 0.0, (at - towards + np.pi) % (2.0 * np.pi) - np.pi, 0.0)
    turned = np.where(length > 0.0, towards, at) + 2.0 * np.arctan2(shrink * np.sin(half), np.cos(half))
    slid = L_j[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    return np.where(slips[:, None], slid, trial), onset[:, None] * np.ones(2)


@dataclass(frozen=True)
class Cycle:
    """A period of n pairs, samples first."""

    T: np.ndarray  # (N_t, n, 2) N
    area: np.ndarray  # (N_t, n, 2) N, of the steps that lead to the samples
    slip: np.ndarray  # (n,) N, the most that slip took of T in a step
    change: np.ndarray  # (n,) N, of T over the period; of those that creep what may be left of it in all


def steady(du, N, k_t, mu, separate, w0=0.0):
    """Return the period that repeats under du (N_t, n, 3) [m] and N = N0 - k_n du_z (N_t, n) [N], from T = k_t (du_t - w0)."""
    n_samples = len(du)
    T = k_t[:, None] * (du[0, :, :2] - w0)
    T, _, at_once = line_step(T, 0.0 * T, N[0], N[0], mu, separate)
    size = np.abs(k_t[:, None] * du[..., :2]).max(axis=(0, 2)) + np.abs(mu * N).max(axis=0)

    def period(T, which):
        kept, areas, slip, before = [], [], np.zeros(len(which)), T
        for j in range(1, n_samples + 1):
            i, j = j - 1, j % n_samples
            q = k_t[which, None] * (du[j, which, :2] - du[i, which, :2])
            T, area, taken = line_step(T, q, N[i, which], N[j, which], mu[which], separate[which])
            kept.append(T)
            areas.append(area)
            slip = np.maximum(slip, taken)
        return Cycle(np.roll(kept, 1, axis=0), np.roll(areas, 1, axis=0), slip, np.abs(T - before).max(axis=1))

    every = np.arange(len(k_t))
    found, before = period(T, every), np.zeros(len(k_t))
    for _ in range(PLAIN if n_samples > 1 else 0):
        if np.all(found.change <= REPEATS * size):
            break
        found, before = period(found.T[0], every), found.change
    creeps = np.flatnonzero(found.change > REPEATS * size)
    slow = (found.change > 0.5 * before) & (found.change > 1e-15 * size) & (before > 0.0)  # little a period, and much in all
    found.change[slow] /= np.maximum(1.0 - found.change[slow] / before[slow], 1e-6)
    T, slowest = found.T[0, creeps], np.zeros(len(creeps))
    for _ in range(JUMPS if len(creeps) else 0):  # Aitken's formula
        one = period(T, creeps)
        two = period(one.T[0], creeps)
        c, d = one.T[0] - T, two.T[0] - one.T[0]
        rate = (c * d).sum(axis=1) / np.maximum((c * c).sum(axis=1), 1e-300)
        rate = np.where((two.slip > 1e-13 * size[creeps]) & (rate > 0.0) & (rate < 1.0), rate, 0.0)
        T, slowest = two.T[0] + d * (rate / (1.0 - rate))[:, None], np.maximum(rate, slowest)
        if np.all(two.change <= 1e-15 * size[creeps]):  # rounding alone
            break
    if len(creeps):
        last = period(T, creeps)
        for name in ("T", "area"):
            getattr(found, name)[:, creeps] = getattr(last, name)
        left = np.maximum(two.change, 1e-15 * size[creeps]) / (1.0 - slowest)  # rounding, in all periods to come
        found.slip[creeps], found.change[creeps] = last.slip, np.maximum(last.change, left)
    return found if n_samples > 1 else Cycle(found.T, found.area, at_once, found.change)


def normal_area(N):
    """Return the mean of min(N, 0), less that of its straight line, over the steps that lead to the samples, (N_t, n)."""
    before = np.roll(N, 1, axis=0)
    with np.errstate(all="ignore"):
        area = 0.5 * np.abs(N * before) / np.abs(N - before)
    return np.where((N > 0.0) != (before > 0.0), area, 0.0)


def shared(area):
    """Return what areas (N_t, ...) of steps add to the samples: half to each end."""
    return 0.5 * (area + np.roll(area, -1, axis=0))
