"""The range of frequencies of a curve, stated in Hz or relative to a mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..messages.errors import CaseError
from ..messages.words import counted, verb


@dataclass(frozen=True, kw_only=True)
class Band:
    """A range of frequencies: either its two ends, or a mode and two factors of its natural frequency."""

    frequencies: tuple[float, float] | None = None  # Hz, the lower one first
    mode: int | None = None  # counted from 1
    span: tuple[float, float] | None = None  # relative to the frequency of the mode


def frequency_band(band: Band, omega_n: np.ndarray) -> tuple[float, float]:
    """Return the lowest and the highest frequency of a band in Hz.  Local.

    Raises
    ------
    CaseError : the requested mode was not computed
    """
    if band.frequencies is not None:
        return band.frequencies
    assert band.mode is not None and band.span is not None, "a band is stated in one of two ways"
    if band.mode > len(omega_n):
        raise CaseError(
            f"[response] mode = {band.mode}, but only {counted(len(omega_n), 'mode')} {verb(len(omega_n), 'were')} "
            "computed; raise [solver] modes"
        )
    low, high = (share * omega_n[band.mode - 1] / (2 * np.pi) for share in band.span)
    return float(low), float(high)
