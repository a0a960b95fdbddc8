"""The contact law along the straight line between samples, and its steady cycle: docs/theory.md, eq. (3.6) and (3.7).

In the friction force T and in angles (path.c); the program moves sliders, by formulas without angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .compiled import arguments, compiled

PLAIN, MORE, JUMPS = 12, 500, 40  # periods marched one by one, of those that drift, and jumps beyond them
REPEATS = 1e-14  # change of T in a period, over the pair's forces, of a cycle that repeats


def line_step(T, q, N_i, N_j, mu, separate):
    """Return T after a step, the mean of p - its straight line over the step, and how much of T its slip took.

    ``T`` (n, 2) before the step; ``q`` (n, 2) = k_t d(du_t) along it; N_i, N_j (n,) = N0 - k_n du_z at its ends, open where not
    positive [N].  Exact for the line, but for the turning of T while it slips, of second order in the step.
    """
    T, area, taken = np.array(T, dtype=float), np.empty(np.shape(T)), np.empty(len(T))
    given = [np.ascontiguousarray(x, dtype=float) for x in (q, N_i, N_j, mu)]
    compiled("path").line_step(*arguments(len(T), T, *given, np.ascontiguousarray(separate, dtype=np.uint8), area, taken))
    return T, area, taken


@dataclass(frozen=True)
class Cycle:
    """A period of n pairs, samples first."""

    T: np.ndarray  # (N_t, n, 2) N
    area: np.ndarray  # (N_t, n, 2) N, of the steps that lead to the samples
    slip: np.ndarray  # (n,) N, the most that slip took of T in a step
    change: np.ndarray  # (n,) N, of T over the period; of those that drift what may be left of it in all


def steady(du, N, k_t, mu, separate, w0=0.0):
    """Return the period that repeats under du (N_t, n, 3) [m] and N = N0 - k_n du_z (N_t, n) [N], from T = k_t (du_t - w0)."""
    n_samples = len(du)
    T = k_t[:, None] * (du[0, :, :2] - w0)
    T, _, at_once = line_step(T, 0.0 * T, N[0], N[0], mu, separate)
    size = np.abs(k_t[:, None] * du[..., :2]).max(axis=(0, 2)) + np.abs(mu * N).max(axis=0)

    ways = k_t[:, None] * (du[..., :2] - np.roll(du[..., :2], 1, axis=0))

    def period(T, which):
        n = len(which)
        given = [np.ascontiguousarray(x) for x in (T, ways[:, which], N[:, which], mu[which])]
        kept, area = np.empty((2, n_samples, n, 2))
        taken, slip = np.zeros((2, n))
        limits = separate[which].astype(np.uint8)
        compiled("path").period(*arguments(n_samples, n, *given, limits, kept, area, taken, slip))
        return Cycle(kept, area, slip, np.abs(kept[0] - T).max(axis=1))

    every = np.arange(len(k_t))
    cycle, before = period(T, every), np.zeros(len(k_t))
    for _ in range(PLAIN if n_samples > 1 else 0):
        if np.all(cycle.change <= REPEATS * size):
            break
        cycle, before = period(cycle.T[0], every), cycle.change
    drifts = np.flatnonzero(cycle.change > REPEATS * size)
    slow = (cycle.change > 0.5 * before) & (cycle.change > 1e-15 * size) & (before > 0.0)  # little a period, and much in all
    cycle.change[slow] /= np.maximum(1.0 - cycle.change[slow] / before[slow], 1e-6)
    T, slowest = cycle.T[0, drifts], np.zeros(len(drifts))
    for _ in range(MORE if len(drifts) else 0):  # a jump may lead beyond the end of the way, to where nothing moves the slider
        one = period(T, drifts)
        T = one.T[0]
        if np.all(one.change <= 1e-15 * size[drifts]):
            break
    for _ in range(JUMPS if len(drifts) else 0):  # Aitken's formula
        one = period(T, drifts)
        two = period(one.T[0], drifts)
        c, d = one.T[0] - T, two.T[0] - one.T[0]
        rate = (c * d).sum(axis=1) / np.maximum((c * c).sum(axis=1), 1e-300)
        rate = np.where((two.slip > 1e-13 * size[drifts]) & (rate > 0.0) & (rate < 1.0), rate, 0.0)
        T, slowest = two.T[0] + d * (rate / (1.0 - rate))[:, None], np.maximum(rate, slowest)
        if np.all(two.change <= 1e-15 * size[drifts]):  # rounding alone
            break
    if len(drifts):
        last = period(T, drifts)
        for name in ("T", "area"):
            getattr(cycle, name)[:, drifts] = getattr(last, name)
        left = np.maximum(two.change, 1e-15 * size[drifts]) / (1.0 - slowest)  # rounding, in all periods to come
        cycle.slip[drifts], cycle.change[drifts] = last.slip, np.maximum(last.change, left)
    return cycle if n_samples > 1 else Cycle(cycle.T, cycle.area, at_once, cycle.change)


def normal_area(N):
    """Return the mean of min(N, 0), less that of its straight line, over the steps that lead to the samples, (N_t, n)."""
    before = np.roll(N, 1, axis=0)
    with np.errstate(all="ignore"):
        area = 0.5 * np.abs(N * before) / np.abs(N - before)
    return np.where((N > 0.0) != (before > 0.0), area, 0.0)


def shared(area):
    """Return what areas (N_t, ...) of steps add to the samples: half to each end."""
    return 0.5 * (area + np.roll(area, -1, axis=0))
