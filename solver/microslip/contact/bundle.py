"""Parallel elastic-Coulomb elements that represent each pair of a law with gradual slip (docs/theory.md, section 3).

The elements are asperities that carry a part of the pressure, or the sliders of an Iwan element; each has a sharp transition from
stick to slip.  Path, derivative and steady cycle are exact for each element, and hence for their sum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..fourier.coefficients import synthesise
from ..fourier.harmonics import Harmonics
from .elastic_coulomb import ElasticCoulomb
from .law import SLIP, STICK, ContactCycle
from .sliders import Sliders

_MOST_DERIVATIVES = 2**24  # entries of dp/dU of elements in memory at the same time


class BundleLaw:
    """Base of the laws whose tangential part is a bundle of elements."""

    bundle: Bundle

    @property
    def order(self) -> int:
        """The order in 1 / N_t at which the harmonics of a cycle converge: the order of the elements."""
        return self.bundle.elements.order

    @property
    def elements_order(self) -> int:
        """The order at which p converges with the number of elements."""
        return 2

    @property
    def n_memory(self) -> int:
        """Number of internal variables per pair that a time step stores in addition to p: the forces of its elements."""
        return self.bundle.n_memory

    @property
    def sliders(self) -> tuple[Sliders, ...]:
        """The sliders of the pairs: the elements."""
        pairs = np.repeat(np.arange(self.bundle.n_pairs), self.bundle.size)
        return tuple(sliders.of_pairs(pairs) for sliders in self.bundle.elements.sliders)


@dataclass(frozen=True)
class Bundle:
    """Elements of n pairs, ``size`` per pair, with the motion of the pair: eq. (3.10).  Only their tangential force is used.

    Elements with a preload contribute to the stiffness of the stuck pair.  Elements with a gap do not: p is their whole force.
    """

    elements: ElasticCoulomb  # (n size,), elements of a pair are consecutive
    size: int

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return self.elements.n_pairs // self.size

    @cached_property
    def has_gap(self) -> np.ndarray:
        """Which elements are open at rest, (n, size) bool."""
        return (self.elements.N0 < 0.0).reshape(-1, self.size)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Tangential stiffness of the elements, (n, size) [N/m]."""
        return self.elements.k_t.reshape(-1, self.size)

    @cached_property
    def springs_of_gaps(self) -> np.ndarray:
        """Sum of the tangential stiffness of the elements that are open at rest, not included in K_J, (n,) [N/m]."""
        return np.where(self.has_gap, self.stiffness, 0.0).sum(axis=1)

    def of_elements(self, values: np.ndarray) -> np.ndarray:
        """Return the ``values`` of the elements (..., n size) as (..., n, size)."""
        return values.reshape(*values.shape[:-1], -1, self.size)

    def take(self, indices: np.ndarray | slice) -> Bundle:
        """Return the elements of some pairs: an index array, a mask or a slice.  Local."""
        chosen = np.arange(self.n_pairs)[indices]
        return replace(self, elements=self.elements.take((chosen[:, None] * self.size + np.arange(self.size)).ravel()))

    def followed(self, path: bool) -> Bundle:
        """Return elements that follow the path between samples, or are evaluated at the samples only.  Local."""
        return replace(self, elements=self.elements.followed(path))

    # -- a cycle -----------------------------------------------------------------------------------------------

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool, harmonics: Harmonics | None) -> ContactCycle:
        """Return the tangential forces beyond the stuck springs under the periodic motion ``U`` (n, 3, N_H), with derivative.

        Local.  docs/theory.md, eq. (3.10).  Rows z are zero.  A pair slips if all of its elements in contact slip.
        """
        rows = U.shape[1] * U.shape[2]
        step = max(1, _MOST_DERIVATIVES // (self.size * rows**2))
        if not tangents or self.n_pairs <= step:
            return self._cycle_of_part(U, n_samples, tangents, harmonics)
        parts = [slice(i, i + step) for i in range(0, self.n_pairs, step)]
        return _joined([self.take(part)._cycle_of_part(U[part], n_samples, tangents, harmonics) for part in parts])

    def _cycle_of_part(self, U: np.ndarray, n_samples: int, tangents: bool, harmonics: Harmonics | None) -> ContactCycle:
        """Return eq. (3.10) for a motion U (n, 3, N_H), from elements that touch; the others carry no force.  Local."""
        n, _, N_H = U.shape
        touching = np.flatnonzero(self._touch(U, n_samples, harmonics))
        pair, elements = touching // self.size, self.elements.take(touching)
        cycle = elements.cycle(U[pair], n_samples, tangents, harmonics)
        springs = np.where(elements.N0 < 0.0, elements.k_t, 0.0)  # of stuck elements that are not part of the stuck pair
        touched, first = np.unique(pair, return_index=True)  # pairs with an element that touches
        p = np.zeros_like(U)
        state, drifts = np.zeros(n, dtype=np.uint8), np.zeros(n, dtype=bool)
        if len(touched):
            p[touched, :2] = np.add.reduceat(cycle.p[:, :2] + springs[:, None, None] * U[pair, :2], first)
            slips = np.logical_and.reduceat((cycle.state != STICK) | (elements.k_t == 0.0), first)
            state[touched[slips]] = SLIP
            drifts[touched] = np.logical_or.reduceat(cycle.drifts, first)
        active, start = np.unique(pair[cycle.active], return_index=True)
        P = None
        if cycle.P is not None:
            P = np.add.reduceat(cycle.P, start) if len(active) else np.empty((0, 3 * N_H, 3 * N_H))
            P[:, 2 * N_H :] = 0.0
            of_gaps, i = np.bincount(pair, springs, n)[active], np.arange(2 * N_H)
            P[:, i, i] += of_gaps[:, None]
        return ContactCycle(p, state, active, P, drifts)

    def _touch(self, U: np.ndarray, n_samples: int, harmonics: Harmonics | None) -> np.ndarray:
        """Return which elements touch at any sample, (n, size): evaluated for elements with a gap, True for the others."""
        if not self.has_gap.any():
            return ~self.has_gap
        closest = synthesise(U[:, 2], n_samples, harmonics).min(axis=1)[:, None]
        return ~self.has_gap | (self.of_elements(self.elements.N0) > self.of_elements(self.elements.k_n) * closest)

    def parameter_rate(
        self, name: str, per_pair: np.ndarray, U: np.ndarray, n_samples: int, harmonics: Harmonics | None
    ) -> np.ndarray:
        """Return the derivative of the forces of :meth:`cycle` by a parameter of the pairs, (n, 3, N_H).

        Local.  ``per_pair`` (n size,) is the derivative of the column ``name`` of the elements by that parameter; the
        derivative of the force of an element is (3.15).
        """
        rate = np.zeros_like(U)
        step = max(1, _MOST_DERIVATIVES // (self.size * (U.shape[1] * (U.shape[2] + 1)) ** 2))
        for i in range(0, self.n_pairs, step):
            part = slice(i, i + step)
            bundle = self.take(part)
            changes = bundle.of_elements(per_pair[i * self.size : (i + step) * self.size]) != 0.0
            touched = np.flatnonzero(bundle._touch(U[part], n_samples, harmonics) & changes)
            pair, elements = touched // self.size, bundle.elements.take(touched)
            elements = replace(elements, open_at_rest=elements.N0 < 0.0)
            of_elements = elements.rate_at_preload(name, U[part][pair], n_samples, harmonics)
            of_elements *= per_pair[i * self.size + touched, None, None]
            np.add.at(rate[part, :2], pair, of_elements[:, :2])
        return rate

    # -- a time step -------------------------------------------------------------------------------------------

    @property
    def n_memory(self) -> int:
        """Number of internal variables per pair: the tangential forces of its elements beyond their stuck springs."""
        return 2 * self.size

    def step(self, du: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the tangential p after a step to ``du`` (..., n, 3), its derivative, which pairs slip, internal variables.

        Local.  docs/theory.md, eq. (3.10).  Shapes (..., n, 2), (..., n, 2, 3), (..., n) and (..., n, n_memory), like ``memory``.
        """
        before = np.zeros((*memory.shape[:-2], self.elements.n_pairs, 3))
        before[..., :2] = memory.reshape(*memory.shape[:-2], -1, 2)
        p, L, state = self.elements.step(np.repeat(du, self.size, axis=-2), before)
        shape = (*du.shape[:-1], self.size)
        springs = np.where(self.has_gap, self.stiffness, 0.0)  # subtracted per element: the force of an open element is exactly 0
        force = (p[..., :2].reshape(*shape, 2) + springs[:, :, None] * du[..., None, :2]).sum(axis=-2)
        L = L[..., :2, :].reshape(*shape, 2, 3)
        L[..., (0, 1), (0, 1)] += springs[:, :, None]
        derivative = L.sum(axis=-3)
        slips = ((state.reshape(shape) != STICK) | (self.stiffness == 0.0)).all(axis=-1)
        return force, derivative, slips, p[..., :2].reshape(memory.shape)

    # -- its limits --------------------------------------------------------------------------------------------

    @cached_property
    def held_at_rest(self) -> np.ndarray:
        """The friction force at rest, (n,) [N]."""
        return np.hypot(*(self.elements.k_t[:, None] * self.elements.w0).reshape(-1, self.size, 2).sum(axis=1).T)

    def stretch(self, du: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Return the stretch of each element under its friction force, (n, size, 2) [m], at ``du`` (n, 3) in a march.  Local.

        ``memory`` (n, n_memory or more) starts with the internal variables of :meth:`step`.  The stretch of an element without
        stiffness is 0.
        """
        k_t = self.elements.k_t.reshape(-1, self.size, 1)
        p = memory[:, : self.n_memory].reshape(-1, self.size, 2)
        stretch = du[:, None, :2] - self.elements.w0.reshape(-1, self.size, 2)
        return np.where(k_t > 0.0, stretch + np.divide(p, k_t, out=np.zeros_like(p), where=k_t > 0.0), 0.0)

    def slip_safety(self, amplitudes: np.ndarray, weakest: int) -> np.ndarray:
        """Return the factor by which motions may grow while all elements of each pair certainly stick, (..., n).

        Without friction forces at rest, this is the factor of the ``weakest`` element.
        """
        if self.elements.w0.any():
            safety = self.of_elements(self.elements.slip_safety(np.repeat(amplitudes, self.size, axis=-2)))
            return np.where(self.has_gap, np.inf, safety).min(axis=-1)
        return self.elements.take(slice(weakest, None, self.size)).slip_safety(amplitudes)

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float) -> np.ndarray:
        """Return an upper bound of |p_t| / stuck tangential force over the elements with a preload, (..., n).  Local."""
        share = self.elements.slipping_share(np.repeat(amplitudes, self.size, axis=-2), of_limit)[..., 0]
        carried = np.where(self.has_gap, 0.0, self.stiffness)
        return (carried * self.of_elements(share)).sum(axis=-1) / carried.sum(axis=1)


def initial_positions(columns: Mapping[str, np.ndarray], size: int) -> np.ndarray | None:
    """Return the initial slider positions of the elements, (n, size, 2) [m], from the columns of pairs; None: 0.  Local."""
    w0 = columns.get("w0")
    return None if w0 is None or w0.shape[1] < size else w0[:, :size]


def _joined(cycles: list[ContactCycle]) -> ContactCycle:
    """Return the concatenation of the cycles of consecutive groups of pairs."""
    starts = np.cumsum([0, *(len(cycle.p) for cycle in cycles)])
    p, state, drifts = (np.concatenate([getattr(cycle, name) for cycle in cycles]) for name in ("p", "state", "drifts"))
    active = np.concatenate([cycle.active + start for cycle, start in zip(cycles, starts)])
    P = None if cycles[0].P is None else np.concatenate([cycle.P for cycle in cycles if cycle.P is not None])
    return ContactCycle(p, state, active, P, drifts)
