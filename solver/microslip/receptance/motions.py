"""Motions of a reduced model under its loads at a level and the contact forces p of all pairs, (3 n_pairs, N_H)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..fourier.amplitudes import matrix_times
from .damping import Damping
from .reduced_model import ReducedModel


class ActingForces(NamedTuple):
    """The forces on a structure at a point, which determine its motion."""

    level: float  # N
    omega: float  # rad/s
    p: np.ndarray  # (3 n_pairs, N_H) N, of the full set of harmonics 0 to H


def linear_motion(model: ReducedModel, level: float, omega: float, rows: slice | None = None) -> np.ndarray:
    """Return U_lin of (5.1), the motion with all pairs stuck, of this rank's pairs or given rows, (n_rows, N_H) [m].  Local."""
    rows, f = model.owned_rows if rows is None else rows, level * model.f
    of_groups = zip(model.groups, model.flexibilities(omega))
    return model.joined([group.receptance.linear_motion(f[:, group.columns], c, rows) for group, c in of_groups])


def static_motion(model: ReducedModel, level: float) -> np.ndarray:
    """Return du_static f, the quasi-static U_lin of this rank's pairs, (3 n_owned, N_H) [m].  Local."""
    f, owned = level * model.f, model.owned_rows
    return model.joined([matrix_times(group.receptance.static.du_static[owned], f[:, group.columns]) for group in model.groups])


def linear_motion_rate(
    model: ReducedModel,
    level: float,
    omega: float,
    d_omega: float = 1.0,
    d_sigma: float = 0.0,
    d_C: Sequence[Damping] | None = None,
) -> np.ndarray:
    """Return the rate of U_lin, (3 n_owned, N_H), with rates as in :meth:`ReceptanceColumns.apply_rate`.  Local."""
    f, owned = level * model.f, model.owned_rows
    if d_omega == d_sigma == 0.0 and d_C is None:
        return np.zeros((3 * (model.owned.stop - model.owned.start), model.N_H))
    of_groups = zip(model.groups, model.flexibility_rates(omega, d_omega, d_sigma, d_C))
    return model.joined([group.receptance.linear_motion_rate(f[:, group.columns], rate, owned) for group, rate in of_groups])


def output_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
    """Return the coefficients of the outputs, (n_outputs, N_H), in their units.  Local."""
    f, of_groups = level * model.f, zip(model.groups, model.flexibilities(omega))
    terms = [group.receptance.output_motion(f[:, group.columns], p[:, group.columns], c) for group, c in of_groups]
    u = model.joined(terms)
    return u if model.observed is None else model.observed.motion(u, p, f, model.harmonics, omega)


def load_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
    """Return the coefficients of f^H u, the motion along each load, (n_loads, N_H) [m].  Local."""
    f, of_groups = level * model.f, zip(model.groups, model.flexibilities(omega))
    return model.joined([group.receptance.load_motion(f[:, group.columns], p[:, group.columns], c) for group, c in of_groups])


def modal_motion(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> list[np.ndarray]:
    """Return the complex modal amplitudes D_n^-1 phi^H (f - R^H p) of each group, (m, n_harmonics) each.  Local."""
    f, of_groups = level * model.f, zip(model.groups, model.flexibilities(omega))
    return [group.receptance.modal_motion(f[:, group.columns], p[:, group.columns], c) for group, c in of_groups]
