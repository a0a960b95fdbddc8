"""An identification as tables, identified.csv and fit.csv, a picture and a scene.  Rank 0 only."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...formats.csv_table import numbered_rows
from ...library.fitted_numbers import IN_FILE
from ...library.identify import Identified
from ...library.settings import output_names, units_of
from ...observe.screen_table import screen_table
from ...results.style import FAINT, INK, RC, WIDTH, Page, level_colours, plain, with_prefix
from ...scene.inputs import named_files
from ...scene.toml_text import as_toml
from ...system.files import atomic_write, make_folder
from ..records import write_csv


def write_identified(result: Identified, scene: Any, folder: Path) -> str:
    """Write the files of an identification; return the table for the screen.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    rows = records(result)
    write_csv(str(folder / "identified.csv"), rows[0], rows)
    rows = fitted_rows(result, output_names(scene))
    write_csv(str(folder / "fit.csv"), rows[0], rows)
    with matplotlib.rc_context(RC):
        draw_fit(result, scene, str(folder / "fit.png"))
    tables = _relocated(result.scene, folder) | _with_pairs(result, folder)
    with atomic_write(str(folder / "identified.toml")) as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write("\n".join([*(f"# {line}" for line in in_words(result)), ""]) + as_toml(tables))
    return "\n".join([on_screen(result), *in_words(result)])


def records(result: Identified) -> list[dict[str, Any]]:
    """Return one record per number, by the names of the columns of identified.csv."""
    return [
        {
            "parameter": key,
            "unit": result.units[i],
            "start": float(result.start[i]),
            "value": float(result.values[i]),
            "low": float(result.low[i]),
            "high": float(result.high[i]),
            "seen": int(key not in result.unseen),
            **{f"correlation with {other}": float(result.correlation[i, j]) for j, other in enumerate(result.keys)},
        }
        for i, key in enumerate(result.keys)
    ]


def fitted_rows(result: Identified, outputs: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return one record per measured row, by the names of the columns of fit.csv."""
    data = {"measured": result.measured, "fit": result.fit, "before": result.before}
    columns = {f"{name}_{of}": values for of, rows in data.items() for name, values in _columns(rows).items()}
    return [
        {"level": float(result.measured.level[i]), "output": outputs[result.measured.output[i]]}
        | {name: float(values[i]) for name, values in columns.items()}
        for i in range(result.measured.n)
    ]


def _columns(rows: Any) -> dict[str, np.ndarray]:
    return {"frequency_Hz": rows.frequency, "amplitude": rows.amplitude, "phase_rad": rows.phase}


def on_screen(result: Identified) -> str:
    """Return the table of the numbers."""
    head = ("number", "unit", "scene", "found", "95 % from", "to", "largest correlation")
    others = np.abs(result.correlation)
    np.fill_diagonal(others, -1.0)
    largest = [f"{result.correlation[i, j]:+.2f} {result.keys[j]}" for i, j in enumerate(others.argmax(axis=1))]
    columns = result.start, result.values, result.low, result.high
    rows = [
        (0, (key, result.units[i], *(f"{values[i]:.5g}" for values in columns), more))
        for i, (key, more) in enumerate(zip(result.keys, largest if len(result.keys) > 1 else ["\u2013"]))
    ]
    return screen_table("numbers that explain the measurement", head, rows, left=("number", "unit", "largest correlation"))


def in_words(result: Identified) -> list[str]:
    """Return the lines on an identification."""
    lines = [] if result.is_converged else [
        f"least squares has not converged within {result.evaluations} evaluations: values and intervals are those of the last; "
        "fit fewer numbers, narrow their bounds or begin nearer"
    ]  # fmt: skip
    assumed = "" if result.has_deviations else "; those not stated are assumed, and the intervals follow from the residuals"
    lines += [
        f"residuals over their deviations: {result.rms:.3g} (root mean square{assumed}) with {max(result.dof, 0)} degrees of "
        f"freedom, after {result.evaluations} evaluations; {result.outcome}"
    ]
    if result.dof <= 0 and not result.has_deviations:
        lines.append("as many numbers as rows: these data give no intervals; measure more rows or fit fewer numbers")
    if not result.is_explained:
        lines.append(
            "the model does not explain the data within the stated deviations: the intervals do not hold; other numbers of the "
            "scene are wrong, the model lacks something, or the deviations are larger"
        )
    lines += [f"{key}: the data do not depend on it; its interval is that of the bounds" for key in result.unseen]
    lines += [f"{a} and {b}: the data determine only a combination of both (correlation {c:+.3f})" for a, b, c in result.alike]
    lines += [f"{key}: at a bound; widen it, or the model lacks something" for key in result.at_bounds]
    in_files = _factors_of_files(result)
    for key, value in result.factors.items():
        place = "in its new file of pairs" if key in in_files else "multiply it there"
        lines.append(f"{key} = {value:.6g} times what a file states; {place}")
    return lines


def _factors_of_files(result: Identified) -> dict[str, tuple[Any, str, float]]:
    """Return joint, column of its file of pairs, and factor of the numbers that such a file states, by key."""
    joints = {joint.name: joint for joint in result.scene.joints if joint.pairs is not None}
    parts = {key: key.removeprefix("joints.").rsplit(".", 1) for key in result.factors}
    return {key: (joints[name], IN_FILE[of], result.factors[key]) for key, (name, of) in parts.items() if name in joints}


def _with_pairs(result: Identified, folder: Path) -> dict[str, Any]:
    """Write the files of pairs of joints with their columns multiplied; return the joints that name them, if there are any."""
    changed: dict[str, str] = {}
    for i, joint in enumerate(result.scene.joints):
        factors = {column: factor for of, column, factor in _factors_of_files(result).values() if of is joint}
        if not factors:
            continue
        (_, header), *rows = numbered_rows(result.scene.folder / joint.pairs)
        by = [factors.get(name.lower(), 1.0) for name in header]
        lines = [header, *([cell if f == 1.0 else repr(f * float(cell)) for f, cell in zip(by, row)] for _, row in rows)]
        changed[joint.name] = f"pairs_{i + 1}.csv"
        with atomic_write(str(folder / changed[joint.name])) as temporary, open(temporary, "w", encoding="utf-8") as file:
            file.writelines(",".join(line) + "\n" for line in lines)
    tables = _relocated(result.scene, folder).get("joints", ())
    joints = tuple({**joint, **({"pairs": changed[joint["name"]]} if joint["name"] in changed else {})} for joint in tables)
    return {"joints": joints} if changed else {}


def draw_fit(result: Identified, scene: Any, path: str) -> None:
    """Draw measured amplitudes and phases, the fit and the scene before it, a row of panels for each output.  Local."""
    measured, levels = result.measured, np.unique(result.measured.level)
    outputs, units = np.unique(measured.output), units_of(scene)
    colours = level_colours(len(levels))
    of_fit: dict[str, Any] = {"ls": "-"}
    of_before: dict[str, Any] = {"ls": "--", "lw": 0.9}
    if measured.of_peaks or measured.n == 1:  # which no line joins
        of_fit, of_before = {"ls": "", "marker": "D", "ms": 4.0}, {"ls": "", "marker": "x", "ms": 4.0}
    handles = [Line2D([], [], color=c, **of_fit, label=f"{level:g} {units.level}") for c, level in zip(colours, levels)]
    handles += [
        Line2D([], [], color=INK, marker="o", lw=0, ms=3.5, mfc="white", label="measured"),
        Line2D([], [], color=INK, **of_fit, label="fit"),
        Line2D([], [], color=FAINT, **of_before, label="scene as it was"),
    ]
    shown = [name for name in ("amplitude", "phase") if np.isfinite(getattr(measured, name)).any()] or ["amplitude"]
    page = Page(result.scene, "measured and fitted responses", WIDTH, 2.9 * len(outputs), handles)
    cells = page.grid(len(outputs), len(shown)).subplots(squeeze=False)
    for ax, k, name in ((ax, k, name) for row, k in zip(cells, outputs) for ax, name in zip(row, shown)):
        sizes = np.concatenate([each.amplitude[measured.output == k] for each in (measured, result.fit)])
        factor, unit = with_prefix(sizes[np.isfinite(sizes)], units.outputs[k])
        label = f"{plain(output_names(scene)[k], 24)} [{unit}]"
        if name == "phase":
            factor, label = 180.0 / np.pi, f"phase of {plain(output_names(scene)[k], 24)} [°]"
        for colour, level in zip(colours, levels):
            rows = np.flatnonzero((measured.output == k) & (measured.level == level))
            rows = rows[np.argsort(measured.frequency[rows])]
            before, fit, points = (getattr(each, name)[rows] for each in (result.before, result.fit, measured))
            if name == "phase":
                fit = np.unwrap(fit)
                before, points = (fit + np.angle(np.exp(1j * (phase - fit))) for phase in (before, points))
            ax.plot(result.before.frequency[rows], factor * before, color=FAINT, **of_before)
            ax.plot(result.fit.frequency[rows], factor * fit, color=colour, **of_fit)
            ax.plot(measured.frequency[rows], factor * points, "o", color=colour, ms=3.5, mfc="white")
        ax.set(xlabel="frequency [Hz]", ylabel=label)
    page.save(path)


def _relocated(scene: Any, folder: Path) -> dict[str, Any]:
    """Return the tables of a scene with the paths of its files as seen from another folder."""
    files = {str(stated): os.path.relpath(scene.folder / stated, folder.absolute()) for _, stated in named_files(scene)}

    def moved(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: moved(entry) for key, entry in value.items()}
        if isinstance(value, (tuple, list)):
            return tuple(moved(entry) for entry in value)
        return files.get(value, value) if isinstance(value, str) else value

    tables: dict[str, Any] = moved(scene.model_dump(exclude_unset=True))
    return tables
