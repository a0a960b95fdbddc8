"""Growth of a small disturbance of a steady state, marched in time (docs/theory.md, section 10)."""

import numpy as np

from .march import March
from .scheme import Motion
from .steady import Start

DISTURBED = 1e-6  # of the motion
SHRUNK, GROWN = 1e-3, 1e2  # of the first change by a period, at which the march of a point ends
MOST_PERIODS = 200
FITTED = 0.5  # of the marched periods, the last ones, whose rate counts
LEAST_FITTED = 4  # periods


def growth(march: March, start: Start, seed: int = 1) -> np.ndarray:
    """Return the factor (B,) by which a random disturbance of each steady state changes in a period, fitted over many.  Local.

    Two motions are marched from each state, one of them disturbed.  What counts is how much their difference changes in a period:
    a slider that was moved and then rests, a neutral direction, changes nothing.  For a steady state that is not reached exactly
    the difference still follows the map of a period.

    Raises
    ------
    ConvergenceError : Newton's method does not converge in a step
    """
    B, rng = len(march.level), np.random.default_rng(seed)
    x = march.scheme.pack(start.z)
    noise = rng.standard_normal(x.shape)
    size = np.sqrt((x**2).sum(axis=(1, 2), keepdims=True) / np.maximum((noise**2).sum(axis=(1, 2), keepdims=True), 1e-300))
    pairs = march.take(np.tile(np.arange(B), 2))
    z = pairs.scheme.unpack(np.concatenate([x, x + DISTURBED * size * noise]))
    p, root = np.concatenate([start.p, start.p]), march.model.memory_scale
    changes: list[list[float]] = [[] for _ in range(B)]
    left, before = np.arange(B), _difference(pairs, z, p, root)
    for _ in range(MOST_PERIODS):
        z, p, _ = pairs.period(z, p)
        now = _difference(pairs, z, p, root)
        for i, change in zip(left, np.linalg.norm(now - before, axis=1)):
            changes[i].append(float(change))
        continues = np.array([SHRUNK * changes[i][0] < changes[i][-1] < GROWN * changes[i][0] for i in left])
        if not continues.any():
            break
        both = np.flatnonzero(np.tile(continues, 2))
        pairs, z, p = pairs.take(both), Motion(*(getattr(z, name)[both] for name in ("eta", "v", "a"))), p[both]
        left, before = left[continues], now[continues]
    return np.array([_rate(of_point) for of_point in changes])


def _difference(pairs: March, z: Motion, p: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the differences of motion and contact between the disturbed half of the points and the other, (B, n)."""
    both = np.concatenate([pairs.scheme.pack(z).reshape(len(p), -1), p / root], axis=1)
    return both[len(both) // 2 :] - both[: len(both) // 2]


def _rate(changes: list[float]) -> float:
    """Return the factor a period of a geometric sequence fitted to the last changes; 0 where the last is zero."""
    n = max(LEAST_FITTED, int(np.ceil(FITTED * len(changes))))
    last = np.array(changes[-n:])
    if not np.all(last > 0.0) or len(last) < 2:
        return 0.0
    return float(np.exp(np.polyfit(np.arange(len(last)), np.log(last), 1)[0]))
