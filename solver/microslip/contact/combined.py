"""Pairs of several laws as a single law: each part evaluates its own pairs; the order of the pairs does not change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..fourier.harmonics import Harmonics
from .law import ContactCycle, Law
from .sliders import Sliders


@dataclass(frozen=True)
class CombinedLaw:
    """The law of pairs with different laws, in two or more parts; constructed by :func:`as_one`."""

    parts: tuple[tuple[np.ndarray, Law], ...]  # pair numbers, ascending, and their law; every pair belongs to one part

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return sum(len(pairs) for pairs, _ in self.parts)

    @property
    def order(self) -> int:
        """The order in 1 / N_t at which the harmonics of a cycle converge: the lowest of the parts."""
        return min(law.order for _, law in self.parts)

    @property
    def elements_order(self) -> int:
        """The order of the error of a finite number of elements: the highest of the parts."""
        return max(law.elements_order for _, law in self.parts)

    @property
    def n_memory(self) -> int:
        """Number of internal variables per pair that a time step stores in addition to p: the maximum over the parts."""
        return max(law.n_memory for _, law in self.parts)

    @property
    def stiffness(self) -> np.ndarray:
        """The springs K_J of a pair that sticks, (n, 3) [N/m]."""
        return self._together(lambda law, pairs: law.stiffness)

    @property
    def springs(self) -> np.ndarray:
        """The springs of a pair in contact, (n, 3) [N/m]."""
        return self._together(lambda law, pairs: law.springs)

    def take(self, indices: np.ndarray | slice) -> Law:
        """Return the law of some pairs, an index array, a mask or a slice; of one part, if they all belong to it.  Local."""
        chosen = np.arange(self.n_pairs)[indices]
        part_of, place = np.empty((2, self.n_pairs), dtype=np.intp)
        for i, (pairs, _) in enumerate(self.parts):
            part_of[pairs], place[pairs] = i, np.arange(len(pairs))
        parts = [(np.flatnonzero(part_of[chosen] == i), law) for i, (_, law) in enumerate(self.parts)]
        return as_one([(pairs, law.take(place[chosen[pairs]])) for pairs, law in parts])

    def followed(self, path: bool) -> CombinedLaw:
        """Return the law that follows the path between samples, or the law evaluated at the samples only.  Local."""
        return CombinedLaw(tuple((pairs, law.followed(path)) for pairs, law in self.parts))

    @cached_property
    def refined(self) -> CombinedLaw:
        """The law with more elements per pair, in the parts with several per pair."""
        return CombinedLaw(tuple((pairs, law.refined) for pairs, law in self.parts))

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None) -> ContactCycle:
        """Return the harmonics of p under the periodic motion ``U`` (n, 3, N_H) [m], with their exact derivative.  Local."""
        if self.n_pairs != len(U):
            raise ValueError(f"harmonics of {len(U)} pairs with the law of {self.n_pairs}")
        cycles = [(pairs, law.cycle(U[pairs], n_samples, tangents, harmonics)) for pairs, law in self.parts]
        p, state, drifts = np.zeros_like(U), np.zeros(len(U), dtype=np.uint8), np.zeros(len(U), dtype=bool)
        for pairs, cycle in cycles:
            p[pairs], state[pairs], drifts[pairs] = cycle.p, cycle.state, cycle.drifts
        active = np.concatenate([pairs[cycle.active] for pairs, cycle in cycles])
        order = np.argsort(active)
        P = np.concatenate([cycle.P for _, cycle in cycles if cycle.P is not None])[order] if tangents else None
        return ContactCycle(p, state, active[order], P, drifts)

    def with_parameters(self, name: str, pairs: np.ndarray, values: np.ndarray) -> CombinedLaw:
        """Return the law with new values of a parameter for some pairs, whose laws must have the parameter.  Local."""
        all_pairs = np.full(self.n_pairs, np.nan)
        chosen = np.zeros(self.n_pairs, dtype=bool)
        all_pairs[pairs], chosen[pairs] = values, True
        parts = []
        for part, law in self.parts:
            pairs_of_part = np.flatnonzero(chosen[part])
            parts.append(
                (part, law.with_parameters(name, pairs_of_part, all_pairs[part[pairs_of_part]]) if len(pairs_of_part) else law)
            )
        return CombinedLaw(tuple(parts))

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters that any of the parts has."""
        return tuple(dict.fromkeys(name for _, law in self.parts for name in law.parameters))

    def parameter_rate(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter of each pair, (n, 3, N_H); 0 where its law does not have it and another has.  Local."""

        def rate(law: Law, pairs: np.ndarray) -> np.ndarray:
            is_without = name not in law.parameters and name in self.parameters
            return np.zeros_like(U[pairs]) if is_without else law.parameter_rate(name, U[pairs], n_samples, harmonics)

        return self._together(rate)

    def step(self, du: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p and internal variables after a time step, the derivative of p, and the states, as in :class:`Law`.  Local."""
        after, L = np.zeros_like(before), np.zeros((*du.shape, 3))
        state = np.zeros(du.shape[:-1], dtype=np.uint8)
        for pairs, law in self.parts:
            used = 3 + law.n_memory
            after[..., pairs, :used], L[..., pairs, :, :], state[..., pairs] = law.step(
                du[..., pairs, :], before[..., pairs, :used]
            )
        return after, L, state

    @property
    def sliders(self) -> tuple[Sliders, ...]:
        """The sliders of the pairs, part by part."""
        return tuple(sliders.of_pairs(pairs) for pairs, law in self.parts for sliders in law.sliders)

    def memoryless_rate(self, du: np.ndarray) -> np.ndarray:
        """Return d p / d du of the history-independent part of p, component by component, (..., n, 3) [N/m].  Local."""
        return self._together(lambda law, pairs: law.memoryless_rate(du[..., pairs, :]), -2)

    def slip_safety(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the factor by which motions may grow while each pair certainly sticks and stays closed, (..., n).  Local."""
        return self._together(lambda law, pairs: law.slip_safety(amplitudes[..., pairs, :]), -1)

    def utilisation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the utilisation of each pair, stuck force divided by its limit, (..., n).  Local."""
        return self._together(lambda law, pairs: law.utilisation(amplitudes[..., pairs, :]), -1)

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float = 1.0) -> np.ndarray:
        """Return an upper bound of |p| / stuck force, (..., n, 3).  Local."""
        return self._together(lambda law, pairs: law.slipping_share(amplitudes[..., pairs, :], of_limit), -2)

    def keeps_half_wave_symmetry(self, moves: np.ndarray) -> np.ndarray:
        """Return which pairs keep half-wave symmetry if the components ``moves`` (n, 3) move, (n,); see :class:`Law`.  Local."""
        return self._together(lambda law, pairs: law.keeps_half_wave_symmetry(moves[pairs]))

    def _together(self, of: Callable[[Law, np.ndarray], np.ndarray], axis: int = 0) -> np.ndarray:
        """Return the values ``of(law, pairs)`` of the parts in the order of the pairs, which are along ``axis``."""
        order = np.argsort(np.concatenate([pairs for pairs, _ in self.parts]))
        return np.concatenate([of(law, pairs) for pairs, law in self.parts], axis).take(order, axis)


def as_one(parts: Sequence[tuple[np.ndarray, Law]]) -> Law:
    """Return the law of pairs from the laws of the parts; the law of the only part with pairs, if there is one.  Local."""
    some = [(pairs, law) for pairs, law in parts if len(pairs) > 0]
    if len(some) > 1:
        return CombinedLaw(tuple(some))
    return some[0][1] if some else parts[0][1]
