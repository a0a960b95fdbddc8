"""Steady state of M u'' + C u' + K u + R^T f_nl(R u) = f_ex(t) by direct time integration.

Every scheme is written as one linear step of its state z (u comes first in z) with the contact force f at both ends:
    z_free = Phi z + Psi f + b,    z+ = z_free - Gam f+,    du+ = D z+,    f+ = f_nl(du+, T)
so that only the 3 n_pairs relative displacements are iterated: du+ + D Gam f+ = D z_free.  Schemes:
    generalised-alpha   Chung and Hulbert's, rho_inf sets the damping of the highest frequencies; 1 conserves energy
    exponential         exact for the linear part; the contact force is linear within a step
    explicit            leapfrog: Gam has no part in u, nothing is iterated, so it is the fastest where small steps are
                        needed anyway; stable up to h omega_max = 2
The contact law is that of docs/theory.md, f_nl = (T_x, T_y, max(N0, 0) - N); it starts from T = 0.  Within a step,
    path      solves it exactly for du that moves along a straight line: the default, second order in the step
    return    returns radially to the friction circle of the step's end, as the sampled law of harmonic balance does:
              first order where the direction of slip turns, or where a pair closes
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, atan2, cos, exp, hypot, log, sin, sqrt, tan

import numpy as np
from scipy.linalg import expm

from .scenes import (
    cycle_work,
    damping_matrix,
    force_coefficients,
    harmonic_basis,
    harmonic_coefficients,
    joint_stiffness,
    stuck_frequencies,
)


@dataclass(frozen=True)
class Scheme:
    """Matrices of one linear step; the load enters as ``B0 f_ex(t_k + shift h)`` and ``B1 f_ex(t_k+1 ...)``."""

    Phi: np.ndarray  # (n_z, n_z)
    Psi: np.ndarray  # (n_z, 3 n_pairs)
    Gam: np.ndarray  # (n_z, 3 n_pairs)
    B0: np.ndarray  # (n_z, n) load at the start of the step
    B1: np.ndarray  # (n_z, n) load at its end


@dataclass(frozen=True)
class SteadyState:
    """The last period of a march; samples at t = k T / n_steps, k = 0 ... n_steps - 1."""

    omega: float
    level: float
    u: np.ndarray  # (n_steps, n) m
    du: np.ndarray  # (n_steps, n_pairs, 3) m
    f_nl: np.ndarray  # (n_steps, n_pairs, 3) N
    u_hat: np.ndarray  # (n, 2 H + 1) harmonics of u
    du_hat: np.ndarray  # (n_pairs, 3, 2 H + 1)
    state: np.ndarray  # (n_pairs,) 0 stuck, 1 slips, 2 open at some sample of the period
    input: float  # J per cycle
    viscous: float  # J per cycle
    friction: np.ndarray  # (n_pairs,) J per cycle
    change: float  # largest change of u between the last two periods over the largest |u|
    cycles: int
    restart: tuple  # u, v, T at the end of the period, for ``start``


def generalised_alpha(system, h, rho_inf=0.9):
    """Return the scheme with z = (u, v, a): second order, unconditionally stable."""
    M, K, C, R = system["M"], system["K"], damping_matrix(system), system["R"]
    n, one, zero = len(M), np.eye(len(M)), np.zeros_like(M)
    alpha_m, alpha_f = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0), rho_inf / (rho_inf + 1.0)
    gamma, beta = 0.5 - alpha_m + alpha_f, 0.25 * (1.0 - alpha_m + alpha_f) ** 2
    u_pred = np.hstack([one, h * one, h * h * (0.5 - beta) * one])
    v_pred = np.hstack([zero, one, h * (1.0 - gamma) * one])
    u_now, v_now, a_now = np.eye(3 * n).reshape(3, n, 3 * n)
    A = (1.0 - alpha_m) * M + (1.0 - alpha_f) * (gamma * h * C + beta * h * h * K)
    weigh = np.vstack([beta * h * h * one, gamma * h * one, one]) @ np.linalg.inv(A)  # new z per unit force
    history = (
        alpha_m * M @ a_now + C @ ((1.0 - alpha_f) * v_pred + alpha_f * v_now) + K @ ((1.0 - alpha_f) * u_pred + alpha_f * u_now)
    )
    Phi = np.vstack([u_pred, v_pred, np.zeros((n, 3 * n))]) - weigh @ history
    return Scheme(Phi, -alpha_f * weigh @ R.T, (1.0 - alpha_f) * weigh @ R.T, alpha_f * weigh, (1.0 - alpha_f) * weigh)


def exponential(system, h):
    """Return the scheme with z = (u, v) that is exact for forces linear in a step."""
    M, K, C, R = system["M"], system["K"], damping_matrix(system), system["R"]
    n, M_inv = len(M), np.linalg.inv(M)
    big = np.zeros((4 * n, 4 * n))  # (u, v, force, slope of the force)
    big[:n, n : 2 * n] = np.eye(n)
    big[n : 2 * n, :n], big[n : 2 * n, n : 2 * n], big[n : 2 * n, 2 * n : 3 * n] = -M_inv @ K, -M_inv @ C, M_inv
    big[2 * n : 3 * n, 3 * n :] = np.eye(n)
    E = expm(h * big)[: 2 * n]
    B1 = E[:, 3 * n :] / h
    B0 = E[:, 2 * n : 3 * n] - B1
    return Scheme(E[:, : 2 * n], -B0 @ R.T, B1 @ R.T, B0, B1)


def explicit(system, h):
    """Return the leapfrog scheme with z = (u, v half a step earlier)."""
    M, K, C, R = system["M"], system["K"], damping_matrix(system), system["R"]
    n, one = len(M), np.eye(len(M))
    fastest = stuck_frequencies(system).max()
    if h * fastest >= 2.0:
        raise ValueError(
            f"{system['name']}: leapfrog is unstable, h omega_max = {h * fastest:.3g} of 2; take more steps or a smaller coarse"
        )
    kick = h * np.linalg.inv(M + 0.5 * h * C)
    v_rows = np.hstack([-kick @ K, kick @ (M / h - 0.5 * C)])
    Phi = np.vstack([np.hstack([one, np.zeros_like(M)]) + h * v_rows, v_rows])
    B0 = np.vstack([h * kick, kick])
    return Scheme(Phi, -B0 @ R.T, np.zeros((2 * n, len(R))), B0, np.zeros((2 * n, n)))


SCHEMES = {"generalised-alpha": generalised_alpha, "exponential": exponential, "explicit": explicit}


class Contacts:
    """The pairs of a system in plain floats, and the step equation du + G f(du) = du_free."""

    def __init__(self, system, G, law="return"):
        self.G, self.K_J = G, joint_stiffness(system)
        self.follows_path = {"return": False, "path": True}[law]
        self.pairs = list(zip(*(system[key].tolist() for key in ("mu", "N0", "k_t", "k_n", "separate")), strict=True))
        self.one = np.eye(len(G))
        self.stick_inverse = np.linalg.inv(self.one + G * self.K_J)
        self.f_rest = np.zeros(len(G))  # closed: f_z = max(N0, 0) - N0 + k_n du_z
        self.f_rest[2::3] = np.maximum(-system["N0"], 0.0)
        self.tangential = np.tile([1.0, 1.0, 0.0], len(self.pairs))

    def law(self, f_stick):
        """Return f (3 n_pairs,), the rows of its tangent (three of three for each pair) and each pair's state.

        ``f_stick`` (list) are the forces of the springs if every pair stuck: predictor of T, unlimited normal force.
        """
        f, rows, state = [], [], []
        for i, (mu, N0, k_t, k_n, separate) in enumerate(self.pairs):
            closing = max(N0, 0.0) - f_stick[3 * i + 2]  # N0 - k_n du_z
            N, dN = (closing, -k_n) if closing > 0.0 else (0.0, 0.0)
            limit = _limit_separate if separate else _limit_circle
            (Tx, Ty), rows_t, slips = limit(f_stick[3 * i], f_stick[3 * i + 1], mu, N, dN, k_t)
            f += [Tx, Ty, max(N0, 0.0) - N]
            rows.append((*rows_t, (0.0, 0.0, -dN)))
            state.append(2 if closing <= 0.0 else int(slips))
        return np.array(f), rows, state

    def along_path(self, f, f_stick, f_before, state):
        """Return ``f`` with the T that the exact law has after a straight step, for the pairs that slip or open."""
        f = f.tolist()
        for i, (mu, N0, _, _, separate) in enumerate(self.pairs):
            j, rest = 3 * i, max(N0, 0.0)
            if state[i]:
                (Tx, Ty), ex, ey = f_before[j : j + 2], f_stick[j] - f_before[j], f_stick[j + 1] - f_before[j + 1]
                normal = (self.closing_before[i], rest - f_stick[j + 2], mu)
                if separate:
                    f[j], f[j + 1] = (straight_step((T, 0.0), (e, 0.0), *normal)[0] for T, e in ((Tx, ex), (Ty, ey)))
                else:
                    f[j : j + 2] = straight_step((Tx, Ty), (ex, ey), *normal)
        return np.array(f)

    def tangent(self, rows):
        """Return d f / d du, (3 n_pairs, 3 n_pairs) [N/m]; pairs are not coupled."""
        J = np.zeros_like(self.one)
        for i, block in enumerate(rows):
            J[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
        return J

    def step(self, du_free, du, f, max_iterations=50):
        """Return du, f and states at the end of a step from ``du`` and ``f``; Newton from the stuck solution."""
        self.closing_before = [
            max(N0, 0.0) - fz for (_, N0, *_), fz in zip(self.pairs, (self.f_rest + self.K_J * du)[2::3].tolist(), strict=True)
        ]
        f_before = f.tolist()
        base = self.f_rest + self.tangential * (f - self.K_J * du)  # f_stick = base + K_J du+
        new = self.stick_inverse @ (du_free - self.G @ base)
        f_new, rows, state = self.law((base + self.K_J * new).tolist())
        if not any(state):
            return new, f_new, state
        bound = 1e-13 * (max(map(abs, new.tolist())) + max(map(abs, du_free.tolist())))
        for _ in range(max_iterations):
            if self.follows_path:  # its tangent differs from that of the radial return by the rotation within a step
                f_new = self.along_path(f_new, (base + self.K_J * new).tolist(), f_before, state)
            gap = du_free - new - self.G @ f_new
            if max(map(abs, gap.tolist())) <= bound:
                return new, f_new, state
            new = new + np.linalg.solve(self.one + self.G @ self.tangent(rows), gap)
            f_new, rows, state = self.law((base + self.K_J * new).tolist())
        raise RuntimeError(
            f"contact step: no convergence, residual {np.abs(gap).max():.2e} m (bound {bound:.1e}); take smaller steps"
        )


def straight_step(T, e, closing, closing_new, mu):
    """Return the friction force (2,) after a step in which du_t and du_z move along a straight line.

    ``e`` = k_t d(du_t); the force moves by it while it sticks.  ``closing`` = N0 - k_n du_z at both ends, negative
    where open.  Once the growing |T| - mu N reaches zero the pair slips for the rest of the step, |T| = mu N, and the
    angle psi from e to T obeys d(psi) = -sin(psi) |de| / (mu N), so that tan(psi / 2) decays exponentially.
    """
    (Tx, Ty), (ex, ey) = T, e
    if closing_new <= 0.0:
        return [0.0, 0.0]
    if closing < 0.0:  # closes in the step
        share = closing_new / (closing_new - closing)
        Tx, Ty, ex, ey, closing = 0.0, 0.0, share * ex, share * ey, 0.0
    growth = mu * (closing_new - closing)
    if hypot(Tx + ex, Ty + ey) <= mu * closing_new:
        return [Tx + ex, Ty + ey]
    # |T + xi e|^2 = (mu N(xi))^2 where it begins to slip
    a, b = ex * ex + ey * ey - growth * growth, Tx * ex + Ty * ey - mu * closing * growth
    c = min(0.0, Tx * Tx + Ty * Ty - (mu * closing) ** 2)
    root = sqrt(max(0.0, b * b - a * c))
    xi = -c / (b + root) if b > 0.0 else (root - b) / a if a != 0.0 else 0.0
    xi = min(1.0, max(0.0, xi))
    Tx, Ty, limit = Tx + xi * ex, Ty + xi * ey, mu * closing + xi * growth
    size, end = hypot(ex, ey), mu * closing_new
    if size == 0.0:
        return [end * Tx / limit, end * Ty / limit]
    ex, ey, length = ex / size, ey / size, (1.0 - xi) * size
    if limit <= 1e-14 * end:
        return [end * ex, end * ey]
    mean = (end - limit) / log(end / limit) if abs(end - limit) > 1e-6 * end else 0.5 * (end + limit)
    half = atan2(Ty * ex - Tx * ey, limit + Tx * ex + Ty * ey)  # psi / 2
    psi = 2.0 * atan(tan(half) * exp(-length / mean))
    return [end * (ex * cos(psi) - ey * sin(psi)), end * (ey * cos(psi) + ex * sin(psi))]


def _limit_circle(Tx, Ty, mu, N, dN, k_t):
    """Return T, d(T)/d(du_x, du_y, du_z) and whether the friction circle is left."""
    size, limit = sqrt(Tx * Tx + Ty * Ty), mu * N
    if size <= limit:
        return (Tx, Ty), ((k_t, 0.0, 0.0), (0.0, k_t, 0.0)), False
    x, y = Tx / size, Ty / size
    turn, grow = limit * k_t / size, mu * dN
    rows = ((turn * y * y, -turn * x * y, grow * x), (-turn * x * y, turn * x * x, grow * y))
    return (limit * x, limit * y), rows, True


def _limit_separate(Tx, Ty, mu, N, dN, k_t):
    """Return the same with an independent limit in each direction."""
    limit, T, rows, slips = mu * N, [], [], False
    for direction, predictor in enumerate((Tx, Ty)):
        row = [0.0, 0.0, 0.0]
        if abs(predictor) <= limit:
            T.append(predictor)
            row[direction] = k_t
        else:
            sign = 1.0 if predictor > 0.0 else -1.0
            T.append(sign * limit)
            row[2], slips = sign * mu * dN, True
        rows.append(row)
    return T, rows, slips


class March:
    """One period after another with a fixed number of steps."""

    def __init__(self, system, omega, level, n_steps, scheme, law="path", **options):
        self.system, self.omega, self.n_steps = system, omega, n_steps
        self.h = 2.0 * np.pi / omega / n_steps
        self.scheme = SCHEMES[scheme](system, self.h, **options)
        self.explicit = scheme == "explicit"
        n = len(system["M"])
        D = np.hstack([system["R"], np.zeros((len(system["R"]), len(self.scheme.Phi) - n))])
        self.contacts, self.D, self.n = Contacts(system, D @ self.scheme.Gam, law), D, n
        H = max(load["harmonic"] for load in system["loads"])
        self.f_ex = force_coefficients(system, level, H) @ harmonic_basis(H, n_steps)  # (n, n_steps)
        self.b = (self.scheme.B0 @ self.f_ex + self.scheme.B1 @ np.roll(self.f_ex, -1, axis=1)).T.copy()

    def begin(self, u, v, T):
        """Return state z, du and f for displacement, velocity and friction forces (n_pairs, 2) at t = 0."""
        system, s = self.system, self.contacts
        du = system["R"] @ u
        f_stick = s.f_rest + s.K_J * du
        f_stick.reshape(-1, 3)[:, :2] = T
        f, _, _ = s.law(f_stick.tolist())
        a = self._acceleration(u, v, f)
        if self.explicit:
            return np.concatenate([u, v - 0.5 * self.h * a]), du, f
        return np.concatenate([u, v, a])[: len(self.scheme.Phi)], du, f

    def velocity(self, z, du, f):
        """Return the velocity at the sample of ``z`` (leapfrog stores it half a step earlier)."""
        v = z[self.n : 2 * self.n]
        if not self.explicit:
            return v
        return v + 0.5 * self.h * self._acceleration(z[: self.n], v, f)

    def _acceleration(self, u, v, f):
        """Return u'' at the start of a period."""
        s = self.system
        return np.linalg.solve(s["M"], self.f_ex[:, 0] - damping_matrix(s) @ v - s["K"] @ u - s["R"].T @ f)

    def period(self, z, du, f, ramp=None):
        """Return z, du, f after one period and the records u, du, f, state at the end of every step.

        ``ramp``: factor of the load for every step, (n_steps,), or None.
        """
        s, D, contacts = self.scheme, self.D, self.contacts
        us, dus, fs, states = [], [], [], []
        for k in range(self.n_steps):
            b = self.b[k] if ramp is None else ramp[k] * self.b[k]
            z_free = s.Phi @ z + s.Psi @ f + b
            du, f, state = contacts.step(D @ z_free, du, f)
            z = z_free - s.Gam @ f
            us.append(z[: self.n])
            dus.append(du)
            fs.append(f)
            states.append(state)
        return z, du, f, [np.array(record) for record in (us, dus, fs, states)]


def steady_state(
    system,
    omega,
    level,
    *,
    n_steps=1024,
    harmonics=15,
    scheme="generalised-alpha",
    tolerance=1e-6,
    max_cycles=1000,
    ramp_cycles=5,
    start=None,
    coarse=4,
    **options,
):
    """March until one period repeats the previous one, and return its ``SteadyState``.

    Parameters
    ----------
    system : dictionary of scenes.py
    omega, level : excitation frequency [rad/s], factor of the loads
    n_steps, harmonics : steps per period; harmonics of the returned coefficients
    tolerance : largest change of u from period to period over the largest |u|; the remaining distance from the
        steady state is about this over the decay per period (2 pi zeta for a resonance)
    ramp_cycles : the load grows linearly over so many periods, so that the start causes no slip
    start : u (n,), v (n,), T (n_pairs, 2) at t = 0 instead of rest; no ramp then
    coarse : the transient is marched with n_steps / coarse steps first
    options : law, "path" or "return"; rho_inf for generalised-alpha

    Raises
    ------
    RuntimeError : not periodic within ``max_cycles``
    """
    n, n_pairs = len(system["M"]), len(system["mu"])
    u, v, T = start if start is not None else (np.zeros(n), np.zeros(n), np.zeros((n_pairs, 2)))
    ramp_cycles = 0 if start is not None else ramp_cycles
    cycles = 0
    for steps in ([n_steps // coarse] if coarse > 1 else []) + [n_steps]:
        march = March(system, omega, level, steps, scheme, **options)
        z, du, f = march.begin(np.asarray(u), np.asarray(v), T)
        before, change = None, np.inf
        last_cycle = max_cycles if steps == n_steps else max_cycles // 4  # coarse steps need not converge
        while change > tolerance and cycles < last_cycle:
            ramp = None
            if cycles < ramp_cycles:
                ramp = (cycles + (np.arange(steps) + 1.0) / steps) / ramp_cycles
            z, du, f, records = march.period(z, du, f, ramp)
            cycles += 1
            if before is not None and cycles > ramp_cycles:
                change = np.abs(records[0] - before).max() / max(np.abs(records[0]).max(), 1e-300)
            before = records[0]
        u, v, T = z[:n], march.velocity(z, du, f), f.reshape(-1, 3)[:, :2].copy()
    if not change <= tolerance:
        raise RuntimeError(
            f"{system['name']}: not periodic at omega = {omega:.6g}, level {level:.4g} after {cycles} "
            f"cycles of {n_steps} steps, change {change:.2e} (tolerance {tolerance:.1e})"
        )
    return _summary(system, omega, level, records, march.f_ex, harmonics, change, cycles, (u, v, T))


def _summary(system, omega, level, records, f_ex, harmonics, change, cycles, restart):
    """Return the ``SteadyState`` of one period of records taken at the end of every step."""
    u, du, f, states = (np.roll(record, 1, axis=0) for record in records)  # first sample at t = 0
    n_pairs = len(system["mu"])
    H_energy = (len(u) - 1) // 2
    u_all = harmonic_coefficients(u.T, H_energy)
    n = np.arange(1, H_energy + 1)
    C = damping_matrix(system)
    squares = np.einsum("ik,ij,jk->k", u_all[:, 1:], C, u_all[:, 1:]).reshape(-1, 2).sum(axis=1)
    # friction: trapezoidal work of T over the increments of du
    T, d_du = 0.5 * (f + np.roll(f, -1, axis=0)), np.roll(du, -1, axis=0) - du
    work = (T * d_du).reshape(len(u), n_pairs, 3)[:, :, :2].sum(axis=(0, 2))
    du = du.reshape(len(u), n_pairs, 3)
    return SteadyState(
        omega=omega,
        level=level,
        u=u,
        du=du,
        f_nl=f.reshape(len(u), n_pairs, 3),
        u_hat=harmonic_coefficients(u.T, harmonics),
        du_hat=harmonic_coefficients(np.moveaxis(du, 0, -1), harmonics),
        state=states.max(axis=0),
        input=float(cycle_work(harmonic_coefficients(f_ex, H_energy), u_all).sum()),
        viscous=float(np.pi * omega * np.sum(n**2 * squares)),
        friction=work,
        change=float(change),
        cycles=cycles,
        restart=restart,
    )
