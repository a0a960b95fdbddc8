"""Damping of modes, modal or full; dynamic flexibilities and the matrices of a time step.

Only two other modules distinguish the two kinds: columns.py, whose compiled product exists for the diagonal only, and
reduction/truncation.py, where a full matrix exerts damping forces on the truncated modes.  With modal damping all matrices are
diagonal: m numbers instead of (m, m) for each harmonic or each point of a time integration.  NumPy only; everything is local.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Protocol

import numpy as np

from ..fourier.amplitudes import to_complex, to_real

_COUPLES = 1e-12  # |C_ij| / sqrt(C_ii C_jj) between modes beyond which a damping matrix is stored as full


def diagonal_if_possible(modal: np.ndarray) -> np.ndarray:
    """Return the diagonal (m,) of a Hermitian matrix (m, m) if it couples no modes, otherwise the matrix.  Local."""
    size = np.sqrt(np.abs(np.diag(modal)))
    is_coupled = np.abs(modal - np.diag(np.diag(modal))) > _COUPLES * np.outer(size, size)
    return modal if is_coupled.any() else np.diag(modal).real.copy()


def added(C: np.ndarray, of_modes: np.ndarray) -> np.ndarray:
    """Return a damping C, (m,) or (m, m), plus the damping of each mode (m,).  Local."""
    return C + (of_modes if C.ndim == 1 else np.diag(of_modes))


class StatedDamping(Protocol):
    """Damping stated in a scene for modes, which applies to any set of modes."""

    @property
    def structural(self) -> float:
        """The loss factor eta of the bodies."""

    def modal(self, omega_n: np.ndarray) -> np.ndarray:
        """Return the diagonal of phi^H C phi of modes, (m,) [1/s]."""


def structural_damping(omega_n: np.ndarray, R_phi: np.ndarray, K_J: np.ndarray, eta: float) -> np.ndarray:
    """Return eta phi^H K phi [1/s2], K without the springs of the joints, as diagonal if it couples no modes, otherwise full.

    Local.  docs/theory.md, eq. (13.2); phi^H K_L phi is diagonal.  ``K_J`` is (3 n_pairs,) [N/m].
    """
    of_springs = R_phi.conj().T @ (K_J[:, None] * R_phi)
    return eta * diagonal_if_possible(np.diag(omega_n**2) - 0.5 * (of_springs + of_springs.conj().T))


@dataclass(frozen=True, eq=False)
class Damping:
    """phi^H C phi of M-normalised modes [1/s], and eta phi^T K phi of structural damping [1/s2]."""

    C: np.ndarray  # (m,) 2 zeta omega_n of modal damping, or the full, Hermitian (m, m)
    S: np.ndarray | None = None  # of the same shape; None: no structural damping

    def __post_init__(self) -> None:
        if self.S is not None and self.S.ndim != self.C.ndim:
            for name in ("C", "S"):
                values = getattr(self, name)
                object.__setattr__(self, name, values if values.ndim == 2 else np.diag(values))

    @property
    def couples_modes(self) -> bool:
        """Whether the damping couples modes."""
        return self.C.ndim == 2

    @property
    def n_coupled(self) -> int:
        """Number of modes coupled to each other: 1 with modal damping."""
        return len(self.C) if self.couples_modes else 1

    @property
    def diagonal(self) -> np.ndarray:
        """2 zeta omega_n, (m,) [1/s]."""
        return np.diag(self.C).real if self.couples_modes else self.C

    @property
    def structural_diagonal(self) -> np.ndarray:
        """Diagonal of S, (m,) [1/s2]; eta omega_n^2 if there are no springs of joints."""
        if self.S is None:
            return np.zeros(len(self.C))
        return np.diag(self.S).real if self.couples_modes else self.S

    def plus(self, sigma: float) -> Damping:
        """Return the damping with sigma M [1/s] added to the damping matrix, docs/theory.md, eq. (7.3)."""
        return Damping(self.C + (sigma * np.eye(len(self.C)) if self.couples_modes else sigma), self.S)

    def with_more(self, C: np.ndarray, factor: float) -> Damping:
        """Return the damping plus C, (m,) or (m, m) [1/s], with structural damping times a factor."""
        more = np.diag(C) if C.ndim == 1 and self.couples_modes else C
        S = None if self.S is None else factor * self.S
        return Damping((np.diag(self.C) if more.ndim > self.C.ndim else self.C) + more, S)

    def conjugated(self) -> Damping:
        """Return the damping of the complex conjugate modes."""
        return Damping(self.C.conj(), None if self.S is None else self.S.conj())

    def apply(self, eta: np.ndarray) -> np.ndarray:
        """Return phi^H C phi eta, (m, n) each."""
        return self.C @ eta if self.couples_modes else self.C[:, None] * eta

    def apply_structural(self, eta: np.ndarray) -> np.ndarray:
        """Return the structural damping times eta, (m, n) each."""
        if self.S is None:
            return np.zeros_like(eta)
        return self.S @ eta if self.couples_modes else self.S[:, None] * eta

    def apply_to_rows(self, v: np.ndarray) -> np.ndarray:
        """Return phi^H C phi times modal velocities in rows, (..., m) each."""
        return v @ self.C.T if self.couples_modes else self.C * v

    def step_matrix(self, omega_n: np.ndarray, mass: float, rest: float, c: np.ndarray, k: np.ndarray) -> StepMatrix:
        """Return A = mass + rest (c C + k Omega^2) for B points, with c [s] and k [s2] of shape (B,)."""
        squares = omega_n**2
        if not self.couples_modes:
            return StepMatrix(mass + rest * (c[:, None] * self.C + k[:, None] * squares), is_inverse=False)
        A = mass * np.eye(len(squares)) + rest * (c[:, None, None] * self.C + k[:, None, None] * np.diag(squares))
        return StepMatrix(np.linalg.inv(A), is_inverse=True)


class Flexibility:
    """A complex matrix over the modes for each harmonic of a set, applied to real coefficients.

    ``c`` is (m, n_harmonics) if the matrices are diagonal, otherwise (n_harmonics, m, m); read-only.
    """

    def __init__(self, c: np.ndarray):
        self.c = c
        c.flags.writeable = False

    def apply(self, q: np.ndarray) -> np.ndarray:
        """Return the real coefficients of c_n q_n for modal forces q, real coefficients (m, N_H) or (m, n, N_H)."""
        if self.c.ndim == 3:
            n = q.shape[1] if q.ndim == 3 else 1
            q_n = to_complex(q.reshape(len(q) * n, q.shape[-1])).T.reshape(len(self.c), len(q), n)
            return to_real(np.moveaxis(self.c @ q_n, 0, -1).reshape(len(q) * n, len(self.c)), q.shape[-1]).reshape(q.shape)
        in_phase, in_quadrature = (c[:, -q.shape[-1] :] for c in self._real_form)
        if q.ndim == 3:
            in_phase, in_quadrature = in_phase[:, None], in_quadrature[:, None]
        return in_phase * q + in_quadrature * q.take(_other_coefficients(q.shape[-1]), axis=-1)

    @property
    def couples_modes(self) -> bool:
        """Whether the damping couples modes."""
        return self.c.ndim == 3

    @property
    def matrices(self) -> np.ndarray:
        """The matrices c_n, (n_harmonics, m, m)."""
        return self.c if self.couples_modes else _full(self.c)

    @cached_property
    def _real_form(self) -> tuple[np.ndarray, np.ndarray]:
        """Factors of a coefficient and of the other one of its harmonic, (m, 2 n_harmonics) each; of a mean the second ones.

        NumPy rounds products of complex numbers by their distance in memory; those of real numbers repeat to the last bit.
        """
        in_quadrature = np.repeat(self.c.imag, 2, axis=1)
        in_quadrature[:, 1::2] *= -1.0
        return np.repeat(self.c.real, 2, axis=1), in_quadrature

    def adjoint(self) -> Flexibility:
        """Return the flexibility with c_n^H instead of c_n: ``apply`` then uses the transposed real matrix."""
        return Flexibility(self.c.conj() if self.c.ndim == 2 else self.c.conj().swapaxes(1, 2))

    def between(self, x: np.ndarray, i: int, y: np.ndarray) -> np.ndarray:
        """Return x c_n y^H, complex (a, b), for the i-th harmonic and participations x (a, m) and y (b, m)."""
        c = self.c[:, i] if self.c.ndim == 2 else self.c[i]
        if np.iscomplexobj(x) or np.iscomplexobj(y):
            return (x * c if c.ndim == 1 else x @ c) @ y.conj().T
        real, imaginary = ((x * part if part.ndim == 1 else x @ part.copy()) @ y.T for part in (c.real, c.imag))
        return real + 1j * imaginary

    def row(self, j: int, i: int) -> np.ndarray:
        """Return row j of c_n for the i-th harmonic, complex (m,)."""
        return np.eye(len(self.c))[j] * self.c[j, i] if self.c.ndim == 2 else self.c[i, j]


class DynamicFlexibility(Flexibility):
    """c_n = D_n^-1 - Omega^-2 [s2] at one frequency, D_n = Omega^2 - (n omega)^2 + i n omega phi^H C phi.

    docs/theory.md, eq. (4.1).  Structural damping adds i eta phi^T K phi to D_n for n > 0, eq. (13.2).

    Parameters
    ----------
    omega_n : (m,) natural frequencies [rad/s]
    n : (n_harmonics,) numbers of the harmonics
    omega : excitation frequency [rad/s]
    springs : (m,) additional stiffness of the modes in harmonic 1 only [1/s2]: D_1 + diag(springs); None: none
    """

    def __init__(self, omega_n: np.ndarray, damping: Damping, n: np.ndarray, omega: float, springs: np.ndarray | None = None):
        self.damping, self.n, self.n_omega, self.squares = damping, n, n * omega, omega_n**2
        further = np.zeros((len(omega_n), 1)) if springs is None else springs[:, None] * (n == 1)
        if damping.couples_modes:
            stiffness = np.diag(self.squares) - self.n_omega[:, None, None] ** 2 * np.eye(len(omega_n))
            stiffness = stiffness + further.T[:, :, None] * np.eye(len(omega_n))
            resistance = 1j * self.n_omega[:, None, None] * damping.C
            if damping.S is not None:
                resistance = resistance + 1j * (n > 0)[:, None, None] * damping.S
            self.inverse = _inverses(stiffness + resistance)
            super().__init__(self.inverse - np.diag(1.0 / self.squares))
        else:
            w2, resistance = self.squares[:, None], 1j * damping.C[:, None] * self.n_omega
            if damping.S is not None:
                resistance = resistance + 1j * damping.S[:, None] * (n > 0)
            self.D = w2 - self.n_omega**2 + resistance + further
            # 1 / D - 1 / w2 without cancellation far below the mode; no number at a resonance without damping
            unbounded, difference = np.full(self.D.shape, np.nan + 0j), self.n_omega**2 - resistance - further
            super().__init__(np.divide(difference, w2 * self.D, out=unbounded, where=self.D != 0.0))

    def rate(self, d_omega: float = 1.0, d_sigma: float = 0.0, d_C: Damping | None = None) -> Flexibility:
        """Return the rate of c_n for the rates ``d_omega`` of omega, ``d_sigma`` of a damping sigma M at sigma = 0, ``d_C``.

        ``d_C`` is that of C and S; where it couples modes the result is full for any damping.
        """
        terms = [self._of_omega * d_omega] if d_omega != 0.0 or (d_sigma == 0.0 and d_C is None) else []
        if d_sigma != 0.0:
            terms.append(self._of_damping(Damping(np.ones(len(self.squares)))) * d_sigma)
        if d_C is not None:
            terms.append(self._of_damping(d_C))
        if any(term.ndim == 3 for term in terms):
            terms = [term if term.ndim == 3 else _full(term) for term in terms]
        return Flexibility(sum(terms[1:], start=terms[0]))

    @cached_property
    def _of_omega(self) -> np.ndarray:
        """d c_n / d omega [s3], with the shape of c_n."""
        n, n_omega = self.n, self.n_omega
        if not self.damping.couples_modes:
            return (2.0 * n * n_omega - 1j * self.damping.C[:, None] * n) / self.D**2
        dD = -2.0 * (n * n_omega)[:, None, None] * np.eye(len(self.squares)) + 1j * n[:, None, None] * self.damping.C
        return -self.inverse @ dD @ self.inverse

    def _of_damping(self, d: Damping) -> np.ndarray:
        """Return the rate of c_n for the rates of C and S, with the shape of c_n, or full."""
        vibrates, S = self.n > 0, np.zeros_like(d.C) if d.S is None else d.S
        if not (d.couples_modes or self.damping.couples_modes):
            d_D = self.n_omega * d.C[:, None] + vibrates * S[:, None]
            return -1j * d_D * (self.c + 1.0 / self.squares[:, None]) ** 2
        inverse = self.inverse if self.damping.couples_modes else _full(self.c + 1.0 / self.squares[:, None])
        if not d.couples_modes:
            return -1j * (inverse @ ((self.n_omega[:, None] * d.C + vibrates[:, None] * S)[:, :, None] * inverse))
        return -1j * (inverse @ (self.n_omega[:, None, None] * d.C + vibrates[:, None, None] * S) @ inverse)

    def whole(self, q: np.ndarray, i: int) -> np.ndarray:
        """Return D_n^-1 q, complex (m, k), for the i-th harmonic: modal amplitudes under modal forces q (m, k)."""
        if self.damping.couples_modes:
            return (self.c[i] + np.diag(1.0 / self.squares)) @ q
        return (self.c[:, i] + 1.0 / self.squares)[:, None] * q


@cache
def _other_coefficients(N_H: int) -> np.ndarray:
    """Return the place of the sine of each cosine and of the cosine of each sine, (N_H,); any of a mean, whose factor is 0."""
    first = N_H % 2
    return np.maximum((np.arange(first, N_H + first) ^ 1) - first, 0)


def _full(c: np.ndarray) -> np.ndarray:
    """Return diagonals (m, n_harmonics) as matrices (n_harmonics, m, m)."""
    return c.T[:, :, None] * np.eye(len(c))


def _inverses(D: np.ndarray) -> np.ndarray:
    """Return the inverses of matrices (n, m, m); of one that is singular, at a resonance without damping, no numbers."""
    try:
        return np.linalg.inv(D)
    except np.linalg.LinAlgError:
        if len(D) > 1:
            return np.concatenate([_inverses(each[None]) for each in D])
        return np.full(D.shape, np.nan, dtype=complex)


class StepMatrix:
    """A positive definite matrix over the modes for each of B points: diagonal (B, m), or the inverse of a full one (B, m, m)."""

    def __init__(self, values: np.ndarray, is_inverse: bool):
        self.values, self.is_inverse = values, is_inverse

    def solve(self, q: np.ndarray) -> np.ndarray:
        """Return A^-1 q, (B, m) each."""
        return np.einsum("bij,bj->bi", self.values, q) if self.is_inverse else q / self.values

    def flexibility(self, scale: np.ndarray) -> StepFlexibility:
        """Return scale A^-1 for factors (B,)."""
        return StepFlexibility(scale[:, None, None] * self.values if self.is_inverse else scale[:, None] / self.values)


class StepFlexibility:
    """d eta / d q at the end of a time step [s2] of B points, (B, m) diagonal or (B, m, m) full."""

    def __init__(self, values: np.ndarray):
        self.values = values

    def apply(self, q: np.ndarray) -> np.ndarray:
        """Return (d eta / d q) q, (B, m) each."""
        return self.values * q if self.values.ndim == 2 else np.einsum("bij,bj->bi", self.values, q)

    def between(self, x: np.ndarray, b: int, y: np.ndarray) -> np.ndarray:
        """Return x (d eta / d q) y^T, (k, l), for the b-th point and participations x (k, m) and y (l, m)."""
        d = self.values[b]
        return (x * d if d.ndim == 1 else x @ d) @ y.T
