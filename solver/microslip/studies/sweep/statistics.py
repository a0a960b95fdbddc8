"""Statistics of samples: percentiles with their ranges, the effect of each number on the peak.  Local."""

from dataclasses import dataclass

import numpy as np

from ...library.sweep import SweepTable

PERCENTILES = (5, 50, 95)
RESAMPLED = 1000  # times


@dataclass(frozen=True)
class Effect:
    """The effect of one number on the amplitude of the peak, others unchanged."""

    key: str
    ends: tuple[float, float]  # of the number: its least and largest, or of samples their percentiles 5 and 95
    low: float  # the amplitude at the first end
    high: float  # the amplitude at the second end
    explained: float = float("nan")  # share of the variance that all numbers linearly explain; NaN where nothing was fitted

    @property
    def size(self) -> float:
        """The change of the amplitude between the two ends."""
        return abs(self.high - self.low)


def percentiles(values: np.ndarray) -> list[tuple[int, float, float, float]]:
    """Return percentiles of samples (n,), each with the range that 95 % of resampled sets have.  Local."""
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return []
    rng = np.random.default_rng(0)
    resampled = np.percentile(rng.choice(values, (RESAMPLED, len(values))), PERCENTILES, axis=1)
    ranges = np.percentile(resampled, [2.5, 97.5], axis=1).T
    values_at = np.percentile(values, PERCENTILES)
    return [(p, float(value), float(low), float(high)) for p, value, (low, high) in zip(PERCENTILES, values_at, ranges)]


def effects_of(table: SweepTable) -> list[Effect]:
    """Return the effects of numbers by falling size: as computed one by one, or by a straight plane through samples.  Local."""
    design, y = table.design, table["amplitude"]
    if design.kind == "one by one":
        effects = [_alone(table, j) for j in range(len(design.keys))]
    elif design.is_grid or np.isfinite(y).sum() < 2 * len(design.keys) + 2:
        return []
    else:
        effects = _by_plane(table)
    return sorted((effect for effect in effects if effect is not None), key=lambda effect: -effect.size)


def _alone(table: SweepTable, j: int) -> Effect | None:
    """Return the effect of the j-th number in the samples in which it alone differs from the scene."""
    x, y = table.design.values, table["amplitude"]
    nominal = np.array(table.nominal.values)
    alone = np.flatnonzero((np.delete(x, j, 1) == np.delete(nominal, j)).all(axis=1) & np.isfinite(y))
    if len(alone) < 2:
        return None
    low, high = alone[np.argmin(x[alone, j])], alone[np.argmax(x[alone, j])]
    return Effect(table.design.keys[j], (float(x[low, j]), float(x[high, j])), float(y[low]), float(y[high]))


def _by_plane(table: SweepTable) -> list[Effect | None]:
    """Return the effects by a plane of least squares through the logarithm of the amplitude."""
    y, x = table["amplitude"], table.design.values
    known = np.isfinite(y)
    x, log_y = x[known], np.log(y[known])
    centre, scale = x.mean(axis=0), np.where(x.std(axis=0) > 0.0, x.std(axis=0), 1.0)
    A = np.column_stack([np.ones(len(x)), (x - centre) / scale])
    plane, *_ = np.linalg.lstsq(A, log_y, rcond=None)
    variance = float(np.var(log_y))
    explained = 1.0 - float(np.var(log_y - A @ plane)) / variance if variance > 0.0 else float("nan")
    ends = np.percentile(x, [5, 95], axis=0)
    amplitudes = np.exp(plane[0] + plane[1:] * (ends - centre) / scale)
    return [
        Effect(key, (float(a), float(b)), float(low), float(high), explained)
        for key, a, b, low, high in zip(table.design.keys, *ends, *amplitudes)
    ]
