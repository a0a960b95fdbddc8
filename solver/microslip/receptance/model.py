"""What a reduction hands to harmonic balance: the receptance of the pairs, loads and outputs in modal and static parts.

The receptance of harmonic n between any two of loads, pairs and outputs with modal participations x, y is (docs/theory.md,
eq. (4.1))

    A_n(omega) = A_static + x c_n(omega) y^T,

with c_n of the modal family of the harmonic (receptance/damping.py).  Coefficients are real, in the order of
fourier/harmonics.py; the complex amplitude of harmonic n is cos - i sin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..fourier.amplitudes import to_complex
from ..fourier.harmonics import Harmonics
from ..parallel.errors import CaseError
from .damping import DynamicFlexibility, Flexibility
from .family import ModalFamily, Share, shared_out
from .observed import Observed
from .static_columns import StaticColumns

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """Modal families and static residuals, seen from pairs, loads and outputs: docs/theory.md, eq. (4.1).

    Everything is replicated except the columns of ``G_static``, whose rows live with their pairs.
    """

    comm: MPI.Comm
    pair_ranges: np.ndarray  # (size + 1,) rank r owns pairs pair_ranges[r]:pair_ranges[r + 1]
    families: tuple[ModalFamily, ...]  # exactly one of them serves a harmonic
    G_static: StaticColumns  # columns of R K_L^-1 R^T, solved for on demand; rows of this rank's pairs
    du_static: np.ndarray  # (3 n_pairs, n_loads) R K_L^-1 f
    out_static: np.ndarray  # (n_outputs, n_loads) o K_L^-1 f
    out_R: np.ndarray  # (n_outputs, 3 n_pairs) o K_L^-1 R^T
    load_static: np.ndarray  # (n_loads, n_loads) f^T K_L^-1 f
    f: np.ndarray  # (n_loads, N_H) Fourier coefficients of the loads at unit level
    harmonics: Harmonics  # those of every motion and force, in whose order coefficients run
    H_recorded: int = 1  # results have the harmonics 0 to this one at least
    observed: Observed | None = None  # what makes outputs of their rows; None: they are displacements

    @property
    def n_pairs(self) -> int:
        return len(self.du_static) // 3

    @property
    def n_outputs(self) -> int:
        return len(self.out_static)

    @property
    def omega_n(self) -> np.ndarray:
        """Natural frequencies of all families, one after the other, (n,) [rad/s]."""
        return np.concatenate([family.omega_n for family in self.families])

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios of the same modes, (n,) [-]."""
        return np.concatenate([family.zeta for family in self.families])

    @property
    def n_modes(self) -> int:
        """Modes that a harmonic has, at most."""
        return max(len(family.omega_n) for family in self.families)

    @property
    def one_family(self) -> ModalFamily:
        """The family of every harmonic, for what knows modes of one kind alone; there must be no other."""
        (family,) = self.families
        return family

    @cached_property
    def N_H(self) -> int:
        return self.harmonics.n_coefficients

    @property
    def recorded(self) -> Harmonics:
        """The full set 0, 1, ..., H of results: all harmonics ever used, and harmonic 1, zero where it is not."""
        return Harmonics.up_to(max(self.H_recorded, self.harmonics.highest))

    @cached_property
    def owned(self) -> slice:
        """The pairs of this rank."""
        return slice(self.pair_ranges[self.comm.rank], self.pair_ranges[self.comm.rank + 1])

    @cached_property
    def owned_rows(self) -> slice:
        """Rows of the pairs of this rank."""
        return slice(3 * self.owned.start, 3 * self.owned.stop)

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
