"""Motions of a reduced model under its loads at a level and contact forces p, (3 n_pairs, N_H), of all pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..fourier.amplitudes import to_complex
from .damping import Flexibility
from .family import ModalFamily
from .reduced_model import ReducedModel


class ActingForces(NamedTuple):
    """What acts on a structure at a point: all its motion follows from that."""

    level: float  # N
    omega: float  # rad/s
    p: np.ndarray  # (3 n_pairs, N_H) N, of the full set of harmonics 0 to H


def linear_motion(model: ReducedModel, level: float, omega: float, rows: slice | None = None) -> np.ndarray:
    """Return U_lin of (5.1), the motion with all pairs stuck, of this rank's pairs or given rows, (n_rows, N_H) [m].  Local."""
    rows = model.owned_rows if rows is None else rows
    dynamic = _moved(model, lambda family: family.R_phi[rows], model.flexibilities(omega), modal_forces(model, level))
    return model.du_static[rows] @ (level * model.f) + dynamic


def static_motion(model: ReducedModel, level: float) -> np.ndarray:
    """Return du_static f, U_lin as it would be if nothing had inertia, of this rank's pairs, (3 n_owned, N_H) [m].  Local."""
    return model.du_static[model.owned_rows] @ (level * model.f)


def linear_motion_rate(model: ReducedModel, level: float, omega: float, d_omega: float = 1.0, d_sigma: float = 0.0) -> np.ndarray:
    """Return the rate of U_lin while omega and a damping sigma M change at given rates, (3 n_owned, N_H).  Local."""
    rates = [c.rate(d_omega, d_sigma) for c in model.flexibilities(omega)]
    return _moved(model, lambda family: family.R_phi[model.owned_rows], rates, modal_forces(model, level))


def output_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
    """Return the coefficients of the outputs, (n_outputs, N_H), in their units.  Local."""
    dynamic = _moved(model, lambda family: family.o, model.flexibilities(omega), modal_forces(model, level, p))
    u = model.out_static @ (level * model.f) - model.out_R @ p + dynamic
    return u if model.observed is None else model.observed.motion(u, p, level * model.f, model.harmonics, omega)


def load_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
    """Return the coefficients of f^T u, the motion along each load, (n_loads, N_H) [m].  Local."""
    dynamic = _moved(model, lambda family: family.b.T, model.flexibilities(omega), modal_forces(model, level, p))
    return model.load_static @ (level * model.f) - model.du_static.T @ p + dynamic


def modal_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> list[np.ndarray]:
    """Return the complex modal amplitudes D_n^-1 phi^T (f - R^T p) of each share, (m, n_harmonics) of its own.  Local."""
    return [
        to_complex(c.apply(q)) + to_complex(q) / share.family.omega_n[:, None] ** 2
        for share, c, q in zip(model.shares, model.flexibilities(omega), modal_forces(model, level, p))
    ]


def modal_forces(model: ReducedModel, level: float, p: np.ndarray | None = None) -> list[np.ndarray]:
    """Return phi^T (f - R^T p) of each share, (m, N_H) of its own; of the loads alone without ``p``.  Local."""
    f = level * model.f
    q = [share.family.b @ f[:, share.columns] for share in model.shares]
    if p is None:
        return q
    return [q_k - share.family.R_phi.T @ p[:, share.columns] for share, q_k in zip(model.shares, q)]


def _moved(
    model: ReducedModel, seen_by: Callable[[ModalFamily], np.ndarray], c: Sequence[Flexibility], q: list[np.ndarray]
) -> np.ndarray:
    """Return x c_n q_n, (n, N_H), as seen by participations x (n, m) of each family."""
    return model.joined([seen_by(share.family) @ c_k.apply(q_k) for share, c_k, q_k in zip(model.shares, c, q)])
