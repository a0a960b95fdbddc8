"""How many modes: as many as the scene says, or the fewest whose bound meets the accuracy it asks for."""

from __future__ import annotations

import numpy as np

from ..modes.band import frequency_band
from ..modes.eigen import Modes, first_of, is_complete, lowest_modes
from ..modes.limits import FEW, SHARE, most_modes
from ..parallel.errors import CaseError
from ..scene.schema import DEFAULT_ACCURACY
from .truncation import LeftOut, left_out

_AT_ONCE = 400  # DOFs up to which LAPACK finds all modes at once
_START, _MOST = 12, 600  # modes of the first batch, each further one has twice as many; and of the last
_EQUAL = 1e-6  # relative difference of equal frequencies, which are kept or left out together


def choose_modes(linearised, pairs, scene) -> tuple[Modes, str]:
    """Return the modes of the stuck structure that the scene needs, and a line that says why so many.

    Collective on the system's communicator.

    Raises
    ------
    CaseError : the accuracy asked for needs more modes than are computed
    ConvergenceError : the modes did not converge
    """
    solver, n_dof = scene.solver, linearised.system.n_dof
    if solver.modes is not None:
        modes = lowest_modes(linearised, solver.modes, solver.verify_modes)
        return modes, f"modes: {solver.modes}, as [solver] modes says" + _missing(modes, scene.response, n_dof)
    if n_dof <= FEW:
        modes = lowest_modes(linearised, n_dof, solver.verify_modes, fewer_will_do=True)
        return modes, f"modes: all {len(modes.omega_n)} there are"
    return _fewest(linearised, pairs, scene, solver.accuracy or DEFAULT_ACCURACY)


def _missing(modes: Modes, response, n_dof: int) -> str:
    """Say that resonances may be missing, where the modes that the scene states end below the end of its range.  Local."""
    n_modes = len(modes.omega_n)
    if n_modes in (0, n_dof):
        return ""
    last, highest = modes.omega_n[-1] / (2.0 * np.pi), frequency_band(response, modes.omega_n)[1]
    if last >= highest:
        return ""
    return (
        f"; WARNING: they end at {last:.6g} Hz, within the range up to {highest:.6g} Hz: resonances between may be missing, "
        "and error bars do not know of them"
    )


def _fewest(linearised, pairs, scene, accuracy: float) -> tuple[Modes, str]:
    """Return the fewest modes whose bound meets the accuracy, from batches of growing size."""
    n_dof, verify = linearised.system.n_dof, scene.solver.verify_modes
    cap = n_dof if n_dof <= SHARE * _MOST else min(_MOST, most_modes(n_dof))
    n_batch = max(_START, (scene.response.mode or 0) + 1)
    while True:
        n_batch = n_dof if n_dof <= _AT_ONCE or (SHARE * n_batch > n_dof and cap == n_dof) else min(n_batch, cap)
        modes = lowest_modes(linearised, n_batch, verify=False, fewer_will_do=True)
        n_found = len(modes.omega_n)
        is_all, is_last = n_found < n_batch or n_found == n_dof, n_batch == cap
        if (scene.response.mode or 0) < n_found or is_all or is_last:
            bound = left_out(linearised, modes, pairs, scene)
            n_modes = linearised.system.comm.bcast(_first_within(bound.total, modes.omega_n, scene.response, accuracy))
            if n_modes is None and is_all:
                return modes, f"modes: all {n_found} there are; leaving any out would cost the accuracy {accuracy:g}"
            if n_modes is None and is_last:
                n_modes = _out_of_reach(bound.total, scene)
            if n_modes and (not verify or is_complete(linearised, modes, n_modes)):
                return first_of(modes, n_modes), _why(n_modes, modes.omega_n, bound, accuracy)
        if is_last:
            return lowest_modes(linearised, n_found), f"modes: {n_found}, the most the program picks by itself"
        n_batch *= 2


def _first_within(bound: np.ndarray, omega_n: np.ndarray, response, accuracy: float) -> int | None:
    """Return the least number of modes within the accuracy, with all modes of the range among them.  Local."""
    highest = 2.0 * np.pi * frequency_band(response, omega_n)[1]
    following = omega_n[1:]
    good = (bound[:-1] <= accuracy) & (following > highest) & (following > (1.0 + _EQUAL) * omega_n[:-1])
    good[: (response.mode or 1) - 1] = False
    return int(np.argmax(good)) + 1 if good.any() else None


def _out_of_reach(bound: np.ndarray, scene) -> int:
    """Return all modes but one, the next one known, where the scene leaves the accuracy to the program; refuse otherwise."""
    n_modes = len(bound) - 1
    if scene.solver.accuracy is not None:
        raise CaseError(
            f"{scene.path}: [solver] accuracy = {scene.solver.accuracy:g}: {n_modes} modes reach about "
            f"{bound[n_modes - 1]:.1e}, and the program picks no more by itself; ask for that, or state modes"
        )
    return n_modes


def _why(n_modes: int, omega_n: np.ndarray, bound: LeftOut, accuracy: float) -> str:
    k, hertz = n_modes - 1, omega_n[n_modes] / (2 * np.pi)
    is_met = bound.total[k] <= accuracy
    goal = f"picked for accuracy {accuracy:g}" if is_met else f"which misses the default accuracy {accuracy:g}"
    return (
        f"modes: {n_modes}, {goal}: those left out, from {hertz:.6g} Hz, change the response by at most about "
        f"{bound.total[k]:.1e} of its linear peak ({bound.direct[k]:.1e} directly, {bound.joint[k]:.1e} through the joint)"
    )
