"""The comparison of two results as text, table and JSON, and the files of the command `diff`."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...messages.words import counted, listed, verb
from ...observe.screen_table import screen_table
from ...results.record import COMPLETE, ResultFile
from ...system.files import atomic_write, make_folder
from .command import Difference, diff
from .compared_inputs import Change
from .compared_levels import LevelDifference
from .picture import draw

_MOST = 60  # largest number of characters of a value
_RESOLVED = 0.9  # of a difference: if less exceeds the resolution of the points, the text states it
_ROUNDING = 1e-14  # rounding, relative to the peak
_HEAD = (
    "level|output|points|difference %|at Hz|peak A|B|change %|at Hz A|B|shift %|friction loss A, J|B|slip A, B|open A, B|in bars"
).split("|")
DIFFERENT = 1  # exit status, as in diff(1)


def compare_files(a: str, b: str, tolerance: float | None, bars: bool, out: Path | None, as_json: bool) -> tuple[str, int]:
    """Return the comparison of two result files, and the exit status: 0 equal, 1 different.  Local.

    With a folder ``out`` diff.png and diff.json are written there.

    Raises
    ------
    CaseError : a file cannot be read or written
    ResourceError : the disk is full
    """
    comparison = diff(a, b, tolerance, bars)
    if out is not None:
        make_folder(str(out))
        draw(comparison, str(out / "diff.png"))
        with atomic_write(str(out / "diff.json")) as temporary:
            Path(temporary).write_text(json_of(comparison) + "\n", encoding="utf-8")
    return (json_of(comparison) if as_json else text_of(comparison)), 0 if comparison.is_same else DIFFERENT


def text_of(comparison: Difference) -> str:
    """Return the complete comparison as text, with the verdict in the last line.  Local."""
    heads = f"A  {_head(comparison.a)}\nB  {_head(comparison.b)}"
    parts = [heads, _inputs(comparison), _structure(comparison)]
    if comparison.levels:
        parts.append(_table(comparison))
    notes = _notes(comparison)
    return "\n\n".join([*(part for part in (*parts, notes) if part), verdict(comparison)])


def verdict(comparison: Difference) -> str:
    """Return one line on whether two results are the same, and within which tolerance."""
    largest = max((level.difference for level in comparison.levels), default=0.0)
    text = f"the curves differ by up to {_percent(largest)} % of the peak" if largest > _ROUNDING else "the curves are equal"
    if not comparison.levels:
        return "different: no common level"
    if all(level.is_disjoint for level in comparison.levels):
        return "different: no common frequency at any level"
    if comparison.is_same:
        return f"the same: {text}{_by(comparison)}"
    why = [
        *(f"{', '.join(names)} in {side} only" for side, names in zip("AB", comparison.only) if names),
        *(f"{side} is not complete" for side in comparison.incomplete),
        *(f"no common frequency at {level.level:g} {level.unit}" for level in comparison.levels if level.is_disjoint),
    ]
    if all(map(comparison.is_level_same, comparison.levels)):
        ranges = [] if why else ["the frequency ranges differ"]
        return f"different: {'; '.join([*why, *ranges])}; in the common range {text}{_by(comparison)}"
    worst = max(comparison.levels, key=lambda level: level.difference)
    return f"different: {'; '.join([*why, f'{text}, at {worst.level:g} {worst.unit}'.removesuffix(' 1')])}{_by(comparison)}"


def _by(comparison: Difference) -> str:
    """Return the applied tolerance as text."""
    tolerance = max(map(comparison.bound, comparison.levels))
    text = f" (tolerance {100.0 * tolerance:.2g} %"
    if comparison.tolerance is None and not all(level.same_points for level in comparison.levels):
        text += " beyond the resolution of the points"
    return text + (", or the error bars)" if comparison.bars else ")")


def _head(results: ResultFile) -> str:
    origin = results.origin
    parts = [results.path, f"scene {results.name}"]
    if origin is not None:
        parts += [origin.started, f"{origin.n_ranks} rank{'s' if origin.n_ranks > 1 else ''}", origin.command]
    return _short(", ".join(parts), 200)


def _inputs(comparison: Difference) -> str:
    """Return the keys, facts and files that differ."""
    lines = _changes("inputs", comparison.keys) or ["inputs: the same keys and values"]
    lines += _changes("computed with", comparison.facts)
    if comparison.inputs is None:
        old = [side for side, results in (("A", comparison.a), ("B", comparison.b)) if results.origin is None]
        lines.append(f"files read: {listed(old)} was written by an earlier version without this list")
    else:
        n = len(comparison.a.origin.inputs) if comparison.a.origin else 0
        lines += _changes("files read", comparison.inputs) or [f"files read: the same {n}, by their hashes"]
    return "\n".join(lines)


def _changes(head: str, changes: Sequence[Change]) -> list[str]:
    width = max((len(change.key) for change in changes), default=0)
    return [head] * bool(changes) + [f"  {change.key:<{width}}  {_short(change.a)}  ->  {_short(change.b)}" for change in changes]


def _structure(comparison: Difference) -> str:
    structure = comparison.structure
    parts = []
    if any(structure.n_dof):
        parts.append(_counted("DOF", structure.n_dof))
    parts.append(_counted("pairs", structure.n_pairs))
    if structure.joints[0] != structure.joints[1]:
        parts.append(f"joints {listed(structure.joints[0]) or 'none'} -> {listed(structure.joints[1]) or 'none'}")
    elif structure.n_pairs[0] == structure.n_pairs[1] and not structure.same_pairs:
        parts.append("the pairs have other positions or nodes")
    parts += [
        f"{name} of the pairs by up to {_percent(difference)} %"
        for name, difference in structure.pairs.items()
        if difference > 1e-12
    ]
    parts.append(_counted("modes", structure.n_modes))
    if structure.mode:
        parts.append(
            f"their frequencies differ by up to {_percent(structure.modes)} %, mode {structure.mode}"
            if structure.modes
            else "equal"
        )
    return f"structure: {', '.join(parts)}"


def _counted(what: str, n: tuple[int, int]) -> str:
    return f"{n[0]} {what}" if n[0] == n[1] else f"{n[0]} -> {n[1]} {what}"


def _table(comparison: Difference) -> str:
    rows = [row for level in comparison.levels for row in _rows(level)]
    title = "difference: of mean and all harmonics, in % of the peak of A; peaks, losses, states: where harmonic 1 is largest"
    return screen_table(title, _HEAD, rows, left=("level", "output"), wraps=("output",), close=True)


def _rows(level: LevelDifference) -> list[tuple[float, list[str]]]:
    name = f"{level.level:g} {level.unit}".removesuffix(" 1")
    n = str(level.n_points[0]) if level.same_points else f"{level.n_points[0]}, {level.n_points[1]}"
    if not level.outputs:
        return [(level.level, [name, "\u2013", n, *["\u2013"] * (len(_HEAD) - 3)])]
    rows = []
    for k, output in enumerate(level.outputs):
        both = [
            *(f"{value:.4g}" for value in level.friction),
            f"{level.slip[0]}, {level.slip[1]}",
            f"{level.open[0]}, {level.open[1]}",
        ]
        cells = [
            name if k == 0 else "",
            output.name,
            n if k == 0 else "",
            _percent(output.difference),
            f"{output.at:.6g}",
            *(f"{value:.5g}" for value in output.peak),
            _percent(_relative(*output.peak)),
            *(f"{value:.7g}" for value in output.peak_at),
            _percent(_relative(*output.peak_at)),
            *(both if k == 0 else [""] * len(both)),
            "\u2013" if output.inside_bars is None else "yes" if output.inside_bars else "no",
        ]
        rows.append((level.level, cells))
    return rows


def _notes(comparison: Difference) -> str:
    """Return notes on levels: early ends, different points, pairs in different states."""
    lines = []
    for level in comparison.levels:
        name = f"{level.level:g} {level.unit}".removesuffix(" 1")
        for side, status, failure, n in zip("AB", level.status, level.failure, level.n_points):
            if status != COMPLETE:
                how = f"ended early: {_short(failure, 150)}" if failure else "was not finished when the file was written"
                lines.append(f"{name}: {side} {how} ({counted(n, 'point')})")
        if level.ends is not None:
            (low_a, high_a), (low_b, high_b) = level.ends
            how = "no common frequency" if level.is_disjoint else "compared in the overlap"
            lines.append(f"{name}: A from {low_a:.6g} to {high_a:.6g} Hz, B from {low_b:.6g} to {high_b:.6g} Hz; {how}")
        if level.beyond < _RESOLVED * level.difference:
            lines.append(
                f"{name}: different points; beyond their resolution the curves differ by {_percent(level.beyond)} % of the peak"
            )
        if others := level.n_other_state:
            lines.append(
                f"{name}: {counted(others, 'pair')} {verb(others, 'are')} in another state where the response is largest"
            )
    for side, results in (("A", comparison.a), ("B", comparison.b)):
        known = {level.level for level in comparison.levels}
        lines += [
            f"{level.level:g} {level.unit}: {side} {level.status}"
            for level in results.levels
            if level.status != COMPLETE and level.level not in known
        ]
    return "\n".join(lines)


def json_of(comparison: Difference) -> str:
    """Return the comparison as JSON: numbers unformatted, null for unknown ones.  Local."""
    levels = [
        {
            **asdict(level),
            "difference": level.difference,
            "beyond": level.beyond,
            "inside_bars": level.inside_bars,
            "is_whole": level.is_whole,
            "is_same": comparison.is_level_same(level),
        }
        for level in comparison.levels
    ]
    content: dict[str, Any] = {
        "a": comparison.a.path,
        "b": comparison.b.path,
        "is_same": comparison.is_same,
        "verdict": verdict(comparison),
        "tolerance": max(map(comparison.bound, comparison.levels), default=None),
        "beyond_resolution": comparison.tolerance is None,
        "bars": comparison.bars,
        "incomplete": comparison.incomplete,
        "keys": [asdict(change) for change in comparison.keys],
        "computed_with": [asdict(change) for change in comparison.facts],
        "inputs": None if comparison.inputs is None else [asdict(change) for change in comparison.inputs],
        "structure": asdict(comparison.structure),
        "levels": levels,
        "only_a": comparison.only[0],
        "only_b": comparison.only[1],
    }
    return json.dumps(_finite(content), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    """Return a value with None in place of numbers that JSON lacks."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _relative(a: float, b: float) -> float:
    return b / a - 1.0 if a else float("nan") if b else 0.0


def _percent(share: float) -> str:
    return "\u2013" if not math.isfinite(share) else f"{100.0 * share:.2g}"


def _short(text: str, most: int = _MOST) -> str:
    """Return a text on one line, shortened and without control characters."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= most else line[: most - 1] + "\u2026"
