"""Wear of the joints of a structure: the steady cycle of a worn joint, and jumps of cycles (docs/theory.md, section 18)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..contact.law import STICK
from ..continuation.levels import follow_level
from ..continuation.peak_curves import PeakAt, peak_at
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError, ConvergenceError
from ..points.branch import Branch, Point
from ..scene.schema import Scene
from ..scene.wear import ARCHARD, Wear
from ..statics.equilibrium import Flexibility
from ..statics.rest import with_gaps, worn_at_rest
from .arguments import refuse_no_structure
from .build import Structure, at_another_rest
from .jumps import JumpControl, WornState, follow_wear
from .prepare import Prepared, prepare
from .respond import scene_with
from .settings import units_of

OF_APPROACH = 0.5  # of the largest elastic approach N0 / k_n at rest: the depth of a jump, unless stated


@dataclass(frozen=True, eq=False)
class WearCycle:
    """The steady cycle of a worn joint; the same on every rank, but for the motion in ``point``."""

    point: Point
    damping: float  # -, (7.10), of the peak; NaN at a frequency that stays
    N0: np.ndarray  # (n_pairs,) N, normal force at rest; below 0 a gap of -N0 / k_n
    T0: np.ndarray  # (n_pairs, 2) N, friction force at rest
    energy: np.ndarray  # (n_pairs,) J, friction loss of a cycle of pairs that slide
    rate: np.ndarray  # (n_pairs,) m, depth that a cycle takes


def wear_of(scene: Scene) -> Wear:
    """Return the table [wear] of a scene.  Local.

    Raises
    ------
    CaseError : there is none
    """
    if scene.wear is None:
        raise CaseError(f"{scene.path}: [wear] is missing: expected {Scene.model_fields['wear'].description}")
    return scene.wear


def depth_per_energy(wear: Wear, pairs: ContactPairs) -> np.ndarray:
    """Return the depth that a unit of friction energy takes from each pair, (n_pairs,) [m/J].  Local.

    docs/theory.md, eq. (18.1) and eq. (18.2).

    Raises
    ------
    CaseError : no coefficient, no area, or Archard's law without friction
    """
    rates = np.zeros(pairs.n_pairs)
    for name, of_joint in pairs.by_joint().items():
        coefficient, area = wear.coefficient_of(name), pairs.area[of_joint]
        if coefficient is None:
            raise CaseError(f"[wear] coefficient: that of joint {name!r} is missing; 0 if it does not wear")
        if coefficient == 0.0:
            continue
        stated = wear.area_of(name)
        area = np.where(np.isfinite(area), area, np.nan if stated is None else stated)
        if np.isnan(area).any():
            raise CaseError(
                f"[wear] area: the pairs of joint {name!r} are given without areas, and depth is volume over area; state that "
                f"of each pair in m2, as area = {{ {name} = 1e-6 }}"
            )
        mu = pairs.mu[of_joint] if wear.law == ARCHARD else np.ones(len(of_joint))
        if not (mu > 0.0).all():
            raise CaseError(
                f'[wear] law = "{ARCHARD}": joint {name!r} has pairs without friction, and slip is measured by its friction '
                "energy; state a friction coefficient above 0, however small"
            )
        rates[of_joint] = coefficient / (mu * area)
    if not rates.any():
        raise CaseError("[wear] coefficient: 0 of every joint that has pairs; nothing wears")
    return rates


class WearingJoint:
    """A structure whose joints wear.  Collective on ``structure.comm``, as all its methods.

    The last peak is stored as the guess for the next one; it changes results only within the solver's tolerance.

    Raises
    ------
    CaseError : no [wear], or one that this structure cannot have; on every rank
    """

    def __init__(self, structure: Structure):
        refuse_no_structure(structure, "wear")
        scene, wear = structure.scene, wear_of(structure.scene)
        self.structure, self.wear, self.units = structure, wear, units_of(scene)
        self.per_energy = depth_per_energy(wear, structure.pairs)
        self.level = wear.level or max(scene.response.levels)
        names = [output.name for output in scene.outputs]
        self.output = 0 if wear.output is None else names.index(wear.output)
        stays = wear.frequency
        keys = {"levels": self.level, "at": () if stays is None else (stays,), "over": (), "peaks": False, "stability": False}
        self.scene = scene_with(scene, keys, {})
        self._near: PeakAt | None = None

    @cached_property
    def flexibility(self) -> Flexibility:
        """The flexibility of the structure with all pairs stuck, where the preload is stated."""
        return self.structure.pair_flexibility()

    @property
    def control(self) -> JumpControl:
        """The limits of the jumps.

        Raises
        ------
        CaseError : no wearing pair has a normal force at rest, by which the depth of a jump is chosen
        """
        pairs, wear = self.structure.pairs, self.wear
        pressed = (self.per_energy > 0.0) & (pairs.N0 > 0.0)
        if wear.jump is None and not pressed.any():
            raise CaseError("[wear] jump is missing: no pair that wears is pressed at rest, by whose approach it would be chosen")
        approach = float((pairs.N0[pressed] / pairs.k_n[pressed]).max(initial=0.0))
        return JumpControl(wear.cycles, wear.jump or OF_APPROACH * approach, wear.tolerance)

    def worn(self, depth: np.ndarray) -> Structure:
        """Return the structure at rest with a joint that has lost ``depth`` (n_pairs,) [m].

        Raises
        ------
        ConvergenceError, ResourceError : on every rank
        """
        structure = self.structure
        if structure.reference is not None:
            return at_another_rest(structure, structure.scene, with_gaps(structure.reference.pairs, depth)[0])[0]
        return replace(structure, pairs=worn_at_rest(self.flexibility, structure.pairs, depth))

    def prepared(self, depth: np.ndarray) -> Prepared:
        """Return the structure with a joint that has lost ``depth`` (n_pairs,) [m], prepared for its response at the level."""
        return prepare(self.worn(depth), self.scene)

    def cycle(self, depth: np.ndarray) -> WearCycle:
        """Return the steady cycle of a joint that has lost ``depth`` (n_pairs,) [m].

        Raises
        ------
        CaseError : no peak in the range of frequencies; on every rank
        ConvergenceError : no rest, or no response; on every rank
        """
        prepared = self.prepared(depth)
        branch, damping = self._at_frequency(prepared) if self.wear.frequency else self._at_peak(prepared)
        if not branch.points:
            raise ConvergenceError(f"wear: no response of the worn joint: {branch.failure}")
        point, pairs = branch.points[0], prepared.pairs
        energy = np.where((point.state != STICK) & (self.per_energy > 0.0), np.maximum(point.energy, 0.0), 0.0)
        return WearCycle(point, damping, pairs.N0, pairs.T0, energy, self.per_energy * energy)

    def _at_peak(self, prepared: Prepared) -> tuple[Branch, float]:
        """Return the peak as a branch of one point, and its damping ratio."""
        peak = peak_at(prepared.response, self.output, self.level, self._near)
        self._near = peak if peak.there is not None else None
        points, comm = peak.curve.branch.points, prepared.model.comm
        damping = peak.curve.damping_ratio(points[0]) if points else np.nan
        return peak.curve.branch, comm.bcast(damping)

    def _at_frequency(self, prepared: Prepared) -> tuple[Branch, float]:
        """Return the solution of largest amplitude at the stated frequency as a branch of one point."""
        branch = follow_level(prepared.response, self.level)
        there = [point for point in branch.points if point.requested]
        there.sort(key=lambda point: -float(np.hypot(*point.response[self.output, 1:3])))
        return replace(branch, points=there[:1]), float("nan")

    def start(self) -> WornState[WearCycle]:
        """Return the joint before the first cycle, with that cycle."""
        none = np.zeros(self.structure.pairs.n_pairs)
        return WornState(0.0, none, none, self.cycle(none))

    def follow(self, state: WornState[WearCycle]) -> Iterator[WornState[WearCycle]]:
        """Yield the joint after each jump of cycles; nothing where nothing slides.

        Raises
        ------
        ConvergenceError, ResourceError : on every rank
        """
        return follow_wear(self.cycle, self.control, state)
