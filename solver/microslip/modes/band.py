"""The frequencies of a curve, where the scene states them relative to a mode."""

from __future__ import annotations

import numpy as np

from ..parallel.errors import CaseError


def frequency_band(response, omega_n: np.ndarray) -> tuple[float, float]:
    """Return the lowest and the highest frequency of [response] in Hz.  Local.

    Raises
    ------
    CaseError : the mode asked for was not computed
    """
    if response.frequencies is not None:
        return response.frequencies
    if response.mode > len(omega_n):
        raise CaseError(f"[response] mode = {response.mode}, but only {len(omega_n)} modes were computed; raise [solver] modes")
    low, high = (share * omega_n[response.mode - 1] / (2 * np.pi) for share in response.span)
    return float(low), float(high)
