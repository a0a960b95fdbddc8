"""The steady state: a motion that repeats after a period of time steps (docs/theory.md, section 10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.coefficients import analyse, synthesise
from ..fourier.harmonics import Harmonics
from .march import Cycle, March
from .scheme import Motion
from .transient_model import TransientModel

DEPTH = 8  # differences in the history of the acceleration
_LARGEST = (2.0, 20.0)  # bounds of |step| / |F| of motion and contact forces: an excursion would cause additional slip
_CUT = 1e-7  # of the largest singular value: linearly dependent differences
_SETTLING = 20  # periods of the law under a given motion
RAMP = 20  # periods over which the load rises from rest


@dataclass(frozen=True, eq=False)
class Start:
    """Initial state of a march, at t = 0: B motions, contact forces p = f_nl - K_J du and internal variables of the law.

    ``p`` is (B, n_pairs (3 + n_memory)) [N].
    """

    z: Motion
    p: np.ndarray

    def take(self, points: np.ndarray | slice | list[int]) -> Start:
        """Return the start at some points."""
        return Start(self.z.take(points), self.p[points])


@dataclass(frozen=True, eq=False)
class SteadyState:
    """The period of each of B points that is closest to a steady state, and its distance."""

    start: Start  # of this period
    cycle: Cycle
    periods: np.ndarray  # (B,) periods marched up to this one
    change: np.ndarray  # (B,) of motion and contact forces in a period, relative to their size
    distance: np.ndarray  # (B,) from the steady state, relative to the motion: the change, amplified by (1 - Phi^N)^-1


def from_rest(model: TransientModel, n_points: int) -> Start:
    """Return the state of rest without traction.  Local."""
    zero = np.zeros((n_points, len(model.modes.omega_n)))
    return Start(Motion(zero, zero, zero), np.zeros((n_points, model.n_pairs * (3 + model.law.n_memory))))


def from_harmonics(model: TransientModel, omega: np.ndarray, eta: np.ndarray, U: np.ndarray, n_steps: int) -> Start:
    """Return the state at t = 0 of periodic motions, eta (B, m, N_H) and U (B, n_pairs, 3, N_H).  Local.

    Slider positions follow from the march of section 3 under this motion: from w = w0 at the first sample, until a period repeats
    or for ``_SETTLING`` periods.
    """
    n = np.arange(1, eta.shape[-1] // 2 + 1)
    w = omega[:, None]
    z = Motion(eta[..., 0] + eta[..., 1::2].sum(axis=-1), w * (eta[..., 2::2] @ n), -(w**2) * (eta[..., 1::2] @ n**2))
    du = np.moveaxis(synthesise(U, n_steps), -1, 0)
    p, before = np.zeros((*du.shape[1:-1], 3 + model.law.n_memory)), None
    for k in range(_SETTLING * n_steps + 1):
        p, _, _ = model.law.step(du[k % n_steps], p)
        if k % n_steps == 0:
            if before is not None and np.abs(p - before).max(initial=0.0) <= 1e-10 * np.abs(p).max(initial=0.0):
                break
            before = p
    return Start(z, p.reshape(len(p), -1))


class Acceleration:
    """Anderson acceleration of x <- x + F(x) for one point, where x has the motion and the contact forces.

    D. G. Anderson: Iterative procedures for nonlinear integral equations, Journal of the ACM 12 (1965) 547.
    """

    def __init__(self, n_motion: int):
        self.parts = (slice(0, n_motion), slice(n_motion, None))
        self.dx: list[np.ndarray] = []
        self.dF: list[np.ndarray] = []
        self.last: tuple[np.ndarray, np.ndarray] | None = None

    def next(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Return the next x; components with F = 0, sliders of sticking pairs, do not change.  Local."""
        if self.last is not None:
            self.dx.append(x - self.last[0])
            self.dF.append(F - self.last[1])
            del self.dx[:-DEPTH], self.dF[:-DEPTH]
        self.last = x, F
        step = F.copy()
        if self.dF:
            dF, dx = np.array(self.dF).T, np.array(self.dx).T
            size = np.linalg.norm(dF, axis=0)
            size[size == 0.0] = 1.0
            step -= (dx + dF) @ (np.linalg.lstsq(dF / size, F, rcond=_CUT)[0] / size)
        for part, largest in zip(self.parts, _LARGEST):
            longest, length = largest * np.linalg.norm(F[part]), np.linalg.norm(step[part])
            step[part] *= longest / length if length > longest else 1.0
        return x + np.where(F != 0.0, step, 0.0)


def steady_state(march: March, start: Start, tolerance: float, most_periods: int, accelerated: bool = True) -> SteadyState:
    """Return for every point the steady period, or the period closest to it.  Local.

    Without ``accelerated`` the points are marched to their steady state, from rest under a load that grows over ``RAMP`` periods.
    Otherwise motion and contact forces at the start of a period are corrected after each period: the motion by the correction
    for the stuck structure, (1 - Phi^N)^-1 (x_N - x_0), the contact forces by the law; this fixed-point iteration has Anderson
    acceleration.  Ends at ``distance`` <= ``tolerance`` and a change of p of at most 10 ``tolerance`` in a period.

    Raises
    ------
    ConvergenceError : Newton's method does not converge in a step
    """
    B = len(march.level)
    accelerations = [Acceleration(3 * len(march.model.modes.omega_n)) for _ in range(B)] if accelerated else None
    springs = march.model.law.springs.ravel()
    steady: list[tuple] = [()] * B
    best = np.full(B, np.inf)
    left, now = np.arange(B), start
    for period in range(1, most_periods + 1):
        part = march.take(left)
        ramp = None
        if accelerations is None and period <= RAMP:
            ramp = (period - 1 + np.arange(1, march.n_steps + 1) / march.n_steps) / RAMP
        z, p, cycle = part.period(now.z, now.p, ramp)
        before, after = part.scheme.pack(now.z), part.scheme.pack(z)
        correction = part.scheme.solve_period(after - before, march.n_steps)
        size = np.maximum(_norm(after), 1e-300)
        distance = _norm(correction) / size
        du = np.abs(cycle.eta @ march.model.modes.R_phi.T).max(axis=0, initial=0.0)
        force = np.maximum((springs * du).max(axis=1, initial=0.0), 1e-300)
        moved = np.abs(p - now.p).max(axis=1, initial=0.0) / force
        change = np.maximum(_norm(after - before) / size, moved)
        merit = np.maximum(distance, 0.1 * moved)
        if ramp is None:
            for i in np.flatnonzero(~(merit >= best[left])):
                best[left[i]] = merit[i]
                steady[left[i]] = (now.take([i]), _single(cycle, i), period, change[i], distance[i])
        before_p = now.p
        done = (merit <= tolerance) & (ramp is None)
        if done.all():
            break
        now = Start(z, p)
        if accelerations is not None:
            now = _accelerated([accelerations[point] for point in left], part, before, correction, before_p, p)
        now = now.take(~done)
        left = left[~done]
    return _together(steady)


def _accelerated(
    accelerations: list[Acceleration],
    march: March,
    motion: np.ndarray,
    correction: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> Start:
    """Return the start of the next period of every point; motion and forces are accelerated in units of root energy.  Local."""
    n, shape, root = motion[0].size, motion[0].shape, march.model.memory_scale
    x = [
        acceleration.next(np.append(x0, p0 / root), np.append(c, (p1 - p0) / root))
        for acceleration, x0, c, p0, p1 in zip(accelerations, motion, correction, before, after)
    ]
    return Start(
        march.scheme.unpack(np.array([each[:n].reshape(shape) for each in x])), np.array([each[n:] * root for each in x])
    )


def _norm(x: np.ndarray) -> np.ndarray:
    return np.sqrt((x**2).sum(axis=(1, 2)))


def _single(cycle: Cycle, i: int) -> Cycle:
    column = slice(i, i + 1)
    return Cycle(cycle.eta[:, column].copy(), cycle.v[:, column].copy(), cycle.p[:, column].copy(), cycle.state[column])


def _together(steady: list[tuple]) -> SteadyState:
    starts, cycles, periods, change, distance = zip(*steady)
    motion = Motion(*(np.concatenate([getattr(start.z, name) for start in starts]) for name in ("eta", "v", "a")))
    cycle = Cycle(
        *(
            np.concatenate([getattr(cycle, name) for cycle in cycles], axis=axis)
            for name, axis in (("eta", 1), ("v", 1), ("p", 1), ("state", 0))
        )
    )
    return SteadyState(
        Start(motion, np.concatenate([start.p for start in starts])),
        cycle,
        np.array(periods),
        np.array(change),
        np.array(distance),
    )


def samples(
    model: TransientModel, omega: np.ndarray, level: np.ndarray, cycle: Cycle
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return du (n_steps, B, 3 n_pairs), the outputs (.., n_outputs) and f^T u (.., n_loads) at the ends of the steps.  Local."""
    f = level[:, None] * model.loads(len(cycle.eta))[:, None, :]  # (n_steps, B, n_loads)
    du = cycle.eta @ model.modes.R_phi.T + f @ model.s.T - cycle.p @ model.G.T
    output = cycle.eta @ model.modes.o.T + f @ model.out_f.T - cycle.p @ model.out_p.T
    along = cycle.eta @ model.modes.b + f @ model.load_f.T - cycle.p @ model.s
    q, rigid = model.rigid_coordinates(omega, level, len(cycle.eta)), model.rigid
    if q is not None and rigid is not None:
        output, along = output + q @ rigid.o.T, along + q @ rigid.b
    return du, output, along


def coefficients(values: np.ndarray, H: int) -> np.ndarray:
    """Return the Fourier coefficients (B, k, 2 H + 1) of samples (n_steps, B, k) at the ends of the steps.  Local."""
    return analyse(np.moveaxis(np.roll(values, 1, axis=0), 0, -1), Harmonics.up_to(H))


def energies(
    model: TransientModel, omega: np.ndarray, level: np.ndarray, cycle: Cycle
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return input, viscous and friction loss per period, (B,) [J], by the trapezoidal rule.  Local."""
    du, _, along = samples(model, omega, level, cycle)
    f = level[:, None] * model.loads(len(cycle.eta))[:, None, :]
    damping = (cycle.v * model.modes.damping.apply_to_rows(cycle.v)).sum(axis=(0, 2)) * 2.0 * np.pi / omega / len(cycle.eta)
    return _work(f, along), damping + model.rigid_loss(omega, level), _work(cycle.p, du)


def _work(force: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return the closed integral of force d(motion), (B,), of samples (n_steps, B, k)."""
    return (0.5 * (force + np.roll(force, 1, axis=0)) * (motion - np.roll(motion, 1, axis=0))).sum(axis=(0, 2))
