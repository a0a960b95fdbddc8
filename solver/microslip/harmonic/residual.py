"""The harmonic-balance residual r(U, omega) = U - U_lin(omega) + G(omega) p(U) and its derivatives.

docs/theory.md, section 5.  The rows of a pair live on the rank that owns it; ``p`` of the pairs that do not stick is
gathered once an application.  ``p`` and dp/dU vanish where a pair sticks, so the cost follows the others.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from ..contact.aft import contact_harmonics
from ..contact.law import ContactParameters
from ..fourier.harmonics import Harmonics
from ..linear.dense import summed
from ..receptance.columns import ReceptanceColumns
from ..receptance.model import ReducedModel
from .mean_slip import hold_mean_slip


@dataclass(frozen=True)
class ContactForces:
    """Contact forces at one motion: what this rank evaluated and what all ranks gathered."""

    state: np.ndarray  # (n_owned,) STICK, SLIP, OPEN
    active_owned: np.ndarray  # (m,) pairs of this rank, counted from its first, with p or dp/dU not zero
    P: np.ndarray | None  # (m, 3 N_H, 3 N_H) dp/dU of those [N/m]
    active: np.ndarray  # (n_active,) the active pairs of all ranks, in rank order
    p: np.ndarray  # (3 n_active, N_H) their forces [N]
    extras: tuple[float, ...]  # sums over the ranks of what each passed along


class HarmonicBalance:
    """Residual and derivatives over frequency at one level; ``selected`` pairs may slip or open, the others are held stuck."""

    is_a_way = False  # to the first point of a branch, not the branch itself

    def __init__(self, model: ReducedModel, parameters: ContactParameters, n_samples: int, level: float):
        self.model = model
        self.comm = model.comm
        self.parameters = parameters.take(np.arange(model.n_pairs)[model.owned])
        # a constant motion is one sample: the kept period then holds the one step there is, and the state says which pairs slid
        self.n_samples = n_samples if model.harmonics.highest > 0 else 1
        self.level = level
        self.held_at: np.ndarray | None = None  # (n_owned, 2) mean of p_t about which the mean slip is held [N]
        self.n_owned = model.owned.stop - model.owned.start
        self.shape = (self.n_owned, 3, model.N_H)
        self._linear_at, self._linear = np.nan, (np.empty(0), np.empty(0))

    def contact_forces(
        self, U: np.ndarray, selected: np.ndarray, tangents: bool, extras: tuple[float, ...] = ()
    ) -> ContactForces:
        """Return the contact forces under the motion ``U`` (n_owned, 3, N_H) [m] of this rank's pairs.

        Collective on ``comm``: one gather, which also sums the ``extras`` of the ranks.  ``selected`` (n_pairs,) bool,
        the same on every rank.
        """
        chosen = np.flatnonzero(selected[self.model.owned])
        all_chosen = len(chosen) == self.n_owned
        parameters = self.parameters if all_chosen else self.parameters.take(chosen)
        found = contact_harmonics(
            U if all_chosen else U[chosen], parameters, self.n_samples, tangents=tangents, harmonics=self.model.harmonics
        )
        if self.held_at is not None:
            hold_mean_slip(found, self.held_at if all_chosen else self.held_at[chosen])
        state = np.zeros(self.n_owned, dtype=np.uint8)
        state[chosen] = found.state
        active_owned = chosen[found.active]
        p_owned = np.ascontiguousarray(found.p[found.active]).reshape(3 * len(active_owned), self.model.N_H)
        active, p = active_owned + self.model.owned.start, p_owned
        if self.comm.size > 1:
            actives, forces, sums = zip(*self.comm.allgather((active, p_owned, np.array(extras))))
            active, p, extras = np.concatenate(actives), np.concatenate(forces), tuple(sum(sums))
        return ContactForces(state, active_owned, found.P, active, p, extras)

    def gather(self, owned: np.ndarray) -> np.ndarray:
        """Concatenate the rows of all ranks in rank order.  Collective on ``comm``."""
        return owned if self.comm.size == 1 else np.concatenate(self.comm.allgather(owned))

    def gather_sum(self, partial: np.ndarray) -> np.ndarray:
        """Return the sum over the ranks.  Collective on ``comm``."""
        return partial if self.comm.size == 1 else summed(self.comm, partial)

    def hold_mean_slip(self, U: np.ndarray, selected: np.ndarray) -> None:
        """From now on hold the mean slip about what it is at ``U``, a solution, which stays one.  Collective.

        The mean is among the harmonics.
        """
        forces = self.contact_forces(U, selected, tangents=False)
        self.held_at = self.full_force(forces).reshape(-1, 3, self.model.N_H)[self.model.owned, :2, 0].copy()

    def full_force(self, forces: ContactForces) -> np.ndarray:
        """Return p of all pairs, (3 n_pairs, N_H) [N], zero where they stick.  Local."""
        p = np.zeros((self.model.n_pairs, 3, self.model.N_H))
        p[forces.active] = forces.p.reshape(-1, 3, self.model.N_H)
        return p.reshape(-1, self.model.N_H)

    def of(self, model: ReducedModel) -> HarmonicBalance:
        """Return the same problem on another model of the same pairs, with the same harmonics.  Local."""
        other = copy(self)
        other.model, other._linear_at = model, np.nan
        return other

    def resolved(self, harmonics: Harmonics, n_samples: int) -> HarmonicBalance:
        """Return the same problem with other harmonics and samples.  Local."""
        other = self.of(self.model.with_harmonics(harmonics))
        other.n_samples, other.shape = n_samples, (self.n_owned, 3, other.model.N_H)
        return other

    # -- the one-parameter family: here the frequency at a fixed level -----------------------------------------

    def omega_at(self, parameter: float) -> float:
        """Return the excitation frequency [rad/s]."""
        return parameter

    def level_at(self, parameter: float) -> float:
        """Return the load level [N]."""
        return self.level

    def model_at(self, parameter: float) -> ReducedModel:
        """Return the model."""
        return self.model

    def where(self, parameter: float) -> str:
        """Name a point of the family in a message."""
        omega = self.omega_at(parameter)
        return f"{omega / 2 / np.pi:.6g} Hz ({omega:.6g} rad/s) at level {self.level_at(parameter):.4g} N"

    def linear_motion(self, parameter: float) -> tuple[np.ndarray, np.ndarray]:
        """Return U_lin and its derivative with respect to the parameter, each (n_owned, 3, N_H).

        Local.  Kept for the last parameter: do not write into them.
        """
        if self._linear_at != parameter:
            U_lin = self.model.linear_motion(self.level, parameter)
            dU_lin = self.model.linear_motion_rate(self.level, parameter)
            self._linear_at, self._linear = parameter, (U_lin.reshape(self.shape), dU_lin.reshape(self.shape))
        return self._linear

    def receptance_at(self, parameter: float, active: np.ndarray) -> ReceptanceColumns:
        """Return G restricted to the columns of the ``active`` pairs.  Collective where static columns are new."""
        return self.model.at(parameter, active)

    def force_derivative(self, parameter: float, G: ReceptanceColumns, p: np.ndarray) -> np.ndarray:
        """Return (dG / d parameter) p on this rank's pairs, (n_owned, 3, N_H).  Local."""
        return G.apply_rate(p)


class LevelFamily(HarmonicBalance):
    """The same residual at a fixed frequency, with the load level as parameter."""

    is_a_way = True

    def __init__(self, of: HarmonicBalance, omega: float):
        self.__dict__.update(of.__dict__)
        self.omega = omega
        self.U_lin_per_newton = self.model.linear_motion(1.0, omega).reshape(self.shape)

    def omega_at(self, parameter: float) -> float:
        return self.omega

    def level_at(self, parameter: float) -> float:
        return parameter

    def linear_motion(self, parameter: float) -> tuple[np.ndarray, np.ndarray]:
        return parameter * self.U_lin_per_newton, self.U_lin_per_newton

    def receptance_at(self, parameter: float, active: np.ndarray) -> ReceptanceColumns:
        return self.model.at(self.omega, active)

    def force_derivative(self, parameter: float, G: ReceptanceColumns, p: np.ndarray) -> np.ndarray:
        return np.zeros(self.shape)


class DampingFamily(HarmonicBalance):
    """The same residual at a fixed frequency and level, with further damping that falls to none as the parameter t rises to 1.

    D_n gets i n omega sigma (eq. 4.1) with sigma = omega (1 - t) / t, alike for all modes, as of a damping matrix sigma M.
    """

    is_a_way = True

    def __init__(self, of: HarmonicBalance, omega: float):
        self.__dict__.update(of.__dict__)
        self.omega, self._linear_at = omega, np.nan
        self._damped_at, self._damped = np.nan, self.model

    def omega_at(self, parameter: float) -> float:
        return self.omega

    def model_at(self, parameter: float) -> ReducedModel:
        if self._damped_at != parameter:
            self._damped_at, self._damped = parameter, self.model.with_damping(self.omega * (1.0 - parameter) / parameter)
        return self._damped

    def where(self, parameter: float) -> str:
        return f"{super().where(self.omega)}, damped further by {self.omega * (1.0 - parameter) / parameter:.3g} M"

    def linear_motion(self, parameter: float) -> tuple[np.ndarray, np.ndarray]:
        if self._linear_at != parameter:
            model = self.model_at(parameter)
            U_lin = model.linear_motion(self.level, self.omega)
            dU_lin = model.linear_motion_rate(self.level, self.omega, d_omega=0.0, d_sigma=-self.omega / parameter**2)
            self._linear_at, self._linear = parameter, (U_lin.reshape(self.shape), dU_lin.reshape(self.shape))
        return self._linear

    def receptance_at(self, parameter: float, active: np.ndarray) -> ReceptanceColumns:
        return self.model_at(parameter).at(self.omega, active)

    def force_derivative(self, parameter: float, G: ReceptanceColumns, p: np.ndarray) -> np.ndarray:
        return G.apply_rate(p, d_omega=0.0, d_sigma=-self.omega / parameter**2)
