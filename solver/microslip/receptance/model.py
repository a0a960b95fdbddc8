"""What harmonic balance solves with: a reduced structure under its loads, in a set of harmonics.

The receptance of harmonic n between any two of loads, pairs and outputs with modal participations x, y is (docs/theory.md,
eq. (4.1))

    A_n(omega) = A_static + x c_n(omega) y^T,

with c_n of the modal family of the harmonic (receptance/damping.py).  Coefficients are real, in the order of
fourier/harmonics.py; the complex amplitude of harmonic n is cos - i sin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..fourier.amplitudes import to_complex
from ..fourier.harmonics import Harmonics
from ..parallel.errors import CaseError
from .damping import DynamicFlexibility, Flexibility
from .excitation import Excitation
from .family import ModalFamily, Share, shared_out
from .structure import ReducedStructure


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedModel(ReducedStructure):
    """A reduced structure, the Fourier coefficients of its loads and the harmonics of every motion."""

    f: np.ndarray  # (n_loads, N_H) at unit level
    harmonics: Harmonics  # in whose order coefficients run
    H_recorded: int = 1  # results have the harmonics 0 to this one at least

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
        return _flexibilities(self, omega)

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

    # -- motions under the loads at a level and contact forces p (3 n_pairs, N_H), all replicated -------------------

    def linear_motion(self, level: float, omega: float) -> np.ndarray:
        """Return U_lin of (5.1), the motion with all pairs stuck, of this rank's pairs, (3 n_owned, N_H) [m].  Local."""
        return self._linear_motion(level, omega, self.owned_rows)

    def linear_motion_of_all(self, level: float, omega: float) -> np.ndarray:
        """Return U_lin of all pairs, (3 n_pairs, N_H) [m].  Local."""
        return self._linear_motion(level, omega, slice(None))

    def _linear_motion(self, level: float, omega: float, rows: slice) -> np.ndarray:
        dynamic = self._moved(lambda family: family.R_phi[rows], self.flexibilities(omega), self.modal_forces(level))
        return self.du_static[rows] @ (level * self.f) + dynamic

    def linear_motion_rate(self, level: float, omega: float, d_omega: float = 1.0, d_sigma: float = 0.0) -> np.ndarray:
        """Return the rate of U_lin while omega and a damping sigma M change at given rates, (3 n_owned, N_H).  Local."""
        rates = [c.rate(d_omega, d_sigma) for c in self.flexibilities(omega)]
        return self._moved(lambda family: family.R_phi[self.owned_rows], rates, self.modal_forces(level))

    def output_motion(self, level: float, omega: float, p: np.ndarray) -> np.ndarray:
        """Return the coefficients of the outputs, (n_outputs, N_H), in their units.  Local."""
        dynamic = self._moved(lambda family: family.o, self.flexibilities(omega), self.modal_forces(level, p))
        u = self.out_static @ (level * self.f) - self.out_R @ p + dynamic
        return u if self.observed is None else self.observed.motion(u, p, level * self.f, self.harmonics, omega)

    def output_factors(self, n_omega: float) -> np.ndarray | float:
        """Return what the rows of the outputs are multiplied by at n omega, in size: 1 of displacements, (n_outputs,).  Local."""
        return 1.0 if self.observed is None else self.observed.factors(n_omega)

    def load_motion(self, level: float, omega: float, p: np.ndarray) -> np.ndarray:
        """Return the coefficients of f^T u, the motion along each load, (n_loads, N_H) [m].  Local."""
        dynamic = self._moved(lambda family: family.b.T, self.flexibilities(omega), self.modal_forces(level, p))
        return self.load_static @ (level * self.f) - self.du_static.T @ p + dynamic

    def modal_motion(self, level: float, omega: float, p: np.ndarray) -> list[np.ndarray]:
        """Return the complex modal amplitudes D_n^-1 phi^T (f - R^T p) of each share, (m, n_harmonics) of its own.  Local."""
        return [
            to_complex(c.apply(q)) + to_complex(q) / share.family.omega_n[:, None] ** 2
            for share, c, q in zip(self.shares, self.flexibilities(omega), self.modal_forces(level, p))
        ]

    def modal_forces(self, level: float, p: np.ndarray | None = None) -> list[np.ndarray]:
        """Return phi^T (f - R^T p) of each share, (m, N_H) of its own; of the loads alone without ``p``.  Local."""
        f = level * self.f
        q = [share.family.b @ f[:, share.columns] for share in self.shares]
        if p is None:
            return q
        return [q_k - share.family.R_phi.T @ p[:, share.columns] for share, q_k in zip(self.shares, q)]

    def _moved(self, seen_by: Callable[[ModalFamily], np.ndarray], c: Sequence[Flexibility], q: list[np.ndarray]) -> np.ndarray:
        """Return x c_n q_n, (n, N_H), as seen by participations x (n, m) of each family."""
        return self.joined([seen_by(share.family) @ c_k.apply(q_k) for share, c_k, q_k in zip(self.shares, c, q)])


@lru_cache(maxsize=4)
def _flexibilities(model: ReducedModel, omega: float) -> tuple[DynamicFlexibility, ...]:
    return tuple(share.family.flexibility(share.harmonics, omega) for share in model.shares)


def _parts(structure: ReducedStructure) -> dict[str, Any]:
    """Return the fields of a structure, also where it is a model."""
    return {one.name: getattr(structure, one.name) for one in fields(ReducedStructure)}
