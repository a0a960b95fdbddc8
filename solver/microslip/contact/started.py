"""Sliders that start at a phase of the cycle other than the first sample, as in the other sectors of a full disc.

The residual force of a slider that has slipped once and rests depends on its initial position (docs/theory.md, section 3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..fourier.coefficients import shifted
from ..fourier.harmonics import Harmonics
from .law import ContactCycle, Law
from .sliders import Sliders


@dataclass(frozen=True)
class StartedLaw:
    """The law of n pairs whose march begins at the phases ``start`` (n,) [rad] of the cycle, docs/theory.md, eq. (3.16).

    The samples of a pair are counted from its start, so that a wave on a disc has the same samples in every sector.
    """

    law: Law
    start: np.ndarray

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return self.law.n_pairs

    @property
    def order(self) -> int:
        """The order in 1 / N_t at which the harmonics of a cycle converge."""
        return self.law.order

    @property
    def elements_order(self) -> int:
        """The order of the error of a finite number of elements."""
        return self.law.elements_order

    @property
    def n_memory(self) -> int:
        """Number of internal variables per pair that a time step stores in addition to p."""
        return self.law.n_memory

    @property
    def stiffness(self) -> np.ndarray:
        """The springs K_J of a pair that sticks, (n, 3) [N/m]."""
        return self.law.stiffness

    @property
    def springs(self) -> np.ndarray:
        """The springs of a pair in contact, (n, 3) [N/m]."""
        return self.law.springs

    @property
    def refined(self) -> StartedLaw:
        """The law with more elements per pair, where a pair has several."""
        return replace(self, law=self.law.refined)

    def take(self, indices: np.ndarray | slice) -> StartedLaw:
        """Return the law of some pairs: an index array, a mask or a slice.  Local."""
        return StartedLaw(self.law.take(indices), self.start[indices])

    def followed(self, path: bool) -> StartedLaw:
        """Return the law that follows the path between samples, or the law evaluated at the samples only.  Local."""
        return replace(self, law=self.law.followed(path))

    def with_parameters(self, name: str, pairs: np.ndarray, values: np.ndarray) -> StartedLaw:
        """Return the law with new values of a parameter for some pairs.  Local."""
        return replace(self, law=self.law.with_parameters(name, pairs, values))

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None) -> ContactCycle:
        """Return the harmonics of p under the periodic motion ``U`` (n, 3, N_H) [m], with their exact derivative.

        Local.  docs/theory.md, eq. (3.16).
        """
        harmonics = harmonics or Harmonics.full(U.shape[2])
        start = self.start[:, None]
        cycle = self.law.cycle(shifted(U, start, harmonics), n_samples, tangents, harmonics)
        P = cycle.P
        if P is not None:
            back, shape = -self.start[cycle.active][:, None, None], (len(P), P.shape[1], 3, harmonics.n_coefficients)
            for _ in range(2):  # columns, then rows
                P = shifted(P.reshape(shape), back, harmonics).reshape(P.shape).transpose(0, 2, 1)
        return replace(cycle, p=shifted(cycle.p, -start, harmonics), P=P)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters of the law that vary."""
        return self.law.parameters

    def parameter_rate(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter of each pair under the motion ``U``, (n, 3, N_H).  Local."""
        harmonics = harmonics or Harmonics.full(U.shape[2])
        start = self.start[:, None]
        return shifted(self.law.parameter_rate(name, shifted(U, start, harmonics), n_samples, harmonics), -start, harmonics)

    def step(self, du: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p and internal variables after a time step, the derivative of p, and the states.  Local."""
        return self.law.step(du, before)

    @property
    def sliders(self) -> tuple[Sliders, ...]:
        """The sliders of the pairs."""
        return self.law.sliders

    def memoryless_rate(self, du: np.ndarray) -> np.ndarray:
        """Return the derivative of the history-independent part of p, as in :class:`Law`.  Local."""
        return self.law.memoryless_rate(du)

    def slip_safety(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the factor by which motions may grow while each pair certainly sticks and stays closed, (..., n).  Local."""
        return self.law.slip_safety(amplitudes)

    def utilisation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the utilisation of each pair, stuck force divided by its limit, (..., n).  Local."""
        return self.law.utilisation(amplitudes)

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float = 1.0) -> np.ndarray:
        """Return an upper bound of |p| / stuck force, (..., n, 3).  Local."""
        return self.law.slipping_share(amplitudes, of_limit)

    def keeps_half_wave_symmetry(self, moves: np.ndarray) -> np.ndarray:
        """Return which pairs keep half-wave symmetry if the components ``moves`` (n, 3) move, (n,); see :class:`Law`.  Local."""
        return self.law.keeps_half_wave_symmetry(moves)


def started_at(law: Law, start: np.ndarray | None) -> Law:
    """Return the law of pairs that start at phases (n,) [rad]; NaN or none: at the first sample.  Local."""
    phases = np.zeros(law.n_pairs) if start is None else np.nan_to_num(start)
    return StartedLaw(law, phases) if phases.any() else law
