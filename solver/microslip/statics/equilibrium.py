"""Rest of a joint under constant loads: unilateral contact and friction in load steps (docs/theory.md, section 12).

With all pairs stuck the structure is linear, and only what the contact forces add is not: the equations are those of harmonic
balance with the mean alone, condensed to the pairs, and the law is that of the vibration, step by step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..contact.law import Law
from ..linear.dense import summed
from ..linear.joint_springs import Linearised
from ..mesh.data import ContactPairs
from ..modes.constraint import static_columns
from ..parallel.agree import on_root
from ..parallel.errors import ConvergenceError, ResourceError

TOLERANCE = 1e-12  # of the relative displacement, over the largest there is
MOST_ITERATIONS = 60
HALVINGS = 6  # of a Newton step that makes the residual grow
FARTHEST = 1e6  # over the displacement with all pairs stuck: beyond it nothing holds a body
SHORTEST = 2.0**-12  # of a load step
LARGEST = 12_000  # rows of pairs that open or slip, solved for densely
BATCH = 32  # pairs whose columns are solved for together


@dataclass(frozen=True, eq=False)
class Rest:
    """A joint in equilibrium; the same on every rank but for the displacement of the structure."""

    du: np.ndarray  # (n_pairs, 3) m, relative displacements
    force: np.ndarray  # (n_pairs, 3) N, on body 2 and against body 1: friction x and y, and minus the normal force
    u_owned: np.ndarray  # (n_dof_owned,) m, this rank's rows of the displacement
    iterations: int  # of Newton, in all steps
    steps: int  # that were taken

    @property
    def N(self) -> np.ndarray:
        """Normal forces, (n_pairs,) [N], 0 where open."""
        return -self.force[:, 2]


class Flexibility:
    """R K_L^-1 R^T by columns, solved for when pairs first need them; kept on rank 0, where the pairs are solved for."""

    def __init__(self, linearised: Linearised):
        R = linearised.system.R
        self._linearised, self._R_T, self.n_pairs = linearised, R.T.tocsc(), R.shape[0] // 3
        self.known = np.zeros(self.n_pairs, dtype=bool)
        n_kept = R.shape[0] if linearised.system.comm.rank == 0 else 0
        self._columns = np.empty((n_kept, n_kept), order="F")  # pages that no pair needs are never touched

    def require(self, pairs: np.ndarray) -> None:
        """Solve for the columns of ``pairs`` that are not known.  Collective; the same on every rank."""
        missing = np.flatnonzero(pairs & ~self.known)
        for start in range(0, len(missing), BATCH):
            rows = _rows(missing[start : start + BATCH])
            columns = static_columns(self._linearised, self._linearised.system.R, self._R_T[:, rows])
            if len(self._columns):
                self._columns[:, rows] = columns
        self.known[missing] = True

    def of(self, pairs: np.ndarray) -> np.ndarray:
        """Return the columns of some pairs, (3 n_pairs, 3 m) [m/N].  Rank 0."""
        return self._columns[:, _rows(np.flatnonzero(pairs))]


def equilibrium(linearised: Linearised, pairs: ContactPairs, forces_owned: np.ndarray, n_steps: int) -> Rest:
    """Return the joint at rest under ``forces_owned`` (n_dof_owned,) [N], this rank's rows, put on in equal steps.

    Collective.  ``linearised`` has the springs of all pairs.  docs/theory.md, eq. (12.3).  A step without a solution is halved.

    Raises
    ------
    ConvergenceError : no equilibrium; the text says which body nothing presses on any more; on every rank
    ResourceError : more pairs open or slip than are solved for densely; on every rank
    """
    system, comm = linearised.system, linearised.system.comm
    u_load = linearised.factor.solve(forces_owned[:, None])[:, 0]
    first, last = linearised.K_L.getOwnershipRange()
    du_load = comm.bcast(summed(comm, system.R[:, first:last] @ u_load))
    contact = _Contact(comm, pairs.law, pairs.N0, Flexibility(linearised), du_load.reshape(-1, 3))
    share, step, n_taken = 0.0, 1.0 / n_steps, 0
    now = _State(np.zeros((pairs.n_pairs, 3)), np.zeros((pairs.n_pairs, 3)))
    while share < 1.0 - 1e-9:
        next_share = min(share + step, 1.0)
        found = contact.solve(now, share, next_share)
        if found is None:
            step *= 0.5
            if step < SHORTEST / n_steps:
                raise ConvergenceError(contact.why_not(now, share, pairs))
            continue
        now, share, n_taken, step = found, next_share, n_taken + 1, min(2.0 * step, 1.0 / n_steps)
    p_owned = (system.R[:, first:last].T @ now.p.ravel())[:, None]
    u_owned = u_load - linearised.factor.solve(p_owned)[:, 0]
    force = now.p + pairs.law.stiffness * now.du
    force[:, 2] -= np.maximum(pairs.N0, 0.0)
    return Rest(now.du, force, u_owned, contact.iterations, n_taken)


@dataclass(frozen=True, eq=False)
class _State:
    du: np.ndarray  # (n_pairs, 3) m
    p: np.ndarray  # (n_pairs, 3) N


class _Contact:
    """du = share du_load - G p, p by the law from what it was: Newton's method on rank 0, columns of G from all."""

    def __init__(self, comm, law: Law, N0: np.ndarray, G: Flexibility, du_load: np.ndarray):
        self.comm, self.law, self.N0, self.G, self.du_load = comm, law, N0, G, du_load
        self.iterations = 0
        self.largest = float(np.abs(du_load).max(initial=0.0))

    def solve(self, was: _State, share: float, next_share: float) -> _State | None:
        """Return the state at the next share of the load, None where Newton does not find one.  Collective.

        From where the load moves the pairs if none changes its state; if that fails, from all gaps closed: a body that hangs on
        its gaps alone is nowhere near its rest before it has fallen through them.
        """
        load = next_share * self.du_load
        found = self._newton_from(was.du + (next_share - share) * self.du_load, was, load)
        if found is None and (self.N0 < 0.0).any():
            found = self._newton_from(self._closed(was, load), was, load)
        return found

    def _closed(self, was: _State, load: np.ndarray) -> np.ndarray:
        """Return du with all gaps closed by what the springs of the pairs carry.  Collective."""
        p = was.p.copy()
        p[:, 2] = np.maximum(-self.N0, 0.0)
        self.G.require(p.any(axis=1))
        return on_root(self.comm, lambda: load - (self.G.of(p.any(axis=1)) @ p[p.any(axis=1)].ravel()).reshape(load.shape))

    def _newton_from(self, du: np.ndarray, was: _State, load: np.ndarray) -> _State | None:
        """Return the state that Newton's method finds from ``du``, if it does.  Collective."""
        for _ in range(MOST_ITERATIONS):
            p, L, _ = self.law.step(du, was.p)
            active = p.any(axis=1) | L.any(axis=(1, 2))
            if 3 * np.count_nonzero(active) > LARGEST:
                raise ResourceError(
                    f"[statics]: {np.count_nonzero(active)} contact pairs open or slip at rest; up to {LARGEST // 3} are "
                    "solved for: a coarser mesh of the contact surfaces, or stiffer contact, has fewer"
                )
            self.G.require(active)
            size = max(self.largest, float(np.abs(du).max(initial=0.0)))
            better, error = on_root(self.comm, self._iterate, was, load, du, p, L, active)
            self.iterations += 1
            if size > FARTHEST * self.largest:
                return None
            if error <= TOLERANCE * size:
                return _State(du, p)
            if better is None:
                return None
            du = better
        return None

    def _iterate(self, was: _State, load, du, p, L, active) -> tuple[np.ndarray | None, float]:
        """Return du after a Newton step, None where there is none, and the residual before it [m].  Rank 0."""
        residual = self._residual(load, du, p, active)
        error = float(np.abs(residual).max(initial=0.0))
        step = self._newton(residual, L, active)
        if step is None:
            return None, error
        best, best_error = du + step, np.inf
        for k in range(HALVINGS + 1):
            trial = du + 0.5**k * step
            p_trial, _, _ = self.law.step(trial, was.p)
            moving = p_trial.any(axis=1)
            if not (moving & ~self.G.known).any():
                trial_error = float(np.abs(self._residual(load, trial, p_trial, moving)).max(initial=0.0))
                if trial_error < best_error:
                    best, best_error = trial, trial_error
                if trial_error < error:
                    break
            elif k == 0:
                return trial, error  # pairs of which nothing is known yet
        return best, error

    def _residual(self, load, du, p, active) -> np.ndarray:
        return du - load + (self.G.of(active) @ p[active].ravel()).reshape(du.shape)

    def _newton(self, residual, L, active) -> np.ndarray | None:
        """Return the Newton step, (n_pairs, 3) [m]; None where the system is singular."""
        rows, columns = _rows(np.flatnonzero(active)), self.G.of(active)
        J = np.einsum("rmi,mij->rmj", columns[rows].reshape(len(rows), len(rows) // 3, 3), L[active]).reshape(
            len(rows), len(rows)
        )
        J[np.diag_indices_from(J)] += 1.0
        try:
            of_active = np.linalg.solve(J, -residual[active].ravel())
        except np.linalg.LinAlgError:
            return None
        dp = np.einsum("mij,mj->mi", L[active], of_active.reshape(-1, 3))
        step = -residual - (columns @ dp.ravel()).reshape(residual.shape)
        return step if np.isfinite(step).all() else None

    def why_not(self, now: _State, share: float, pairs: ContactPairs) -> str:
        """Say what is open where the load ends at which there is equilibrium.  Local."""
        du = now.du + SHORTEST * self.du_load
        is_open = pairs.N0 - pairs.k_n * du[:, 2] <= 0.0
        joints = [f"{np.count_nonzero(is_open[own])} of {len(own)} pairs of {name!r}" for name, own in _by_joint(pairs)]
        return (
            f"[statics]: no equilibrium beyond {share:.1%} of the load, where {', '.join(joints)} are open: a body that nothing "
            "presses on flies off, or slides where friction cannot hold it; check the directions of loads and axis, state more "
            "friction or a support, or smaller [statics] steps"
        )


def _by_joint(pairs: ContactPairs) -> list[tuple[str, np.ndarray]]:
    names = np.array(pairs.joint)
    return [(name, np.flatnonzero(names == name)) for name in dict.fromkeys(pairs.joint)]


def _rows(pairs: np.ndarray) -> np.ndarray:
    return (3 * pairs[:, None] + np.arange(3)).ravel()
