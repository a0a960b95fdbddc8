"""Sensitivities of a result: derivatives by the numbers of a scene, and the table of them.  NumPy only."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from ..fourier.coefficients import amplitude
from ..messages.errors import CaseError
from ..messages.words import hint
from ..points.peak import Peak
from ..points.quantities import Column, hertz
from ..points.sensitivities import COMMON, NUMBERS, of_size
from .record import Joint, LevelResult, ResultFile
from .table import write_table

NAME = "sensitivities.csv"
NEAR_TOP = 0.99  # of the amplitude of the highest point: a peak that is lower is another one
COLUMNS = (
    Column("level_N", "level"),
    Column("of", "`point` of a curve, or `peak`"),
    Column("number", "number of the point on its curve, or of the peak, from 0"),
    Column("frequency_Hz", "frequency of the excitation"),
    Column("output", "name of the output"),
    Column("amplitude_m", "amplitude of harmonic 1"),
    Column("parameter", "number of the scene by which the derivatives are"),
    Column("value", "its value"),
    Column("unit", "its unit"),
    Column("d_amplitude", "derivative of the amplitude; of a peak that of the peak, whose frequency changes as well"),
    Column("d_phase_rad", "of the phase"),
    Column("d_frequency_Hz", "of the frequency of a peak; empty of a point"),
    Column("relative", "change of the amplitude in per cent with 1 % of the value"),
    Column("unit_of_output", "unit of the output: that of its amplitude, also if the column ends in `_m`"),
)


@dataclass(frozen=True, eq=False)
class Varied:
    """A number of a scene, and how those of the pairs follow from it."""

    key: str  # "joints.NAME.friction", "level", "damping.ratio", ...
    unit: str
    value: float | None  # None: the level of the points
    number: str  # of ``NUMBERS``, or of ``COMMON``
    pairs: np.ndarray  # (m,) of the joint
    weights: np.ndarray  # (m,) rate of the number of each; () of a common one

    def rate(self, by_pairs: np.ndarray, by_common: np.ndarray) -> np.ndarray:
        """Return derivatives (...,) from those by all pairs (..., n_numbers, n_pairs) and by common numbers (..., n_common)."""
        if self.number in COMMON:
            return by_common[..., COMMON.index(self.number)] * self.weights
        return by_pairs[..., NUMBERS.index(self.number), self.pairs] @ self.weights


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives of amplitude and phase of harmonic 1 of the outputs at the points of all levels, padded with nan."""

    amplitude: np.ndarray  # (n_levels, n, n_outputs), by each pair (n_levels, n, n_outputs, n_pairs)
    phase: np.ndarray  # of the same shape


@dataclass(frozen=True, eq=False)
class OfPeak:
    """Derivatives of a peak by one number."""

    amplitude: float
    phase: float  # rad
    frequency: float  # Hz


@dataclass(frozen=True, eq=False)
class Scatter:
    """Standard deviations to first order, from those of independent numbers."""

    amplitude: np.ndarray  # (n_levels, n, n_outputs) of points, padded with nan
    peaks: dict[float, list[tuple[float, float]]]  # by level: of amplitude and frequency [Hz] of each peak with derivatives


class SensitivityTable(Mapping[str, Derivative]):
    """Derivatives by the numbers of a scene, by key, and by numbers of each pair: "mu", "N0", "k_t", "k_n", "slip_force"."""

    def __init__(self, results: ResultFile, varied: Sequence[Varied]):
        self.results, self.varied = results, {each.key: each for each in varied}

    def __iter__(self) -> Iterator[str]:
        return iter(self.varied)

    def __len__(self) -> int:
        return len(self.varied)

    @cached_property
    def levels(self) -> list[LevelResult]:
        """The levels, which must have derivatives."""
        if any(level.d_by_pairs is None for level in self.results.levels):
            raise CaseError("there are no sensitivities; state sensitivities=True, or [response] sensitivities = true")
        return list(self.results.levels)

    def __getitem__(self, key: str) -> Derivative:
        """Return the derivatives by a number of the scene, or by one of each pair.

        Raises
        ------
        CaseError : an unknown key, or a response without sensitivities
        """
        if key not in self.varied and key not in NUMBERS:
            raise CaseError(f"sensitivity: there is no number {key!r}{hint(key, [*self.varied, *NUMBERS])}")
        both = [of_size_at(level, self._rate(level, key)) for level in self.levels]
        return Derivative(*(_padded([parts[i] for parts in both]) for i in (0, 1)))

    def _rate(self, level: LevelResult, key: str) -> np.ndarray:
        if key in NUMBERS:
            return level.d_by_pairs[:, :, :, NUMBERS.index(key)]
        return self.varied[key].rate(level.d_by_pairs, level.d_by_common)

    def of_peaks(self, level: float) -> list[tuple[Peak, dict[str, OfPeak]]]:
        """Return the peaks of a level [N] with their derivatives by key; none where no solution next to a peak is known."""
        at_level = next((each for each in self.levels if each.level == level), None)
        if at_level is None or at_level.peaks is None:
            raise CaseError(f"sensitivity: there are no peaks of a level {level:g}; state peaks = true")
        return [(peak, peak_rates(peak, self.varied.values())) for peak in at_level.peaks]

    def scatter(self, deviations: Mapping[str, float]) -> Scatter:
        """Return the first-order effect of scattered numbers: ``deviations`` are standard deviations in per cent, by key.

        Raises
        ------
        CaseError : an unknown key, a deviation below 0, or a response without sensitivities
        """
        for key, percent in deviations.items():
            if key not in self.varied:
                raise CaseError(f"scatter: there is no number {key!r}{hint(key, list(self.varied))}")
            if not percent >= 0.0:
                raise CaseError(f"scatter: {key} = {percent}: a deviation in per cent of at least 0 is expected")
        squares: list[np.ndarray] = []
        peaks: dict[float, list[tuple[float, float]]] = {}
        for level in self.levels:
            units = {key: 0.01 * percent * value_at(self.varied[key], level.level) for key, percent in deviations.items()}
            changes = [units[key] * of_size_at(level, self._rate(level, key))[0] for key in deviations]
            squares.append(np.sqrt(sum(change**2 for change in changes)) + np.zeros(level.response.shape[:2]))
            rates = [peak_rates(peak, self.varied.values()) for peak in level.peaks or ()]
            peaks[level.level] = [
                (
                    float(np.sqrt(sum((units[key] * of[key].amplitude) ** 2 for key in deviations))),
                    float(np.sqrt(sum((units[key] * of[key].frequency) ** 2 for key in deviations))),
                )
                for of in rates
                if of
            ]
        return Scatter(_padded(squares), peaks)


def value_at(varied: Varied, level: float) -> float:
    """Return the value of a number at a level."""
    return level if varied.value is None else varied.value


def of_size_at(level: LevelResult, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives of amplitude and phase at the points of a level from those of the quadratures (n, n_outputs, 2, ...)."""
    cos, sin = (level.response[:, :, i].reshape(*level.response.shape[:2], *[1] * (rate.ndim - 3)) for i in (1, 2))
    return of_size(cos, sin, rate[:, :, 0], rate[:, :, 1])


def peak_rates(peak: Peak, varied: Iterable[Varied]) -> dict[str, OfPeak]:
    """Return the derivatives of a peak by key; none where they are not known."""
    if peak.by_pairs is None or peak.by_common is None:
        return {}
    return {each.key: OfPeak(*map(float, each.rate(peak.by_pairs, peak.by_common))) for each in varied}


def relative_of_pairs(joint: Joint, level: LevelResult, at: int) -> dict[str, np.ndarray]:
    """Return the relative change of the first amplitude at a point with that of a number of each pair, (n_pairs,) each.  Local.

    By the name of the number; none without sensitivities.  Their sum over a joint is that by the joint's number.
    """
    if level.d_by_pairs is None:
        return {}
    size = float(amplitude(level.response[at, 0]))
    return _relative(joint, of_size_at(level, level.d_by_pairs)[0][at, 0], size or 1.0)


def _relative(joint: Joint, rates: np.ndarray, size: float) -> dict[str, np.ndarray]:
    """Return the relative changes by name from the derivatives (n_numbers, n_pairs) of an amplitude."""
    columns = {"mu": joint.mu, "N0": joint.N0, "k_t": joint.k_t, "k_n": joint.k_n}
    return {name: np.nan_to_num(column) * rates[NUMBERS.index(name)] / size for name, column in columns.items()}


def relative_at_peak(joint: Joint, level: LevelResult) -> tuple[float, dict[str, np.ndarray], float]:
    """Return the frequency [Hz] of the first output's peak, and its relative change with numbers of each pair and with damping.

    Of a level with sensitivities: at the peak that was solved for, at its own frequency, or else at the highest point.
    """
    of_output = [peak for peak in level.peaks or () if peak.output == 0]
    peak = max(of_output, key=lambda peak: abs(peak.amplitude), default=None)
    size = float(amplitude(level.response[level.top, 0]))
    if peak is None or peak.by_pairs is None or peak.by_common is None or abs(peak.amplitude) < NEAR_TOP * size:
        by_damping = float(of_size_at(level, level.d_by_common)[0][level.top, 0, COMMON.index("damping")]) / (size or 1.0)
        return float(level.frequency[level.top]), relative_of_pairs(joint, level, level.top), by_damping
    size = abs(peak.amplitude)
    by_damping = float(peak.by_common[0, COMMON.index("damping")]) / size
    return hertz(peak.omega), _relative(joint, peak.by_pairs[0], size), by_damping


def write_sensitivities(folder: str, results: ResultFile, varied: Sequence[Varied]) -> None:
    """Write the table of all points and peaks; nothing where no level has sensitivities.  Local, on rank 0.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    levels = [level for level in results.levels if level.d_by_pairs is not None]
    if levels:
        rows = chain.from_iterable(_rows(results, level, varied) for level in levels)
        write_table(os.path.join(folder, NAME), [column.name for column in COLUMNS], rows)


def _rows(results: ResultFile, level: LevelResult, varied: Sequence[Varied]) -> Iterator[list[object]]:
    sizes = amplitude(level.response)
    rates = [(each, *of_size_at(level, each.rate(level.d_by_pairs, level.d_by_common))) for each in varied]
    for i, frequency in enumerate(level.frequency):
        for k in range(len(results.outputs)):
            for each, d_size, d_phase in rates:
                yield _row(results, level, each, "point", i, frequency, k, sizes[i, k], (d_size[i, k], d_phase[i, k]))
    for i, peak in enumerate(level.peaks or ()):
        of_peak = peak_rates(peak, varied)
        for each in varied if of_peak else ():
            d = of_peak[each.key]
            rate = d.amplitude, d.phase, d.frequency
            yield _row(results, level, each, "peak", i, hertz(peak.omega), peak.output, abs(peak.amplitude), rate)


def _row(results, level, varied, of, i, frequency, k, size, rate) -> list[object]:
    value = value_at(varied, level.level)
    cells = [f"{x:.13g}" for x in rate] + [""] * (3 - len(rate))
    relative = value * rate[0] / size if size > 0.0 else 0.0
    return [
        *(f"{level.level:.13g}", of, i, f"{frequency:.13g}", results.outputs[k], f"{size:.13g}"),
        *(varied.key, f"{value:.13g}", varied.unit, *cells, f"{relative:.6g}", results.unit_of(k)),
    ]


def _padded(parts: list[np.ndarray]) -> np.ndarray:
    """Return the arrays of all levels as one, padded with nan."""
    shape = np.max([part.shape for part in parts], axis=0)
    padded = np.full((len(parts), *shape), np.nan)
    for row, part in zip(padded, parts):
        row[tuple(map(slice, part.shape))] = part
    return padded
