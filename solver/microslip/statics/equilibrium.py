"""Rest of a joint under constant loads: unilateral contact and friction in load steps (docs/theory.md, section 12).

With all pairs stuck the structure is linear, and only what the contact forces add is not: the equations are those of harmonic
balance with the mean alone, condensed to the pairs, and the law is that of the vibration, step by step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from mpi4py import MPI

from ..contact.law import Law
from ..contact.laws import are_springs, pressed_to
from ..linear.joint_springs import Linearised
from ..mesh.data import ContactPairs
from ..messages.errors import ConvergenceError, ResourceError
from ..modes.constraint import static_columns
from ..parallel.agree import on_root
from ..parallel.ownership import rows_of, summed
from .bolts import BoltsAtRest, Cuts, of_loads

TOLERANCE = 1e-12  # of the relative displacement, over the largest there is
MOST_ITERATIONS = 60
HALVINGS = 6  # of a Newton step that makes the residual grow
FARTHEST = 1e6  # over the displacement with all pairs stuck: beyond it nothing holds a body
SHORTEST = 2.0**-12  # of a load step
LARGEST = 12_000  # rows of pairs that open or slip, solved for densely


@dataclass(frozen=True, eq=False)
class Rest:
    """A joint in equilibrium; the same on every rank but for the displacement of the structure."""

    du: np.ndarray  # (n_pairs, 3) m, relative displacements
    force: np.ndarray  # (n_pairs, 3) N, on body 2 and against body 1: friction x and y, and minus the normal force
    u_owned: np.ndarray  # (n_dof_owned,) m, this rank's rows of the displacement
    iterations: int  # of Newton, in all steps
    steps: int  # that were taken
    bolts: BoltsAtRest | None = None
    memory: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # (n_pairs, n_memory) what the law remembers beside p

    @property
    def N(self) -> np.ndarray:
        """Normal forces, (n_pairs,) [N], 0 where open."""
        return -self.force[:, 2]


class Flexibility:
    """R K_L^-1 R^T by columns, solved for when pairs first need them; kept on rank 0, where the pairs are solved for."""

    def __init__(self, linearised: Linearised):
        R = linearised.system.R
        self.linearised, self._R_T, self.n_pairs = linearised, R.T.tocsc(), R.shape[0] // 3
        self.known = np.zeros(self.n_pairs, dtype=bool)
        n_kept = R.shape[0] if linearised.system.comm.rank == 0 else 0
        self._columns = np.empty((n_kept, n_kept), order="F")  # pages that no pair needs are never touched

    def require(self, pairs: np.ndarray) -> None:
        """Solve for the columns of ``pairs`` that are not known.  Collective; the same on every rank."""
        missing = np.flatnonzero(pairs & ~self.known)
        if len(missing) == 0:
            return
        rows = rows_of(missing)
        columns = static_columns(self.linearised, self.linearised.system.R, self._R_T[:, rows])
        if len(self._columns):
            self._columns[:, rows] = columns
        self.known[missing] = True

    def of(self, pairs: np.ndarray) -> np.ndarray:
        """Return the columns of some pairs, (3 n_pairs, 3 m) [m/N].  Rank 0."""
        return self._columns if pairs.all() else self._columns[:, rows_of(np.flatnonzero(pairs))]


def equilibrium(
    G: Flexibility,
    pairs: ContactPairs,
    forces_owned: np.ndarray,
    n_steps: int,
    cuts: Cuts | None = None,
    which_flies: Callable[[], str] = lambda: "",
) -> Rest:
    """Return the joint at rest under ``forces_owned`` (n_dof_owned,) [N], this rank's rows, put on in equal steps.

    Collective.  ``G`` is that of the springs of all pairs.  docs/theory.md, eq. (12.3).  A step without a solution is halved.
    Bolts, by their ``cuts``, are tightened first, in as many steps; then their shortening is held while the forces are put on.

    Parameters
    ----------
    which_flies : says which bodies the loads move freely, and what would hold them; collective

    Raises
    ------
    ConvergenceError : no equilibrium; the text says which body nothing presses on any more; on every rank
    ResourceError : more pairs open or slip than are solved for densely; on every rank
    """
    linearised, system, comm = G.linearised, G.linearised.system, G.linearised.system.comm
    first, last = linearised.K_L.getOwnershipRange()
    R_owned = system.R[:, first:last]
    u_load = linearised.factor.solve(forces_owned[:, None])[:, 0]
    du_load = comm.bcast(summed(comm, R_owned @ u_load)).reshape(-1, 3)
    contact = Contact(comm, pairs, G)
    unloaded = np.zeros((pairs.n_pairs, 3 + pairs.law.n_memory))
    now, n_taken, found = State(np.zeros(du_load.shape), unloaded), 0, None
    held, u_held = np.zeros(du_load.shape), 0.0
    if cuts is not None:
        delta = cuts.tightened(now.p)
        tightening = Loading(held, (cuts.RU @ delta).reshape(-1, 3), "the bolts' forces", release=cuts.release)
        now, n_taken = contact.follow(tightening, now, n_steps)
        delta = cuts.tightened(now.p)
        tightened = cuts.force(delta, now.p)
        held, u_held = (cuts.RU @ delta).reshape(-1, 3), cuts.U_owned @ delta
    if cuts is None or comm.allreduce(bool(forces_owned.any()), MPI.LOR):
        loading = Loading(held, du_load, "the load", which_flies)
        now, n_more = contact.follow(loading, now, n_steps)
        n_taken += n_more
    if cuts is not None:
        at_rest = cuts.force(delta, now.p, of_loads(cuts, linearised, forces_owned))
        bolts = cuts.bolts
        found = BoltsAtRest(tuple(bolt.label for bolt in bolts.given), bolts.area, delta, tightened, at_rest)
    u_owned = u_held + u_load - linearised.factor.solve((R_owned.T @ now.p.ravel())[:, None])[:, 0]
    force = now.p + pairs.law.stiffness * now.du
    force[:, 2] -= np.maximum(np.nan_to_num(pairs.N0), 0.0)
    return Rest(now.du, force, u_owned, contact.iterations, n_taken, found, now.after[:, 3:])


def stuck_forces(G: Flexibility, pairs: ContactPairs, forces_owned: np.ndarray, cuts: Cuts | None) -> np.ndarray:
    """Return the normal forces of the pairs if all of them stuck, closed, under the bolts and all loads, (n_pairs,) [N].

    Collective; arguments as in :func:`equilibrium`.
    """
    linearised, comm = G.linearised, G.linearised.system.comm
    first, last = linearised.K_L.getOwnershipRange()
    du = comm.bcast(summed(comm, linearised.system.R[:, first:last] @ linearised.factor.solve(forces_owned[:, None])[:, 0]))
    if cuts is not None:
        du = du + cuts.RU @ cuts.tightened(np.zeros(len(du)))
    return -pairs.k_n * du.reshape(-1, 3)[:, 2]


@dataclass(frozen=True, eq=False)
class State:
    """The joint where a march has come to."""

    du: np.ndarray  # (n_pairs, 3) m
    after: np.ndarray  # (n_pairs, 3 + n_memory) N, p and what the law remembers beside it

    @property
    def p(self) -> np.ndarray:
        return self.after[:, :3]


@dataclass(frozen=True, eq=False)
class Loading:
    """What moves the pairs while they all stick: a part that is there, and one that is put on in steps."""

    held: np.ndarray  # (n_pairs, 3) m
    rising: np.ndarray  # (n_pairs, 3) m
    name: str  # of what is put on, for messages
    which_flies: Callable[[], str] = lambda: ""
    release: tuple[np.ndarray, np.ndarray] | None = None  # R K_L^-1 F and S^-1 of bolts that give way at their force

    @property
    def largest(self) -> float:
        return float(max(np.abs(self.held).max(initial=0.0), np.abs(self.rising).max(initial=0.0)))


@dataclass(frozen=True, eq=False)
class _Sought:
    """An equilibrium to be found: under which loads, by which law, from which state on."""

    loading: Loading
    share: float  # of what rises
    law: Law
    was: State

    @property
    def load(self) -> np.ndarray:
        """What moves the pairs while they all stick, (n_pairs, 3) [m]."""
        return self.loading.held + self.share * self.loading.rising

    def at(self, du: np.ndarray) -> _Trial:
        """Return the pairs at a motion (n_pairs, 3) [m].  Local."""
        after, L, _ = self.law.step(du, self.was.after)
        return _Trial(State(du, after), L, after[:, :3].any(axis=1) | L.any(axis=(1, 2)))


@dataclass(frozen=True, eq=False)
class _Trial:
    """The pairs at a motion that may be an equilibrium."""

    state: State
    L: np.ndarray  # (n_pairs, 3, 3) dp / d du [N/m]
    active: np.ndarray  # (n_pairs,) bool: p or L is not zero


class Contact:
    """du = held + share rising - G p, p by the law from what it was: Newton's method on rank 0, columns of G from all."""

    def __init__(self, comm: MPI.Comm, pairs: ContactPairs, G: Flexibility):
        self.comm, self.pairs, self.law, self.G = comm, pairs, pairs.law, G
        self.iterations = 0

    def follow(self, loading: Loading, now: State, n_steps: int) -> tuple[State, int]:
        """Return the state under all of a loading, put on in equal steps or shorter ones, and their number.  Collective."""
        share, step, n_taken = 0.0, 1.0 / n_steps, 0
        while share < 1.0 - 1e-9:
            next_share = min(share + step, 1.0)
            guess = now.du + (next_share - share) * loading.rising
            found = self._solve(loading, now, next_share, pressed_to(self.pairs.laws, self.pairs.columns, now.du, guess))
            if found is None and n_taken == 0 and step == 1.0 / n_steps and (self.pairs.N0 < 0.0).any():
                found = self._fallen(loading, now, next_share)
            if found is None:
                step *= 0.5
                if step < SHORTEST / n_steps:
                    raise ConvergenceError(self._why_not(loading, now, share, n_steps))
                continue
            now, share, n_taken, step = found, next_share, n_taken + 1, min(2.0 * step, 1.0 / n_steps)
        return now, n_taken

    def _fallen(self, loading: Loading, was: State, share: float) -> State | None:
        """Return the state of bodies that have fallen through their gaps, None where none is found.  Collective.

        A body that hangs on its gaps alone moves freely until they close, so that no share of the load leads there.  Instead the
        gaps open from none, under that share; then friction begins, from none.
        """
        opened, step, gaps = 0.0, 1.0, np.minimum(self.pairs.N0, 0.0)
        start = share * loading.rising
        now = self._solve(loading, was, share, start, replace(self.pairs, N0=self.pairs.N0 - gaps).law)
        while now is not None and opened < 1.0:
            target = min(opened + step, 1.0)
            start = now.du.copy()
            start[:, 2] += (target - opened) * np.divide(gaps, self.pairs.k_n, out=np.zeros_like(gaps), where=gaps < 0.0)
            found = self._solve(loading, now, share, start, replace(self.pairs, N0=self.pairs.N0 - (1.0 - target) * gaps).law)
            if found is None and step < SHORTEST:
                return None
            now, opened, step = (now, opened, 0.5 * step) if found is None else (found, target, 2.0 * step)
        if now is None:
            return None
        after, anew = now.after.copy(), are_springs(self.pairs.laws)
        after[anew, :2] = -(self.law.stiffness[:, :2] * now.du[:, :2])[anew]
        return self._solve(loading, State(now.du, after), share, now.du)

    def _solve(self, loading: Loading, was: State, share: float, du: np.ndarray, law: Law | None = None) -> State | None:
        """Return the state at a share of the load, from ``du``; None where Newton does not find one.  Collective.

        Many gaps close and open in full steps sooner than in those that must lower the residual, which come after them.
        """
        has_gaps, sought = bool((self.pairs.N0 < 0.0).any()), _Sought(loading, share, law or self.law, was)
        found = self._newton_from(sought, du, 0) if has_gaps else None
        return found or self._newton_from(sought, du, HALVINGS)

    def _newton_from(self, sought: _Sought, du: np.ndarray, halvings: int) -> State | None:
        """Return the state that Newton's method finds from ``du`` with steps halved so often, if it does.  Collective."""
        largest = max(sought.loading.largest, float(np.abs(du).max(initial=0.0)))
        for _ in range(MOST_ITERATIONS):
            trial = sought.at(du)
            if 3 * np.count_nonzero(trial.active) > LARGEST:
                raise ResourceError(
                    f"[statics]: {np.count_nonzero(trial.active)} contact pairs open or slip at rest; up to {LARGEST // 3} are "
                    "solved for: a coarser mesh of the contact surfaces, or stiffer contact, has fewer"
                )
            self.G.require(trial.active)
            size = max(largest, float(np.abs(du).max(initial=0.0)))
            better, error = on_root(self.comm, self._iterate, sought, trial, halvings)
            self.iterations += 1
            if size > FARTHEST * largest:
                return None
            if error <= TOLERANCE * size:
                return trial.state
            if better is None:
                return None
            du = better
        return None

    def _iterate(self, sought: _Sought, trial: _Trial, halvings: int) -> tuple[np.ndarray | None, float]:
        """Return du after a Newton step, None where there is none, and the residual before it [m].  Rank 0."""
        residual = self._residual(sought, trial.state.du, trial.state.p, trial.active)
        error = float(np.abs(residual).max(initial=0.0))
        step = self._newton(sought.loading, residual, trial)
        if step is None:
            return None, error
        best, best_error = trial.state.du + step, np.inf
        for k in range(halvings + 1):
            du = trial.state.du + 0.5**k * step
            p = sought.law.step(du, sought.was.after)[0][:, :3]
            moving = p.any(axis=1)
            if not (moving & ~self.G.known).any():
                du_error = float(np.abs(self._residual(sought, du, p, moving)).max(initial=0.0))
                if du_error < best_error:
                    best, best_error = du, du_error
                if du_error < error:
                    break
            elif k == 0:
                return du, error  # pairs of which nothing is known yet
        return best, error

    def _columns(self, loading: Loading, active: np.ndarray) -> np.ndarray:
        """Return columns of the flexibility, with that of bolts that give way, (3 n_pairs, 3 m) [m/N].  Rank 0."""
        columns = self.G.of(active)
        if loading.release is None:
            return columns
        RU, compliance = loading.release
        return columns + RU @ (compliance @ RU[rows_of(np.flatnonzero(active))].T)

    def _residual(self, sought: _Sought, du: np.ndarray, p: np.ndarray, active: np.ndarray) -> np.ndarray:
        return du - sought.load + (self._columns(sought.loading, active) @ p[active].ravel()).reshape(du.shape)

    def _newton(self, loading: Loading, residual: np.ndarray, trial: _Trial) -> np.ndarray | None:
        """Return the Newton step, (n_pairs, 3) [m]; None where the system is singular."""
        L, active = trial.L, trial.active
        rows, columns = rows_of(np.flatnonzero(active)), self._columns(loading, active)
        of_active = columns[rows].T.reshape(len(rows) // 3, 3, len(rows))
        J = np.matmul(L[active].transpose(0, 2, 1), of_active).reshape(len(rows), len(rows)).T
        J[np.diag_indices_from(J)] += 1.0
        try:
            d_du = np.linalg.solve(J, -residual[active].ravel())
        except np.linalg.LinAlgError:
            return None
        dp = np.einsum("mij,mj->mi", L[active], d_du.reshape(-1, 3))
        step = -residual - (columns @ dp.ravel()).reshape(residual.shape)
        return step if np.isfinite(step).all() else None

    def _why_not(self, loading: Loading, now: State, share: float, n_steps: int) -> str:
        """Say what is open where the load ends at which there is equilibrium, what moves beyond it, and what would hold it.

        Collective.
        """
        flies = loading.which_flies() or (
            "no body flies off as a whole; what bends, rocks or slides on the way lets go: more friction or preload holds it, a "
            f"support, or more [statics] steps than {n_steps}, which follow the path of the loads more closely"
        )
        du, pairs = now.du + SHORTEST * loading.rising, self.pairs
        is_open = pairs.N0 - pairs.k_n * du[:, 2] <= 0.0
        joints = [f"{np.count_nonzero(is_open[own])} of {len(own)} pairs of {name!r}" for name, own in _by_joint(pairs)]
        found_to = "the very beginning" if share < 5e-4 else f"{share:.1%}"
        return f"[statics]: no equilibrium beyond {found_to} of {loading.name}, where {', '.join(joints)} are open: {flies}"


def _by_joint(pairs: ContactPairs) -> list[tuple[str, np.ndarray]]:
    names = np.array(pairs.joint)
    return [(name, np.flatnonzero(names == name)) for name in dict.fromkeys(pairs.joint)]
