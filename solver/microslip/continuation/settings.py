"""Settings of a response: levels, range, steps and accuracy, those stated by the user and those selected by the program."""

from __future__ import annotations

from dataclasses import dataclass

from ..points.band import Band


@dataclass(frozen=True, kw_only=True)
class ResponseSettings:
    """Levels and frequencies of the curves, and how their points are solved."""

    levels: tuple[float, ...]  # N
    band: Band
    at: tuple[float, ...] = ()  # Hz, that must be points
    direction: str = "up"
    points: int = 100  # a level
    ds: float | None = None  # stated step lengths, as shares of the length of the linear curve
    ds_min: float | None = None
    ds_max: float | None = None
    samples: int = 128
    follows_path: bool = True  # between them; else the contact law uses the samples alone
    tolerance: float = 1e-8
    accuracy: float | None = None  # of the response over its peak; None: harmonics, samples and steps are as stated
    is_corrected: bool = False  # whether the accuracy counts for the corrected amplitude
    keeps: frozenset[str] = frozenset()  # of harmonics, samples, solver: those stated in addition to the accuracy
    chooses_steps: bool = True  # whether steps follow from the accuracy
    peaks: bool = False  # whether maxima of the outputs are solved for
    stability: bool = False  # whether the multipliers of every point are computed
    sensitivities: bool = False  # whether the derivatives of the outputs are computed at every point, and every peak
    loaded: int = 1  # highest harmonic of the loads, at least 1
