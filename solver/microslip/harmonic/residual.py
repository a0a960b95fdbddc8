"""The harmonic-balance residual r(U, omega) = U - U_lin(omega) + G(omega) p(U) and its derivatives.

docs/theory.md, section 5.  The rows of a pair live on the rank that owns it; ``p`` of the pairs that do not stick is
gathered once an application.  ``p`` and dp/dU vanish where a pair sticks, so the cost follows the others.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from ..contact.law import Law
from ..fourier.harmonics import Harmonics
from ..linear.dense import summed
from ..receptance import motion as receptance
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

    def __init__(self, model: ReducedModel, law: Law, n_samples: int, level: float):
        self.model = model
        self.comm = model.comm
        self.law = law.take(np.arange(model.n_pairs)[model.owned])
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
        law = self.law if all_chosen else self.law.take(chosen)
        found = law.cycle(U if all_chosen else U[chosen], self.n_samples, tangents, self.model.harmonics)
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
            U_lin, dU_lin = receptance.linear_motion(self.model, self.level, parameter)
            self._linear_at, self._linear = parameter, (U_lin.reshape(self.shape), dU_lin.reshape(self.shape))
        return self._linear

    def receptance_at(self, parameter: float, active: np.ndarray) -> ReceptanceColumns:
        """Return G restricted to the columns of the ``active`` pairs.  Collective where static columns are new."""
        return ReceptanceColumns(self.model, parameter, active)

    def force_derivative(self, G: ReceptanceColumns, p: np.ndarray) -> np.ndarray:
        """Return (dG / d parameter) p on this rank's pairs, (n_owned, 3, N_H).  Local."""
        return G.apply_derivative(p)


class LevelFamily(HarmonicBalance):
    """The same residual at a fixed frequency, with the load level as parameter."""

    is_a_way = True

    def __init__(self, of: HarmonicBalance, omega: float):
        self.__dict__.update(of.__dict__)
        self.omega = omega
        unit, _ = receptance.linear_motion(self.model, 1.0, omega)
        self.U_lin_per_newton = unit.reshape(self.shape)

    def omega_at(self, parameter: float) -> float:
        return self.omega

    def level_at(self, parameter: float) -> float:
        return parameter

    def linear_motion(self, parameter: float) -> tuple[np.ndarray, np.ndarray]:
        return parameter * self.U_lin_per_newton, self.U_lin_per_newton

    def receptance_at(self, parameter: float, active: np.ndarray) -> ReceptanceColumns:
        return ReceptanceColumns(self.model, self.omega, active)

    def force_derivative(self, G: ReceptanceColumns, p: np.ndarray) -> np.ndarray:
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
            model, f = self.model_at(parameter), self.level * self.model.f
            U_lin, _ = receptance.linear_motion(model, self.level, self.omega)
            dc = self._derivative(parameter)
            dU_lin = model.r[model.owned_rows] @ receptance.modal(dc, model.b @ f)
            self._linear_at, self._linear = parameter, (U_lin.reshape(self.shape), dU_lin.reshape(self.shape))
        return self._linear

    def receptance_at(self, parameter: float, active: np.ndarray) -> ReceptanceColumns:
        columns = ReceptanceColumns(self.model_at(parameter), self.omega, active)
        columns.dc = self._derivative(parameter)
        return columns

    def _derivative(self, parameter: float) -> np.ndarray:
        """Return d c_n / d t [s2]."""
        return receptance.damping_derivative(self.model_at(parameter), self.omega) * (-self.omega / parameter**2)


class ReceptanceColumns:
    """Columns of G_n(omega), all harmonics of the set, that belong to some pairs; rows are those of this rank's pairs."""

    def __init__(self, model: ReducedModel, omega: float, active: np.ndarray):
        self.G_static = model.G_static.transposed(active)
        self.r_active = model.r if len(active) == model.n_pairs else model.r[(3 * active[:, None] + np.arange(3)).ravel()]
        self.r_owned = model.r[model.owned_rows]
        self.c, self.dc = receptance.dynamic_part(model, omega)
        self.shape = (-1, 3, model.N_H)

    def rows(self, owned: np.ndarray) -> np.ndarray:
        """Return the rows of some of this rank's pairs of the static part, (3 m, 3 n_active) [m/N].  Local."""
        return self.G_static[:, (3 * owned[:, None] + np.arange(3)).ravel()].T

    def dynamic_block(self, i: int) -> np.ndarray:
        """Return r c_n r^T between the active pairs for the i-th harmonic of the set, (3 n_active, 3 n_active), complex [m/N].

        Local.
        """
        if self.c.ndim == 2:
            return (self.r_active * self.c[:, i]) @ self.r_active.T
        return self.r_active @ self.c[i] @ self.r_active.T

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p on this rank's pairs, (n_owned, 3, N_H) [m], for p (3 n_active, N_H) [N].  Local."""
        if len(p) == 0:
            return np.zeros((len(self.r_owned) // 3, *self.shape[1:]))
        dynamic = self.r_owned @ receptance.modal(self.c, self.r_active.T @ p)
        return ((p.T @ self.G_static).T + dynamic).reshape(self.shape)

    def apply_transposed(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's part of G^T x for x (n_owned, 3, N_H), (3 n_active, N_H).  Local; to be summed over the ranks."""
        rows = x.reshape(-1, x.shape[-1])
        adjoint = self.c.conj() if self.c.ndim == 2 else self.c.conj().swapaxes(1, 2)
        return self.G_static @ rows + self.r_active @ receptance.modal(adjoint, self.r_owned.T @ rows)

    def adjoint(self) -> ReceptanceColumns:
        """Return the columns of the transposed of G, which has the same static part.  Local."""
        other = copy(self)
        other.c = self.c.conj() if self.c.ndim == 2 else self.c.conj().swapaxes(1, 2)
        return other

    def apply_derivative(self, p: np.ndarray) -> np.ndarray:
        """Return (dG / d omega) p on this rank's pairs, (n_owned, 3, N_H) [m s].  Local."""
        return (self.r_owned @ receptance.modal(self.dc, self.r_active.T @ p)).reshape(self.shape)


class ActiveColumns:
    """Columns and rows of G_n(omega) of pairs that do not stick, in one array and of a precision to choose.

    Forces come in units of 1 / ``unit`` [N], the same on all ranks, so that single precision neither overflows nor vanishes,
    whatever the units of the scene.  Collective on ``comm``.
    """

    def __init__(self, comm, G: ReceptanceColumns, owned: np.ndarray, precision: type):
        self.precision, rows = precision, (3 * owned[:, None] + np.arange(3)).ravel()
        self.unit = max(comm.allgather(float(np.abs(G.G_static).max(initial=0.0)))) or 1.0  # m/N
        self.r_unit = float(np.abs(G.r_active).max(initial=0.0)) or 1.0
        self.n_rows = len(rows)
        self.columns: np.ndarray = np.empty((len(G.r_active), len(rows) + G.r_active.shape[1]), dtype=precision)
        self.columns[:, : self.n_rows] = G.G_static[:, rows] / self.unit
        self.columns[:, self.n_rows :] = G.r_active / self.r_unit
        self.r_rows = G.r_owned[rows] * (self.r_unit / self.unit)
        self.c = G.c

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p, (3 m, N_H) [m], for p (3 n_active, N_H) in units of 1 / ``unit`` [N].  Local."""
        product = (p.T.astype(self.precision, copy=False) @ self.columns).T
        return product[: self.n_rows] + self.r_rows @ receptance.modal(self.c, product[self.n_rows :].astype(float))

    def scaled(self, P: np.ndarray) -> np.ndarray:
        """Return tangents P [N/m] that give forces in units of 1 / ``unit``, in the precision of the columns.  Local."""
        scaled: np.ndarray = np.empty_like(P, dtype=self.precision)
        return np.multiply(P, self.unit, out=scaled, casting="same_kind")

    def apply_to_several(self, p: np.ndarray) -> np.ndarray:
        """Return G p of several forces at once, (n, 3 m, N_H) [m], for p (n, 3 n_active, N_H) in those units.  Local."""
        n, rows, N_H = p.shape
        together = p.swapaxes(0, 1).reshape(rows, n * N_H)
        product = self.columns.T @ together.astype(self.precision, copy=False)
        q = product[self.n_rows :].astype(float)
        modal = receptance.modal(self.c, q.reshape(len(q), n, N_H)).reshape(q.shape)
        return (product[: self.n_rows] + self.r_rows @ modal).reshape(self.n_rows, n, N_H).swapaxes(0, 1)
