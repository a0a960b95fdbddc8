"""Measured responses: rows of frequency, amplitude and phase of outputs at levels, or of peaks, from files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..messages.errors import CaseError
from ..messages.words import counted, hint, listed
from .csv_table import numbered_rows
from .measured_files import functions, variables

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
UNITS = {"m": LENGTHS, "m/s": {f"{name}/s": size for name, size in LENGTHS.items()}, "N": {"N": 1.0, "kN": 1e3}}
UNITS["m/s2"] = {f"{name}/s2": size for name, size in LENGTHS.items()} | {"g": 9.80665}
FREQUENCIES, PEAKS = {"frequency_hz": 1.0, "frequency_khz": 1e3}, {"peak_frequency_hz": 1.0, "peak_frequency_khz": 1e3}
PHASES = {"phase_rad": 1.0, "phase_deg": np.pi / 180.0}
UNIVERSAL = (".unv", ".uff", ".uf")  # endings of universal files
LEVELS = {"level_n": 1.0, "level_kn": 1e3, "level": 1.0}
_SPELLED = {"hz": "Hz", "khz": "kHz", "n": "N", "kn": "kN"}  # units, in names that are compared in small letters


@dataclass(frozen=True, eq=False)
class Measured:
    """n measured rows, of points of curves or of peaks; NaN where a row does not have a number."""

    frequency: np.ndarray  # (n,) Hz
    level: np.ndarray  # (n,) N
    output: np.ndarray  # (n,) numbers of the outputs
    amplitude: np.ndarray  # (n,) in the unit of the output
    phase: np.ndarray  # (n,) rad
    deviation: np.ndarray  # (n,) standard deviation of the amplitude
    deviation_of_phase: np.ndarray  # (n,) rad
    deviation_of_frequency: np.ndarray  # (n,) Hz, of peaks
    of_peaks: bool = False

    @property
    def n(self) -> int:
        """The number of rows."""
        return len(self.frequency)

    def rows(self, chosen: np.ndarray) -> Measured:
        """Return some of the rows.  Local."""
        arrays = {name: values[chosen] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return replace(self, **arrays)


def read_measured(
    path: Path,
    outputs: Sequence[str],
    units: Sequence[str],
    levels: Sequence[float],
    frequencies: tuple[float, float] | None = None,
) -> Measured:
    """Return the rows of a CSV file with a header, a MATLAB file with variables of the same names, or a universal file.  Local.

    Parameters
    ----------
    outputs, units : names and units of the outputs of the scene
    levels : of the scene [N]; rows without a level belong to the only one
    frequencies : range of the scene [Hz], outside which lines of a universal file are left out and rows refused; None for all

    Raises
    ------
    CaseError : states the fault, with the line
    """
    if path.suffix.lower() == ".mat":
        return _within(measured_of(_of_one_length(variables(path), path), str(path), outputs, units, levels), frequencies, path)
    if path.suffix.lower() in UNIVERSAL:
        return measured_of(functions(path, outputs, units, levels, frequencies), str(path), outputs, units, levels)
    numbered = numbered_rows(path)
    if len(numbered) < 2:
        raise CaseError(f"{path}: a header and at least one row are expected; {_expected()}")
    (line, header), *rest = numbered
    if ";" in header[0]:
        raise CaseError(f"{path}, line {line}: values are separated by semicolons, not by commas")
    for at, row in rest:
        if len(row) != len(header):
            raise CaseError(f"{path}, line {at}: {len(row)} values; {len(header)} are needed: {','.join(header)}")
    columns = {name: [row[i] for _, row in rest] for i, name in enumerate(header)}
    lines = [at for at, _ in rest]
    return _within(measured_of(columns, str(path), outputs, units, levels, lines), frequencies, path, lines)


def _within(rows: Measured, frequencies: tuple[float, float] | None, path: Path, lines: Sequence[int] = ()) -> Measured:
    """Return measured rows; CaseError where one lies outside a range of frequencies."""
    low, high = frequencies or (0.0, np.inf)
    outside = np.flatnonzero((rows.frequency < low) | (rows.frequency > high))
    if len(outside):
        where = f", line {lines[outside[0]]}" if lines else f", value {outside[0] + 1}"
        raise CaseError(
            f"{path}{where}: {rows.frequency[outside[0]]:g} Hz lies outside [response] frequencies, {low:g} to {high:g} Hz "
            f"({len(outside)} of {counted(rows.n, 'row')}); widen these or leave the rows out"
        )
    return rows


def measured_of(
    columns: Mapping[str, Any],
    where: str,
    outputs: Sequence[str],
    units: Sequence[str],
    levels: Sequence[float],
    lines: Sequence[int] = (),
) -> Measured:
    """Return columns by name, (n,) each, as measured rows.  Local.  CaseError as :func:`read_measured`."""
    given = {name.strip().lower(): values for name, values in columns.items()}
    if len(given) < len(columns):
        raise CaseError(f"{where}: a column appears twice; {_expected()}")
    n = len(next(iter(given.values()), ()))

    def numbers(name: str) -> np.ndarray:
        return _numbers(given.pop(name), name, where, lines)

    def one_of(kind: Mapping[str, float]) -> np.ndarray:
        names = [name for name in kind if name in given]
        if len(names) > 1:
            raise CaseError(f"{where}: {listed(list(map(_spelled, names)), 'and')} state the same; keep one")
        return kind[names[0]] * numbers(names[0]) if names else np.full(n, np.nan)

    named = given.pop("output", None)
    which = np.zeros(n, dtype=int) if named is None else _outputs(named, outputs, where)
    of_units = {units[k] for k in which}
    if len(of_units) > 1:
        raise CaseError(f"{where}: outputs in {listed(sorted(of_units), 'and')}: put those of one unit in each file")
    unit = of_units.pop() if of_units else "m"
    of_unit = UNITS.get(unit, {unit: 1.0})
    sizes = {f"amplitude_{name}".lower(): size for name, size in of_unit.items()}
    spreads = {f"sigma_{of}{name}".lower(): size for of in ("", "amplitude_") for name, size in of_unit.items()}
    peaks, frequency = one_of(PEAKS), one_of(FREQUENCIES)
    of_peaks = bool(np.isfinite(peaks).any())
    if of_peaks and np.isfinite(frequency).any():
        raise CaseError(f"{where}: frequency and peak_frequency both; put points of curves and peaks in files of their own")
    measured = Measured(
        frequency=peaks if of_peaks else frequency,
        level=one_of(LEVELS),
        output=which,
        amplitude=one_of(sizes),
        phase=one_of(PHASES),
        deviation=one_of(spreads),
        deviation_of_phase=one_of({f"sigma_{name}": size for name, size in PHASES.items()}),
        deviation_of_frequency=one_of({"sigma_frequency_hz": 1.0}),
        of_peaks=of_peaks,
    )
    if given:
        known = ["output", *FREQUENCIES, *PEAKS, *LEVELS, *sizes, *PHASES, *spreads, "sigma_phase_rad", "sigma_frequency_hz"]
        name = next(iter(given))
        bare = name.split("_")[0] in ("frequency", "amplitude", "phase", "peak", "sigma") and name not in known
        more = f"; the outputs are in {unit}: state the unit in the name" if bare else ""
        near = hint(_spelled(name), list(map(_spelled, known)))
        raise CaseError(f'{where}: the column "{_spelled(name)[:40]}" is unknown{near}{more}; {_expected(unit)}')
    return _checked(measured, where, levels, unit)


def _checked(measured: Measured, where: str, levels: Sequence[float], unit: str) -> Measured:
    """Return the rows with their levels.  CaseError: a number is missing, or out of range."""
    if not np.isfinite(measured.frequency).all() or not (measured.frequency > 0.0).all():
        raise CaseError(f"{where}: every row needs a frequency above 0; {_expected(unit)}")
    if not (measured.of_peaks or np.isfinite(measured.amplitude).any() or np.isfinite(measured.phase).any()):
        raise CaseError(f"{where}: there is neither an amplitude nor a phase; {_expected(unit)}")
    if (missing := np.isnan(measured.level)).any():
        if len(levels) != 1:
            raise CaseError(f"{where}: the scene has {counted(len(levels), 'level')}, and no column level_N states that of a row")
        measured = replace(measured, level=np.where(missing, levels[0], measured.level))
    for name, values in (("level", measured.level), ("amplitude", measured.amplitude), ("sigma", measured.deviation)):
        if (values <= 0.0).any():
            raise CaseError(f"{where}: {name} = {values[values <= 0.0][0]:g}: a number above 0 is expected")
    return measured


def _expected(unit: str = "m") -> str:
    return (
        f"columns are frequency_Hz (or peak_frequency_Hz of peaks), amplitude_{unit}, phase_rad or phase_deg, level_N, output, "
        f"and standard deviations sigma_{unit}, sigma_phase_rad, sigma_frequency_Hz"
    )


def _spelled(name: str) -> str:
    """Return the name of a column in small letters with its unit as it is written."""
    head, line, unit = name.rpartition("_")
    return f"{head}{line}{_SPELLED.get(unit, unit)}"


def _outputs(named: Sequence[Any], outputs: Sequence[str], where: str) -> np.ndarray:
    names = [str(name).strip() for name in named]
    for name in names:
        if name not in outputs:
            raise CaseError(f'{where}: there is no output "{name[:40]}"{hint(name, outputs)}; there are {listed(outputs)}')
    return np.array([outputs.index(name) for name in names], dtype=int)


def _numbers(values: Sequence[Any], name: str, where: str, lines: Sequence[int]) -> np.ndarray:
    """Return a column as numbers; an empty cell is NaN."""
    column = np.full(len(values), np.nan)
    for i, value in enumerate(values):
        if isinstance(value, str) and not value.strip():
            continue
        try:
            column[i] = float(value)
        except (TypeError, ValueError):
            column[i] = np.inf
        if np.isinf(column[i]) or (isinstance(value, str) and np.isnan(column[i])):
            line = f", line {lines[i]}" if len(lines) else ""
            raise CaseError(f'{where}{line}: {_spelled(name)} = "{str(value)[:20]}" is not a finite number')
    return column


def _of_one_length(columns: dict[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    lengths = {len(values) for values in columns.values() if values.ndim == 1}
    if len(lengths) != 1 or any(values.ndim != 1 for values in columns.values()):
        raise CaseError(f"{path}: variables of one length, named like columns, are expected; {_expected()}")
    return columns
