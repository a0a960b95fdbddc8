"""The equation of harmonic balance, condensed to the pairs: r(U, omega) = U - U_lin(omega) + G(omega) p(U).

docs/theory.md, section 5.  The rank that owns a pair stores its rows; ``p`` of the active pairs is gathered once per evaluation.
``p`` and dp/dU vanish where a pair sticks, so the cost is proportional to the number of active pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from ..contact.law import ContactCycle, Law
from ..fourier.harmonics import Harmonics
from ..parallel.ownership import summed
from ..receptance.columns import ReceptanceColumns
from ..receptance.damping import Damping
from ..receptance.motions import linear_motion, linear_motion_rate
from ..receptance.other_springs import with_springs
from ..receptance.reduced_model import ReducedModel
from ..receptance.springs import SpringChange, stated_damping_rate
from .mean_slip import HOLD, hold_mean_slip
from .operating_point import ContactForces, LawParameter, OperatingPoint, Rates, stiffness_rates


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
        """Return the same equation with the mean slip held about the ``mean`` of p_t (n_owned, 2) [N], or free.  Local."""
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

        Newton's method evaluates the cycle twice, for the residual and its derivative, and the record of a point once more.
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
        return self if not at.law else self._cached("under", at.law, lambda: self._with_law(at.law))

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
                mine = self._of_owned(parameter)
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

    def _of_owned(self, parameter: LawParameter) -> np.ndarray:
        """Return which pairs of a parameter this rank owns, (m,) bool."""
        return (parameter.pairs >= self.model.owned.start) & (parameter.pairs < self.model.owned.stop)

    def law_rate(self, forces: ContactForces, parameter: LawParameter) -> np.ndarray:
        """Return the derivative of p of the active pairs of all ranks by a parameter of the law, (3 n_active, N_H).

        Collective: one gather.  The motion is constant.
        """
        active_owned, d_p = forces.active_owned, np.zeros((len(forces.active_owned), 3, self.model.N_H))
        _, chosen, of_parameter = np.intersect1d(active_owned + self.model.owned.start, parameter.pairs, return_indices=True)
        if len(chosen):
            law, U = self.law.take(active_owned[chosen]), forces.U[active_owned[chosen]]
            d_p[chosen] = self._rate_of(law, parameter.name, U) * parameter.shape[of_parameter, None, None]
        return self.gather(d_p.reshape(-1, self.model.N_H))

    def _rate_of(self, law: Law, name: str, U: np.ndarray) -> np.ndarray:
        """Return how p of some pairs changes with a parameter of each under a motion that stays, (n, 3, N_H).  Local."""
        rate = law.parameter_rate(name, U, self.n_samples, self.harmonics)
        if self.held is not None:
            rate[:, :2, 0] *= 1.0 - HOLD
        return rate

    def contact_force_rates(self, forces: ContactForces, names: Sequence[str]) -> list[np.ndarray | None]:
        """Return how p + K_J U of this rank's pairs changes with the parameter of each, (n_owned, 3, N_H) for each name.

        Local.  The motion stays as it is.  None where no pair's law has the parameter.
        """
        active, law, rates = forces.active_owned, self.law.take(forces.active_owned), list[np.ndarray | None]()
        for name in names:
            rate = np.zeros(self.shape) if name in self.law.parameters else None
            if rate is not None and len(active) and name in law.parameters:
                rate[active] = self._rate_of(law, name, forces.U[active])
            if rate is not None and name in ("k_t", "k_n"):
                rate += self.unit_springs(name)[:, :, None] * forces.U
            rates.append(rate)
        return rates

    def unit_springs(self, name: str) -> np.ndarray:
        """Return the rate of the springs K_J of this rank's pairs by a stiffness of each, (n_owned, 3).  Local."""
        return self._cached(f"springs of {name}", self.n_owned, lambda: _springs_of(self.law, name, np.ones(self.n_owned)))

    def spring_rate(self, parameter: LawParameter) -> np.ndarray:
        """Return the derivative of K_J of the pairs of a stiffness parameter by its value, (m, 3) in ascending pair order.

        Collective: one gather.
        """
        mine = self._of_owned(parameter)
        pairs_owned = parameter.pairs[mine] - self.model.owned.start
        unit = _springs_of(self.law.take(pairs_owned), parameter.name, parameter.shape[mine])
        return self.gather(unit[np.argsort(pairs_owned)])

    def moved_by_springs(self, at: OperatingPoint, parameter: LawParameter, V: np.ndarray) -> np.ndarray:
        """Return G dK_J V, (n_owned, 3, N_H), for motions V of this rank's pairs and the derivative dK_J by a stiffness.

        Collective: two gathers.  The result is minus the derivative of V, the motion under given forces, with constant damping
        matrix.
        """
        pairs, owned = np.sort(parameter.pairs), self.model.owned
        mine = (pairs >= owned.start) & (pairs < owned.stop)
        forces = self.spring_rate(parameter)[mine][:, :, None] * V[pairs[mine] - owned.start]
        return self.receptance(at, pairs).apply(self.gather(forces.reshape(-1, self.model.N_H)))

    def of_structure(self, rates: Rates) -> tuple[float, float, list[Damping] | None]:
        """Return the rates of omega, of sigma and of the damping of each group; None: it is constant.

        Local; collective by a stiffness: one gather.
        """
        of_springs, stated, of_damping = stiffness_rates(rates), self.model.stated_damping, None
        if of_springs and stated is not None:
            dK = np.zeros((self.model.n_pairs, 3))
            for parameter, of_value in of_springs:
                dK[np.sort(parameter.pairs)] += of_value * self.spring_rate(parameter)
            of_damping = [Damping(stated_damping_rate(group.receptance.modes, stated, dK.ravel())) for group in self.model.groups]
        elif rates.get("damping", 0.0):
            of_damping = [group.receptance.modes.stated_part(stated, rates["damping"]) for group in self.model.groups]
        return rates.get("omega", 0.0), rates.get("sigma", 0.0), of_damping

    def model_at(self, at: OperatingPoint) -> ReducedModel:
        """Return the model with the damping of an operating point.  Local."""
        if at.sigma == 0.0 and at.damping == 1.0:
            return self.model
        return self._cached("model", (at.sigma, at.damping), lambda: self.model.with_damping(at.sigma, at.damping))

    def linear_motion(self, at: OperatingPoint) -> np.ndarray:
        """Return U_lin of this rank's pairs, (n_owned, 3, N_H) [m].  Local; cached for the last point, therefore read-only."""
        return self._cached("motion", at, lambda: linear_motion(self.model_at(at), at.level, at.omega).reshape(self.shape))

    def linear_motion_rate(self, at: OperatingPoint, rates: Rates) -> np.ndarray:
        """Return the derivative of U_lin by a parameter, (n_owned, 3, N_H).  Local; collective for a stiffness: one gather."""
        model, level = self.model_at(at), rates.get("level", 0.0)
        d_U = linear_motion_rate(model, at.level, at.omega, *self.of_structure(rates)).reshape(self.shape)
        per_newton = linear_motion(model, 1.0, at.omega).reshape(self.shape) if level else 0.0
        d_U = d_U + level * per_newton
        for parameter, of_value in stiffness_rates(rates):
            d_U -= of_value * self.moved_by_springs(at, parameter, self.linear_motion(at))
        return d_U

    def receptance(self, at: OperatingPoint, active: np.ndarray) -> ReceptanceColumns:
        """Return G restricted to the columns of the ``active`` pairs; cached.  Collective where static columns are missing."""
        return self._cached("columns", (at, active.tobytes()), lambda: ReceptanceColumns(self.model_at(at), at.omega, active))

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

    def _cached(self, name: str, key: Any, make: Callable[[], Any]) -> Any:
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


def _springs_of(law: Law, name: str, values: np.ndarray) -> np.ndarray:
    """Return the springs K_J that k_t or k_n of each pair makes, (n, 3) [N/m], where these have the ``values`` (n,).  Local."""
    springs = law.with_parameters(name, np.arange(law.n_pairs), values).stiffness.copy()
    springs[:, [2] if name == "k_t" else [0, 1]] = 0.0
    return springs
