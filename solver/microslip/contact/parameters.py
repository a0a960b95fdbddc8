"""Variable parameters of contact laws: columns with new values, and functions common to the parameter derivatives of all laws."""

from __future__ import annotations

import numpy as np

from ..fourier.harmonics import Harmonics

PARAMETERS = ("mu", "N0", "gap", "k_t", "k_n", "slip_force")  # gap [m]: -N0 / k_n of pairs without preload


def not_among(name: str, law: str, has: tuple[str, ...]) -> ValueError:
    """Return the error for a parameter that a law does not have."""
    return ValueError(f"{law} has no parameter {name!r}, but {', '.join(has)}")


def column_with(column: np.ndarray, pairs: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a copy of a column (n,) with new ``values`` (m,) for some ``pairs`` (m,).  Local."""
    changed = column.copy()
    changed[pairs] = values
    return changed


def with_mean(U: np.ndarray, harmonics: Harmonics | None) -> tuple[np.ndarray, Harmonics, slice]:
    """Return a motion (n, 3, N_H) extended by a mean if it has none, its harmonics, the slice of the given ones.  Local."""
    harmonics = harmonics or Harmonics.full(U.shape[2])
    if harmonics.has_mean:
        return U, harmonics, slice(None)
    return np.pad(U, ((0, 0), (0, 0), (1, 0))), Harmonics((0, *harmonics.chosen)), slice(1, None)
