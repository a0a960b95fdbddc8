"""Harmonic balance of a small system in full physical coordinates: dense, plain, the sampled law of docs/theory.md.

Unknowns are the harmonics of every DOF, (n, 2 H + 1).  The contact law is marched sample by sample from T = k_t du_t at the
first sample until it repeats.  Its derivative is taken by complex steps through the same march (a perturbation
of 1e-30 i does not change any branch), so no tangent is coded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scenes import (
    cycle_work,
    damping_matrix,
    force_coefficients,
    harmonic_basis,
    harmonic_coefficients,
    joint_stiffness,
    stuck_stiffness,
)

PERIODS = 40  # largest number of periods of the march


@dataclass(frozen=True)
class Balance:
    """A converged point."""

    omega: float
    level: float
    u_hat: np.ndarray  # (n, 2 H + 1) m
    du_hat: np.ndarray  # (n_pairs, 3, 2 H + 1) m
    f_hat: np.ndarray  # (n_pairs, 3, 2 H + 1) N, harmonics of f_nl
    p_hat: np.ndarray  # (n_pairs, 3, 2 H + 1) N, f_nl - K_J du
    state: np.ndarray  # (n_pairs,) 0 stuck, 1 slips, 2 open at some sample of the recorded period
    T: np.ndarray  # (n_pairs, 2) N, friction forces at the first sample of the recorded period
    input: float  # J per cycle
    viscous: float  # J per cycle
    friction: np.ndarray  # (n_pairs,) J per cycle, of the retained harmonics
    residual: float  # |r| / |f_ex|
    iterations: int

    def start(self):
        """Return u, v, T at t = 0, from which time integration can start."""
        n = np.arange(1, self.u_hat.shape[1] // 2 + 1)
        u = self.u_hat[:, 0] + self.u_hat[:, 1::2].sum(axis=1)
        return u, self.omega * (self.u_hat[:, 2::2] @ n), self.T


def sampled_law(du, system, law="return"):
    """Return f_nl (n_samples, ..., n_pairs, 3) [N] and the states (..., n_pairs) for a period of du of the same shape [m].

    Complex ``du`` carry a derivative in their imaginary part: branches depend on real parts only.  ``law`` "path" follows
    the straight line from sample to sample exactly, see ``straight_step``.
    """
    mu, N0, k_t, k_n, separate = (system[key] for key in ("mu", "N0", "k_t", "k_n", "separate"))
    closing = N0 - k_n * du[..., 2]
    N = np.where(closing.real > 0.0, closing, 0.0)
    limit = (mu * N)[..., None]
    pull = k_t[:, None] * (du[..., :2] - np.roll(du, 1, axis=0)[..., :2])  # k_t d(du_t) from the previous sample
    T, slips = k_t[:, None] * du[0, ..., :2], np.zeros(du.shape[1:-1], dtype=bool)
    f = np.empty_like(du)
    f[..., 2] = np.maximum(N0, 0.0) - N
    size = np.abs(T.real).max(initial=0.0) + np.abs(limit.real).max(initial=0.0)
    for period in range(PERIODS):
        T_start, slips = T, np.zeros_like(slips)
        for k in range(period == 0, len(du)):
            T_before, T = T, T + pull[k]
            square = T * T
            square = np.where(separate[:, None], square, square.sum(axis=-1, keepdims=True))
            leaves = square.real > limit[k].real ** 2
            if leaves.any():
                T = np.where(leaves, limit[k] * T / np.sqrt(np.where(leaves, square, 1.0)), T)
                # a settled pair touches its limit once per cycle; only roundoff makes it slip there
                slips |= (square.real > (1.0 + 1e-9) * limit[k].real ** 2).any(axis=-1)
            if law == "path":
                T = _along_path(T, T_before, pull[k], closing[k - 1], closing[k], mu, separate)
            f[k, ..., :2] = T
        if period > 0 and np.abs((T - T_start).real).max(initial=0.0) <= 1e-12 * size:
            break
    return f, np.where((closing.real <= 0.0).any(axis=0), 2, np.where(slips, 1, 0))


def _along_path(T_return, T, e, closing, closing_new, mu, separate):
    """Return the friction forces after a straight step; ``T_return`` where the pair sticks in the whole step."""
    coupled = straight_step(T, e, closing, closing_new, mu)
    if separate.any():
        sides = [straight_step(T * side, e * side, closing, closing_new, mu) for side in np.eye(2)]
        coupled = np.where(separate[:, None], sides[0] + sides[1], coupled)
    returned = np.any(T_return != T + e, axis=-1)
    sticks = ~returned & (closing.real >= 0.0) & (closing_new.real > 0.0)
    return np.where(sticks[..., None], T_return, coupled)


def straight_step(T, e, closing, closing_new, mu):
    """Return T (..., 2) after a step in which du_t and du_z move along a straight line, exactly.

    ``e`` = k_t d(du_t) (..., 2); ``closing`` = N0 - k_n du_z (...) at both ends, negative where open.  T moves by e
    until |T| - mu N reaches zero and does not fall again; then it slips, |T| = mu N, and the angle psi from e to T obeys
    d(psi) = -sin(psi) |de| / (mu N): tan(psi / 2) decays exponentially.
    """

    def dot(x, y):
        return (x * y).sum(axis=-1)

    def divide(x, y):
        return np.divide(x, y, out=np.zeros_like(x * y), where=np.abs(y.real) > 0.0)

    closes = closing.real < 0.0
    e = e * np.where(closes, divide(closing_new, closing_new - closing), 1.0)[..., None]
    T, closing = np.where(closes[..., None], 0.0, T), np.where(closes, 0.0, closing)
    end, growth = mu * closing_new, mu * (closing_new - closing)
    stuck = T + e
    slips = dot(stuck, stuck).real > end.real**2
    # |T + xi e|^2 = (mu N(xi))^2 where it begins to slip
    a, b, c = dot(e, e) - growth**2, dot(T, e) - mu * closing * growth, dot(T, T) - (mu * closing) ** 2
    c, square = np.where(c.real > 0.0, 0.0, c), b * b - a * c
    root = np.sqrt(np.where(square.real > 0.0, square, 0.0))
    xi = np.where(b.real > 0.0, divide(-c, b + root), divide(root - b, a))
    xi = np.where(xi.real < 0.0, 0.0, np.where(xi.real > 1.0, 1.0, xi))
    T, limit = T + xi[..., None] * e, mu * closing + xi * growth
    size_square = dot(e, e)
    moves = size_square.real > 0.0
    size = np.sqrt(np.where(moves, size_square, 1.0))
    e = e / size[..., None]
    near = np.abs(end.real - limit.real) <= 1e-6 * np.abs(end.real)
    ratio = np.where(near | (limit.real <= 0.0) | (end.real <= 0.0), 2.0, divide(end, limit))
    mean = np.where(near, 0.5 * (end + limit), (end - limit) / np.log(ratio))
    tangent = divide(T[..., 1] * e[..., 0] - T[..., 0] * e[..., 1], limit + dot(T, e))  # tan(psi / 2)
    turns = slips & (end.real > 0.0) & (limit.real > 1e-14 * end.real)  # otherwise it closes in this step, T is along e
    tangent = np.where(turns, tangent, 0.0) * np.exp(np.where(turns, -divide((1.0 - xi) * size, mean), 0.0))
    cos, sin = (1.0 - tangent**2) / (1.0 + tangent**2), 2.0 * tangent / (1.0 + tangent**2)
    turned = np.stack([cos * e[..., 0] - sin * e[..., 1], cos * e[..., 1] + sin * e[..., 0]], axis=-1)
    slid = end[..., None] * np.where(moves[..., None], turned, divide(T, limit[..., None] + 0.0 * T))
    return np.where((closing_new.real > 0.0)[..., None], np.where(slips[..., None], slid, stuck), 0.0)


def contact_harmonics(du_hat, system, n_samples, law="return"):
    """Return the harmonics of f_nl (n_pairs, 3, N_H) [N], the states, and T (n_pairs, 2) at the first sample."""
    N_H = du_hat.shape[-1]
    du = np.moveaxis(du_hat @ harmonic_basis(N_H // 2, n_samples), -1, 0)
    f, state = sampled_law(du, system, law)
    return harmonic_coefficients(np.moveaxis(f, 0, -1), N_H // 2), state, f[0, :, :2].copy()


def contact_derivative(du_hat, system, n_samples, law="return"):
    """Return d f_hat / d du_hat of every pair, (n_pairs, 3 N_H, 3 N_H) [N/m]; index = direction N_H + coefficient."""
    n_pairs, _, N_H = du_hat.shape
    columns = np.eye(3 * N_H).reshape(3 * N_H, 1, 3, N_H)
    step = 1e-30 * max(np.abs(du_hat).max(), 1e-12)
    trial = du_hat[None] + 1j * step * columns  # (3 N_H, n_pairs, 3, N_H)
    du = np.moveaxis(trial @ harmonic_basis(N_H // 2, n_samples), -1, 0)
    f, _ = sampled_law(du, system, law)
    d_f = harmonic_coefficients(np.moveaxis(f.imag, 0, -1), N_H // 2) / step  # column, pair, direction, coefficient
    return np.moveaxis(d_f, 0, -1).reshape(n_pairs, 3 * N_H, 3 * N_H)


def dynamic_stiffness(system, K, omega, H):
    """Return the real matrix of K u + C u' + M u'' on the harmonics, (n N_H, n N_H), DOF-major."""
    M, C, n, N_H = system["M"], damping_matrix(system), len(system["M"]), 2 * H + 1
    Z = np.zeros((n, N_H, n, N_H))
    Z[:, 0, :, 0] = K
    for h in range(1, H + 1):
        c, s, w = 2 * h - 1, 2 * h, h * omega
        Z[:, c, :, c] = Z[:, s, :, s] = K - w * w * M
        Z[:, c, :, s], Z[:, s, :, c] = w * C, -w * C
    return Z.reshape(n * N_H, n * N_H)


def linear_response(system, omega, level, H, K=None):
    """Return the harmonics (n, N_H) of the linear system, by default with all pairs stuck."""
    Z = dynamic_stiffness(system, stuck_stiffness(system) if K is None else K, omega, H)
    F = force_coefficients(system, level, H)
    return np.linalg.solve(Z, F.ravel()).reshape(F.shape)


def _residual(u_hat, Z, F, system, n_samples, law):
    """Return r = Z u + R^T f_nl - f_ex (n N_H,)."""
    du_hat = (system["R"] @ u_hat).reshape(-1, 3, u_hat.shape[1])
    f_hat, _, _ = contact_harmonics(du_hat, system, n_samples, law)
    return Z @ u_hat.ravel() + (system["R"].T @ f_hat.reshape(-1, u_hat.shape[1]) - F).ravel()


def _jacobian(u_hat, Z, system, n_samples, law):
    """Return d r / d u_hat."""
    R, N_H = system["R"], u_hat.shape[1]
    P = contact_derivative((R @ u_hat).reshape(-1, 3, N_H), system, n_samples, law).reshape(-1, 3, N_H, 3, N_H)
    R_pair = R.reshape(-1, 3, R.shape[1])
    joint = np.einsum("pai,paxby,pbj->ixjy", R_pair, P, R_pair, optimize=True)
    return Z + joint.reshape(Z.shape)


def newton(system, omega, level, u_hat, n_samples, tolerance=1e-10, max_iterations=40, law="return"):
    """Return u_hat, |r| / |f_ex| and the number of iterations; u_hat is None where Newton fails."""
    H = u_hat.shape[1] // 2
    Z, F = dynamic_stiffness(system, system["K"], omega, H), force_coefficients(system, level, H)
    size = np.linalg.norm(F)
    r = _residual(u_hat, Z, F, system, n_samples, law)
    history = [np.linalg.norm(r)]
    for iteration in range(max_iterations):
        if history[-1] <= tolerance * size:
            return u_hat, history[-1] / size, iteration
        d_u = np.linalg.solve(_jacobian(u_hat, Z, system, n_samples, law), -r).reshape(u_hat.shape)
        for factor in 0.5 ** np.arange(8):
            trial = u_hat + factor * d_u
            r = _residual(trial, Z, F, system, n_samples, law)
            if np.linalg.norm(r) < max(history[-6:]):  # not monotonic: it rises where samples change state
                break
        u_hat = trial
        history.append(np.linalg.norm(r))
    return None, np.linalg.norm(r) / size, max_iterations


def solve(system, omega, level, *, H=15, n_samples=1024, start=None, tolerance=1e-10, law="return"):
    """Return the ``Balance`` at one frequency and level.

    Newton from ``start`` (harmonics of u, (n, any number)) or from the linear solution, with all pairs stuck, or all
    open where every pair has a gap; where that fails, the level is raised in steps from a thousandth of it.

    Raises
    ------
    RuntimeError : the level could not be reached
    """
    if start is None:
        K = system["K"] if (system["N0"] < 0.0).all() else None
        start = linear_response(system, omega, level, H, K)
    start = np.pad(start, ((0, 0), (0, max(0, 2 * H + 1 - start.shape[1]))))[:, : 2 * H + 1]
    u_hat, residual, iterations = newton(system, omega, level, start, n_samples, tolerance, law=law)
    if u_hat is None:
        u_hat, residual, iterations = _raise_level(system, omega, level, start, n_samples, tolerance, law)
    return _summary(system, omega, level, u_hat, n_samples, residual, iterations, law)


def follow(system, omegas, level, *, H=15, n_samples=1024, start=None, tolerance=1e-10, smallest=1e-3, law="return"):
    """Return the ``Balance`` at each of ``omegas``, each from the previous one by a secant predictor and halved steps.

    A branch is followed in frequency only: a turning point raises an error.

    Raises
    ------
    RuntimeError : a step below ``smallest`` times the distance between two of ``omegas`` fails
    """
    points = [solve(system, omegas[0], level, H=H, n_samples=n_samples, start=start, tolerance=tolerance, law=law)]
    omega, u_hat, slope = omegas[0], points[0].u_hat, 0.0
    for goal in omegas[1:]:
        step = goal - omega
        while omega != goal:
            ahead = omega + step if abs(goal - omega) > 1.001 * abs(step) else goal
            guess = u_hat + slope * (ahead - omega)
            trial, residual, iterations = newton(system, ahead, level, guess, n_samples, tolerance, 15, law)
            if trial is not None:
                slope = (trial - u_hat) / (ahead - omega)
                omega, u_hat = ahead, trial
                continue
            step *= 0.5
            if abs(step) < smallest * abs(goal - omega):
                raise RuntimeError(
                    f"{system['name']}: level {level:.4g} cannot be followed beyond omega = "
                    f"{omega:.6g}, |r| / |f_ex| = {residual:.1e}"
                )
        points.append(_summary(system, omega, level, u_hat, n_samples, residual, iterations, law))
    return points


def _raise_level(system, omega, level, start, n_samples, tolerance, law):
    """Return the result of ``newton``, reached through lower levels from a thousandth of ``start``."""
    reached, step, u_hat = 1e-3, 0.3, 1e-3 * start
    while reached < 1.0:
        goal = min(1.0, reached + step)
        trial, residual, iterations = newton(system, omega, goal * level, u_hat * goal / reached, n_samples, tolerance, law=law)
        if trial is not None:
            reached, u_hat = goal, trial
            continue
        step *= 0.5
        if step < 0.01:
            raise RuntimeError(
                f"{system['name']}: no harmonic balance at omega = {omega:.6g} above level "
                f"{reached * level:.4g} of {level:.4g}, |r| / |f_ex| = {residual:.1e}; give a start"
            )
    return u_hat, residual, iterations


def _summary(system, omega, level, u_hat, n_samples, residual, iterations, law):
    """Return the ``Balance`` of converged harmonics."""
    N_H = u_hat.shape[1]
    du_hat = (system["R"] @ u_hat).reshape(-1, 3, N_H)
    f_hat, state, T = contact_harmonics(du_hat, system, n_samples, law)
    n = np.repeat(np.arange(1, N_H // 2 + 1), 2)
    viscous = np.pi * omega * np.einsum("k,ik,ij,jk->", n**2, u_hat[:, 1:], damping_matrix(system), u_hat[:, 1:])
    return Balance(
        omega=omega,
        level=level,
        u_hat=u_hat,
        du_hat=du_hat,
        f_hat=f_hat,
        p_hat=f_hat - joint_stiffness(system).reshape(-1, 3, 1) * du_hat,
        state=state,
        T=T,
        input=float(cycle_work(force_coefficients(system, level, N_H // 2), u_hat).sum()),
        viscous=float(viscous),
        friction=cycle_work(f_hat, du_hat)[:, :2].sum(axis=1),
        residual=float(residual),
        iterations=iterations,
    )
