"""The text and tables of a report as HTML.  All text from a user's file passes through ``escape``."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from ...fourier.coefficients import amplitude
from ...messages.words import counted
from ...points.error_parts import PARTS, total
from ...points.quantities import hertz
from ..audit import balance
from ..fields import Fields, RunRecord
from ..measures import counts, peak
from ..record import COMPLETE, STOPPED, LevelResult, ResultFile, StaticTable
from ..sensitivities import relative_at_peak
from ..style import level_name, some, with_prefix

MOST_MODES = 60
MOST_CYCLES = 15
MOST_PEAKS = 100
_ROWS = 6  # of modes below each other
_LARGE = 0.05  # of the amplitude: an error bar beyond is marked
GOOD, LOOK, BAD = "good", "look", "bad"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], of_numbers: bool = True) -> str:
    """Return a table of cells that are HTML already.  Local."""
    cells = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    kind = ' class="numbers"' if of_numbers else ""
    return f'<div class="wide"><table{kind}><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table></div>'


def quantity_text(value: float, unit: str, digits: int = 4) -> str:
    """Return a number with the prefix of its unit that suits it."""
    factor, name = with_prefix([value], unit)
    return f"{_rounded(factor * value, digits)} {escape(name)}"


def _rounded(value: float, digits: int) -> str:
    """Return a number to this many digits, without an exponent below a million."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e" in text and 1.0 <= abs(value) < 1e6 else text


def _percent(share: float, digits: int = 2) -> str:
    return f"{_rounded(100.0 * share, digits)} %"


def peaks_table(results: ResultFile) -> str:
    """Return the peak of every level, of the first output: frequency, amplitude, error bar, state of the joint."""
    rows = [_peak_row(results, level) for level in results.levels]
    unit = {"N": "per N", "1": ""}.get(results.level_unit, f"per {escape(results.level_unit)}")
    where = "frequency" if any(row[1] for row in rows) else ""
    return table(
        ("level", where, results.shown.heading, "error bar", unit, "slip", "open", "friction loss", "of all losses"), rows
    )


def _peak_row(results: ResultFile, level: LevelResult) -> list[str]:
    name = escape(level_name(level))
    at = peak(level.response)
    if at is None:
        return [name, "", "no point converged", *[""] * 6]
    size = _size(results, level, at)
    bar = "" if level.error is None else "± " + quantity_text(float(total(level.error[at, 0])), results.unit_of(0), 2)
    _, slip, is_open = counts(level.state[at])
    friction, all_losses = float(level.friction[at]), float(level.friction[at] + level.damping[at])
    per = quantity_text(size / abs(level.level), results.unit_of(0)) if level.level else ""
    share = _percent(friction / all_losses, 3) if all_losses > 0.0 else ""
    frequency = results.shown.where(level.frequency[at])
    return [
        name,
        frequency,
        quantity_text(size, results.unit_of(0)),
        bar,
        per,
        str(slip),
        str(is_open),
        quantity_text(friction, "J"),
        share,
    ]


def solved_peaks_table(results: ResultFile) -> str:
    """Return the peaks that were solved for as points; "" without any."""
    rows = [
        (
            escape(level_name(level)),
            escape(results.outputs[peak.output]),
            f"{hertz(peak.omega):.9g} Hz",
            quantity_text(abs(peak.amplitude), results.unit_of(peak.output), 6),
            "" if np.isnan(peak.width) else f"{hertz(peak.width):.4g} Hz",
            "" if np.isnan(peak.width) else _percent(peak.damping, 4),
            str(peak.slipping),
        )
        for level in results.levels
        for peak in level.peaks or ()
    ]
    heads = ("level", "output", "peak, solved for", "amplitude", "half-power width", "damping ratio", "slip or open")
    more = f'<p class="note">{len(rows) - MOST_PEAKS} more are in results.h5.</p>' if len(rows) > MOST_PEAKS else ""
    return table(heads, rows[:MOST_PEAKS]) + more if rows else ""


def sensitivities_table(results: ResultFile) -> str:
    """Return the change of a level's largest amplitude by 1 % of each joint parameter, and of the damping.

    "" without sensitivities; of the first output.
    """
    rows = []
    for level in results.levels:
        if peak(level.response) is None or level.d_by_pairs is None:
            continue
        frequency, of_pairs, by_damping = relative_at_peak(results.joint, level)
        for i, name in enumerate(results.joint.names):
            sums = [float(of_pairs[number][results.joint.joint == i].sum()) for number in ("mu", "N0", "k_t", "k_n")]
            cells = [f"{value:+.2g} %" for value in (*sums, by_damping)]
            rows.append((escape(level_name(level)), f"{frequency:.7g} Hz", escape(name), *cells))
    heads = ("level", "at", "joint", "friction", "preload or gap", "tangential stiffness", "normal stiffness", "damping")
    note = (
        "Change with 1 % more of a number: of the peak, if peaks are solved for, else of the largest amplitude at its frequency;"
    )
    note += " sensitivities.csv has all." + " The state of rest stays as it is." * bool(results.at_rest)
    return table(heads, rows) + f'<p class="note">{note}</p>' if rows else ""


def wear_table(results: ResultFile) -> str:
    """Return depth, preload left, and the drift of the response over numbers of cycles; "" without wear.  Local."""
    wear = results.wear
    if wear is None:
        return ""
    unit, joint = results.unit_of(results.outputs.index(wear.output)), results.joint
    of_joints = [(name, joint.joint == i) for i, name in enumerate(joint.names)]
    rows = []
    for i in some(range(len(wear.cycles)), MOST_CYCLES):
        cells = [f"{wear.cycles[i]:.4g}", quantity_text(float(wear.amplitude[i]), unit), f"{wear.frequency[i]:.7g} Hz"]
        cells.append(f"{100.0 * wear.damping[i]:.3g} %" if np.isfinite(wear.damping[i]) else "–")
        for _, of_joint in of_joints:
            first, now = wear.normal_force[[0, i]][:, of_joint].sum(axis=1)
            cells.append(quantity_text(float(wear.depth[i, of_joint].max(initial=0.0)), "m"))
            cells.append(f"{100.0 * (1.0 - now / first):.2f} %" if first > 0.0 else "–")
        rows.append(cells)
    of_each = [f"{escape(name)}: {what}" for name, _ in of_joints for what in ("deepest", "preload lost")]
    heads = ("cycles", f"amplitude of {escape(wear.output)}", "frequency", "damping", *of_each)
    note = f"By the law {escape(wear.law)}; wear.csv has every number of cycles, wear.vtkhdf and wear_map.png every pair."
    return table(heads, rows) + f'<p class="note">{note}</p>'


def bifurcations_table(results: ResultFile) -> str:
    """Return the folds and places where multipliers cross the unit circle; "" where there are none."""
    rows = [
        (
            escape(level_name(level)),
            each.kind,
            f"{hertz(each.omega):.9g} Hz",
            quantity_text(float(each.amplitude[0]), results.unit_of(0), 6),
            f"{each.multiplier:.4f}" if each.multiplier.imag else f"{each.multiplier.real:.4f}",
        )
        for level in results.levels
        for each in level.bifurcations or ()
    ]
    heads = ("level", "stability changes", "frequency", f"amplitude of {escape(results.outputs[0])}", "multiplier")
    return table(heads, rows[:MOST_PEAKS]) if rows else ""


def _size(results: ResultFile, level: LevelResult, at: int) -> float:
    return float(results.shown.of(level.response[at, 0]))


def cards(results: ResultFile) -> str:
    """Return the essential numbers of the strongest level."""
    solved = results.solved
    if not solved:
        return '<p class="bad">No point converged.</p>'
    level = max(solved, key=lambda level: abs(level.level))
    at = level.top
    _, slip, is_open = counts(level.state[at])
    entries = [
        (
            results.shown.heading,
            quantity_text(_size(results, level, at), results.unit_of(0)),
            escape(f"{results.outputs[0]}, at {level_name(level)}"),
        )
    ]
    if where := results.shown.where(level.frequency[at], 6):
        entries.append(("at", where, _shift(results, level, at)))
    if results.n_sectors > 1:
        n_outputs = len(results.outputs) // results.n_sectors
        sizes = amplitude(level.response[:, ::n_outputs]).max(axis=0)
        k = n_outputs * int(np.argmax(sizes))
        entries.append(
            ("largest of all sectors", quantity_text(float(sizes.max()), results.unit_of(k)), escape(results.outputs[k]))
        )
    if results.joint.n_pairs:
        entries.append(("pairs that slip", f"{slip} of {results.joint.n_pairs}", f"{is_open} open" if is_open else "none opens"))
    losses = float(level.friction[at] + level.damping[at])
    if losses > 0.0:
        entries.append(
            (
                "lost by friction",
                _percent(level.friction[at] / losses),
                quantity_text(float(level.friction[at]), "J") + " a cycle",
            )
        )
    if level.error is not None:
        bar, size = float(total(level.error[at, 0])), _size(results, level, at)
        largest = PARTS[int(np.argmax(level.error[at, 0]))]
        entries.append(
            (
                "error bar",
                "± " + (_percent(bar / size) if size else quantity_text(bar, results.unit_of(0), 2)),
                f"most of it: {largest}",
            )
        )
    boxes = (f"<div><b>{head}</b><span>{value}</span><small>{note}</small></div>" for head, value, note in entries)
    return f'<div class="cards">{"".join(boxes)}</div>'


def _shift(results: ResultFile, level: LevelResult, at: int) -> str:
    """Return the shift of the peak from that of the lowest level."""
    low = min((level for level in results.levels if len(level.frequency)), key=lambda level: abs(level.level))
    if low is level:
        return ""
    reference = low.frequency[peak(low.response) or 0]
    return f"{100.0 * (level.frequency[at] / reference - 1.0):+.3g} % of that at {escape(level_name(low))}"


def disc_note(results: ResultFile) -> str:
    """Return which sectors of a disc the numbers are of; "" without [cyclic]."""
    cyclic = results.cyclic
    if not cyclic:
        return ""
    N, order = int(cyclic["sectors"]), cyclic.get("engine_order")
    wave = f"nodal diameter {_excited_diameter(cyclic)}" + ("" if order is None else f", by engine order {int(order)}")
    if cyclic.get("whole"):
        text = (
            f"A disc of {N} sectors that may differ ({wave}): pairs and energies are those of all sectors, amplitudes in this "
            f"table those of {escape(results.outputs[0])}. sectors.png and sectors.csv of the run have every sector."
        )
    else:
        text = (
            f"A disc of {N} sectors that vibrates as a wave ({wave}): pairs, forces and energies are those of one sector, "
            "the same in every other one. Meshes and motion are those of the whole disc."
        )
    return f'<p class="note">{text}</p>'


def _excited_diameter(cyclic: Mapping[str, Any]) -> int:
    """Return the nodal diameter of harmonic 1, 0 to half of the sectors."""
    order, N = int(cyclic.get("engine_order", cyclic.get("nodal_diameter", 0))), int(cyclic["sectors"])
    return min(order % N, -order % N)


def modes_table(results: ResultFile) -> str:
    """Return the natural frequencies with all pairs stuck."""
    n = len(results.mode_frequency)
    rows = [(str(i + 1), f"{f:.7g} Hz") for i, f in enumerate(results.mode_frequency[:MOST_MODES])]
    parts = "".join(table(("mode", "frequency"), rows[i : i + _ROWS]) for i in range(0, len(rows), _ROWS))
    left = f" {n - MOST_MODES} more are in results.h5." if n > MOST_MODES else ""
    cyclic = results.cyclic
    of = f", at nodal diameter {_excited_diameter(cyclic)}" if cyclic and not cyclic.get("whole") else ""
    return f'<div class="tables">{parts}</div><p class="note">Of the structure with all pairs stuck{of}.{left}</p>'


def understood(results: ResultFile, fields: Fields | None) -> str:
    """Return the program's reading of the scene: bodies, joints, outputs."""
    parts = []
    if fields is not None:
        low, high = fields.mesh.points.min(axis=0), fields.mesh.points.max(axis=0)
        rows = [
            (escape(block.group), f"{len(block.nodes)} {block.kind}", str(len(np.unique(block.nodes))))
            for block in fields.mesh.elements
        ]
        parts.append(table(("body (group)", "elements", "nodes"), rows))
        corners = " to ".join("(" + ", ".join(f"{value:.4g}" for value in corner) + ")" for corner in (low, high))
        parts.append(f"<p>{counted(len(fields.mesh.points), 'node')}, from {corners} m.</p>")
    if results.joint.n_pairs:
        parts.append(_joints(results))
    parts.append(_outputs(results, fields))
    if "bolts" in results.at_rest:
        parts.append(_bolts(results.at_rest["bolts"]))
    return "".join(parts)


def _bolts(bolts: StaticTable) -> str:
    rows = [
        (escape(name), quantity_text(tightened, "N"), quantity_text(force, "N"), f"{1e6 * area:.4g} mm²")
        for name, tightened, force, area in zip(
            bolts.names, *(bolts.columns[column] for column in ("tightened", "force", "area"))
        )
    ]
    return table(("bolt", "tightened to", "at rest", "area of the cut"), rows)


def _joints(results: ResultFile) -> str:
    joint, rows = results.joint, []
    for i, name in enumerate(joint.names):
        of_joint = joint.joint == i
        area, N = joint.area[of_joint].sum(), np.maximum(joint.N0[of_joint], 0.0)
        n_gap = int(np.count_nonzero(joint.N0[of_joint] < 0.0))
        laws = ", ".join(joint.law_names[k] for k in np.unique(joint.laws[of_joint]))
        mu = joint.mu[of_joint]
        friction = "" if np.isnan(mu).any() else f"{mu.min():.3g}" + (f" to {mu.max():.3g}" if np.ptp(mu) > 1e-9 else "")
        rows.append(
            (
                escape(name),
                escape(laws),
                str(int(of_joint.sum())),
                f"{1e6 * area:.5g} mm²" if np.isfinite(area) else "",
                quantity_text(float(N.sum()), "N") if np.isfinite(N).all() else "",
                friction,
                f"{n_gap} with a gap" if n_gap else "",
            )
        )
    return table(("joint", "law", "pairs", "area", "normal preload", "friction", ""), rows)


def _outputs(results: ResultFile, fields: Fields | None) -> str:
    rows = []
    for k, name in enumerate(results.outputs):
        node = fields.output_node[k] if fields is not None else -1
        along = ""
        if fields is not None and node >= 0:
            along = "(" + ", ".join(f"{value:g}" for value in fields.output_direction[k]) + ")"
        rows.append((escape(name), escape(results.unit_of(k)), str(node) if node >= 0 else "", along))
    return table(("output", "unit", "node", "direction"), rows)


def checks(results: ResultFile) -> list[tuple[str, str]]:
    """Return the checks and their results, as (GOOD, LOOK or BAD, HTML).  Local."""
    outcomes = [_complete(results)]
    solved = results.solved
    if not results.shown.is_static:
        outcomes += [_balance(results, level) for level in solved]
    outcomes += [_bar(results, level) for level in solved if level.error is not None]
    noted = sum(bool(note) for level in solved for note in (level.notes if level.notes is not None else ()))
    if noted:
        outcomes.append((LOOK, f"{noted} points carry a note; they are in the log below"))
    return outcomes


def _complete(results: ResultFile) -> tuple[str, str]:
    failed = [level for level in results.levels if level.status == STOPPED]
    if failed:
        return BAD, "; ".join(escape(f"{level_name(level)}: {level.failure}") for level in failed)
    unfinished = [level for level in results.levels if level.status != COMPLETE]
    if unfinished:
        return LOOK, f"{counted(len(unfinished), 'level')} not finished when the results were written"
    n = sum(len(level.frequency) for level in results.levels)
    return GOOD, f"all {counted(len(results.levels), 'level')} are complete, {counted(n, 'point')}"


def _balance(results: ResultFile, level: LevelResult) -> tuple[str, str]:
    gap = balance(results, level)
    worst = int(np.argmax(gap))
    where = f"at {level.frequency[worst]:.6g} Hz; bound {level.closes_to:.0e}"
    text = f"{escape(level_name(level))}: the energy balance closes to {gap[worst]:.1e} of the input, {where}"
    return (GOOD if gap[worst] <= level.closes_to else LOOK), text


def _bar(results: ResultFile, level: LevelResult) -> tuple[str, str]:
    at = level.top
    size, parts = _size(results, level, at), level.error[at, 0]
    share = float(total(parts)) / size if size else 0.0
    largest = ", ".join(
        f"{name} {_percent(part / (size or 1.0))}" for part, name in sorted(zip(parts, PARTS), reverse=True)[:2] if part
    )
    text = f"{escape(level_name(level))}: error bar ± {_percent(share)} at the peak" + (
        f"; parts of a third of it: {largest}" if largest else ""
    )
    return (GOOD if share <= _LARGE else LOOK), text


def checks_list(results: ResultFile) -> str:
    """Return the checks as a list with marks."""
    marks = {GOOD: "✓", LOOK: "!", BAD: "✗"}
    items = (f'<li class="{how}"><b>{marks[how]}</b>{text}</li>' for how, text in checks(results))
    return f'<ul class="checks">{"".join(items)}</ul>'


def warnings_list(notes: Sequence[str]) -> str:
    """Return the warnings of a run as a list with marks; "" without a warning."""
    items = "".join(f'<li class="{LOOK}"><b>!</b>{escape(note)}</li>' for note in notes if "WARNING" in note)
    return f'<ul class="checks">{items}</ul>' if items else ""


def times_table(results: ResultFile, run: RunRecord) -> str:
    """Return the times of stages, and the points of each level."""
    total = sum(stage.seconds for stage in run.stages if stage.depth == 0)
    rows = [
        (
            2 * stage.depth * "&ensp;" + escape(stage.name),
            f"{stage.seconds:.3g} s",
            _percent(stage.seconds / max(total, 1e-9)),
            f"{stage.memory:.0f} MiB",
        )
        for stage in run.stages
    ]
    if rows:
        rows.append(("until the results were written", f"{total:.4g} s", "", ""))
    stages = table(("stage", "time", "share", "peak memory until its end"), rows) if rows else ""
    points = [
        (
            escape(level_name(level)),
            str(len(level.frequency)),
            f"{level.seconds.sum():.3g} s",
            f"{1e3 * level.seconds.mean():.3g} ms" if len(level.seconds) else "",
            f"{level.newton.sum()}",
            f"0 to {level.harmonics.max(initial=0)}",
            f"{level.samples.max(initial=0)}",
            f"{level.unknowns.max(initial=0)}",
        )
        for level in results.levels
    ]
    return stages + table(
        ("level", "points", "time", "a point", "Newton iterations", "harmonics", "samples", "most unknowns"), points
    )


def origin_table(results: ResultFile) -> str:
    """Return the command, the machine, and the files that were read with their hashes; "" where they are not known."""
    origin = results.origin
    if origin is None:
        return ""
    hosts = ", ".join(sorted(set(origin.hosts)))
    rows = [
        ("command", escape(origin.command)),
        ("scene", escape(origin.scene_path)),
        ("ranks", f"{origin.n_ranks} in {origin.n_groups} group{'s' if origin.n_groups > 1 else ''}, on {escape(hosts)}"),
        *((escape(name), escape(value)) for name, value in origin.environment.items()),
        *(
            (escape(entry.key), f"{escape(entry.path)}<br>{entry.size} bytes, SHA-256 {escape(entry.sha256)}")
            for entry in origin.inputs
        ),
    ]
    return table(("origin", ""), rows, of_numbers=False)


def versions_table(results: ResultFile) -> str:
    """Return versions and options of the run."""
    rows = [(escape(name), escape(version)) for name, version in results.versions.items()]
    options = " ".join(results.options)
    return table(("of", "version"), [*rows, ("PETSc options", escape(options) or "none")], of_numbers=False)
