"""Where a nonlinear mode begins: the structure at rest, and the amplitude at which the first pair slips, opens or touches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..contact.law import Law
from ..contact.laws import ELASTIC_COULOMB
from ..continuation.nonlinear_mode import NonlinearMode
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError, ResourceError
from ..messages.words import counted, verb
from ..receptance.other_springs import with_springs
from ..receptance.springs import SpringChange
from .build import WholeStructure
from .prepare import Prepared

ROUNDING = 1e-10  # of the largest motion of a pair in any mode
SLIPS_FROM = 1e-3  # of the amplitude at which a pair is at its limit, if a pair slips from the first motion on
AT_LIMIT = 1e-8  # of the amplitude without friction forces at rest: a pair that slips from less is at its friction limit at rest
FARTHEST = 1e4  # times the amplitude of first slip: the end of a mode without gross slip
FINER = 8  # times the samples of the scene, at which the linear motion is tested for slip
GROWTH, WITHIN = 1.05, 1e-9  # of an amplitude: growth of the next one tried, and the interval that encloses the first slip


@dataclass(frozen=True, eq=False)
class Begin:
    """The beginning of a nonlinear mode; the same on every rank."""

    amplitude: float  # kg^1/2 m, q at which the first pair slips, opens or touches; infinite if the mode moves no pair
    is_first_slip: bool = True  # False: some pairs slip from the first motion on, and q is a small amplitude


def has_springs_across_gap(pairs: ContactPairs) -> np.ndarray:
    """Return which pairs are open by a gap, but closed in the modes of the stuck structure, (n_pairs,) bool.  Local."""
    return (pairs.N0 < 0.0) & ~pairs.open_at_rest & (pairs.laws == ELASTIC_COULOMB)


def note_on_mode(prepared: Prepared) -> list[str]:
    """Return a note on a range about a mode that counts with pairs of a gap closed: its frequency with them open.  Collective."""
    mode, sweep = prepared.response.settings.band.mode, prepared.response.sweep
    n = np.count_nonzero(has_springs_across_gap(prepared.pairs))
    if mode is None or n == 0:
        return []
    note, omega = f"[response] mode = {mode} counts with {counted(n, 'pair')} of a gap closed", np.nan
    try:
        if not isinstance(prepared.structure, WholeStructure):  # which counts the modes of all nodal diameters together
            omega = pairs_without_springs(prepared)[0].model.receptance_of(1).modes.omega_n[mode - 1]
            note += f"; with them open its frequency is {omega / (2.0 * np.pi):.6g} Hz"
    except CaseError:
        note += "; with them open a body has no support"
    except ResourceError:
        pass  # too many pairs for the frequency
    is_inside = min(sweep.start, sweep.stop) <= omega <= max(sweep.start, sweep.stop)
    return [note if is_inside else f"WARNING: {note}; state frequencies if the pairs stay open"]


def pairs_without_springs(prepared: Prepared) -> tuple[Prepared, int]:
    """Return the structure in which pairs with a gap have no springs, and their number, 0 if nothing changes.

    Collective.  The modes of this structure are those of small vibration about rest.  Its damping matrix stays.

    Raises
    ------
    CaseError : without these springs a body has no support; on every rank
    """
    pairs, of = prepared.pairs, prepared.response
    has_gap = has_springs_across_gap(pairs)
    if not has_gap.any():
        return prepared, 0
    at_rest = replace(pairs, open_at_rest=pairs.open_at_rest | has_gap)
    law = at_rest.law.followed(of.settings.follows_path)
    model = with_springs(of.model, SpringChange((law.stiffness - of.law.stiffness).ravel(), law.stiffness.ravel()))
    try:
        assert model.groups, "made here, where an error is one of these springs"
    except ValueError as problem:
        n = int(has_gap.sum())
        raise CaseError(
            f"{prepared.scene.path}: backbone: {n} of {counted(pairs.n_pairs, 'pair')} {verb(n, 'are')} open at rest, "
            "and without contact there the structure has no support, so that no mode of it vibrates about rest; close "
            "the gaps, or add supports"
        ) from problem
    structure = replace(prepared.structure, pairs=at_rest)
    return replace(prepared, structure=structure, response=replace(of, model=model, law=law)), int(has_gap.sum())


def first_slip(prepared: Prepared, problem: NonlinearMode) -> Begin:
    """Return the modal amplitude at which the first pair slips, opens or touches, to 1e-9 of it or to its samples.

    Collective.

    Where some pairs slip from the first motion on, it is a small amplitude.
    """
    moved, law = moved_by(prepared, problem.j), prepared.response.law
    if not moved.any():
        return Begin(np.inf)
    safety, at_limit = law.slip_safety(moved), _at_limit(law, moved)
    without_shear = _at_limit(replace(prepared.pairs, T0=np.zeros_like(prepared.pairs.T0), w0=np.zeros((0, 0, 2))).law, moved)
    certain = safety > AT_LIMIT * np.minimum(without_shear, np.finfo(float).max)
    usual = float(np.min(at_limit[certain | ((safety == 0.0) & (at_limit > AT_LIMIT * without_shear))], initial=np.inf))
    if not np.isfinite(usual):
        usual = float(np.min(without_shear[without_shear > 0.0], initial=np.inf))
    if certain[moved.any(axis=1)].all():
        return Begin(_enclosed(problem, float(np.min(safety))))
    return Begin(SLIPS_FROM * usual, is_first_slip=False)


def _at_limit(law: Law, moved: np.ndarray) -> np.ndarray:
    """Return the amplitude at which each pair is at its limit while it sticks, (n_pairs,); infinite where nothing moves it."""
    with np.errstate(divide="ignore"):
        return 1.0 / law.utilisation(moved)


def _enclosed(problem: NonlinearMode, low: float) -> float:
    """Return the amplitude from which not all pairs stick in the mode, enclosed from ``low``, that of its undamped shape.

    Collective.
    """
    if not np.isfinite(low):
        return np.inf

    equation = problem.equation
    finer = problem.with_equation(equation.resolved(equation.harmonics, FINER * equation.n_samples))

    def sticks(q: float) -> bool:
        return finer.curve.holds((float(np.log(q)), problem.omega, problem.sigma))

    unseen = low * (1.0 + (np.pi / finer.equation.n_samples) ** 2)  # up to there a maximum may lie between samples
    if sticks(unseen):
        low, high, end = unseen, unseen * GROWTH, FARTHEST * low
        while sticks(high) and high < end:
            low, high = high, high * GROWTH
    elif sticks(low * (1.0 - WITHIN)):
        return low
    else:  # damping that couples the modes changes the shape of the motion
        low, high = low / GROWTH, low
        while not sticks(low):
            low, high = low / GROWTH, low
    while high > low * (1.0 + WITHIN):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sticks(middle) else (low, middle)
    return low


def moved_by(prepared: Prepared, j: int) -> np.ndarray:
    """Return the motion of all pairs in mode j, (n_pairs, 3) [kg^-1/2]; 0 where it is rounding relative to any mode's.  Local."""
    k, _ = prepared.model.index_of(1)
    R_phi = np.abs(prepared.model.groups[k].receptance.modes.R_phi)
    moved = R_phi[:, j].reshape(-1, 3)
    return np.where(moved > ROUNDING * R_phi.max(initial=0.0), moved, 0.0)
