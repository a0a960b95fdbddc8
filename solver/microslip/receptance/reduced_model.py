"""What harmonic balance solves with: a reduced structure under its loads, in a set of harmonics.

Coefficients are real, in the order of fourier/harmonics.py; the complex amplitude of harmonic n is cos - i sin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..fourier.harmonics import Harmonics
from ..messages.errors import CaseError
from .damping import DynamicFlexibility
from .excitation import Excitation
from .family import Share, shared_out
from .reduced_structure import ReducedStructure

_KEPT = 4  # frequencies of which a model keeps the flexibilities


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedModel(ReducedStructure):
    """A reduced structure, the Fourier coefficients of its loads and the harmonics of every motion."""

    f: np.ndarray  # (n_loads, N_H) at unit level
    harmonics: Harmonics  # in whose order coefficients run
    H_recorded: int = 1  # results have the harmonics 0 to this one at least
    _flexibilities: dict[float, tuple[DynamicFlexibility, ...]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, structure: ReducedStructure, excitation: Excitation) -> ReducedModel:
        """Return the model of a structure that is excited so.  Local; all arrays of the structure are shared."""
        return cls(**_parts(structure), f=excitation.coefficients, harmonics=excitation.harmonics)

    def on(self, structure: ReducedStructure) -> ReducedModel:
        """Return another structure under the same loads, in the same harmonics.  Local."""
        return replace(self, **_parts(structure))

    @cached_property
    def N_H(self) -> int:
        return self.harmonics.n_coefficients

    @property
    def recorded(self) -> Harmonics:
        """The full set 0, 1, ..., H of results: all harmonics ever used, and harmonic 1, zero where it is not."""
        return Harmonics.up_to(max(self.H_recorded, self.harmonics.highest))

    def with_harmonics(self, harmonics: Harmonics) -> ReducedModel:
        """Return the same model on another set of harmonics; all else is shared, the static columns too.  Local.

        Raises
        ------
        CaseError : a load acts in a harmonic that is not in the set
        """
        loaded = [n for n in self.harmonics.chosen if self.f[:, self.harmonics.columns(n)].any()]
        left_out = [n for n in loaded if n not in harmonics]
        if left_out:
            raise CaseError(f"[[loads]] acts in harmonic {left_out[0]}, which is not one of the harmonics {harmonics}")
        if harmonics == self.harmonics:
            return self
        f = self.harmonics.carry(self.f, harmonics)
        return replace(self, f=f, harmonics=harmonics, H_recorded=self.recorded.highest)

    def with_damping(self, sigma: float) -> ReducedModel:
        """Return the same model with sigma M [1/s] added to its damping matrix; all else is shared.  Local."""
        return replace(self, families=tuple(family.with_damping(sigma) for family in self.families))

    # -- harmonic by harmonic: each family on the columns of its own -----------------------------------------------

    @cached_property
    def shares(self) -> tuple[Share, ...]:
        """What each family serves of the harmonics."""
        return shared_out(self.families, self.harmonics)

    def flexibilities(self, omega: float) -> tuple[DynamicFlexibility, ...]:
        """Return c_n of each share.  Local; kept for the last few frequencies."""
        found = self._flexibilities.pop(omega, None) or tuple(s.family.flexibility(s.harmonics, omega) for s in self.shares)
        self._flexibilities[omega] = found  # the last
        if len(self._flexibilities) > _KEPT:
            del self._flexibilities[next(iter(self._flexibilities))]
        return found

    def joined(self, terms: Sequence[np.ndarray]) -> np.ndarray:
        """Return terms of the shares, each (..., N_H of its own), as one array (..., N_H); the term itself of one.  Local."""
        if len(terms) == 1:
            return terms[0]
        whole = np.empty((*terms[0].shape[:-1], self.N_H))
        for share, term in zip(self.shares, terms):
            whole[..., share.columns] = term
        return whole

    def index_of(self, n: int) -> tuple[int, int]:
        """Return the number of the share that serves harmonic n, and the place of n in it.  Local."""
        return next((k, s.harmonics.chosen.index(n)) for k, s in enumerate(self.shares) if n in s.harmonics)

    def output_receptance(self, omega: float, n: int) -> np.ndarray:
        """Return A_n between the outputs and the pairs, (n_outputs, 3 n_pairs), complex [unit of the output/N].  Local."""
        k, i = self.index_of(n)
        family = self.shares[k].family
        A = self.out_R + self.flexibilities(omega)[k].between(family.o, i, family.R_phi)
        return A if self.observed is None else self.observed.of_forces(A, n * omega)


def _parts(structure: ReducedStructure) -> dict[str, Any]:
    """Return the fields of a structure, also where it is a model."""
    return {one.name: getattr(structure, one.name) for one in fields(ReducedStructure)}
