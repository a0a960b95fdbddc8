"""The amplitudes that error bars are of, and what contact forces do to them.  Local."""

from __future__ import annotations

import numpy as np

from ..harmonic.operating_point import OperatingPoint
from ..receptance.motions import output_motion
from ..receptance.reduced_model import ReducedModel


def sensitivity(model: ReducedModel, omega: float) -> np.ndarray:
    """Return B, minus the derivative of the outputs' cos 1, then sin 1, with respect to p, (2 n_outputs, 3 n_pairs, N_H).

    docs/theory.md, eq. (11.1).  With A = o (K_L^-1 + phi c_1 phi^T) R^T the amplitude is u_lin - A p: the cosine moves by
    -(Re A p_c + Im A p_s), the sine by Im A p_c - Re A p_s.
    """
    A = model.output_receptance(omega, 1)
    n_out, cos = len(A), model.harmonics.columns(1).start
    B = np.zeros((2 * n_out, A.shape[1], model.N_H))
    B[:n_out, :, cos], B[:n_out, :, cos + 1] = A.real, A.imag
    B[n_out:, :, cos], B[n_out:, :, cos + 1] = -A.imag, A.real
    return B


def output_amplitude(model: ReducedModel, at: OperatingPoint, p: np.ndarray) -> np.ndarray:
    """Return cos 1 and then sin 1 of the outputs under loads and ``p`` (3 n_pairs, N_H), (2 n_outputs,) [m]."""
    motion = output_motion(model, at.level, at.omega, p)
    return motion[:, model.harmonics.columns(1)].T.ravel()
