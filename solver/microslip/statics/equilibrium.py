"""Rest of a joint under constant loads: unilateral contact and friction in load steps (docs/theory.md, section 12).

With all pairs stuck the structure is linear, and only the contact forces are nonlinear: the equations are those of harmonic
balance with only the mean, condensed to the pairs, and the contact law of the vibration is applied step by step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from mpi4py import MPI
from scipy.linalg import lapack

from ..assembly.pretension import Bolts
from ..assembly.system import System
from ..contact.law import Law
from ..contact.laws import are_springs, initial_guess
from ..guards.memory import refuse_beyond
from ..linear.joint_springs import Linearised, linearise
from ..mesh.data import ContactPairs
from ..messages.errors import ConvergenceError, ResourceError
from ..messages.words import counted
from ..modes.constraint import static_columns
from ..parallel.agree import on_root
from ..parallel.ownership import gathered_rows, rows_of, split_evenly, summed
from ..receptance.static_columns import StaticColumns
from .bolts import BoltsAtRest, Cuts, cuts_of, of_loads

TOLERANCE = 1e-12  # of the relative displacement over its largest value
MOST_ITERATIONS = 60
HALVINGS = 6  # halvings of a Newton step that increases the residual
FARTHEST = 1e6  # times the displacement with all pairs stuck, beyond which a body is taken as free
SHORTEST = 2.0**-12  # shortest part of a load step
LARGEST = 12_000  # rows of a dense solve for pairs that open or slip
_CHECKED_FROM = 1e8  # bytes from which the available memory is checked before allocation
_BLOCK = 64  # pairs per block of copied rows of the flexibility
_FEWER = "use a coarser mesh of the contact surfaces, a stiffer contact, or more ranks on more machines"


@dataclass(frozen=True, eq=False)
class Rest:
    """A joint in equilibrium; the same on every rank except the displacement of the structure."""

    du: np.ndarray  # (n_pairs, 3) m, relative displacements
    force: np.ndarray  # (n_pairs, 3) N, on body 2, opposite on body 1: friction x and y, and minus the normal force
    u_owned: np.ndarray  # (n_dof_owned,) m, this rank's rows of the displacement
    iterations: int  # Newton iterations of all steps
    steps: int  # number of steps
    bolts: BoltsAtRest | None = None
    memory: np.ndarray = field(
        default_factory=lambda: np.zeros((0, 0))
    )  # (n_pairs, n_memory) internal variables of the law in addition to p

    @property
    def N(self) -> np.ndarray:
        """Normal forces, (n_pairs,) [N], 0 where open."""
        return -self.force[:, 2]


class Flexibility:
    """R K_L^-1 R^T by columns, computed when first needed; each rank has the rows of its pairs."""

    def __init__(self, linearised: Linearised):
        self.linearised, self.system, self.comm = linearised, linearised.system, linearised.system.comm
        self._R_T, self.n_pairs = self.system.R.T.tocsc(), self.system.R.shape[0] // 3
        self._limits = split_evenly(self.n_pairs, self.comm.size)
        self.owned = slice(*self._limits[self.comm.rank :][:2])  # pairs
        self._columns = StaticColumns(self.n_pairs, self.owned.stop - self.owned.start, self._solve)

    @classmethod
    def of(cls, system: System, pairs: ContactPairs, where: str = "") -> Flexibility:
        """Return the flexibility of the structure with all ``pairs`` stuck, whose stiffness is factored.  Collective.

        Raises
        ------
        CaseError, ResourceError : as :func:`~microslip.linear.joint_springs.linearise`; on every rank
        """
        return cls(linearise(system, pairs, where))

    def destroy(self) -> None:
        """Free the factor.  Collective."""
        self.linearised.destroy()

    def cuts(self, bolts: Bolts, where: str = "") -> Cuts:
        """Return the cuts of the bolts in the stuck structure.  Collective: one solve per bolt.

        Raises
        ------
        CaseError : a bolt that clamps nothing; on every rank
        """
        return cuts_of(self.linearised, bolts, where)

    def _solve(self, pairs: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the columns of ``pairs`` (m,), (3 n_owned, 3 m) [m/N].  Collective."""
        return static_columns(self.linearised, self.system.R, self._R_T[:, rows_of(pairs)], 3 * self._limits)

    @property
    def known(self) -> np.ndarray:
        """The pairs with computed columns, (n_pairs,) bool."""
        return self._columns.known

    def require(self, pairs: np.ndarray) -> None:
        """Compute the missing columns of ``pairs``.  Collective; the same on every rank.

        Raises
        ------
        ResourceError : not enough memory; on every rank
        """
        missing = np.flatnonzero(pairs & ~self.known)
        if 72.0 * len(missing) * self.n_pairs > _CHECKED_FROM:
            needed = 72.0 * len(missing) * (self.owned.stop - self.owned.start)
            refuse_beyond(self.comm, needed, f"[statics]: {len(missing)} pairs that open or slip", _FEWER)
        self._columns.require(missing)

    def apply(self, pairs: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return du of forces p (m, 3) [N] on ``pairs`` (m,), by number, (n_pairs, 3) [m].  Collective: one gather."""
        combined = self._columns.chosen(pairs).combined(p.reshape(-1, 1))
        du = gathered_rows(self.comm, combined.reshape(-1, 3), self._limits)
        assert du is not None, "gathered on every rank"
        return du

    def newton_matrix(self, pairs: np.ndarray, L: np.ndarray, release: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray | None:
        """Return 1 + G L of ``pairs`` (m,), L being (m, 3, 3) [N/m], (3 m, 3 m) on rank 0, None elsewhere.  Collective.

        ``release``: of a :class:`Loading`, whose bolts add to G.

        Raises
        ------
        ResourceError : not enough memory; on every rank
        """
        counts = np.diff(np.searchsorted(pairs, self._limits))
        first, n_rows = int(counts[: self.comm.rank].sum()), 3 * len(pairs)
        local = slice(first, first + int(counts[self.comm.rank]))
        if 8.0 * n_rows**2 > _CHECKED_FROM:
            needed = 8.0 * n_rows * (3 * (local.stop - local.start) + (n_rows if self.comm.rank == 0 < self.comm.size - 1 else 0))
            refuse_beyond(self.comm, needed, f"[statics]: the equilibrium of {len(pairs)} pairs that open or slip", _FEWER)
        columns, J_owned = self._columns.chosen(pairs), np.empty((3 * (local.stop - local.start), n_rows))
        for start in range(local.start, local.stop, _BLOCK):
            block = slice(start, min(start + _BLOCK, local.stop))
            G = columns.columns(rows_of(pairs[block] - self.owned.start)).T
            if release is not None:
                RU, compliance = release
                G = G + RU[rows_of(pairs[block])] @ (compliance @ RU[rows_of(pairs)].T)
            part = np.matmul(G.reshape(len(G), len(pairs), 3).swapaxes(0, 1), L)  # (m, 3 k, 3)
            J_owned[3 * (start - local.start) :][: len(G)] = part.swapaxes(0, 1).reshape(len(G), n_rows)
        J = gathered_rows(self.comm, J_owned, 3 * np.append(0, np.cumsum(counts)), root=0)
        if J is not None:
            J.ravel()[:: n_rows + 1] += 1.0  # the diagonal
        return J


def equilibrium(
    G: Flexibility,
    pairs: ContactPairs,
    forces_owned: np.ndarray,
    n_steps: int,
    cuts: Cuts | None = None,
    free_bodies: Callable[[], str] = lambda: "",
) -> Rest:
    """Return the joint at rest under ``forces_owned`` (n_dof_owned,) [N], this rank's rows, applied in equal steps.

    Collective.  ``G`` has the springs of all pairs.  docs/theory.md, eq. (12.3).  Steps without solution are halved.
    Bolts, given by their ``cuts``, are tightened first, in the same number of steps; then the forces act at constant shortening.

    Parameters
    ----------
    free_bodies : returns a text on bodies that the loads move freely and on possible remedies; collective

    Raises
    ------
    ConvergenceError : no equilibrium; the text names the bodies that lose contact; on every rank
    ResourceError : more pairs open or slip than a dense solve allows; on every rank
    """
    linearised, system, comm = G.linearised, G.system, G.comm
    first, last = linearised.K_L.getOwnershipRange()
    R_owned = system.R[:, first:last]
    u_load = linearised.factor.solve(forces_owned[:, None])[:, 0]
    du_load = comm.bcast(summed(comm, R_owned @ u_load)).reshape(-1, 3)
    contact = Contact(comm, pairs, G)
    unloaded = np.zeros((pairs.n_pairs, 3 + pairs.law.n_memory))
    now, n_taken, bolts_at_rest = State(np.zeros(du_load.shape), unloaded), 0, None
    base, u_base = np.zeros(du_load.shape), 0.0
    if cuts is not None:
        delta = cuts.tightened(now.p)
        tightening = Loading(base, (cuts.RU @ delta).reshape(-1, 3), "the bolts' forces", release=cuts.release)
        now, n_taken = contact.follow(tightening, now, n_steps)
        delta = cuts.tightened(now.p)
        tightened = cuts.force(delta, now.p)
        base, u_base = (cuts.RU @ delta).reshape(-1, 3), cuts.U_owned @ delta
    if cuts is None or comm.allreduce(bool(forces_owned.any()), MPI.LOR):
        loading = Loading(base, du_load, "the load", free_bodies)
        now, n_more = contact.follow(loading, now, n_steps)
        n_taken += n_more
    if cuts is not None:
        at_rest = cuts.force(delta, now.p, of_loads(cuts, linearised, forces_owned))
        bolts = cuts.bolts
        bolts_at_rest = BoltsAtRest(tuple(bolt.label for bolt in bolts.given), bolts.area, delta, tightened, at_rest)
    u_owned = u_base + u_load - linearised.factor.solve((R_owned.T @ now.p.ravel())[:, None])[:, 0]
    force = now.p + pairs.law.stiffness * now.du
    force[:, 2] -= np.maximum(np.nan_to_num(pairs.N0), 0.0)
    return Rest(now.du, force, u_owned, contact.iterations, n_taken, bolts_at_rest, now.after[:, 3:])


def stuck_forces(G: Flexibility, pairs: ContactPairs, forces_owned: np.ndarray, cuts: Cuts | None) -> np.ndarray:
    """Return the normal forces of the pairs if all of them stuck, closed, under the bolts and all loads, (n_pairs,) [N].

    Collective; arguments as in :func:`equilibrium`.
    """
    linearised, comm = G.linearised, G.comm
    first, last = linearised.K_L.getOwnershipRange()
    du = comm.bcast(summed(comm, linearised.system.R[:, first:last] @ linearised.factor.solve(forces_owned[:, None])[:, 0]))
    if cuts is not None:
        du = du + cuts.RU @ cuts.tightened(np.zeros(len(du)))
    return -pairs.k_n * du.reshape(-1, 3)[:, 2]


@dataclass(frozen=True, eq=False)
class State:
    """The state of the joint after a load step."""

    du: np.ndarray  # (n_pairs, 3) m
    after: np.ndarray  # (n_pairs, 3 + n_memory) N, p and internal variables of the law

    @property
    def p(self) -> np.ndarray:
        """The forces p of the pairs, (n_pairs, 3) [N]."""
        return self.after[:, :3]


@dataclass(frozen=True, eq=False)
class Loading:
    """The motion of stuck pairs under loads: a constant part, and a part that increases in steps."""

    base: np.ndarray  # (n_pairs, 3) m
    rising: np.ndarray  # (n_pairs, 3) m
    name: str  # name of the increasing part, for messages
    free_bodies: Callable[[], str] = lambda: ""
    release: tuple[np.ndarray, np.ndarray] | None = None  # R K_L^-1 F and S^-1 of bolts with a given force

    @property
    def largest(self) -> float:
        """The largest motion of a pair [m]."""
        return float(max(np.abs(self.base).max(initial=0.0), np.abs(self.rising).max(initial=0.0)))


@dataclass(frozen=True, eq=False)
class _Problem:
    """An equilibrium problem: loads, contact law, and the previous state."""

    loading: Loading
    fraction: float  # fraction of the increasing part
    law: Law
    before: State

    @property
    def load(self) -> np.ndarray:
        """The motion of the stuck pairs under the loads, (n_pairs, 3) [m]."""
        return self.loading.base + self.fraction * self.loading.rising

    def at(self, du: np.ndarray) -> _Trial:
        """Return the pairs at a motion (n_pairs, 3) [m].  Local."""
        after, L, _ = self.law.step(du, self.before.after)
        return _Trial(State(du, after), L, after[:, :3].any(axis=1) | L.any(axis=(1, 2)))


@dataclass(frozen=True, eq=False)
class _Trial:
    """The pairs at a trial motion."""

    state: State
    L: np.ndarray  # (n_pairs, 3, 3) dp / d du [N/m]
    active: np.ndarray  # (n_pairs,) bool: p or L is not zero


class Contact:
    """Newton's method for du = base + fraction rising - G p, with p by the law from the previous state; rank 0 solves."""

    def __init__(self, comm: MPI.Comm, pairs: ContactPairs, G: Flexibility):
        self.comm, self.pairs, self.law, self.G = comm, pairs, pairs.law, G
        self.iterations = 0

    def follow(self, loading: Loading, now: State, n_steps: int) -> tuple[State, int]:
        """Return the state under the complete loading, applied in equal or shorter steps, and their number.  Collective."""
        fraction, step, n_taken = 0.0, 1.0 / n_steps, 0
        while fraction < 1.0 - 1e-9:
            next_fraction = min(fraction + step, 1.0)
            guess = now.du + (next_fraction - fraction) * loading.rising
            state = self._solve(loading, now, next_fraction, initial_guess(self.pairs.laws, self.pairs.columns, now.du, guess))
            if state is None and n_taken == 0 and step == 1.0 / n_steps and (self.pairs.N0 < 0.0).any():
                state = self._fallen(loading, now, next_fraction)
            if state is None:
                step *= 0.5
                if step < SHORTEST / n_steps:
                    raise ConvergenceError(self._why_not(loading, now, fraction, n_steps))
                continue
            now, fraction, n_taken, step = state, next_fraction, n_taken + 1, min(2.0 * step, 1.0 / n_steps)
        return now, n_taken

    def _fallen(self, loading: Loading, before: State, fraction: float) -> State | None:
        """Return the state of bodies that have moved through their gaps, None if there is none.  Collective.

        A body with only gaps moves freely until they close: no fraction of the load leads to this state.  Instead the gaps
        increase from zero under that fraction; then friction increases from zero.
        """
        opened, step, gaps = 0.0, 1.0, np.minimum(self.pairs.N0, 0.0)
        start = fraction * loading.rising
        now = self._solve(loading, before, fraction, start, replace(self.pairs, N0=self.pairs.N0 - gaps).law)
        while now is not None and opened < 1.0:
            target = min(opened + step, 1.0)
            start = now.du.copy()
            start[:, 2] += (target - opened) * np.divide(gaps, self.pairs.k_n, out=np.zeros_like(gaps), where=gaps < 0.0)
            state = self._solve(loading, now, fraction, start, replace(self.pairs, N0=self.pairs.N0 - (1.0 - target) * gaps).law)
            if state is None and step < SHORTEST:
                return None
            now, opened, step = (now, opened, 0.5 * step) if state is None else (state, target, 2.0 * step)
        if now is None:
            return None
        after, restarts = now.after.copy(), are_springs(self.pairs.laws)
        after[restarts, :2] = -(self.law.stiffness[:, :2] * now.du[:, :2])[restarts]
        return self._solve(loading, State(now.du, after), fraction, now.du)

    def _solve(self, loading: Loading, before: State, fraction: float, du: np.ndarray, law: Law | None = None) -> State | None:
        """Return the state at a fraction of the load, from ``du``; None if Newton's method does not converge.  Collective.

        With many gaps, full steps are tried first; if they fail, steps that must reduce the residual follow.
        """
        has_gaps, problem = bool((self.pairs.N0 < 0.0).any()), _Problem(loading, fraction, law or self.law, before)
        state = self._newton_from(problem, du, 0) if has_gaps else None
        return state or self._newton_from(problem, du, HALVINGS)

    def _newton_from(self, problem: _Problem, du: np.ndarray, halvings: int) -> State | None:
        """Return Newton's state from ``du`` with at most ``halvings`` halvings of a step; None if it fails.  Collective."""
        largest = max(problem.loading.largest, float(np.abs(du).max(initial=0.0)))
        for _ in range(MOST_ITERATIONS):
            trial = problem.at(du)
            if 3 * np.count_nonzero(trial.active) > LARGEST:
                raise ResourceError(
                    f"[statics]: {counted(np.count_nonzero(trial.active), 'contact pair')} open or slip at rest; up to "
                    f"{LARGEST // 3} are possible; use a coarser mesh of the contact surfaces or a stiffer contact"
                )
            self.G.require(trial.active)
            size = max(largest, float(np.abs(du).max(initial=0.0)))
            improved, error = self._iterate(problem, trial, halvings)
            self.iterations += 1
            if size > FARTHEST * largest:
                return None
            if error <= TOLERANCE * size:
                return trial.state
            if improved is None:
                return None
            du = improved
        return None

    def _iterate(self, problem: _Problem, trial: _Trial, halvings: int) -> tuple[np.ndarray | None, float]:
        """Return du after a Newton step, None if the step fails, and the residual before it [m].  Collective."""
        residual = self._residual(problem, trial.state.du, trial.state.p, trial.active)
        error = float(np.abs(residual).max(initial=0.0))
        step = self._newton(problem.loading, residual, trial)
        if step is None:
            return None, error
        best, best_error = trial.state.du + step, np.inf
        for k in range(halvings + 1):
            du = trial.state.du + 0.5**k * step
            p = problem.law.step(du, problem.before.after)[0][:, :3]
            moving = p.any(axis=1)
            if not (moving & ~self.G.known).any():
                du_error = float(np.abs(self._residual(problem, du, p, moving)).max(initial=0.0))
                if du_error < best_error:
                    best, best_error = du, du_error
                if du_error < error:
                    break
            elif k == 0:
                return du, error  # pairs that have not been evaluated yet
        return best, error

    def _flexibility(self, loading: Loading, p: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Return the motion by forces p (n_pairs, 3) of ``active`` pairs, with compliant bolts, (n_pairs, 3) [m].  Collective."""
        pairs = np.flatnonzero(active)
        du = self.G.apply(pairs, p[active])
        if loading.release is not None:
            RU, compliance = loading.release
            du = du + (RU @ (compliance @ (RU[rows_of(pairs)].T @ p[active].ravel()))).reshape(du.shape)
        return du

    def _residual(self, problem: _Problem, du: np.ndarray, p: np.ndarray, active: np.ndarray) -> np.ndarray:
        return du - problem.load + self._flexibility(problem.loading, p, active)

    def _newton(self, loading: Loading, residual: np.ndarray, trial: _Trial) -> np.ndarray | None:
        """Return the Newton step, (n_pairs, 3) [m]; None if the system is singular.  Collective."""
        active = np.flatnonzero(trial.active)
        if len(active) == 0:
            return -residual
        L = trial.L[active]
        J = self.G.newton_matrix(active, L, loading.release)
        d_du = on_root(self.comm, _solved, J, -residual[active].ravel())
        if d_du is None:
            return None
        dp = np.zeros_like(residual)
        dp[active] = np.einsum("mij,mj->mi", L, d_du.reshape(-1, 3))
        step = -residual - self._flexibility(loading, dp, trial.active)
        return step if np.isfinite(step).all() else None

    def _why_not(self, loading: Loading, now: State, fraction: float, n_steps: int) -> str:
        """Return a text on the largest load with equilibrium: open pairs there, bodies that move beyond it, and remedies.

        Collective.
        """
        free = loading.free_bodies() or (
            "no body moves away as a whole; contact is lost by bending, rocking or sliding: state more friction or preload, a "
            f"support, or more [statics] steps than {n_steps}, which resolve the path of the loads more finely"
        )
        du, pairs = now.du + SHORTEST * loading.rising, self.pairs
        is_open = pairs.N0 - pairs.k_n * du[:, 2] <= 0.0
        joints = [
            f"{np.count_nonzero(is_open[of_joint])} of {counted(len(of_joint), 'pair')} of {name!r}"
            for name, of_joint in pairs.by_joint().items()
        ]
        reached = "the very beginning" if fraction < 5e-4 else f"{fraction:.1%}"
        return f"[statics]: no equilibrium beyond {reached} of {loading.name}, where {', '.join(joints)} are open: {free}"


def _solved(J: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Return x with J x = right, None if J is singular; J is overwritten.  Local."""
    factors, order, info = lapack.dgetrf(J.T, overwrite_a=True)  # the transpose has the order of LAPACK: no copy
    return lapack.dgetrs(factors, order, right, trans=1)[0] if info == 0 else None
