"""The amplitude corrected by an enriched problem, and the bar of the remaining error (docs/theory.md, section 11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..points.error_parts import PARTS, SAFETY, total
from .adjoint import Adjoint

OF_HARMONICS = 0.2  # remaining fraction of this part: the iteration is converged to a tenth, and higher harmonics are missing
OF_SAMPLES = 0.25  # remaining fraction of the samples part, whose limit is extrapolated
OF_SLIDERS = 0.25  # remaining fraction of the sliders part, whose limit is extrapolated
MOST_STEPS = 14  # of the iteration (11.4)
FAR = 0.2  # of the amplitude: if the later steps go further without convergence, there is no solution near the point
OF_SECOND = 0.2  # remaining fraction of the terms beyond first order, which are converged to a tenth


@dataclass(frozen=True, eq=False)
class Estimate:
    """Error estimate of the complex amplitudes of harmonic 1, cos - i sin, at a point, from enriched problems."""

    parts: np.ndarray  # (n_outputs, n_parts) sizes of the changes, as in ``PARTS`` [m]
    correction: np.ndarray  # (n_outputs,) complex: signed change; 0 where it is not accurate enough [m]
    remaining: np.ndarray  # (n_outputs,) error bar of the corrected amplitudes [m]
    is_near: bool = True  # the enriched equations have a solution near the point
    adjoint: Adjoint | None = None  # of the outputs; None where all pairs stick

    @classmethod
    def of_modes_alone(cls, truncated: np.ndarray) -> Estimate:
        """Return the estimate where all pairs stick, also in the enriched problems, from the changes by truncated modes."""
        of_modes = _sizes(truncated)
        sizes = np.zeros((len(of_modes), len(PARTS)))
        sizes[:, PARTS.index("modes")] = of_modes
        return cls(sizes, np.zeros(len(sizes), dtype=complex), total(sizes))


def corrected(
    parts: np.ndarray, linear: np.ndarray, steps: np.ndarray, is_settled: bool, truncated: np.ndarray, amplitude: np.ndarray
) -> Estimate:
    """Return the error estimate from changes of cos 1 and then sin 1 of the outputs, n = 2 n_outputs rows each.  Local.

    docs/theory.md, eq. (11.4).  Terms beyond first order come mainly from the harmonics, and are added to their part.  If the
    iteration does not converge, there is no correction, and the harmonics part is at least the largest change in the later steps;
    if this change is large, the enriched equations have no solution near the point, and the part is at least the amplitude.

    Parameters
    ----------
    parts : (n_parts, n) of the bar, as in ``PARTS``, of either sign
    linear : (6, n) signed changes to first order: of the basis, harmonics, samples, pairs, solver, sliders
    steps : (n_steps, n) total changes to all orders, in each step of the iteration
    is_settled : whether the iteration converged with the last step
    truncated : (n,) upper bound of the change by truncated modes, without sign
    amplitude : (n,) of the point
    """
    sizes = _sizes(parts).T
    if not is_settled:
        farthest = _sizes(steps[MOST_STEPS // 2 :]).max(axis=0, initial=0.0)
        is_near = bool(farthest.max(initial=0.0) <= FAR * _sizes(amplitude).max(initial=0.0)) and len(steps) == MOST_STEPS
        sizes[:, 1] = np.maximum(sizes[:, 1], farthest if is_near else _sizes(amplitude))
        return Estimate(sizes, np.zeros(len(sizes), dtype=complex), total(sizes), is_near)
    beyond = steps[-1] - steps[0]
    by_harmonics = linear[1] + beyond
    sizes[:, 1] = _sizes(by_harmonics)
    left = [OF_HARMONICS * by_harmonics, OF_SAMPLES * linear[2], OF_SLIDERS * linear[5], OF_SECOND * beyond]
    bar, remaining = total(sizes), SAFETY * _sizes(np.stack([truncated, *left])).sum(axis=0)
    is_shorter = remaining < bar
    cos, sin = np.split(linear.sum(axis=0) + beyond, 2)
    return Estimate(sizes, np.where(is_shorter, cos - 1j * sin, 0.0), np.where(is_shorter, remaining, bar))


def parts_of_corrected(parts: np.ndarray, remaining: np.ndarray) -> np.ndarray:
    """Return the parts of the bar of the corrected amplitudes, (n_outputs, n_parts) [m].  Local.

    Samples and sliders have their remaining fractions; terms beyond first order are part of the harmonics, from which they mainly
    come.  Without a correction the parts do not change.

    Parameters
    ----------
    parts : (n_outputs, n_parts) of the bar, as in ``PARTS`` [m]
    remaining : (n_outputs,) the bar of the corrected amplitudes [m]
    """
    corrected_parts, left = parts.copy(), {"samples": OF_SAMPLES, "sliders": OF_SLIDERS}
    for part, share in left.items():
        corrected_parts[:, PARTS.index(part)] *= share
    modes, harmonics = parts[:, PARTS.index("modes")], parts[:, PARTS.index("harmonics")]
    known = modes + sum(corrected_parts[:, PARTS.index(part)] for part in left)
    corrected_parts[:, PARTS.index("harmonics")] = np.maximum(remaining / SAFETY - known, OF_HARMONICS * harmonics)
    return np.where((remaining < total(parts))[:, None], corrected_parts, parts)


def _sizes(values: np.ndarray) -> np.ndarray:
    """Return the sizes (..., n_outputs) of rows of cos 1, then sin 1, (..., 2 n_outputs)."""
    n = values.shape[-1] // 2
    return np.hypot(values[..., :n], values[..., n:])
