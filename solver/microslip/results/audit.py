"""Energy audit: the work of the loads per cycle equals the losses by damping and friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..fourier.coefficients import amplitude
from ..messages.words import counted
from ..points.branch import CLOSES_TO, Branch
from .record import LevelResult, ResultFile

_ROUNDING = 1e-10  # of pi F a, the most work that a load F can do per cycle at amplitude a


def closure(work: np.ndarray, damping: np.ndarray, friction: np.ndarray, most_work: np.ndarray | float = 0.0) -> np.ndarray:
    """Return |input - damping - friction| over the input, (n,) [-].  Local.

    Parameters
    ----------
    work, damping, friction : (n,) J per cycle
    most_work : (n,) pi F a [J per cycle]; where the input is less than 1e-10 of it (no damping, no slip), the closure
        is relative to that instead, since the input is only rounding
    """
    gap = np.abs(work - damping - friction)
    scale = np.maximum(np.maximum(np.abs(work), np.abs(damping) + np.abs(friction)), _ROUNDING * np.abs(most_work))
    return np.divide(gap, scale, out=np.zeros_like(gap), where=gap > 0.0)


def energy_closure(branch: Branch, works: Sequence[int] | None = None) -> np.ndarray:
    """Return the closure of the energy balance at each point of a branch, (n_points,) [-].  Local, on rank 0.

    ``works`` are the outputs whose amplitude times the level is a work; None: all.
    """
    work, damping, friction = (
        np.array([getattr(point, name) for point in branch.points], dtype=float) for name in ("input", "damping", "friction")
    )
    largest = np.array(
        [amplitude(point.response[slice(None) if works is None else works]).max(initial=0.0) for point in branch.points]
    )
    return closure(work, damping, friction, np.pi * branch.level * largest)


def balance(results: ResultFile, level: LevelResult) -> np.ndarray:
    """Return the closure of the energy balance at the points of a level, (n,) [-].  Local."""
    works = [k for k in range(len(results.outputs)) if (results.unit_of(k), results.level_unit) == ("m", "N")]
    most = np.pi * abs(level.level) * amplitude(level.response[:, works]).max(axis=1, initial=0.0)
    return closure(level.input, level.damping, level.friction, most)


def audit_text(branches: list[Branch], works: Sequence[int] | None = None) -> str:
    """Return the audit of all levels as a small table for the log; ``works`` as above.  Local, on rank 0."""
    bounds = sorted({branch.closes_to for branch in branches}) or [CLOSES_TO]
    limits = " to ".join(f"{bound:.0e}" for bound in {bounds[0], bounds[-1]})
    lines = [
        f"energy balance, input = damping + friction [J per cycle]; to close within {limits}",
        f"  {'level_N':>10} {'largest closure':>15} {'at Hz':>12} {'input there':>12} {'friction at peak':>16}",
    ]
    for branch in branches:
        if not branch.points:
            lines.append(f"  {branch.level:>10.6g} {'no point':>15}")
            continue
        closures = energy_closure(branch, works)
        worst = branch.points[int(np.argmax(closures))]
        top = max(branch.points, key=lambda point: amplitude(point.response[0]))
        lines.append(
            f"  {branch.level:>10.6g} {closures.max():>15.1e} {worst.omega / 2 / np.pi:>12.7g} "
            f"{worst.input:>12.4e} {top.friction:>16.4e}"
        )
        bound = branch.closes_to
        n_beyond = np.count_nonzero(closures > bound)
        if n_beyond:
            lines.append(
                f"  {n_beyond} of {counted(len(closures), 'point')} close worse than {bound:.0e}; lower [solver] tolerance"
            )
    return "\n".join(lines)
