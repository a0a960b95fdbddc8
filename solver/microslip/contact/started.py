"""Sliders that start at a phase of the cycle other than the first sample, as in the other sectors of a full disc.

The residual force of a slider that has slipped once and rests depends on its initial position (docs/theory.md, section 3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ..fourier.coefficients import shifted
from ..fourier.harmonics import Harmonics
from .law import ContactCycle, Law


@dataclass(frozen=True)
class StartedLaw:
    """The law of n pairs whose march begins at the phases ``start`` (n,) [rad] of the cycle, docs/theory.md, eq. (3.16).

    The samples of a pair are counted from its start, so that a wave on a disc has the same samples in every sector.
    """

    law: Law
    start: np.ndarray

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the law that does not depend on the phase: a property, a method of a time step or of limits."""
        if name == "law":
            raise AttributeError(name)  # while a copy is made, before its fields are set
        return getattr(self.law, name)

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
            N_H, shape = harmonics.n_coefficients, P.shape
            units = np.broadcast_to(np.eye(N_H), (len(P), N_H, N_H))
            back = shifted(units, start[cycle.active], harmonics)  # transposed, as each row is shifted: the inverse
            P = np.matmul(back[:, None], P.reshape(-1, 3, N_H, shape[2]))
            P = np.matmul(P.reshape(-1, 3 * shape[1], N_H), back.swapaxes(1, 2)).reshape(shape)
        return replace(cycle, p=shifted(cycle.p, -start, harmonics), P=P)

    def parameter_rate(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter of each pair under the motion ``U``, (n, 3, N_H).  Local."""
        harmonics = harmonics or Harmonics.full(U.shape[2])
        start = self.start[:, None]
        return shifted(self.law.parameter_rate(name, shifted(U, start, harmonics), n_samples, harmonics), -start, harmonics)


def started_at(law: Law, start: np.ndarray | None) -> Law:
    """Return the law of pairs that start at phases (n,) [rad]; NaN or none: at the first sample.  Local."""
    phases = np.zeros(law.n_pairs) if start is None else np.nan_to_num(start)
    return cast(Law, StartedLaw(law, phases)) if phases.any() else law
