"""The dynamic part of the receptance and its derivative with respect to frequency.

The receptance of harmonic n between any two of loads, pairs and outputs with modal participations x, y is
(docs/theory.md, section 4)

    A_n(omega) = A_static + sum_k x_k y_k c_kn,      c_kn = 1 / D_kn - 1 / omega_k^2,
    D_kn = omega_k^2 - (n omega)^2 + 2 i zeta_k omega_k n omega.

Harmonic coefficients are real, [mean, cos 1, sin 1, ...]; the complex amplitude of harmonic n is cos - i sin.
"""

from __future__ import annotations

import numpy as np

from .model import ReducedModel


def dynamic_stiffness(model: ReducedModel, omega: float) -> np.ndarray:
    """Return D_kn, shape (n_phi, H + 1), complex [1/s2].  Local."""
    n_omega = omega * np.arange(model.N_H // 2 + 1)
    w, zeta = model.omega_n[:, None], model.zeta[:, None]
    return w**2 - n_omega**2 + 2j * zeta * w * n_omega


def dynamic_part(model: ReducedModel, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """Return c_kn and d c_kn / d omega, each (n_phi, H + 1), complex [s2].  Local."""
    n = np.arange(model.N_H // 2 + 1)
    w, zeta = model.omega_n[:, None], model.zeta[:, None]
    D = dynamic_stiffness(model, omega)
    n_omega = n * omega
    # 1/D - 1/w^2 without cancellation far below the mode
    c = (n_omega**2 - 2j * zeta * w * n_omega) / (w**2 * D)
    dD = -2.0 * n * n_omega + 2j * zeta * w * n
    return c, -dD / D**2


def to_complex(coefficients: np.ndarray) -> np.ndarray:
    """Return complex amplitudes (m, H + 1) of real coefficients (m, 2 H + 1).  Local."""
    amplitudes = np.empty((coefficients.shape[0], coefficients.shape[1] // 2 + 1), dtype=complex)
    amplitudes[:, 0] = coefficients[:, 0]
    amplitudes[:, 1:] = coefficients[:, 1::2] - 1j * coefficients[:, 2::2]
    return amplitudes


def to_real(amplitudes: np.ndarray) -> np.ndarray:
    """Return real coefficients (m, 2 H + 1) of complex amplitudes (m, H + 1).  Local."""
    coefficients = np.empty((amplitudes.shape[0], 2 * amplitudes.shape[1] - 1))
    coefficients[:, 0] = amplitudes[:, 0].real
    coefficients[:, 1::2] = amplitudes[:, 1:].real
    coefficients[:, 2::2] = -amplitudes[:, 1:].imag
    return coefficients


def modal(c: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the real coefficients of c * q for modal forces q, real coefficients (n_phi, N_H).  Local."""
    return to_real(c * to_complex(q))


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
    """Return the complex modal amplitudes eta_kn = phi_k^T (f - R^T p) / D_kn, (n_phi, H + 1).  Local."""
    q = level * model.b @ model.f - model.r.T @ p
    return to_complex(q) / dynamic_stiffness(model, omega)
