"""The dynamic part of the receptance and its derivative with respect to frequency.

The receptance of harmonic n between any two of loads, pairs and outputs with modal participations x, y is
(docs/theory.md, section 4)

    A_n(omega) = A_static + x^T c_n y,      c_n = D_n^-1 - diag(1 / omega_k^2),
    D_n = diag(omega_k^2 - (n omega)^2) + i n omega phi^T C phi,

diagonal with modal damping, D_kn = omega_k^2 - (n omega)^2 + 2 i zeta_k omega_k n omega, and full otherwise.
Harmonic coefficients are real, in the order of fourier/harmonics.py: [mean if there is one, cos n, sin n, ...], an odd number
exactly if there is a mean.  The complex amplitude of harmonic n is cos - i sin; each harmonic of the model's set has one.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .model import ReducedModel


@lru_cache(maxsize=4)
def dynamic_part(model: ReducedModel, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """Return c_n and d c_n / d omega [s2], [s3], complex.  Local; kept for the last few frequencies: do not write into them.

    Shape (n_phi, n_harmonics) with modal damping, (n_harmonics, n_phi, n_phi) with a full damping matrix.
    """
    n = model.harmonics.numbers
    n_omega = n * omega
    if model.C.ndim == 1:
        w2, C = model.omega_n[:, None] ** 2, model.C[:, None]
        D = w2 - n_omega**2 + 1j * C * n_omega
        # 1 / D - 1 / w2 without cancellation far below the mode
        return (n_omega**2 - 1j * C * n_omega) / (w2 * D), (2.0 * n * n_omega - 1j * C * n) / D**2
    inverse, one = _inverse_full(model, omega), np.eye(model.n_modes)
    dD = -2.0 * (n * n_omega)[:, None, None] * one + 1j * n[:, None, None] * model.C
    return inverse - np.diag(1.0 / model.omega_n**2), -inverse @ dD @ inverse


def damping_derivative(model: ReducedModel, omega: float) -> np.ndarray:
    """Return d c_n / d sigma [s3], complex, where sigma M is added to the damping matrix.  Local; shaped as c_n."""
    n_omega = omega * model.harmonics.numbers
    if model.C.ndim == 1:
        c, _ = dynamic_part(model, omega)
        return -1j * n_omega * (c + 1.0 / model.omega_n[:, None] ** 2) ** 2
    inverse = _inverse_full(model, omega)
    return -1j * n_omega[:, None, None] * (inverse @ inverse)


def _inverse_full(model: ReducedModel, omega: float) -> np.ndarray:
    """Return D_n^-1 with a full damping matrix, (n_harmonics, n_phi, n_phi).  Local."""
    n_omega = omega * model.harmonics.numbers[:, None, None]
    return np.linalg.inv(np.diag(model.omega_n**2) - n_omega**2 * np.eye(model.n_modes) + 1j * n_omega * model.C)


def to_complex(coefficients: np.ndarray) -> np.ndarray:
    """Return complex amplitudes (m, n_harmonics) of real coefficients (m, N_H).  Local."""
    first = coefficients.shape[1] % 2  # column of the first cosine
    amplitudes = np.empty((coefficients.shape[0], (coefficients.shape[1] + 1) // 2), dtype=complex)
    amplitudes[:, :first] = coefficients[:, :first]
    amplitudes[:, first:] = coefficients[:, first::2] - 1j * coefficients[:, first + 1 :: 2]
    return amplitudes


def to_real(amplitudes: np.ndarray, N_H: int) -> np.ndarray:
    """Return real coefficients (m, N_H) of complex amplitudes (m, n_harmonics).  Local."""
    first = N_H % 2
    coefficients = np.empty((amplitudes.shape[0], N_H))
    coefficients[:, :first] = amplitudes[:, :first].real
    coefficients[:, first::2] = amplitudes[:, first:].real
    coefficients[:, first + 1 :: 2] = -amplitudes[:, first:].imag
    return coefficients


def modal(c: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the real coefficients of c_n q_n for modal forces q, real coefficients (n_phi, N_H), or (n_phi, n, N_H).  Local."""
    if c.ndim == 3:
        n = q.shape[1] if q.ndim == 3 else 1
        q_n = to_complex(q.reshape(len(q) * n, q.shape[-1])).T.reshape(len(c), len(q), n)
        return to_real(np.moveaxis(c @ q_n, 0, -1).reshape(len(q) * n, len(c)), q.shape[-1]).reshape(q.shape)
    first = q.shape[-1] % 2  # column of the first cosine
    c = c.conj() if q.ndim == 2 else c.conj()[:, None, :]
    y = np.empty(q.shape)
    y[..., :first] = c.real[..., :first] * q[..., :first]
    pairs = np.ascontiguousarray(q[..., first:], dtype=float).view(complex)  # cos + i sin, the conjugates of amplitudes
    np.multiply(c[..., first:], pairs, out=y[..., first:].view(complex))
    return y


def linear_motion_of_all(model: ReducedModel, level: float, omega: float) -> np.ndarray:
    """Return U_lin of all pairs, (3 n_pairs, N_H) [m].  Local."""
    f = level * model.f
    c, _ = dynamic_part(model, omega)
    return model.du_static @ f + model.r @ modal(c, model.b @ f)


def linear_motion(model: ReducedModel, level: float, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """Return U_lin and d U_lin / d omega of this rank's pairs, each (3 n_owned, N_H) [m], [m s].  Local."""
    f = level * model.f
    c, dc = dynamic_part(model, omega)
    rows, q = model.owned_rows, model.b @ f
    return model.du_static[rows] @ f + model.r[rows] @ modal(c, q), model.r[rows] @ modal(dc, q)


def output_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
    """Return the coefficients of the outputs, (n_outputs, N_H) [m], under the load and ``p`` (3 n_pairs, N_H).  Local."""
    f = level * model.f
    c, _ = dynamic_part(model, omega)
    q = model.b @ f - model.r.T @ p
    return model.out_static @ f - model.out_R @ p + model.o @ modal(c, q)


def load_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
    """Return the coefficients of f^T u, the motion along each load, (n_loads, N_H) [m].  Local."""
    f = level * model.f
    c, _ = dynamic_part(model, omega)
    q = model.b @ f - model.r.T @ p
    return model.load_static @ f - model.du_static.T @ p + model.b.T @ modal(c, q)


def modal_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
    """Return the complex modal amplitudes eta_n = D_n^-1 phi^T (f - R^T p), (n_phi, n_harmonics).  Local."""
    c, _ = dynamic_part(model, omega)
    q = level * model.b @ model.f - model.r.T @ p
    return to_complex(modal(c, q)) + to_complex(q) / model.omega_n[:, None] ** 2
