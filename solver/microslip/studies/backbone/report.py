"""A nonlinear mode as a table, backbone.csv, backbone.h5, backbone.png and synthesis.png.  Rank 0 only."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...contact.law import OPEN, SLIP
from ...library.backbone import Backbone, QuasiStatic, Synthesis
from ...messages.words import counted
from ...observe.screen_table import screen_table
from ...points.peak import Peak
from ...results.layout import log_scale
from ...results.style import FAINT, INK, RC, WIDTH, Page, Titled, level_colours, plain, some, with_prefix
from ...system.files import atomic_write, make_folder, remove_files
from ...system.hdf5 import written_hdf5
from ..records import cell, write_csv

_ROWS = 14  # rows of the table on the screen
RESOLVED = 1e-9  # of the linear frequency, up to which a mode has one frequency
_WIDE = 30.0  # ratio of damping ratios beyond which their axis is logarithmic
_ACCENT, _SECOND = "#0072b2", "#d55e00"


@dataclass(frozen=True, eq=False)
class Forced:
    """The forced response at a level: synthesised from the mode, and computed."""

    level: float  # N
    by_mode: Synthesis
    frequency: np.ndarray  # (n,) Hz
    amplitude: np.ndarray  # (n, n_outputs) complex, harmonic 1
    peaks: Sequence[Peak]
    failure: str | None

    @property
    def peak(self) -> float:
        """The computed peak of the first output that lies next to the phase resonance; without any the largest amplitude."""
        peaks = [peak for peak in self.peaks if peak.output == 0]
        if peaks and np.isfinite(self.by_mode.resonance):
            return abs(min(peaks, key=lambda peak: abs(peak.omega / (2.0 * np.pi) - self.by_mode.resonance)).amplitude)
        return float(np.abs(self.amplitude[:, 0]).max(initial=0.0))

    @property
    def error(self) -> float:
        """Relative error of the peak synthesised from the mode; NaN if the mode does not reach it."""
        return float(self.by_mode.peak[0]) / self.peak - 1.0


def write_backbone(result: Backbone, forced: Sequence[Forced], scene: Titled, folder: Path) -> str:
    """Write the files of a nonlinear mode; return the table for the screen.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    remove_files(folder, "backbone.csv", "backbone.h5", "backbone.png", "synthesis.csv", "synthesis.png")
    rows = records(result)
    if rows:
        write_csv(str(folder / "backbone.csv"), rows[0], rows)
        write_arrays(result, str(folder / "backbone.h5"))
        with matplotlib.rc_context(RC):
            draw_backbone(result, scene, str(folder / "backbone.png"))
            if forced:
                draw_forced(result, forced, scene, str(folder / "synthesis.png"))
    if forced:
        lines = synthesis_records(result, forced)
        if lines:
            write_csv(str(folder / "synthesis.csv"), lines[0], lines)
    return "\n".join([*on_screen(result), *in_words(result), *map(_forced_in_words, forced)])


def records(result: Backbone) -> list[dict[str, Any]]:
    """Return one record per point, by the names of the columns of backbone.csv."""
    columns: dict[str, np.ndarray] = {
        "modal_amplitude": result.amplitude,
        "frequency_Hz": result.frequency,
        "damping_ratio": result.damping,
        "damping_ratio_friction": result.damping_by_friction,
        "friction_J": np.array([point.friction for point in result.points]),
        "slipping": np.count_nonzero(result.state == SLIP, axis=-1),
        "open": np.count_nonzero(result.state == OPEN, axis=-1),
        f"level_{result.level_unit}": result.level if result.points else np.zeros(0),
    }
    if result.points:
        for k, (name, unit) in enumerate(zip(result.outputs, result.units)):
            motion = result.shape[:, k] * result.amplitude
            columns |= {f"{name}_{unit}": np.abs(motion), f"{name}_phase_rad": np.angle(motion)}
    if result.quasi_static is not None:
        frequency, damping = result.quasi_static.at(result.amplitude)
        columns |= {"quasi_static_frequency_Hz": frequency, "quasi_static_damping_ratio": damping}
    if result.checks:
        at = [check.point for check in result.checks]
        for name, of in (("frequency_error_Hz", "frequency"), ("damping_ratio_error", "damping")):
            columns[name] = np.full(len(result.points), np.nan)
            columns[name][at] = [abs(getattr(check, of)) for check in result.checks]
    return [{name: values[i].item() for name, values in columns.items()} for i in range(len(result.points))]


def write_arrays(result: Backbone, path: str) -> None:
    """Write all arrays of a nonlinear mode to an HDF5 file.  Local."""
    arrays = {
        "amplitude": (result.amplitude, "kg^1/2 m"),
        "frequency": (result.frequency, "Hz"),
        "damping": (result.damping, "1"),
        "damping_by_friction": (result.damping_by_friction, "1"),
        "response": (result.response, ", ".join(result.units)),
        "shape": (result.shape, ", ".join(f"{unit}/(kg^1/2 m)" for unit in result.units)),
        "energy": (result.energy, "J"),
        "state": (result.state, "0 sticks, 1 slips, 2 opens"),
        "level": (result.level, result.level_unit),
    }
    if result.quasi_static is not None:
        for name, unit in (("amplitude", "kg^1/2 m"), ("frequency", "Hz"), ("damping", "1")):
            arrays[f"quasi_static/{name}"] = getattr(result.quasi_static, name), unit
    with atomic_write(path) as unfinished, written_hdf5(str(unfinished)) as file:
        for name, (values, unit) in arrays.items():
            file.create_dataset(name, data=values).attrs["unit"] = unit
        file.attrs["mode"], file.attrs["failure"] = result.mode, result.failure or ""
        file.attrs["linear_frequency_Hz"], file.attrs["linear_damping"] = result.linear_frequency, result.linear_damping
        file.attrs["outputs"], file.attrs["joints"] = list(result.outputs), list(result.joints)


def on_screen(result: Backbone) -> list[str]:
    """Return the table for the screen, for evenly spread points."""
    rows = some(records(result), _ROWS)
    if not rows:
        return []
    output = f"{result.outputs[0]}_{result.units[0]}"
    head: list[str] = [
        f"{result.outputs[0]} {result.units[0]}",
        "frequency Hz",
        "damping %",
        "by friction %",
        "slip",
        "open",
        "level",
    ]
    keys: tuple[str, ...] = (
        output,
        "frequency_Hz",
        "damping_ratio",
        "damping_ratio_friction",
        "slipping",
        "open",
        f"level_{result.level_unit}",
    )
    digits: tuple[int, ...] = (4, 7, 4, 4, 0, 0, 4)
    if result.quasi_static is not None:
        head += ["quasi-static Hz", "%"]
        keys, digits = (*keys, "quasi_static_frequency_Hz", "quasi_static_damping_ratio"), (*digits, 7, 4)
    table = [
        (
            0,
            [
                cell(row[key] * (100.0 if "ratio" in key else 1.0), n) if isinstance(row[key], float) else str(row[key])
                for key, n in zip(keys, digits)
            ],
        )
        for row in rows
    ]
    heading = (
        f"nonlinear mode {result.mode}: amplitude of {result.outputs[0]}; level of the loads with phase resonance at the point"
    )
    return [screen_table(heading, head, table)]


def in_words(result: Backbone) -> list[str]:
    """Return lines on a nonlinear mode: its begin, largest damping, cost, and superharmonic resonances."""
    if not result.points:
        return [f"mode {result.mode}: {result.linear_frequency:.6g} Hz, damping {100.0 * result.linear_damping:.4g} %, a line"]
    top = int(np.argmax(result.damping))
    size = np.abs(result.shape[:, 0]) * result.amplitude
    unit, name = result.units[0], result.outputs[0]
    lines = [
        f"mode {result.mode}, {rest_in_words(result)}: {result.linear_frequency:.7g} Hz, "
        f"damping {100.0 * result.linear_damping:.4g} %; " + first_in_words(result, f"{size[0]:.4g} {unit} of {name}"),
        f"largest damping {100.0 * result.damping[top]:.4g} % at {size[top]:.4g} {unit}, {result.frequency[top]:.7g} Hz; "
        f"{counted(len(result.points), 'point')} in {result.seconds:.3g} s",
        *statics_in_words(result, result.quasi_static),
        *checks_in_words(result, size),
    ]
    for meeting in result.meetings:
        at = float(np.interp(meeting.place, np.arange(len(size)), size))
        lines.append(
            f"superharmonic resonance: {meeting.harmonic} x {meeting.frequency:.6g} Hz meets mode {meeting.mode} of the stuck "
            f"structure at about {at:.3g} {unit} of {name}"
        )
    return lines


def checks_in_words(result: Backbone, size: np.ndarray) -> list[str]:
    """Return lines on the points solved again, and on those that have no such solution; ``size``: (n_points,) of the output."""
    solved = [check for check in result.checks if check.is_solved]
    missing = [check.point for check in result.checks if not check.is_solved]
    lines = []
    if solved:
        lines.append(
            f"with twice the harmonics and samples, at {len(solved)} point{'s' * (len(solved) > 1)}: frequency within "
            f"{max(abs(check.frequency) for check in solved):.2g} Hz, damping within "
            f"{100.0 * max(abs(check.damping) / result.damping[check.point] for check in solved):.2g} % of itself"
        )
    if missing:
        is_open, unit = (result.state == OPEN).any(axis=1), result.units[0]
        advice = "state more harmonics"
        if is_open[missing].all():
            advice = f"pairs open from {size[is_open].min():.4g} {unit} on, where more harmonics may have no solution either"
        lines.append(
            f"with twice the harmonics and samples, no solution at {len(missing)} of {counted(len(result.checks), 'point')}, "
            f"{', '.join(f'{size[i]:.4g}' for i in missing)} {unit} of {result.outputs[0]}: the error there is unknown; {advice}"
        )
    return lines


def rest_in_words(result: Backbone) -> str:
    """Return the state of the pairs at rest, in which modes are counted."""
    n = result.open_at_rest
    return f"{n} pair{'s' * (n > 1)} open at rest, the others stuck" if n else "all pairs stuck"


def first_in_words(result: Backbone, amplitude: str) -> str:
    """Return at which amplitude the first pair leaves its state at rest."""
    if result.slips_at_rest:
        return f"some pairs slip, open or touch from the first motion on; computed from {amplitude}"
    return f"the first pair {'slips, opens or touches' if result.open_at_rest else 'leaves sticking'} at {amplitude}"


def statics_in_words(result: Backbone, quasi: QuasiStatic | None) -> list[str]:
    """Return lines on the mode by statics and Masing's rules: its difference, where pairs open, and why it ends."""
    if quasi is None:
        return []
    size, rising = np.abs(result.shape[:, 0]) * result.amplitude, np.argsort(result.amplitude)
    frequency, damping = quasi.at(result.amplitude)
    is_known = np.isfinite(damping)
    off, shift = np.nanmax(np.abs(frequency - result.frequency)), np.ptp(result.frequency)
    close = f"{100.0 * off / shift:.2g} % of the shift" if shift > RESOLVED * result.linear_frequency else f"{off:.2g} Hz"
    worst = np.abs(damping - result.damping)[is_known].max(initial=0.0) / result.damping.max()

    def at(q: float) -> str:
        return f"{np.interp(q, result.amplitude[rising], size[rising]):.4g} {result.units[0]}"

    lines = [
        f"by statics and Masing's rules: frequency within {close}, damping within "
        f"{100.0 * worst:.2g} % of the largest, in {quasi.seconds:.2g} s"
    ]
    if np.isfinite(quasi.opens):
        lines.append(
            f"  from {at(quasi.opens)} on pairs open or touch in one direction of the motion, and Masing's rules do not hold: "
            "they take unloading as the mirror image of loading"
        )
    if quasi.failure is not None:
        last = quasi.amplitude[quasi.amplitude <= result.amplitude.max()].max(initial=quasi.amplitude[0])
        lines.append(f"  it ends at {at(last)}: {quasi.failure}")
    return lines


def _forced_in_words(forced: Forced) -> str:
    if not np.isfinite(forced.error):
        return f"level {forced.level:g}: peak {forced.peak:.5g}; beyond the computed amplitudes of the mode"
    return (
        f"level {forced.level:g}: peak {forced.peak:.5g}, synthesised from the mode {forced.by_mode.peak[0]:.5g} "
        f"({100.0 * forced.error:+.2g} %) at {forced.by_mode.resonance:.6g} Hz"
    )


def synthesis_records(result: Backbone, forced: Sequence[Forced]) -> list[dict[str, Any]]:
    """Return one record per point of the synthesised responses, by the names of the columns of synthesis.csv."""
    return [
        {f"level_{result.level_unit}": each.level, "frequency_Hz": float(frequency)}
        | {f"{name}_{unit}": float(abs(a)) for name, unit, a in zip(result.outputs, result.units, amplitudes)}
        for each in forced
        for frequency, amplitudes in zip(each.by_mode.frequency, each.by_mode.coefficients)
    ]


def draw_backbone(result: Backbone, scene: Titled, path: str) -> None:
    """Draw frequency and damping ratio over the amplitude of the first output.  Local."""
    size = np.abs(result.shape[:, 0]) * result.amplitude
    factor, unit = with_prefix(size, result.units[0])
    quasi = result.quasi_static
    handles = [Line2D([], [], color=_ACCENT, marker="o", ms=3.0, label="nonlinear mode")]
    if quasi is not None:
        handles.append(Line2D([], [], color=_SECOND, ls="--", label="by statics and Masing's rules"))
        if quasi.opens < quasi.amplitude[-1]:
            handles.append(
                Line2D([], [], color=_SECOND, ls=":", lw=0.9, label="the same where pairs open or touch: does not hold")
            )
    handles += [
        Line2D([], [], color=FAINT, lw=0.8, ls=":", label=rest_in_words(result)),
        *(
            [Line2D([], [], color=INK, marker="v", lw=0, ms=5.0, mfc="none", label="superharmonic resonance")]
            if result.meetings
            else []
        ),
    ]
    heading = f"nonlinear mode {result.mode}: frequency and damping ratio over the amplitude of {plain(result.outputs[0], 24)}"
    page = Page(scene, heading, WIDTH, 2.9, handles)
    left, right = page.grid(1, 2).subplots()
    for axes, values, of_stuck, label, of_quasi in (
        (left, result.frequency, result.linear_frequency, "frequency [Hz]", None if quasi is None else quasi.frequency),
        (
            right,
            100.0 * result.damping,
            100.0 * result.linear_damping,
            "damping ratio [%]",
            None if quasi is None else 100.0 * quasi.damping,
        ),
    ):
        axes.axhline(of_stuck, color=FAINT, lw=0.8, ls=":")
        if quasi is not None and of_quasi is not None:
            within = quasi.amplitude <= result.amplitude.max()
            rising = np.argsort(result.amplitude)
            at = np.interp(quasi.amplitude[within], result.amplitude[rising], size[rising] * factor)
            n = int(np.count_nonzero(quasi.amplitude[within] <= quasi.opens))
            axes.plot(at[:n], of_quasi[within][:n], color=_SECOND, ls="--", zorder=3)
            if n < len(at):
                axes.plot(at[max(n - 1, 0) :], of_quasi[within][max(n - 1, 0) :], color=_SECOND, ls=":", lw=0.9, zorder=3)
        axes.plot(size * factor, values, color=_ACCENT, marker="o", ms=2.5)
        for meeting in result.meetings:
            at, value = (np.interp(meeting.place, np.arange(len(size)), each) for each in (size * factor, values))
            axes.plot(at, value, "v", color=INK, ms=5.0, mfc="none")
        log_scale(axes, "x")
        axes.set(xlabel=f"amplitude of {plain(result.outputs[0], 24)} [{unit}]", ylabel=label)
    if result.damping.max() > _WIDE * result.damping.min() > 0.0:
        log_scale(right, "y")
    else:
        right.set_ylim(bottom=0.0)
    page.save(path)


def draw_forced(result: Backbone, forced: Sequence[Forced], scene: Titled, path: str) -> None:
    """Draw synthesised and computed forced responses, with the phase resonances.  Local."""
    size = np.abs(result.shape[:, 0]) * result.amplitude
    factor, unit = with_prefix(np.concatenate([np.abs(each.amplitude[:, 0]) for each in forced]), result.units[0])
    colours = level_colours(len(forced))
    handles = [Line2D([], [], color=c, label=f"{each.level:g} {result.level_unit}") for c, each in zip(colours, forced)]
    handles += [
        Line2D([], [], color=INK, ls="--", label="synthesised from the mode"),
        Line2D([], [], color=FAINT, lw=0.9, label="phase resonance"),
    ]
    page = Page(
        scene,
        f"forced responses of {plain(result.outputs[0], 24)}, computed and from nonlinear mode {result.mode} (synthesised)",
        WIDTH,
        3.4,
        handles,
    )
    axes = page.grid(1, 1).subplots()
    shown = np.concatenate([each.frequency for each in forced])
    axes.plot(result.frequency, size * factor, color=FAINT, lw=0.9)
    for colour, each in zip(colours, forced):
        axes.plot(each.frequency, np.abs(each.amplitude[:, 0]) * factor, color=colour)
        frequency, sizes = each.by_mode.frequency, np.abs(each.by_mode.coefficients[:, 0]) * factor
        if not np.isfinite(each.by_mode.resonance) and len(frequency) > 1:  # beyond the mode's amplitudes: no line across
            between = int(np.argmax(sizes[:-1] + sizes[1:])) + 1
            frequency, sizes = np.insert(frequency, between, np.nan), np.insert(sizes, between, np.nan)
        axes.plot(frequency, sizes, color=INK, ls="--", lw=0.9)
        axes.plot(each.by_mode.resonance, each.by_mode.peak[0] * factor, "o", color=INK, ms=3.5, mfc="white")
    highest = max(float(np.abs(each.amplitude[:, 0]).max(initial=0.0)) for each in forced)
    lowest = min(float(np.abs(each.amplitude[:, 0]).min(initial=np.inf)) for each in forced)
    axes.set(xlim=(shown.min(), shown.max()), ylim=(0.7 * lowest * factor, 1.6 * highest * factor))
    log_scale(axes, "y")
    axes.set(xlabel="frequency [Hz]", ylabel=f"amplitude [{unit}]")
    page.save(path)
