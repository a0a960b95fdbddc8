"""The amplitude corrected by an enriched problem, and the bar of what remains (docs/theory.md, section 11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..points.error_parts import PARTS, SAFETY, total
from .adjoint import Adjoint

OF_HARMONICS = 0.2  # share of that part which is left: the harmonics settle to a tenth, and more would follow beyond them
OF_SAMPLES = 0.25  # the same of the samples, whose limit is extrapolated
OF_SLIDERS = 0.25  # and of the elements that pairs are divided into


@dataclass(frozen=True, eq=False)
class Estimate:
    """What enriched problems say of the complex amplitudes of harmonic 1, cos - i sin, at a point."""

    parts: np.ndarray  # (n_outputs, n_parts) sizes of what they change, as in ``PARTS`` [m]
    correction: np.ndarray  # (n_outputs,) complex: what they change, signed; 0 where that is not known well enough [m]
    remaining: np.ndarray  # (n_outputs,) error bar of the amplitudes with it [m]
    adjoint: Adjoint | None = None  # of the outputs; None where all pairs stick


def corrected(parts: np.ndarray, linear: np.ndarray, second: np.ndarray, truncated: np.ndarray, unsettled: float) -> Estimate:
    """Return the estimate of what changes do to cos 1 and then sin 1 of the outputs, n = 2 n_outputs rows each.  Local.

    docs/theory.md, eq. (11.4).  An amplitude whose bar would be no shorter is not corrected: slip so wide that the changes are
    far from linear.

    Parameters
    ----------
    parts : (n_parts, n) of the bar, as in ``PARTS``, of either sign
    linear : (6, n) signed changes to first order: of the basis, harmonics, samples, pairs, solver, sliders
    second : (n,) what they change beyond first order; infinite where it is not known
    truncated : (n,) what truncated modes change at most, of unknown sign
    unsettled : by how much more than they should the higher harmonics miss, at least 1
    """
    sizes = _sizes(parts).T
    left = [OF_HARMONICS * unsettled * linear[1], OF_SAMPLES * linear[2], OF_SLIDERS * linear[5]]
    rest = _sizes(np.stack([truncated, *left, second]))
    bar, remaining = total(sizes), SAFETY * rest.sum(axis=0)
    is_shorter = remaining < bar
    cos, sin = np.split(np.where(np.isfinite(second), linear.sum(axis=0) + second, 0.0), 2)
    return Estimate(sizes, np.where(is_shorter, cos - 1j * sin, 0.0), np.where(is_shorter, remaining, bar))


def parts_of_corrected(parts: np.ndarray, remaining: np.ndarray) -> np.ndarray:
    """Return the parts of the bar of the corrected amplitudes, (n_outputs, n_parts) [m].  Local.

    What is left of the parts of samples and sliders is known; what is not first order counts with the harmonics, from which most
    of it comes.
    An amplitude that is not corrected has the parts that it had.

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
    cos, sin = np.split(values, 2, axis=-1)
    return np.hypot(cos, sin)
