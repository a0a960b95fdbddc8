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

    The axis after the steps: the value at the end of a step, and begin and end of the linear course within it.
    """

    pairs: np.ndarray  # (m,) numbers of the pairs, ascending
    slider_pair: np.ndarray  # (n_sliders,) place of the pair of each slider among these
    stiffness: np.ndarray  # (n_sliders, 2) [N/m]
    of_sliders: np.ndarray  # (n_sliders, n_steps, 3, 16), see :class:`SliderVariation`
    memoryless_by_first: np.ndarray  # (m, n_steps, 3, 3) [N/m], component by component
    memoryless_by_last: np.ndarray  # (m, n_steps, 3, 3) [N/m]
    n_stuck: int  # sliders that never slip

    @property
    def n_steps(self) -> int:
        """Steps of a cycle."""
        return self.of_sliders.shape[1]

    @property
    def by_memory(self) -> np.ndarray:
        """By p_t at the start of a step, (n_sliders, n_steps, 3, 2, 2) [-]."""
        return self.of_sliders[..., :4].reshape(*self.of_sliders.shape[:3], 2, 2)

    @property
    def by_first(self) -> np.ndarray:
        """By the motion at the start of a step, (n_sliders, n_steps, 3, 2, 3) [N/m]."""
        return self.of_sliders[..., 4:10].reshape(*self.of_sliders.shape[:3], 2, 3)

    @property
    def by_last(self) -> np.ndarray:
        """By the motion at the end of a step, (n_sliders, n_steps, 3, 2, 3) [N/m]."""
        return self.of_sliders[..., 10:].reshape(*self.of_sliders.shape[:3], 2, 3)

    @property
    def repeats(self) -> np.ndarray:
        """Whether the forces vary in a step as in the one before it, (n_steps - 1,) bool: not for the first one."""
        arrays = self.of_sliders, self.memoryless_by_first, self.memoryless_by_last
        return np.all([(of[:, 1:] == of[:, :-1]).all(axis=(0, 2, 3)) for of in arrays], axis=0)


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
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("pairs", "stiffness", "of_sliders", "memoryless_by_first", "memoryless_by_last")
    }
    slider_pair = np.concatenate([part.slider_pair + start for part, start in zip(parts, starts)])
    return ContactVariation(slider_pair=slider_pair, **arrays, n_stuck=sum(part.n_stuck for part in parts))


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
    first, last = _courses_of_rate(rate[::n_within, varying], n_steps, 1)  # exact for springs that do not change
    if changes.any():
        finer = np.moveaxis(synthesise(U[changes], n_steps * n_within * _PARTS, harmonics), 2, 0)  # (n_samples, .., 3)
        courses = _courses_of_rate(law.take(changes).memoryless_rate(finer), n_steps, n_within * _PARTS)
        first[place[changes]], last[place[changes]] = courses
    order = np.argsort(np.concatenate([part.pair for part in parts]), kind="stable")

    def together(name: str) -> np.ndarray:
        """Return a value of the sliders of all kinds, by ascending pair."""
        return np.concatenate([getattr(part, name) for part in parts])[order]

    return ContactVariation(
        numbers[varying],
        place[together("pair")],
        together("stiffness"),
        together("derivatives"),
        first,
        last,
        sum(part.n_stuck for part in parts),
    )


def _courses_of_rate(rate: np.ndarray, n_steps: int, n_within: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates of p by the motion at begin and end of each step, (m, n_steps, 3, 3) each, from samples (n_samples, m, 3).

    docs/theory.md, eq. (16.3).  Along the first axis of three as :class:`SliderVariation` has it.
    """
    at = (np.arange(n_steps)[:, None] * n_within + np.arange(n_within + 1)) % len(rate)
    time = np.linspace(0.0, 1.0, n_within + 1)
    mean = np.full(n_within + 1, 1.0 / n_within)
    mean[[0, -1]] *= 0.5
    moment = time / n_within
    moment[0], moment[-1] = 1.0 / (6.0 * n_within**2), (0.5 - 1.0 / (6.0 * n_within)) / n_within
    end = np.zeros(n_within + 1)
    end[-1] = 1.0
    weights = np.stack([end, 4.0 * mean - 6.0 * moment, 6.0 * moment - 2.0 * mean])
    within = rate[at]  # (n_steps, n_within + 1, m, 3)
    first, last = (np.einsum("wj,sjmi->mswi", weights * share, within, optimize=True) for share in (1.0 - time, time))
    return first, last
