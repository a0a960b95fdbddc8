"""Constraint rows in addition to the harmonic-balance equations: one for each parameter (docs/theory.md, section 7).

Unknowns are scaled: xi = U / its unit, nu = parameters / theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import OperatingPoint
from .iterate import Iterate


@dataclass(frozen=True, eq=False)
class Scaling:
    """Units of the unknowns in SNES and in the arc-length norm, and weights of the rows of the residual."""

    U: float  # m
    parameters: tuple[float, ...]  # rad/s, N, ...
    rows: np.ndarray | float = 1.0  # (n_owned, 3, 1) -, at least 1; see ``row_weights``
    weight: float = 1.0  # the largest of all ranks' rows


@dataclass(frozen=True, eq=False)
class Place:
    """Where constraints are evaluated: a motion, scaled parameters of either sign, and the linearisation there."""

    operating_point: Callable[[tuple[float, ...]], OperatingPoint]  # of k parameters
    scaling: Scaling
    U: np.ndarray  # (n_owned, 3, N_H) m
    nu: np.ndarray  # (k,) the same on all ranks
    linearisation: Linearisation | None  # None where no constraint needs it
    _results: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)

    def once(self, of: Callable[..., Any], *arguments: Any) -> Any:
        """Return ``of(place, *arguments)``, evaluated once for all rows that need it.  Collective as ``of`` is."""
        key = (of, *arguments)
        if key not in self._results:
            self._results[key] = of(self, *arguments)
        return self._results[key]

    @property
    def linear(self) -> Linearisation:
        """The linearisation, for constraints that require it."""
        assert self.linearisation is not None, "made for constraints that take it"
        return self.linearisation


class Constraint(Protocol):
    """A scalar equation g(xi, nu) = 0 of the motion, the parameters and, if it requires it, the linearisation."""

    takes_linearisation: ClassVar[bool]  # forces with tangents, G: for rows that a motion alone does not give

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        """Return this rank's part of g, of its rows of the motion; summed over the ranks with the contact forces.  Local."""

    def value(self, of_motion: float, place: Place) -> float:
        """Return g, from the sum of the ranks' parts.  Collective where it takes the linearisation; the same on all ranks."""

    def gradient(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return d g / d xi (n_owned, 3, N_H) of this rank and d g / d nu (k,), which is the same on all ranks.

        Collective where it takes the linearisation.
        """


class EnclosedRow(Protocol):
    """A row that jumps, which SNES cannot solve for: it is enclosed on the curve of solutions that the other rows leave."""

    def correct(self, corrector: Any, system: Any, guess: Iterate) -> Any:
        """Return the correction, as the corrector's ``correct``, for a system of the k - 1 other rows.  Collective."""


@dataclass(frozen=True, eq=False)
class Plane:
    """n_U . (xi - xi_0) + n_nu . (nu - nu_0) = 0, eq. (7.2), linear, through the iterate ``about``."""

    about: Iterate
    n_U: np.ndarray  # (n_owned, 3, N_H) -
    n_nu: tuple[float, ...]  # (k,) -
    takes_linearisation: ClassVar[bool] = False

    @classmethod
    def fixed_parameter(cls, about: Iterate) -> Plane:
        """Return the row that holds the first parameter at its value."""
        n_nu = np.zeros(len(about.parameters))
        n_nu[0] = 1.0
        return cls(about, np.zeros_like(about.U), tuple(n_nu))

    @property
    def is_at_value(self) -> bool:
        """Whether it is such a row.  Local, the same on all ranks."""
        return self.n_nu[0] == 1.0 and not any(self.n_nu[1:])

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        """Return this rank's part of n_U . (xi - xi_0), scaled.  Local."""
        return float(np.vdot(self.n_U, U - self.about.U)) / scaling.U

    def value(self, of_motion: float, place: Place) -> float:
        """Return the row, eq. (7.2), from the sum of the ranks' parts.  Local; the same on all ranks."""
        of = zip(self.n_nu, place.nu, self.about.parameters, place.scaling.parameters)
        return of_motion + sum(n * (v - about / unit) for n, v, about, unit in of)

    def gradient(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return n_U (n_owned, 3, N_H) and n_nu (k,).  Local."""
        return self.n_U, np.array(self.n_nu)
