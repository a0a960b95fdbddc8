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


def preload_with(name: str, N0: np.ndarray, k_n: np.ndarray, pairs: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return N0 (n,) with new preloads, or gaps, for some pairs.  Local.

    Raises
    ------
    ValueError : a pair would change from preload to gap or back, which would change its state and its springs at rest
    """
    changed = column_with(N0, pairs, values if name == "N0" else -k_n[pairs] * values)
    crosses = (changed > 0.0) != (N0 > 0.0)
    if crosses.any():
        i = np.argmax(crosses)
        raise ValueError(
            f"N0 of pair {i} goes from {N0[i]:g} to {changed[i]:g}: a preload cannot become a gap, or a gap a preload"
        )
    return changed


def preload_of_gaps(N0: np.ndarray, k_n: np.ndarray) -> np.ndarray:
    """Return the derivative of N0 (n,) by k_n at a constant gap, -gap; 0 of pairs with a preload.  Local."""
    return np.divide(np.minimum(N0, 0.0), k_n, out=np.zeros_like(k_n), where=k_n > 0.0)


def with_mean(U: np.ndarray, harmonics: Harmonics | None) -> tuple[np.ndarray, Harmonics, slice]:
    """Return a motion (n, 3, N_H) extended by a mean if it has none, its harmonics, the slice of the given ones.  Local."""
    harmonics = harmonics or Harmonics.full(U.shape[2])
    if harmonics.has_mean:
        return U, harmonics, slice(None)
    return np.pad(U, ((0, 0), (0, 0), (1, 0))), Harmonics((0, *harmonics.chosen)), slice(1, None)
