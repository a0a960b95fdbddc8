"""Variation of the contact forces of pairs in the steps of a periodic motion (docs/theory.md, section 16).

Within a step a variation of the motion is linear, d0 at its begin and d1 at its end.  The forces need not be: where a slider
begins to slip they jump.  They count with their value at the end, and as the linear course that has their mean and their first
moment.
"""

from dataclasses import dataclass

import numpy as np

from ..contact.law import Law
from ..fourier.coefficients import synthesise
from ..fourier.harmonics import Harmonics

_BLOCK = 128  # pairs whose samples are held at a time
_PARTS = 4  # of the way between two samples, at which springs that change are followed: they jump where a pair opens


@dataclass(frozen=True, eq=False)
class ContactVariation:
    """d p of ``m`` pairs along a cycle, by p_t of their sliders and by their motion, on n_sliders sliders that slip.

    Along the first axis of three: the value at the end of a step, and begin and end of the linear course within it.
    """

    pairs: np.ndarray  # (m,) numbers of the pairs, ascending
    slider_pair: np.ndarray  # (n_sliders,) place of the pair of each slider among these
    stiffness: np.ndarray  # (n_sliders, 2) [N/m]
    by_memory: np.ndarray  # (n_steps, 3, n_sliders, 2, 2) [-]
    by_first: np.ndarray  # (n_steps, 3, n_sliders, 2, 3) [N/m]
    by_last: np.ndarray  # (n_steps, 3, n_sliders, 2, 3) [N/m]
    memoryless_by_first: np.ndarray  # (n_steps, 3, m, 3) [N/m], component by component
    memoryless_by_last: np.ndarray  # (n_steps, 3, m, 3) [N/m]
    n_stuck: int  # sliders that never slip

    @property
    def n_steps(self) -> int:
        """Steps of a cycle."""
        return len(self.by_memory)

    @property
    def repeats(self) -> np.ndarray:
        """Whether the forces vary in a step as in the one before it, (n_steps,) bool."""
        arrays = self.by_memory, self.by_first, self.by_last, self.memoryless_by_first, self.memoryless_by_last
        return np.all([(of == np.roll(of, 1, axis=0)).reshape(len(of), -1).all(axis=1) for of in arrays], axis=0)


def contact_variation(
    law: Law, numbers: np.ndarray, U: np.ndarray, harmonics: Harmonics, n_steps: int, n_within: int
) -> ContactVariation:
    """Return how p of pairs (n,) varies along the motion ``U`` (n, 3, N_H), each step followed through ``n_within`` samples.

    Local.  ``numbers`` (n,) are those of the pairs; pairs whose p does not vary are left out.
    """
    blocks = [
        _of_block(law.take(block), numbers[block], U[block], harmonics, n_steps, n_within)
        for block in np.array_split(np.arange(len(U)), max(1, -(-len(U) // _BLOCK)))
    ]
    return joined(blocks)


def joined(parts: list[ContactVariation]) -> ContactVariation:
    """Return the variation of the pairs of all parts, whose numbers ascend from part to part.  Local."""
    starts = np.cumsum([0, *(len(part.pairs) for part in parts)])
    along_steps = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=2)
        for name in ("by_memory", "by_first", "by_last", "memoryless_by_first", "memoryless_by_last")
    }
    return ContactVariation(
        np.concatenate([part.pairs for part in parts]),
        np.concatenate([part.slider_pair + start for part, start in zip(parts, starts)]),
        np.concatenate([part.stiffness for part in parts]),
        **along_steps,
        n_stuck=sum(part.n_stuck for part in parts),
    )


def _of_block(
    law: Law, numbers: np.ndarray, U: np.ndarray, harmonics: Harmonics, n_steps: int, n_within: int
) -> ContactVariation:
    du = np.ascontiguousarray(np.moveaxis(synthesise(U, n_steps * n_within, harmonics), 1, 2))  # (n, n_samples, 3)
    parts = [sliders.variation(du, n_steps) for sliders in law.sliders]
    rate = law.memoryless_rate(np.moveaxis(du, 0, 1))  # (n_samples, n, 3)
    varies, changes = rate.any(axis=(0, 2)), (rate != rate[0]).any(axis=(0, 2))
    for part in parts:
        varies[part.pair] = True
    varying, place = np.flatnonzero(varies), np.cumsum(varies) - 1
    first, last = _moments_of_rate(rate[::n_within, varying], n_steps, 1)  # exact for springs that do not change
    if changes.any():
        finer = np.moveaxis(synthesise(U[changes], n_steps * n_within * _PARTS, harmonics), 2, 0)  # (n_samples, .., 3)
        moments = _moments_of_rate(law.take(changes).memoryless_rate(finer), n_steps, n_within * _PARTS)
        first[:, :, place[changes]], last[:, :, place[changes]] = moments
    order = np.argsort(np.concatenate([part.pair for part in parts]), kind="stable")

    def together(name: str) -> np.ndarray:
        """Return a value of the sliders of all kinds, by ascending pair; along the steps first, as linear courses."""
        values = np.concatenate([getattr(part, name) for part in parts])[order]
        return _as_courses(np.moveaxis(values, 0, 2))

    return ContactVariation(
        numbers[varying],
        place[np.concatenate([part.pair for part in parts])[order]],
        np.concatenate([part.stiffness for part in parts])[order],
        together("by_memory"),
        together("by_first"),
        together("by_last"),
        _as_courses(first),
        _as_courses(last),
        sum(part.n_stuck for part in parts),
    )


def _moments_of_rate(rate: np.ndarray, n_steps: int, n_within: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates of p by the motion at begin and end of each step, (n_steps, 3, m, 3) each, from samples (n_samples, m, 3).

    Along the axis of three as :class:`SliderVariation` has it.
    """
    at = (np.arange(n_steps)[:, None] * n_within + np.arange(n_within + 1)) % len(rate)
    time = np.linspace(0.0, 1.0, n_within + 1)
    mean = np.full(n_within + 1, 1.0 / n_within)
    mean[[0, -1]] *= 0.5
    moment = time / n_within
    moment[0], moment[-1] = 1.0 / (6.0 * n_within**2), (0.5 - 1.0 / (6.0 * n_within)) / n_within
    end = np.zeros(n_within + 1)
    end[-1] = 1.0
    weights = np.stack([end, mean, moment])
    within = rate[at]  # (n_steps, n_within + 1, m, 3)
    first, last = (np.einsum("wj,sjmi->swmi", weights * share, within, optimize=True) for share in (1.0 - time, time))
    return first, last


def _as_courses(values: np.ndarray) -> np.ndarray:
    """Return value at the end, begin and end of the linear course, from value at the end, mean and first moment: axis 1.

    docs/theory.md, eq. (16.3).
    """
    mean, moment = values[:, 1], values[:, 2]
    return np.stack([values[:, 0], 4.0 * mean - 6.0 * moment, 6.0 * moment - 2.0 * mean], axis=1)
