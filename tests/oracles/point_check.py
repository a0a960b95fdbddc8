"""Check a returned point with the matrices only: dynamics, contact law, energies, inequalities.

Nothing of the program is used, neither its modes nor its contact kernel.  Input are M, C or a damping law, K, R, the loads and
the parameters of the pairs (a system of ``oracles.scenes``, also with ``rayleigh``), and of the point the motion
of the pairs U, their forces p, the response of some DOFs, and the reported states and energies.  The law is marched here in the
friction force T along the straight lines between samples, until it repeats (path.py; docs/theory.md, section 3).

Linear systems are solved in double and refined with residuals in extended precision: a joint a million times softer or
stiffer than the structure has a solution exact to far below the tolerances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from . import path
from .scenes import cycle_work

STICK, SLIP, OPEN = 0, 1, 2
_LONG, _CLONG = np.longdouble, np.clongdouble


@dataclass(frozen=True)
class Verdict:
    """Relative errors of a point; a point is right if each lies below its bound."""

    motion: float  # |R u - U| / |U|, u = Z^-1 (f - R^T p) by the full matrices at every harmonic
    response: float  # |outputs - u at their DOFs| / |outputs|
    force: float  # |Z u + R^T f_nl(U) - f| / (|f| + |R^T f_nl|): imbalance with the law at the returned motion
    law: float  # |p - p(U)| of a pair / the largest of its K_J |U|, N0 and |p|
    energy: float  # |W - D - E| / |W|, or / a hundredth of the apparent work where |W| is less
    reported: float  # the largest difference of W, D, E from the reported values, on the same scale
    friction_limit: float  # |T| - mu N at the samples, over the largest force of the pair
    tension: float  # -N over the largest force of the pair
    negative_energy: (
        float  # -e_i / (pi H |T| |du_t| (2 / N_t)^2): the sampled law rotates its slip within a sample; 2 / N_t if it opens
    )
    finite: bool
    states: bool  # the states are those of the march, except for pairs at the limit to rounding

    def worst(self) -> tuple[str, float]:
        """Return the name and the size of the largest error relative to its bound."""
        shares = {name: getattr(self, name) / bound for name, bound in BOUNDS.items()}
        name = max(shares, key=lambda key: shares[key] if np.isfinite(shares[key]) else np.inf)
        return name, getattr(self, name)

    def faults(self, slack: float = 1.0) -> list[str]:
        """Return the faults of the point, an empty list if it is right."""
        computed = [] if self.finite else ["not a finite number"]
        computed += [
            f"{name} {getattr(self, name):.1e} (bound {slack * bound:.0e})"
            for name, bound in BOUNDS.items()
            if not getattr(self, name) <= slack * bound
        ]
        return computed + ([] if self.states else ["states differ from those of the march"])


# a point is accepted at a relative residual of 1e-8 in U; the other bounds follow from the stiffness of joint and structure
BOUNDS = {
    "motion": 1e-7,
    "response": 1e-7,
    "force": 1e-5,
    "law": 1e-8,  # sliders of a steady cycle return to 1e-14 of their slip distance, however slowly they drift
    "energy": 1e-4,
    "reported": 1e-5,
    "friction_limit": 1e-9,
    "tension": 1e-12,
    "negative_energy": 1.0,
}


class Judge:
    """The full system, prepared once for all points of a scene."""

    def __init__(self, system: dict, H: int, n_samples: int):
        self.system, self.H, self.n_samples = system, H, n_samples
        k_t, k_n = system["k_t"], system["k_n"]
        self.k = np.stack([k_t, k_t, k_n], axis=1)
        self.R = np.asarray(system["R"], dtype=float)
        self.M = np.asarray(system["M"], dtype=_LONG)
        self.K_L = np.asarray(system["K"], dtype=_LONG) + self.R.T.astype(_LONG) @ (
            self.k.ravel().astype(_LONG)[:, None] * self.R.astype(_LONG)
        )
        self.C = damping(system, self.K_L).astype(_LONG)

    def verdicts(self, points, levels, outputs) -> list[Verdict]:
        """Return the errors of points at one level, or at one level each; all are marched at once.

        ``outputs`` (n_outputs,) are the DOFs of the responses.
        """
        if not points:
            return []
        n_pairs, march = len(self.k), self.march(np.nan_to_num(np.concatenate([point.U for point in points])))
        parts = [march.of(slice(i * n_pairs, (i + 1) * n_pairs)) for i in range(len(points))]
        return [
            self.verdict(point, level, outputs, part)
            for point, level, part in zip(points, np.broadcast_to(levels, len(points)), parts)
        ]

    def verdict(self, point, level: float, outputs, march: March | None = None, forces: np.ndarray | None = None) -> Verdict:
        """Return the errors of a point; without ``march`` as :meth:`verdicts`."""
        U, p, N_H = np.asarray(point.U, dtype=float), np.asarray(point.p, dtype=float), 2 * self.H + 1
        everything = [U, p, point.response, point.energy, [point.input, point.damping, point.friction, point.omega]]
        if not all(np.isfinite(part).all() for part in everything):
            return Verdict(*[np.nan] * 9, finite=False, states=False)
        f = loads(self.system, level, self.H) if forces is None else forces
        if forces is None and not np.any(f):  # loads that cancel: nothing moves except by rounding
            in_phase = [{**load, "vector": np.abs(load["vector"]), "phase": 0.0} for load in self.system["loads"]]
            u, _ = self.motion(point.omega, loads({**self.system, "loads": in_phase}, level, self.H))
            still = float(np.linalg.norm(U) / (np.linalg.norm(u) or 1.0))
            return Verdict(
                motion=still,
                response=still,
                force=still,
                law=0.0,
                energy=0.0,
                reported=0.0,
                friction_limit=0.0,
                tension=0.0,
                negative_energy=0.0,
                finite=True,
                states=True,
            )
        u, _ = self.motion(point.omega, f - self.R.T @ p.reshape(-1, N_H))
        du = (self.R @ u).reshape(U.shape)
        march = self.march(U) if march is None else march
        if any(
            "held by springs" in note for note in point.notes
        ):  # as the notes of the point state: the mean of p_t is not that of the law (theory.md, eq. 5.6)
            march.p[:, :2, 0] = p[:, :2, 0]
        unknown = march.change > 1e-12 * march.size  # sliders without a steady cycle in this march: only the balance is checked
        march.p[unknown] = p[unknown]
        law = np.abs(p - march.p).max(axis=(1, 2), initial=0.0) / march.size
        f_nl = march.p + self.k[:, :, None] * U
        unbalanced = self.R.T @ (p - march.p).reshape(-1, N_H) + self.R.T @ (self.k[:, :, None] * (du - U)).reshape(-1, N_H)
        size = np.linalg.norm(f) + np.linalg.norm(self.R.T @ f_nl.reshape(-1, N_H))
        energies = self.energies(point.omega, f, u, march, U)
        W, D, E = energies
        apparent = np.pi * sum(
            n * np.linalg.norm(f[:, 2 * n - 1 : 2 * n + 1]) * np.linalg.norm(u[:, 2 * n - 1 : 2 * n + 1])
            for n in range(1, self.H + 1)
        ) + 1e-3 * np.pi * np.linalg.norm(f[:, 0]) * np.linalg.norm(u[:, 0])
        scale = max(abs(W), abs(D) + abs(E), 1e-2 * apparent) or 1.0
        order = np.where(march.state == OPEN, 1, 2)  # of the sampled law: friction jumps where a pair lifts off
        stated = np.array([point.input, point.damping, point.friction])
        response = np.asarray(point.response)
        return Verdict(
            motion=relative(du - U, U),
            response=relative(response - u[list(outputs)], response),
            force=float(np.linalg.norm(unbalanced) / (size or 1.0)),
            law=float(law.max(initial=0.0)),
            energy=float(abs(W - D - E) / scale),
            reported=float(np.abs(stated - energies).max() / scale),
            friction_limit=float(march.beyond_limit.max(initial=0.0)),
            tension=float(march.tension.max(initial=0.0)),
            negative_energy=float(
                (np.maximum(-point.energy, 0.0) / march.most_work * (self.n_samples / 2.0) ** order).max(initial=0.0)
            ),
            finite=True,
            states=bool(np.all((np.asarray(point.state) == march.state) | march.at_limit | unknown)),
        )

    def motion(self, omega: float, forces: np.ndarray) -> tuple[np.ndarray, float]:
        """Return u (n, N_H) under forces (n, N_H) with all joint springs in place, and the backward error of its last solve."""
        u, error = np.empty_like(forces), 0.0
        u[:, 0], error = refined_solve(self.K_L, forces[:, 0])
        for n in range(1, self.H + 1):
            w = _LONG(n) * _LONG(omega)
            Z = self.K_L - w * w * self.M + 1j * w * self.C
            x, error = refined_solve(Z, forces[:, 2 * n - 1] - 1j * forces[:, 2 * n])
            u[:, 2 * n - 1], u[:, 2 * n] = x.real, -x.imag
        return u, error

    def energies(self, omega: float, f, u, march, U) -> np.ndarray:
        """Return the work of the loads, the viscous loss and the loss of the pairs, each per cycle [J]."""
        D = np.pi * omega * sum(n * n * (u[:, c] @ self.C @ u[:, c]) for n in range(1, self.H + 1) for c in (2 * n - 1, 2 * n))
        return np.array([cycle_work(f, u).sum(), float(D), cycle_work(march.p, U).sum()])

    def march(self, U: np.ndarray) -> March:
        """Return the contact law for the motion U (n_pairs, 3, N_H), or for several motions one after the other."""
        n_motions = len(U) // max(len(self.k), 1)
        s = {key: np.tile(self.system[key], n_motions) for key in ("mu", "N0", "k_t", "k_n", "separate")}
        springs, theta = np.tile(self.k, (n_motions, 1))[:, :, None], 2.0 * np.pi * np.arange(self.n_samples) / self.n_samples
        n = np.arange(1, self.H + 1)[:, None]
        basis = np.empty((2 * self.H + 1, self.n_samples))
        basis[0], basis[1::2], basis[2::2] = 1.0, np.cos(n * theta), np.sin(n * theta)
        du = np.moveaxis(U @ basis, -1, 0)  # (N_t, n_pairs, 3)
        pressed = s["N0"] - s["k_n"] * du[..., 2]
        N = np.where(pressed > 0.0, pressed, 0.0)
        limit, k_t, separate = s["mu"] * N, s["k_t"], s["separate"]
        noise = k_t * np.abs(du[..., :2]).max(axis=(0, 2))
        cycle = path.steady(du, pressed, k_t, s["mu"], separate)
        forces = cycle.T
        room = (limit - np.where(separate, np.abs(forces).max(axis=2), np.linalg.norm(forces, axis=2))).min(axis=0)
        slides = (cycle.slip > 1e-9 * limit.max(axis=0)) & (cycle.slip > 1e-13 * noise) | (limit == 0.0).any(axis=0)
        nearly = np.where(slides, cycle.slip, room) <= 1e-7 * limit.max(axis=0) + 1e-10 * noise
        f_nl = np.empty((self.n_samples, len(k_t), 3))
        # max(N0, 0) - N, written so that a motion much smaller than the preload causes no cancellation
        f_nl[..., :2] = forces
        f_nl[..., 2] = np.where(pressed > 0.0, np.maximum(-s["N0"], 0.0) + s["k_n"] * du[..., 2], np.maximum(s["N0"], 0.0))
        weights = np.full(2 * self.H + 1, 2.0 / self.n_samples)
        weights[0] = 1.0 / self.n_samples
        between = np.concatenate([path.shared(cycle.area), path.shared(path.normal_area(pressed))[..., None]], axis=2)
        f_hat = np.moveaxis(f_nl + between, 0, -1) @ basis.T * weights
        p = f_hat - springs * U
        opens = (pressed <= 0.0).any(axis=0)
        size = np.maximum(np.abs(springs * U).max(axis=(1, 2)), np.maximum(np.abs(s["N0"]), np.abs(f_nl).max(axis=(0, 2))))
        size = np.where(size > 0.0, size, 1.0)
        length = np.where(separate[:, None], np.abs(forces), np.linalg.norm(forces, axis=2, keepdims=True))
        beyond = np.maximum((length - limit[..., None]).max(axis=(0, 2)), 0.0)
        # at least rounding of k_t du, of which T is a small difference
        beyond = beyond / np.maximum(limit.max(axis=0), size)
        T_size, u_size = (np.linalg.norm(x[:, :2, 1:], axis=(1, 2)) for x in (f_hat, U))
        most_work = np.pi * self.H * np.maximum(T_size * u_size, 1e-9 * size * u_size)
        return March(
            p=p,
            size=size,
            most_work=np.where(most_work > 0.0, most_work, 1.0),
            state=np.where(opens, OPEN, np.where(slides, SLIP, STICK)),
            at_limit=nearly | (np.abs(pressed).min(axis=0) <= 1e-7 * size),
            beyond_limit=beyond,
            tension=np.maximum(-N.min(axis=0), 0.0) / size,
            change=cycle.change,
        )


@dataclass(frozen=True)
class March:
    """The contact law for a motion."""

    p: np.ndarray  # (n_pairs, 3, N_H) N
    size: np.ndarray  # (n_pairs,) N, the largest force of each pair
    most_work: np.ndarray  # (n_pairs,) J, largest possible work of its friction force in a cycle
    state: np.ndarray  # (n_pairs,)
    at_limit: np.ndarray  # (n_pairs,) bool: within rounding of another state
    beyond_limit: np.ndarray  # (n_pairs,) of |T| - mu N, relative to the largest force
    tension: np.ndarray  # (n_pairs,) of -N, relative to the largest force
    change: np.ndarray  # (n_pairs,) N, of the friction force in a period

    def of(self, pairs: slice) -> March:
        """Return the law of a subset of pairs."""
        return March(**{name: value[pairs] for name, value in vars(self).items()})


def damping(system: dict, K_L: np.ndarray) -> np.ndarray:
    """Return C (n, n): the given matrix, alpha M + beta K_L, or the ratio of every mode of (K_L, M)."""
    if "C" in system:
        return np.asarray(system["C"], dtype=float)
    M = np.asarray(system["M"], dtype=float)
    if "rayleigh" in system:
        alpha, beta = system["rayleigh"]
        return alpha * np.asarray(M) + beta * np.asarray(K_L, dtype=float)
    theta, x = scipy.linalg.eigh(M, np.asarray(K_L, dtype=float))
    has_mass = theta > 1e-13 * theta[-1] if (np.diag(M) == 0.0).any() else np.ones(len(theta), dtype=bool)
    x = x[:, has_mass]
    mass, stiffness = (np.einsum("ij,ij->j", x, np.asarray(A @ x, dtype=float)) for A in (M, K_L))
    M_phi = M @ (x / np.sqrt(mass))
    return (M_phi * (2.0 * system["zeta"] * np.sqrt(stiffness / mass))) @ M_phi.T


def loads(system: dict, level: float, H: int) -> np.ndarray:
    """Return the coefficients (n, N_H) [N] of level vector cos(n omega t + phase); of harmonic 0 the constant part cos(phase)."""
    f = np.zeros((len(system["M"]), 2 * H + 1))
    for load in system["loads"]:
        n, phase, vector = load["harmonic"], load.get("phase", 0.0), level * np.asarray(load["vector"], dtype=float)
        f[:, max(2 * n - 1, 0)] += vector * np.cos(phase)
        if n > 0:
            f[:, 2 * n] -= vector * np.sin(phase)
    return f


def refined_solve(A: np.ndarray, b: np.ndarray, rounds: int = 4) -> tuple[np.ndarray, float]:
    """Return A^-1 b with residuals in extended precision (A long double), and |A x - b| / (|A| |x| + |b|)."""
    is_complex = np.iscomplexobj(A) or np.iscomplexobj(b)
    kind, long_kind = (complex, _CLONG) if is_complex else (float, _LONG)
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(A)).astype(float), np.finfo(float).tiny))
    factor = scipy.linalg.lu_factor(A.astype(kind) * np.outer(scale, scale))
    b = b.astype(long_kind)
    x = np.zeros(len(b), dtype=long_kind)
    for _ in range(rounds):
        r = (b - A @ x).astype(kind)
        x = x + scale * scipy.linalg.lu_solve(factor, scale * r)
    size = float(np.abs(A).max() * np.abs(x).max() + np.abs(b).max()) or 1.0
    return x.astype(kind), float(np.abs(b - A @ x).max()) / size


def relative(difference: np.ndarray, of: np.ndarray) -> float:
    """Return |difference| / |of|; 0 where both vanish."""
    size, change = float(np.linalg.norm(of)), float(np.linalg.norm(difference))
    return change / size if size > 0.0 else float(change > 0.0)
