"""The equation of harmonic balance, condensed to the pairs: r(U, omega) = U - U_lin(omega) + G(omega) p(U).

docs/theory.md, section 5.  The rank that owns a pair stores its rows; ``p`` of the active pairs is gathered once per evaluation.
``p`` and dp/dU vanish where a pair sticks, so the cost is proportional to the number of active pairs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from ..contact.law import ContactCycle, Law
from ..fourier.harmonics import Harmonics
from ..parallel.ownership import summed
from ..receptance.columns import ReceptanceColumns
from ..receptance.motions import linear_motion
from ..receptance.other_springs import with_springs
from ..receptance.reduced_model import ReducedModel
from ..receptance.springs import SpringChange
from .mean_slip import hold_mean_slip
from .operating_point import ContactForces, LawParameter, OperatingPoint


@dataclass(frozen=True, eq=False)
class HarmonicBalance:
    """The residual (5.1) and its linearisation; ``selected`` pairs may slip or open, the others are assumed to stick."""

    model: ReducedModel
    law: Law  # of this rank's pairs
    n_samples: int  # per period
    held: np.ndarray | None = None  # (n_owned, 2) mean of p_t about which springs hold the mean slip [N]; None: no springs
    _known: dict = field(default_factory=dict, init=False, repr=False)  # cache of the last operating point

    @classmethod
    def of_all(cls, model: ReducedModel, law: Law, n_samples: int) -> HarmonicBalance:
        """Return the equation of a model whose pairs, on all ranks, have this law.  Local."""
        # constant motion: the period is a single step, and the state of a pair is whether it slid in this step
        owned = law.take(np.arange(model.n_pairs)[model.owned])
        return cls(model, owned, model.harmonics.samples(n_samples))

    # -- sizes and variants --------------------------------------------------------------------------------------

    @property
    def comm(self) -> MPI.Comm:
        """The communicator of the model."""
        return self.model.comm

    @property
    def harmonics(self) -> Harmonics:
        """The harmonics of the equation."""
        return self.model.harmonics

    @property
    def n_owned(self) -> int:
        """The number of pairs of this rank."""
        return self.model.owned.stop - self.model.owned.start

    @property
    def shape(self) -> tuple[int, int, int]:
        """The shape of a motion of this rank's pairs, (n_owned, 3, N_H)."""
        return self.n_owned, 3, self.model.N_H

    @property
    def every_pair(self) -> np.ndarray:
        """The selection of all pairs, (n_pairs,) bool."""
        return np.ones(self.model.n_pairs, dtype=bool)

    def resolved(self, harmonics: Harmonics, n_samples: int) -> HarmonicBalance:
        """Return the same equation with other harmonics and samples.  Local."""
        return replace(self, model=self.model.with_harmonics(harmonics), n_samples=n_samples)

    def of(self, model: ReducedModel) -> HarmonicBalance:
        """Return the same equation for another model of the same pairs, with the same harmonics.  Local."""
        return replace(self, model=model)

    def holding(self, mean: np.ndarray | None) -> HarmonicBalance:
        """Return the same equation with the mean slip regularised about a ``mean`` of p_t (n_owned, 2) [N], or free.  Local."""
        return replace(self, held=mean)

    # -- forces --------------------------------------------------------------------------------------------------

    def contact_forces(
        self, U: np.ndarray, selected: np.ndarray, tangents: bool, extras: tuple[float, ...] = ()
    ) -> ContactForces:
        """Return the contact forces under the motion ``U`` (n_owned, 3, N_H) [m] of this rank's pairs.

        Collective on ``comm``: one gather, which also sums the ``extras`` of the ranks.  ``selected`` (n_pairs,) bool is
        the same on every rank.
        """
        chosen = selected[self.model.owned].nonzero()[0]
        cycle = self._cycle(U, chosen, tangents)
        state = np.zeros(self.n_owned, dtype=np.uint8)
        state[chosen] = cycle.state
        active_owned = chosen[cycle.active]
        p_owned = np.ascontiguousarray(cycle.p[cycle.active]).reshape(3 * len(active_owned), self.model.N_H)
        active, p = active_owned + self.model.owned.start, p_owned
        if self.comm.size > 1:
            actives, forces, sums = zip(*self.comm.allgather((active, p_owned, np.array(extras))))
            active, p, extras = np.concatenate(actives), np.concatenate(forces), tuple(sum(sums))
        P = (self._no_tangents if cycle.P is None else cycle.P) if tangents else None
        return ContactForces(U, selected, state, bool(cycle.drifts.any()), active_owned, P, active, p, extras)

    def _cycle(self, U: np.ndarray, chosen: np.ndarray, tangents: bool) -> ContactCycle:
        """Return the cycle of some of this rank's pairs, cached for the last motion and therefore read-only.  Local.

        Newton's method evaluates the cycle twice, for the residual and its derivative, and the record of a point a third time.
        """
        key = U.tobytes(), chosen.tobytes()
        known, cycle = self._known.get("cycle", (None, None))
        if known != key or (tangents and cycle.P is None and len(cycle.active) > 0):
            everything = len(chosen) == self.n_owned
            law, motion = (self.law, U) if everything else (self.law.take(chosen), U[chosen])
            cycle = law.cycle(motion, self.n_samples, tangents=tangents, harmonics=self.harmonics)
            if self.held is not None:
                hold_mean_slip(cycle, self.held if everything else self.held[chosen])
            self._known["cycle"] = key, cycle
        return cycle

    @property
    def _no_tangents(self) -> np.ndarray:
        """Tangents of no pair, (0, 3 N_H, 3 N_H)."""
        return np.empty((0, 3 * self.model.N_H, 3 * self.model.N_H))

    def full_force(self, forces: ContactForces) -> np.ndarray:
        """Return p of all pairs, (3 n_pairs, N_H) [N], zero where they stick.  Local."""
        p = np.zeros((self.model.n_pairs, 3, self.model.N_H))
        p[forces.active] = forces.p.reshape(-1, 3, self.model.N_H)
        return p.reshape(-1, self.model.N_H)

    # -- the equation --------------------------------------------------------------------------------------------

    def under(self, at: OperatingPoint) -> HarmonicBalance:
        """Return the equation with the contact law of an operating point, and the structure with its stiffness; cached.

        Collective where the point has law parameters: an agreement, and with k_t or k_n the update (4.7) of the structure.

        Raises
        ------
        ValueError : a law has no such parameter or value, or a stiffness needs another structure; on every rank
        ResourceError : not enough memory for the update; on every rank
        """
        return self if not at.law else self.cached("under", at.law, lambda: self._with_law(at.law))

    def allows(self, at: OperatingPoint) -> bool:
        """Return whether the laws of all pairs accept the parameters of an operating point.  Collective as :meth:`under`."""
        try:
            self.under(at)
        except ValueError:
            return False
        return True

    def _with_law(self, values: tuple[tuple[LawParameter, float], ...]) -> HarmonicBalance:
        law, first, problem = self.law, self.model.owned.start, ""
        try:
            for parameter, value in values:
                mine = self.owned_by_rank(parameter)
                law = law.with_parameters(parameter.name, parameter.pairs[mine] - first, value * parameter.shape[mine])
        except ValueError as error:  # of a pair of this rank
            problem = str(error)
        problems = [text for text in self.comm.allgather(problem) if text]
        if problems:
            raise ValueError(problems[0])
        if not any(parameter.is_stiffness for parameter, _ in values):
            return replace(self, law=law)
        K_J = self.gather(law.stiffness).ravel()
        change = SpringChange(K_J - self.gather(self.law.stiffness).ravel(), K_J, self.model.stated_damping)
        model = with_springs(self.model, change) if change.dK.any() else self.model
        assert model.groups, "made here, where an error is one of this value"
        return replace(self, law=law, model=model)

    def owned_by_rank(self, parameter: LawParameter) -> np.ndarray:
        """Return which pairs of a parameter this rank owns, (m,) bool."""
        return (parameter.pairs >= self.model.owned.start) & (parameter.pairs < self.model.owned.stop)

    def model_at(self, at: OperatingPoint) -> ReducedModel:
        """Return the model with the damping of an operating point.  Local."""
        if at.sigma == 0.0 and at.damping == 1.0:
            return self.model
        return self.cached("model", (at.sigma, at.damping), lambda: self.model.with_damping(at.sigma, at.damping))

    def linear_motion(self, at: OperatingPoint) -> np.ndarray:
        """Return U_lin of this rank's pairs, (n_owned, 3, N_H) [m].  Local; cached for the last point, therefore read-only."""
        return self.cached("motion", at, lambda: linear_motion(self.model_at(at), at.level, at.omega).reshape(self.shape))

    def receptance(self, at: OperatingPoint, active: np.ndarray) -> ReceptanceColumns:
        """Return G restricted to the columns of the ``active`` pairs; cached.  Collective where static columns are missing."""
        return self.cached("columns", (at, active.tobytes()), lambda: ReceptanceColumns(self.model_at(at), at.omega, active))

    def residual(
        self, U: np.ndarray, at: OperatingPoint, forces: ContactForces, G: ReceptanceColumns | None = None
    ) -> np.ndarray:
        """Return this rank's rows of r(U, omega), eq. (5.1), under ``forces``, (n_owned, 3, N_H) [m].

        Collective where static columns are missing, and of a whole disc.  ``G`` of the active pairs at ``at`` may be passed if
        available.
        """
        return self.residual_under(U, at, forces.active, forces.p, G)

    def residual_under(
        self, U: np.ndarray, at: OperatingPoint, active: np.ndarray, p: np.ndarray, G: ReceptanceColumns | None = None
    ) -> np.ndarray:
        """Return the residual as :meth:`residual`, for any forces ``p`` (3 n_active, N_H) [N] of the ``active`` pairs."""
        return U - self.linear_motion(at) + (G or self.receptance(at, active)).apply(p)

    def cached(self, name: str, key: Any, make: Callable[[], Any]) -> Any:
        """Return the result of ``make``, cached under ``name`` for the last ``key``."""
        cached = self._known.get(name)
        if cached is None or cached[0] != key:
            cached = self._known[name] = key, make()
        return cached[1]

    # -- sums over the ranks -------------------------------------------------------------------------------------

    def gather(self, owned: np.ndarray) -> np.ndarray:
        """Concatenate the rows of all ranks in rank order.  Collective on ``comm``."""
        return owned if self.comm.size == 1 else np.concatenate(self.comm.allgather(owned))

    def sum(self, partial: np.ndarray) -> np.ndarray:
        """Return the sum over the ranks.  Collective on ``comm``."""
        return partial if self.comm.size == 1 else summed(self.comm, partial)

    def agreed_sum(self, partial: np.ndarray) -> np.ndarray:
        """Return the sum over the ranks, with the same rounding on all of them.  Collective on ``comm``."""
        return partial if self.comm.size == 1 else self.comm.bcast(summed(self.comm, partial))
