"""The contact law along the straight line between samples, and its steady cycle: docs/theory.md, eq. (3.6) and (3.7).

It uses the friction force T and angles (path.c); the program moves sliders, by formulas without angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .compiled import arguments, compiled

PLAIN, MORE, JUMPS = 12, 500, 40  # periods marched one by one; further periods of pairs that drift; then jumps
REPEATS = 1e-14  # change of T per period of a steady cycle, relative to the forces of the pair


def line_step(T, q, N_i, N_j, mu, separate):
    """Return T after a step, the mean of p less its straight line over the step, and the reduction of T by slip.

    ``T`` (n, 2) before the step; ``q`` (n, 2) = k_t d(du_t) along it; N_i, N_j (n,) = N0 - k_n du_z at its ends, open where not
    positive [N].  Exact for the straight line, except for the rotation of T during slip, of second order in the step.
    """
    T, area, taken = np.array(T, dtype=float), np.empty(np.shape(T)), np.empty(len(T))
    given = [np.ascontiguousarray(x, dtype=float) for x in (q, N_i, N_j, mu)]
    compiled("path").line_step(*arguments(len(T), T, *given, np.ascontiguousarray(separate, dtype=np.uint8), area, taken))
    return T, area, taken


@dataclass(frozen=True)
class Cycle:
    """A period of n pairs; the first axis are the samples."""

    T: np.ndarray  # (N_t, n, 2) N
    area: np.ndarray  # (N_t, n, 2) N, of the steps that lead to the samples
    slip: np.ndarray  # (n,) N, largest reduction of T by slip in a step
    change: np.ndarray  # (n,) N, of T over the period; for pairs that drift, a bound of the whole remaining change


def steady(du, N, k_t, mu, separate, w0=0.0):
    """Return the steady period under du (N_t, n, 3) [m] and N = N0 - k_n du_z (N_t, n) [N], from T = k_t (du_t - w0)."""
    n_samples = len(du)
    T = k_t[:, None] * (du[0, :, :2] - w0)
    T, _, at_once = line_step(T, 0.0 * T, N[0], N[0], mu, separate)
    size = np.abs(k_t[:, None] * du[..., :2]).max(axis=(0, 2)) + np.abs(mu * N).max(axis=0)

    ways = k_t[:, None] * (du[..., :2] - np.roll(du[..., :2], 1, axis=0))

    def period(T, which):
        n = len(which)
        given = [np.ascontiguousarray(x) for x in (T, ways[:, which], N[:, which], mu[which])]
        recorded, area = np.empty((2, n_samples, n, 2))
        taken, slip = np.zeros((2, n))
        limits = separate[which].astype(np.uint8)
        compiled("path").period(*arguments(n_samples, n, *given, limits, recorded, area, taken, slip))
        return Cycle(recorded, area, slip, np.abs(recorded[0] - T).max(axis=1))

    every = np.arange(len(k_t))
    cycle, before = period(T, every), np.zeros(len(k_t))
    for _ in range(PLAIN if n_samples > 1 else 0):
        if np.all(cycle.change <= REPEATS * size):
            break
        cycle, before = period(cycle.T[0], every), cycle.change
    drifts = np.flatnonzero(cycle.change > REPEATS * size)
    slow = (cycle.change > 0.5 * before) & (cycle.change > 1e-15 * size) & (before > 0.0)  # small per period, but large in total
    cycle.change[slow] /= np.maximum(1.0 - cycle.change[slow] / before[slow], 1e-6)
    T, slowest = cycle.T[0, drifts], np.zeros(len(drifts))
    for _ in range(MORE if len(drifts) else 0):  # a jump may lead beyond the end of the drift, where nothing moves the slider
        first = period(T, drifts)
        T = first.T[0]
        if np.all(first.change <= 1e-15 * size[drifts]):
            break
    for _ in range(JUMPS if len(drifts) else 0):  # Aitken's formula
        first = period(T, drifts)
        second = period(first.T[0], drifts)
        c, d = first.T[0] - T, second.T[0] - first.T[0]
        rate = (c * d).sum(axis=1) / np.maximum((c * c).sum(axis=1), 1e-300)
        rate = np.where((second.slip > 1e-13 * size[drifts]) & (rate > 0.0) & (rate < 1.0), rate, 0.0)
        T, slowest = second.T[0] + d * (rate / (1.0 - rate))[:, None], np.maximum(rate, slowest)
        if np.all(second.change <= 1e-15 * size[drifts]):  # only rounding remains
            break
    if len(drifts):
        last = period(T, drifts)
        for name in ("T", "area"):
            getattr(cycle, name)[:, drifts] = getattr(last, name)
        left = np.maximum(second.change, 1e-15 * size[drifts]) / (1.0 - slowest)  # rounding, in all later periods
        cycle.slip[drifts], cycle.change[drifts] = last.slip, np.maximum(last.change, left)
    return cycle if n_samples > 1 else Cycle(cycle.T, cycle.area, at_once, cycle.change)


def normal_area(N):
    """Return the mean of min(N, 0), less that of its straight line, over the steps that lead to the samples, (N_t, n)."""
    before = np.roll(N, 1, axis=0)
    with np.errstate(all="ignore"):
        area = 0.5 * np.abs(N * before) / np.abs(N - before)
    return np.where((N > 0.0) != (before > 0.0), area, 0.0)


def shared(area):
    """Return the contributions of the areas (N_t, ...) of steps to the samples: half to each end."""
    return 0.5 * (area + np.roll(area, -1, axis=0))
