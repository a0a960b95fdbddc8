"""Exact results of friction: single elements, one-mass oscillators, a bar on a friction foundation, spheres in contact.

Units are any consistent set.  docs/validation.md names the use of each result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import quad, simpson
from scipy.optimize import brentq, fsolve, minimize_scalar

# --- one element ------------------------------------------------------------------------------------------------------


def jenkins_harmonic(X, k_t, muN):
    """Return a1, b1 and the loss per cycle of a Jenkins element under u = X cos th: f ~ a1 cos th - b1 sin th.

    Below d = muN / k_t it sticks: k_t X, 0, 0.
    """
    d = muN / k_t
    if X <= d:
        return k_t * X, 0.0, 0.0
    th = np.arccos(1.0 - 2.0 * d / X)
    return (k_t * X / np.pi * (th - 0.5 * np.sin(2.0 * th)), 4.0 * muN / np.pi * (1.0 - d / X), 4.0 * muN * (X - d))


def jenkins_peak(level, muN, c, k_t=1.0):
    """Return the peak amplitude of m = k = 1 at a level, one harmonic, from the first slip on."""

    def level_of(X):
        a1, b1, _ = jenkins_harmonic(X, k_t, muN)

        def squared(w):
            return (1.0 + a1 / X - w * w) ** 2 * X * X + (c * w * X + b1) ** 2

        return np.sqrt(
            minimize_scalar(squared, bounds=(0.9, 1.1 * np.sqrt(1.0 + k_t)), method="bounded", options={"xatol": 1e-12}).fun
        )

    return brentq(lambda X: level_of(X) - level, muN / k_t * (1.0 + 1e-9), 1e4, xtol=1e-12)


def circle_path(X, k_t, muN):
    """Return the friction force along du and along its velocity, and the loss per cycle, for du_t = X (cos th, sin th).

    The slider moves on a circle of radius sqrt(X^2 - d^2) with its spring tangent to that circle, d = muN / k_t; the
    force has the constant size muN.  Below d it sticks: k_t X, 0, 0.
    """
    d = muN / k_t
    if X <= d:
        return k_t * X, 0.0, 0.0
    return k_t * d * d / X, muN * np.sqrt(1.0 - (d / X) ** 2), 2.0 * np.pi * muN * np.sqrt(X * X - d * d)


def in_phase_loop(X, k_t, mu, N0, gamma):
    """Return the corners (n, 2) of the loop (u, T) and its area for u = X cos th, N = max(0, N0 + gamma u), gamma > 0.

    Straight sides: sticking with slope k_t, slipping on T = +-mu N; with lift-off (gamma X > N0) the force is zero
    below u = -N0 / gamma.  Needs mu gamma < k_t and slip on every side.
    """
    top = (X, mu * (N0 + gamma * X))
    u_down = (k_t * X - mu * (2.0 * N0 + gamma * X)) / (k_t + mu * gamma)
    corners = [top, (u_down, -mu * (N0 + gamma * u_down))]
    if gamma * X > N0:
        corners.append((-N0 / gamma, 0.0))
        slips_on_every_side = u_down > -N0 / gamma
    else:
        u_up = (2.0 * mu * N0 - (k_t + mu * gamma) * X) / (k_t - mu * gamma)
        corners += [(-X, -mu * (N0 - gamma * X)), (u_up, mu * (N0 + gamma * u_up))]
        slips_on_every_side = -X < u_down and u_up < X
    if mu * gamma >= k_t or not slips_on_every_side:
        raise ValueError("in_phase_loop: the element does not slip on every side of this loop")
    u, T = np.array(corners).T
    return np.array(corners), 0.5 * abs(np.dot(u, np.roll(T, -1)) - np.dot(T, np.roll(u, -1)))


def masing_loss(backbone, X):
    """Return the loss per cycle 8 (integral_0^X F du - X F(X) / 2) of a Masing material with backbone F(u)."""
    return 8.0 * (quad(backbone, 0.0, X, limit=200)[0] - 0.5 * X * backbone(X))


# --- one mass ---------------------------------------------------------------------------------------------------------


def jenkins_frequencies(X, F, *, m, c, k, k_t, muN):
    """Return the frequencies [rad/s], ascending, at which one harmonic of amplitude X balances the force F.

    (k + a1 / X - m w^2)^2 X^2 + (c w X + b1)^2 = F^2, a quartic in w.
    """
    a1, b1, _ = jenkins_harmonic(X, k_t, muN)
    K = k + a1 / X
    quartic = [m * m * X * X, 0.0, (c * c - 2.0 * K * m) * X * X, 2.0 * c * X * b1, K * K * X * X + b1 * b1 - F * F]
    roots = np.roots(quartic)
    return np.sort(roots[(abs(roots.imag) < 1e-9 * abs(roots)) & (roots.real > 0.0)].real)


def jenkins_amplitude(omega, F, *, m, c, k, k_t, muN):
    """Return the one-harmonic amplitude X at one frequency; the smallest where there are several."""

    def excess(X):
        a1, b1, _ = jenkins_harmonic(X, k_t, muN)
        return (k * X + a1 - m * omega**2 * X) ** 2 + (c * omega * X + b1) ** 2 - F * F

    X = muN / k_t * 1e-6
    while excess(X) > 0.0:
        X *= 0.5
    while excess(1.01 * X) < 0.0:
        X *= 1.01
    return brentq(excess, X, 1.01 * X, xtol=1e-15, rtol=1e-14)


@dataclass(frozen=True)
class HalfCycle:
    """Symmetric steady state of one mass: u falls from X at t = 0 to -X at pi / omega; load F cos(omega t + phi)."""

    omega: float
    X: float
    phi: float
    stick: float  # time after the turn at which sliding begins
    pieces: tuple  # functions t -> (u, v): sticking, sliding
    loss: float  # per cycle

    @property
    def is_valid(self):
        """True if the motion falls monotonically, so that there is no further stick or turn."""
        _, v = self(np.linspace(0.0, np.pi / self.omega, 2001)[1:-1])
        return bool(self.X > 0.0 and (v < 0.0).all())

    def __call__(self, t):
        """Return u and v at times t (array), 0 <= t <= pi / omega."""
        return np.where(t < self.stick, self.pieces[0](t), self.pieces[1](t))

    def harmonics(self, H, n=2000):
        """Return mean, cos 1, sin 1, ... of u, with the load's phase as zero: load = F cos(omega t)."""
        # Simpson over both pieces: the second half cycle is the first with the sign changed, so even harmonics vanish
        h = np.arange(1, H + 1)
        total = np.zeros(H, dtype=complex)
        for piece, (a, b) in zip(self.pieces, ((0.0, self.stick), (self.stick, np.pi / self.omega)), strict=True):
            t = np.linspace(a, b, n + 1)
            total += simpson(piece(t)[0] * np.exp(-1j * self.omega * np.multiply.outer(h, t)), x=t)
        total *= 2.0 * self.omega / np.pi * np.exp(-1j * h * self.phi) * (h % 2)
        return np.concatenate([[0.0], np.stack([total.real, -total.imag], axis=1).ravel()])


def _forced_piece(m, c, kappa, g, F, omega, phi, t0, u0, v0):
    """Return t -> (u, v) of m u'' + c u' + kappa u + g = F cos(omega t + phi) from u0, v0 at t0."""
    amplitude = F * np.exp(1j * phi) / (kappa - m * omega**2 + 1j * c * omega)
    roots = np.roots([m, c, kappa]).astype(complex)
    at_t0 = amplitude * np.exp(1j * omega * t0)
    rest = [u0 + g / kappa - at_t0.real, v0 - (1j * omega * at_t0).real]
    weights = np.linalg.solve(np.vstack([np.ones(2), roots]), rest)

    def motion(t):
        forced = amplitude * np.exp(1j * omega * np.asarray(t))
        free = weights[:, None] * np.exp(np.multiply.outer(roots, np.ravel(t) - t0))
        u = forced.real - g / kappa + free.sum(axis=0).real.reshape(np.shape(t))
        v = (1j * omega * forced).real + (roots[:, None] * free).sum(axis=0).real.reshape(np.shape(t))
        return np.array([u, v])

    return motion


def jenkins_steady_state(omega, F, *, m, c, k, k_t, muN):
    """Return the exact steady state, all harmonics, of one mass on a Jenkins element that slips once in each direction per cycle.

    Solved for X, phi and the end of sticking: u(stick) = X - 2 muN / k_t, u(pi / omega) = -X, v(pi / omega) = 0.
    For k_t -> infinity it tends to Den Hartog's motion, with an error of order 1 / sqrt(k_t).

    Raises
    ------
    RuntimeError : the element sticks, or the motion is not of the assumed form
    """
    d = muN / k_t

    def pieces(X, phi, stick):
        sticking = _forced_piece(m, c, k + k_t, muN - k_t * X, F, omega, phi, 0.0, X, 0.0)
        sliding = _forced_piece(m, c, k, -muN, F, omega, phi, stick, *sticking(stick))
        return sticking, sliding

    def mismatch(unknowns):
        X, phi, stick = unknowns
        sticking, sliding = pieces(X, phi, stick)
        end = sliding(np.pi / omega)
        return [(sticking(stick)[0] - X + 2.0 * d) / d, (end[0] + X) / d, end[1] / (omega * d)]

    X = jenkins_amplitude(omega, F, m=m, c=c, k=k, k_t=k_t, muN=muN)
    if X <= d:
        raise RuntimeError(f"jenkins_steady_state: omega = {omega}: the element sticks (X = {X:.4g}, d = {d:.4g})")
    a1, b1, _ = jenkins_harmonic(X, k_t, muN)
    phi = np.angle(complex(k * X + a1 - m * omega**2 * X, c * omega * X + b1))
    stick = np.arccos(max(-1.0, 1.0 - 2.0 * d / X)) / omega
    solution, _, status, message = fsolve(mismatch, [X, phi, stick], xtol=1e-13, full_output=True)
    if status != 1 and np.abs(mismatch(solution)).max() > 1e-9:
        raise RuntimeError(f"jenkins_steady_state: omega = {omega}: {message}")
    X, phi, stick = solution
    result = HalfCycle(omega, X, phi, stick, pieces(*solution), 4.0 * muN * (X - d))
    if not (0.0 < stick < np.pi / omega and result.is_valid):
        raise RuntimeError(f"jenkins_steady_state: omega = {omega}: more than one slip each way (X = {X:.4g})")
    return result


def den_hartog_amplitude(beta, friction_ratio):
    """Return X k / P of Den Hartog's motion without stops; beta = w / w_n, friction_ratio = F_f / P."""
    V = 1.0 / (1.0 - beta * beta)
    U = np.sin(np.pi / beta) / (beta * (1.0 + np.cos(np.pi / beta)))
    return np.sqrt(V * V - (friction_ratio * U) ** 2)


def den_hartog_motion(beta, friction_ratio):
    """Return Den Hartog's motion without stops as a ``HalfCycle`` with m = k = P = 1; check its ``is_valid``.

    The phase of the load at the turn has X = V cos phi and friction_ratio U = -V sin phi.
    """
    X = den_hartog_amplitude(beta, friction_ratio)
    U, V = np.sin(np.pi / beta) / (beta * (1.0 + np.cos(np.pi / beta))), 1.0 / (1.0 - beta * beta)
    phi = np.angle(complex(X / V, -friction_ratio * U / V))
    sliding = _forced_piece(1.0, 0.0, 1.0, -friction_ratio, 1.0, beta, phi, 0.0, X, 0.0)
    return HalfCycle(beta, X, phi, 0.0, (sliding, sliding), 4.0 * friction_ratio * X)


# --- bodies -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrictionBar:
    """A bar 0 <= x <= L on an elastic, perfectly plastic shear foundation, pulled by P at x = 0, free at x = L.

    EA u'' = k u where it sticks (|u| <= q / k), EA u'' = q where it slips, which is 0 <= x <= s.
    """

    EA: float
    L: float
    q: float  # friction limit per length
    k: float  # foundation stiffness per length

    @property
    def lam(self):
        return np.sqrt(self.k / self.EA)

    @property
    def stuck_stiffness(self):
        """P / u(0) before the first slip."""
        return self.EA * self.lam * np.tanh(self.lam * self.L)

    @property
    def first_slip(self):
        """The P at which the loaded end begins to slip."""
        return self.q / self.lam * np.tanh(self.lam * self.L)

    @property
    def full_slip(self):
        """The P that the foundation can hold at most."""
        return self.q * self.L

    def force(self, s):
        """Return P for the slip length s: the limit over s plus the force of the stuck part, P = q s + P_s."""
        return self.q * s + self.stuck_force(s)

    def stuck_force(self, s):
        """Return the bar's force at the tip of the slip zone, P_s = q / lam tanh(lam (L - s))."""
        return self.q / self.lam * np.tanh(self.lam * (self.L - s))

    def slip_length(self, P):
        """Return s for a monotonic force P, |P| <= q L."""
        P = abs(P)
        if P <= self.first_slip:
            return 0.0
        if P > self.full_slip * (1.0 + 1e-12):
            raise ValueError(f"FrictionBar: P = {P:.6g} exceeds the full slip {self.full_slip:.6g}")
        return brentq(lambda s: self.force(s) - P, 0.0, self.L, xtol=1e-15 * self.L) if P < self.full_slip else self.L

    def end_displacement(self, P):
        """Return u(0) under a monotonic force P: q / k + P_s s / EA + q s^2 / (2 EA) once it slips."""
        s = self.slip_length(P)
        if s == 0.0:
            return P / self.stuck_stiffness
        return np.sign(P) * (self.q / self.k + (self.stuck_force(s) * s + 0.5 * self.q * s * s) / self.EA)

    def end_force(self, u):
        """Return P on the backbone at the end displacement u; q L beyond full slip."""
        if abs(u) >= self.end_displacement(self.full_slip):
            return np.sign(u) * self.full_slip
        if abs(u) * self.stuck_stiffness <= self.first_slip:
            return u * self.stuck_stiffness
        return np.sign(u) * brentq(
            lambda P: self.end_displacement(P) - abs(u), self.first_slip, self.full_slip, xtol=1e-15 * self.full_slip
        )

    def displacement(self, x, P):
        """Return u(x) under a monotonic force P."""
        x, s = np.asarray(x, dtype=float), self.slip_length(P)
        u_s = self.q / self.k if s > 0.0 else abs(P) / self.stuck_stiffness
        # cosh(near) / cosh(far) without overflow
        near, far = self.lam * (self.L - np.maximum(x, s)), self.lam * (self.L - s)
        stuck = u_s * np.exp(near - far) * (1.0 + np.exp(-2.0 * near)) / (1.0 + np.exp(-2.0 * far))
        y = np.maximum(s - x, 0.0)
        return np.sign(P) * (stuck + (self.stuck_force(s) * y + 0.5 * self.q * y * y) / self.EA * (s > 0.0))

    def cyclic_displacement(self, x, P_max, P):
        """Return u(x) on the way down from P_max at the force P in a steady cycle of +-P_max (Masing)."""
        return self.displacement(x, P_max) - 2.0 * self.displacement(x, 0.5 * (P_max - P))

    def loss_density(self, x, P_max):
        """Return the loss per cycle and length: 4 q (|u(x)| - q / k) in the slip zone."""
        return 4.0 * self.q * np.maximum(self.displacement(x, abs(P_max)) - self.q / self.k, 0.0)

    def loss(self, P_max):
        """Return the loss per cycle of +-P_max: 2 q s^2 / EA (P_s + q s / 3)."""
        s = self.slip_length(P_max)
        return 2.0 * self.q * s * s / self.EA * (self.stuck_force(s) + self.q * s / 3.0)


def rigid_foundation_bar(P, EA, q):
    """Return slip length, end displacement and loss per cycle of ``FrictionBar`` for k -> infinity, P <= q L."""
    return P / q, P * P / (2.0 * EA * q), 2.0 * P**3 / (3.0 * EA * q)


def cattaneo_mindlin(Q, *, mu, P, a, G, nu):
    """Return the tangential approach of equal spheres (contact radius a, normal force P) and the loss of +-Q."""
    c, q = 2.0 * (2.0 - nu) / G, Q / (mu * P)
    rest = (1.0 - q) ** (2.0 / 3.0)
    displacement = 3.0 * mu * P * c / (16.0 * a) * (1.0 - rest)
    loss = 9.0 * (mu * P) ** 2 * c / (10.0 * a) * (1.0 - (1.0 - q) ** (5.0 / 3.0) - 5.0 * q / 6.0 * (1.0 + rest))
    return displacement, loss
