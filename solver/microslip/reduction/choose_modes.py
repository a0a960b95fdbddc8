"""The number of modes: as stated, or the fewest whose bound meets the requested accuracy."""

from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from ..messages.errors import CaseError
from ..modes.limits import FEW, SHARE, most_modes
from ..modes.shift_invert import ModeSearch
from ..points.band import Band, frequency_band
from .settings import ReductionSettings
from .stuck import StuckStructure
from .truncation import TruncationBound, truncation_bound

Stuck = TypeVar("Stuck", bound=StuckStructure)
_AT_ONCE = 400  # DOFs up to which LAPACK computes all modes at once
_START, _MOST = 12, 600  # modes of the first and the last batch; each batch has twice as many as the one before
_WITHOUT_DAMPING = (
    ": nothing damps a resonance in the range, and its linear peak, to which an accuracy refers, is infinite; "
    "state [damping], or [solver] modes"
)
_EQUAL = 1e-6  # relative difference of equal frequencies, which are used or truncated together


def choose_modes(stuck: Stuck, settings: ReductionSettings) -> tuple[Stuck, str]:
    """Return a stuck structure with the necessary number of modes in use, and a line on the reason for that number.

    Collective on the structure's communicator.  Modes computed before are reused; others are computed.

    Raises
    ------
    CaseError : the requested accuracy needs more modes than are computed, or nothing damps a resonance in the range
    ConvergenceError : the modes did not converge
    """
    n_dof = stuck.n_elastic
    if settings.modes is not None:
        stuck = stuck.with_lowest(settings.modes, settings.verify_modes)
        return stuck, as_stated(stuck.omega_n, settings, n_dof)
    if n_dof <= FEW:
        stuck = stuck.with_lowest(n_dof, settings.verify_modes, allows_fewer=True)
        return stuck, f"modes: all {stuck.n_modes} there are"
    return _fewest(stuck, settings)


def as_stated(omega_n: np.ndarray, settings: ReductionSettings, n_dof: int) -> str:
    """Return the line on the reason for a stated number of modes.  Local."""
    return f"modes: {settings.modes}, stated by [solver] modes" + _missing(omega_n, settings.band, n_dof)


def _missing(omega_n: np.ndarray, band: Band, n_dof: int) -> str:
    """Return a note that resonances may be missing, if the stated modes end below the end of the range.  Local."""
    if len(omega_n) in (0, n_dof):
        return ""
    last, highest = omega_n[-1] / (2.0 * np.pi), frequency_band(band, omega_n)[1]
    if last >= highest:
        return ""
    return (
        f"; WARNING: they end at {last:.6g} Hz, within the range up to {highest:.6g} Hz: resonances between may be missing, "
        "and error bars do not include them"
    )


def _fewest(stuck: Stuck, settings: ReductionSettings) -> tuple[Stuck, str]:
    """Return the fewest modes whose bound meets the accuracy, from batches of growing size."""
    n_dof, verify, mode = stuck.n_elastic, settings.verify_modes, settings.band.mode or 0
    n_computed, search = 0, None
    for n_batch, is_last in batches(n_dof, mode):
        if stuck.n_computed < n_batch:
            search = search or ModeSearch(stuck.linearised)
            stuck = stuck.with_modes(stuck.lowest_modes(n_batch, verify=False, allows_fewer=True, search=search))
        n_computed = min(n_batch, stuck.n_computed)
        is_all = n_computed < n_batch or n_computed == n_dof
        if mode < n_computed or is_all or is_last:
            batch = stuck.using(n_computed)
            bound = _bound(batch, settings)
            n_modes, why = stuck.comm.bcast(picked(bound, batch.omega_n, is_all, is_last, settings))
            if n_modes and (n_modes == n_computed or not verify):
                return stuck.using(n_modes), why
            chosen = stuck.using_proved(n_modes) if n_modes else None
            if chosen is not None:
                return chosen, why
    modes = stuck.lowest_modes(n_computed, search=search)
    return stuck.with_modes(modes), f"modes: {n_computed}, the largest number that the program chooses"


def _bound(stuck: StuckStructure, settings: ReductionSettings) -> TruncationBound:
    """Return the bounds of the modes of a structure for the harmonics of its group and of the conjugate one.  Collective."""
    structures = stuck.with_harmonics_of(settings.excitation.harmonics.above_mean) or [stuck]
    bounds = [truncation_bound(structure, settings) for structure in structures]
    return TruncationBound(*(np.max([getattr(b, part) for b in bounds], axis=0) for part in ("direct", "joint")))


def batches(n_dof: int, mode: int) -> Iterator[tuple[int, bool]]:
    """Yield the number of modes of each batch, and whether it is the last; ``mode`` is the highest requested mode.  Local."""
    cap = n_dof if n_dof <= SHARE * _MOST else min(_MOST, most_modes(n_dof))
    n_batch = max(_START, mode + 1)
    while True:
        n_batch = n_dof if n_dof <= _AT_ONCE or (SHARE * n_batch > n_dof and cap == n_dof) else min(n_batch, cap)
        yield n_batch, n_batch == cap
        if n_batch == cap:
            return
        n_batch *= 2


def picked(
    bound: TruncationBound, omega_n: np.ndarray, is_all: bool, is_last: bool, settings: ReductionSettings
) -> tuple[int | None, str]:
    """Return how many of the computed modes are needed and why, None if more must be computed.  Local.

    Raises
    ------
    CaseError : the requested accuracy needs more modes than are computed
    """
    n_modes = _first_within(bound.total, omega_n, settings)
    if n_modes is None and is_all:
        n_modes = len(omega_n)
        reason = "" if np.isfinite(bound.total[:-1]).all() else _WITHOUT_DAMPING
        return n_modes, f"modes: all {n_modes} there are; leaving any out would cost the accuracy {settings.accuracy:g}{reason}"
    if n_modes is None and is_last:
        n_modes = _out_of_reach(bound.total, settings)
    return n_modes, _why(n_modes, omega_n, bound, settings.accuracy) if n_modes else ""


def _first_within(bound: np.ndarray, omega_n: np.ndarray, settings: ReductionSettings) -> int | None:
    """Return the smallest number of modes within the accuracy that includes all modes in the range.  Local."""
    highest = 2.0 * np.pi * frequency_band(settings.band, omega_n)[1]
    following = omega_n[1:]
    good = (bound[:-1] <= settings.accuracy) & (following > highest) & (following > (1.0 + _EQUAL) * omega_n[:-1])
    good[: (settings.band.mode or 1) - 1] = False
    return int(np.argmax(good)) + 1 if good.any() else None


def _out_of_reach(bound: np.ndarray, settings: ReductionSettings) -> int:
    """Return all modes but the last, which bounds the truncation, with the default accuracy; refuse if an accuracy is stated."""
    n_modes = len(bound) - 1
    if settings.insists:
        raise CaseError(
            f"{settings.where}: [solver] accuracy = {settings.accuracy:g}: {n_modes} modes reach about "
            f"{bound[n_modes - 1]:.1e}, and the program chooses no more; state that accuracy, or modes"
        )
    return n_modes


def _why(n_modes: int, omega_n: np.ndarray, bound: TruncationBound, accuracy: float) -> str:
    k, hertz = n_modes - 1, omega_n[n_modes] / (2 * np.pi)
    if not np.isfinite(bound.total[k]):
        return f"modes: {n_modes}, the largest number that the program chooses{_WITHOUT_DAMPING}"
    is_met = bound.total[k] <= accuracy
    goal = f"picked for accuracy {accuracy:g}" if is_met else f"which misses the default accuracy {accuracy:g}"
    return (
        f"modes: {n_modes}, {goal}: those left out, from {hertz:.6g} Hz, change the response by at most about "
        f"{bound.total[k]:.1e} of its linear peak ({bound.direct[k]:.1e} directly, {bound.joint[k]:.1e} through the joint)"
    )
