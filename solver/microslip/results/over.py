"""Peaks over numbers of the scene in the files of a run: groups of results.h5 and a table."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import chain

import h5py
import numpy as np

from ..contact.law import OPEN, SLIP
from ..fourier.coefficients import phase
from ..points.peak import PEAK_QUANTITIES
from ..points.quantities import Column
from ..system.hdf5 import extended_hdf5
from .record import PeaksOver, ResultFile, peak_arrays
from .table import write_table
from .writer import common_unit, write_array, write_level

NAME = "peaks_over.csv"
COLUMNS = (
    Column("curve", "number of the curve, from 1: one for each table `[[response.over]]` and peak of the linear response"),
    Column("key", "the number that varies"),
    Column("value", "its value"),
    Column("unit", "its unit"),
    Column("output", "name of the output"),
    Column("frequency_Hz", "frequency of the peak"),
    Column("amplitude_m", "amplitude of harmonic 1 at the peak"),
    Column("phase_rad", "harmonic 1: u = amplitude · cos(ω t + phase)"),
    Column("per_level", "amplitude per unit of the level"),
    Column("damping", "damping ratio of one mode that has this amplitude per unit of the level"),
    Column("slipping", "numbers of pairs"),
    Column("open", "numbers of pairs"),
    Column("friction_J", "friction loss, a cycle"),
    Column("input_J", "work of the loads, a cycle"),
    Column("error_m", "error bar of the amplitude; empty without `error_bars`"),
    Column("unit_of_output", "unit of the output: that of its amplitude and error bar, also if their columns end in `_m`"),
)


def store_peaks_over(folder: str, head: ResultFile, curves: Sequence[PeaksOver]) -> None:
    """Add curves to results.h5, and write their table.  Local, on rank 0; each file is complete or as it was.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    path, units = os.path.join(folder, "results.h5"), [head.unit_of(k) for k in range(len(head.outputs))]
    with extended_hdf5(path, "over") as file:
        for i, curve in enumerate(curves):
            _write(file.create_group(f"over/{i:04d}"), curve, common_unit(units), units[curve.linear.output])
    rows = (_rows(i, curve, head.outputs[curve.linear.output], units[curve.linear.output]) for i, curve in enumerate(curves, 1))
    write_table(os.path.join(folder, NAME), [column.name for column in COLUMNS], chain.from_iterable(rows))


def _write(group: h5py.Group, curve: PeaksOver, unit: str, unit_of_output: str) -> None:
    group.attrs["key"], group.attrs["unit"] = curve.key, curve.unit
    write_array(group, "value", curve.value, curve.unit)
    write_array(group, "damping", curve.damping, "1")
    write_level(group.create_group("points"), curve.points, unit)
    arrays = peak_arrays([curve.linear])
    for quantity in (quantity for quantity in PEAK_QUANTITIES if quantity.dataset in arrays):
        of = f"{unit_of_output} per unit of the level" if quantity.unit == "m" else quantity.unit
        write_array(group, f"linear/peaks/{quantity.dataset}", arrays[quantity.dataset], of)


def _rows(number: int, curve: PeaksOver, output: str, unit: str) -> list[list[object]]:
    """Return the rows of a curve."""
    points, error, k = curve.points, curve.error, curve.linear.output
    counts = [np.count_nonzero(points.state == kind, axis=1) for kind in (SLIP, OPEN)]
    numbers = (
        (curve.frequency, curve.amplitude, phase(points.response[:, k]), curve.per_level, curve.damping),
        (points.friction, points.input),
    )
    return [
        [number, curve.key, f"{value:.13g}", curve.unit, output]
        + [f"{column[i]:.13g}" for column in numbers[0]]
        + [int(count[i]) for count in counts]
        + [f"{column[i]:.13g}" for column in numbers[1]]
        + ["" if error is None else f"{error[i]:.4g}", unit]
        for i, value in enumerate(curve.value)
    ]
