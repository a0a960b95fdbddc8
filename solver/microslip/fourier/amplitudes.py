"""Complex amplitudes, cos - i sin, of real Fourier coefficients, and back.  NumPy only; every function is local.

Coefficients run in the order of harmonics.py, an odd number exactly if there is a mean; each harmonic has one amplitude.
"""

import numpy as np


def to_complex(coefficients: np.ndarray) -> np.ndarray:
    """Return complex amplitudes (m, n_harmonics) of real coefficients (m, N_H)."""
    first = coefficients.shape[1] % 2  # column of the first cosine
    amplitudes = np.empty((coefficients.shape[0], (coefficients.shape[1] + 1) // 2), dtype=complex)
    amplitudes[:, :first] = coefficients[:, :first]
    np.conjugate(np.ascontiguousarray(coefficients[:, first:], dtype=float).view(complex), out=amplitudes[:, first:])
    return amplitudes


def to_real(amplitudes: np.ndarray, N_H: int) -> np.ndarray:
    """Return real coefficients (m, N_H) of complex amplitudes (m, n_harmonics)."""
    first = N_H % 2
    coefficients = np.empty((amplitudes.shape[0], N_H))
    coefficients[:, :first] = amplitudes[:, :first].real
    np.conjugate(amplitudes[:, first:], out=coefficients[:, first:].view(complex))
    return coefficients


def matrix_times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the real coefficients of A x_n, (m, N_H), for those of x_n (n, N_H); a complex A has no mean to multiply.

    docs/theory.md, eq. (4.6).
    """
    return A @ x if A.dtype.kind != "c" else (A @ _conjugates(x).conj()).conj().view(float)


def loaded_times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the real coefficients of A x_n as ``matrix_times``, for few harmonics with loads: vanishing x_n cost nothing."""
    if A.dtype.kind == "c":
        return matrix_times(A, x)
    product, loaded = np.zeros((len(A), x.shape[1])), x.any(axis=0)
    product[:, loaded] = A @ x[:, loaded]
    return product


def adjoint_times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the real coefficients of A^H x_n, (n, N_H), for those of x_n (m, N_H): the transposed of ``matrix_times``.

    docs/theory.md, eq. (4.6).
    """
    return A.T @ x if A.dtype.kind != "c" else (A.T @ _conjugates(x)).view(float)


def _conjugates(x: np.ndarray) -> np.ndarray:
    """Return the conjugates cos + i sin (m, N_H / 2) of amplitudes with real coefficients x (m, N_H), without a mean."""
    return np.ascontiguousarray(x, dtype=float).view(complex)
