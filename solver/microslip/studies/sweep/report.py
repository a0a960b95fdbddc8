"""A sweep as tables and pictures: sweep.csv, sweep.h5, and the pictures of its design.  Rank 0 only."""

from pathlib import Path
from typing import Any

import h5py
import matplotlib
import numpy as np

from ...library.design import sobol_indices, sobol_intervals
from ...library.sample_peaks import DONE, FAILED, MISSING, OUTSIDE
from ...library.sweep import NUMBERS, SMOOTH, SweepTable
from ...messages.words import counted
from ...observe.screen_table import screen_table
from ...results.style import RC, some
from ...scene.schema import Scene
from ...system.files import atomic_write, make_folder, remove_files
from ...system.hdf5 import written_hdf5
from ..records import cell, write_csv
from .pictures import draw_bands, draw_effects, draw_grid, draw_indices, draw_map, draw_scatter
from .statistics import Effect, effects_of, percentiles

_ROWS = 16  # of the table on the screen
_LEAST = 8  # samples with a peak, from which percentiles are given
_OF_SOME_DESIGNS = ("sweep.png", "peak_map.png", "scatter.png", "tornado.png", "bands.png", "indices.png", "indices.csv")
_STATES = (DONE, FAILED, OUTSIDE, MISSING)


def write_sweep(table: SweepTable, scene: Scene, folder: Path, has_indices: bool = False) -> str:
    """Write the files of a sweep; return the text for the screen.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    remove_files(folder, *_OF_SOME_DESIGNS)
    rows = table.records()
    write_csv(str(folder / "sweep.csv"), rows[0], rows)
    write_arrays(table, scene.title, str(folder / "sweep.h5"))
    indices = _indices(table) if has_indices and table.is_done.any() else None
    effects = effects_of(table)
    if indices is not None:
        write_csv(str(folder / "indices.csv"), indices[0], indices)
    with matplotlib.rc_context(RC):
        _draw(table, scene, folder, effects, indices)
    lines = [_on_screen(table), *_percentiles_in_words(table), *map(_effect_in_words, effects), *_indices_in_words(indices)]
    missing = sum(sample.status == MISSING for sample in table.samples)
    lines += [f"{missing} of {counted(len(table), 'sample')} are not computed yet; the table has the others"] * (missing > 0)
    return "\n".join(lines)


def _draw(table: SweepTable, scene: Scene, folder: Path, effects: list[Effect], indices: list[dict] | None) -> None:
    if table.is_done.sum() < 2:
        return
    lengths = [n for n in table.design.shape if n > 1]
    if table.design.is_grid and len(lengths) == 1:
        draw_grid(table, scene, str(folder / "sweep.png"))
    elif table.design.is_grid and len(table.design.keys) == 2:
        draw_map(table, scene, str(folder / "peak_map.png"))
    else:
        draw_scatter(table, scene, str(folder / "scatter.png"))
    if effects:
        draw_effects(table, effects, scene, str(folder / "tornado.png"))
    if indices is not None:
        draw_indices(indices, scene, str(folder / "indices.png"))
    if table.curves is not None:
        draw_bands(table, scene, str(folder / "bands.png"))


# -- files -----------------------------------------------------------------------------------------------------------------


def write_arrays(table: SweepTable, title: str, path: str) -> None:
    """Write the table as HDF5 with named axes, dimension scales as netCDF-4 has them: xarray opens it.  Local."""
    design, axes = table.design, table.design.axes
    with atomic_write(path) as unfinished, written_hdf5(str(unfinished)) as file:
        for name, values in zip(axes, design.coordinates if design.is_grid else (np.arange(len(design)),)):
            _scale(file, name, values)
        if not design.is_grid:
            for key, values in zip(design.keys, design.coordinates):
                _dataset(file, key, values, axes, table.unit_of(key), "number of the scene")
        for key in design.keys:
            file[key].attrs["units"] = table.unit_of(key)
        for name, (_, meaning) in NUMBERS.items():
            _dataset(file, name, table.on_axes(name), axes, table.unit_of(name), meaning)
        status = np.array([_STATES.index(sample.status) for sample in table.samples], dtype="u1").reshape(design.shape)
        _dataset(file, "status", status, axes, "1", ", ".join(f"{i} {name}" for i, name in enumerate(_STATES)))
        if (curves := table.curves) is not None:
            _scale(file, "frequency_of_curve", table.frequencies)
            file["frequency_of_curve"].attrs["units"] = "Hz"
            shape = (*design.shape, len(table.frequencies))
            _dataset(file, "curve", curves.reshape(shape), (*axes, "frequency_of_curve"), table.unit, "amplitude along the curve")
        nominal = {name: getattr(table.nominal, name) for name in NUMBERS}
        file.attrs.update({"title": title, "output": table.output, "design": design.kind, "keys": list(design.keys)})
        file.attrs.update({f"scene_{name}": value for name, value in nominal.items()})


def _scale(file: h5py.File, name: str, values: np.ndarray) -> None:
    file.create_dataset(name, data=values).make_scale(name)


def _dataset(file: h5py.File, name: str, values: np.ndarray, axes: tuple[str, ...], unit: str, meaning: str) -> None:
    data = file.create_dataset(name, data=values)
    data.attrs["units"], data.attrs["long_name"] = unit, meaning
    for i, axis in enumerate(axes):
        data.dims[i].attach_scale(file[axis])


# -- words -----------------------------------------------------------------------------------------------------------------


def _on_screen(table: SweepTable) -> str:
    """Return the table for the screen: samples evenly spread."""
    head = ["sample", *table.design.keys, f"{table.output} {table.unit}", "frequency Hz", "width Hz", "damping %", "slip", "open"]
    head += ["error bar %"]
    rows = []
    for i in some(range(len(table)), _ROWS):
        sample = table.samples[i]
        numbers = [cell(float(value), 5) for value in sample.values]
        if sample.status == DONE:
            bar = 100.0 * sample.error / sample.amplitude
            cells = (sample.amplitude, 5), (sample.frequency, 7), (sample.width, 4), (100.0 * sample.damping, 4)
            numbers += [*(cell(value, digits) for value, digits in cells), str(sample.slipping), str(sample.open), cell(bar, 2)]
        else:
            numbers += [sample.status, *[""] * 6]
        rows.append((0, [str(i), *numbers]))
    return screen_table(f"peaks of {table.output}", head, rows)


def _percentiles_in_words(table: SweepTable) -> list[str]:
    if not table.design.is_random or table.is_done.sum() < _LEAST:
        return []
    lines = []
    for name in SMOOTH:
        rows = percentiles(table[name])
        text = ", ".join(f"P{p} {value:.5g} ({low:.5g} to {high:.5g})" for p, value, low, high in rows)
        lines.append(f"{name} [{table.unit_of(name)}]: {text}")
    return ["percentiles of the samples, and the ranges of 95 % of them by resampling:", *lines]


def _effect_in_words(effect: Effect) -> str:
    share = "" if np.isnan(effect.explained) else f" (all numbers linearly: R2 {effect.explained:.3f})"
    low, high, text = effect.low, effect.high, f"{effect.key} from {effect.ends[0]:.5g} to {effect.ends[1]:.5g}"
    return f"{text}: peak from {low:.5g} to {high:.5g}{share}"


def _indices(table: SweepTable) -> list[dict]:
    """Return main and total Sobol indices of each number with half of the ranges of 95 %, one record each."""
    d = len(table.design.keys)
    rows: list[dict[str, Any]] = [{"key": key} for key in table.design.keys]
    for name in SMOOTH:
        kinds = [f"{name}_{kind}" for kind in ("main", "total")]
        for kind, index, within in zip(kinds, sobol_indices(table[name], d), sobol_intervals(table[name], d)):
            for i, row in enumerate(rows):
                row |= {kind: float(index[i]), f"{kind}_within": float(within[i])}
    return rows


def _indices_in_words(indices: list[dict] | None) -> list[str]:
    if indices is None:
        return []
    head = ["key", *(f"{name} {kind}" for name in SMOOTH for kind in ("main", "total"))]
    shown = [[row["key"], *(row[f"{name}_{kind}"] for name in SMOOTH for kind in ("main", "total"))] for row in indices]
    rows = [(0, [cell(value, 3) if isinstance(value, float) else value for value in row]) for row in shown]
    return [
        screen_table(
            "Sobol indices: share of the variance by a number alone, and with all that it takes part in (ranges: indices.csv)",
            head,
            rows,
        )
    ]
