"""The record of a branch: the result of continuation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Annotated

import numpy as np

from ..contact.law import OPEN, SLIP, STICK
from ..fourier.coefficients import amplitude, phase
from ..messages.words import counted
from .bifurcation import Bifurcation
from .error_parts import PARTS, SAFETY, total
from .multipliers import is_stable
from .peak import Peak
from .quantities import TEXT, Column, Quantity, declared, hertz, number


def pairs_in(kind: int) -> Callable[[np.ndarray], int]:
    """Return a function that counts the pairs in a contact state, for states (n_pairs,).  Local."""
    return lambda state: np.count_nonzero(state == kind)


_SHIFT = "harmonic 1: u = amplitude · cos(ω t + phase)"
_MOTION = (
    Column("amplitude_m", _SHIFT, amplitude),
    Column("phase_rad", _SHIFT, phase),
    Column("mean_m", "constant part of the displacement", itemgetter(0)),
)
_STATES = tuple(
    Column(name, "numbers of pairs", pairs_in(kind)) for name, kind in (("sticking", STICK), ("slipping", SLIP), ("open", OPEN))
)
_BAR = Column("error_m", "error bar of the amplitude, of which amplitude and phase follow; empty without `error_bars`", total, 4)
_CORRECTED = "the same, corrected by the enriched model of the error bar where that makes the bar shorter"
_OF_CORRECTED = (
    Column("amplitude_corrected_m", _CORRECTED, lambda first: np.hypot(*first)),
    Column("phase_corrected_rad", _CORRECTED, lambda first: np.arctan2(-first[1], first[0])),
)
_REMAINING = "error bar of the corrected amplitude"
_SHARE = f"its parts; the bar is {SAFETY:g} times their sum"
_BARS = (_BAR, *(Column(f"error_{part}_m", _SHARE, itemgetter(i), 4) for i, part in enumerate(PARTS)))

_UNKNOWNS = "size of the method's reduced model at this point"
_NEWTON = "Newton iterations; 0 where the predictor is the solution, as on the linear part"
SEGMENTS = {1: "from the other end of the range", 2: "with steps a quarter as long"}
SHORT_STEPS, SHORTER = 2, 4  # the segment with shorter steps, and how many times shorter they are
_WAYS = f"0 from the start, 1 {SEGMENTS[1]}, 2 from the start {SEGMENTS[2]}"
_SEGMENT = f"{_WAYS}; 1 and 2 where those before ended early"
_HARMONICS = "highest harmonic of the solution at this point; arrays have zeros for higher ones"
_COS_SIN = "cosine and sine of harmonic 1 with the correction computed with the error bar"
_PARTS = "parts of the error bar, in the order of the attribute `parts`"
_STABLE = "1 where the motion is stable, 0 where a small disturbance grows; empty without `stability`"
_OF_LARGEST = "Floquet multiplier of largest modulus, without those of sliders that never slip"
_MULTIPLIERS = (
    Column("largest_multiplier", f"modulus of the {_OF_LARGEST}", lambda values: np.hypot(*values[0])),
    Column("multiplier_real", f"the {_OF_LARGEST}", lambda values: values[0, 0]),
    Column("multiplier_imaginary", f"the {_OF_LARGEST}", lambda values: values[0, 1]),
)
_LARGEST = "Floquet multipliers by falling modulus, without those of sliders that never slip"
_NEUTRAL = "sliders that never slip, whose multipliers are 1 and no instability"
_BY_PAIRS = "derivatives of cosine and sine of harmonic 1 by numbers of each pair, in the order of the attribute `numbers`"
_BY_COMMON = "derivatives by the level, a factor of the damping and the frequency [rad/s], in the order of the attribute `common`"


@dataclass(frozen=True, slots=True)
class Point:
    """A converged point of a curve.  Arrays are gathered on rank 0; counts and floats agree on all ranks.

    Harmonic coefficients are mean, cos 1, sin 1, ..., cos H, sin H (N_H = 2 H + 1); those of harmonics that were not solved for
    are zero.  H is the same for all points of a run, and at least 1.

    The annotation of a field declares its name in the files, its axes, unit and meaning; frf.csv, results.h5, its reader and the
    tables of the guide follow from these declarations.
    """

    omega: Annotated[float, number("frequency_Hz", "Hz", "frequency of the excitation", stored=hertz)]  # rad/s
    response: Annotated[np.ndarray, Quantity("response", "outputs coefficients", "m", "displacement", columns=_MOTION)]
    U: Annotated[np.ndarray, Quantity("du", "pairs directions coefficients", "m", "relative displacement")]
    p: Annotated[np.ndarray, Quantity("p", "pairs directions coefficients", "N", "contact force beyond the stuck springs")]
    energy: Annotated[np.ndarray, Quantity("energy_J", "pairs", "J", "friction loss of each pair, a cycle")]
    state: Annotated[np.ndarray, Quantity("state", "pairs", "0 stick, 1 slip, 2 open", "state of each pair", "u1", _STATES)]
    unknowns: Annotated[int, number("unknowns", "1", _UNKNOWNS, "i8")]
    newton: Annotated[int, number("newton", "1", _NEWTON, "i8")]
    krylov: Annotated[int, Quantity("krylov", "", "1", "GMRES iterations", "i8")]
    friction: Annotated[float, number("friction_J", "J", "friction loss, a cycle")]
    damping: Annotated[float, number("damping_J", "J", "loss by damping, viscous and structural, a cycle")]
    input: Annotated[float, number("input_J", "J", "work of the loads, a cycle")]
    seconds: Annotated[float, number("seconds", "s", "wall time of the point", digits=4)]
    harmonics: Annotated[int, Quantity("harmonics", "", "1", _HARMONICS, "i8")] = 0
    samples: Annotated[int, Quantity("samples", "", "1", "time samples per period of the solution", "i8")] = 0
    requested: Annotated[
        bool, Quantity("requested", "", "1", "1 where the frequency is one of [response] `at`", "u1", earlier="asked")
    ] = False
    error: Annotated[np.ndarray | None, Quantity("error_m", "outputs parts", "m", _PARTS, columns=_BARS)] = None
    segment: Annotated[int, number("segment", _WAYS, _SEGMENT, "u1")] = 0
    notes: Annotated[tuple[str, ...], Quantity("notes", "", "1", "notes on the point", TEXT, stored="; ".join)] = ()
    corrected: Annotated[
        np.ndarray | None, Quantity("corrected", "outputs quadratures", "m", _COS_SIN, columns=_OF_CORRECTED)
    ] = None
    parameters: tuple[float, ...] = ()  # of the problem: rad/s, N, ...; the first one was continued
    error_corrected: Annotated[
        np.ndarray | None,
        Quantity("error_corrected_m", "outputs", "m", _REMAINING, columns=(Column("error_corrected_m", _REMAINING, digits=4),)),
    ] = None
    multipliers: Annotated[
        np.ndarray | None,
        number("stable", "1", _STABLE, "u1", stored=is_stable),
        Quantity("multipliers", "multipliers complex", "1", _LARGEST, columns=_MULTIPLIERS),
    ] = None
    neutral: Annotated[np.ndarray | None, number("neutral_sliders", "1", _NEUTRAL, "i8")] = None  # () of integers
    by_pairs: Annotated[np.ndarray | None, Quantity("d_by_pairs", "outputs quadratures numbers pairs", "m", _BY_PAIRS)] = None
    by_common: Annotated[np.ndarray | None, Quantity("d_by_common", "outputs quadratures common", "m", _BY_COMMON)] = None


QUANTITIES = declared(Point)
NOTHING = np.empty((0, 3, 0))  # the motion of a point where it is not stored: on ranks other than 0
CLOSES_TO = 1e-6  # closure of the energy balance beyond which a point deserves a second look


@dataclass
class Branch:
    """The points of one level, in the order of the branch, segment by segment where it was followed more than once."""

    level: float  # N
    points: list[Point] = field(default_factory=list)
    failure: str | None = None  # why the branch ends early; None if it is complete
    is_linear: bool = False  # no pair leaves sticking: the linear response at this level, nothing was solved
    closes_to: float = CLOSES_TO  # of the energy balance, by the tolerance of its points
    odd: bool = False  # solved in odd harmonics alone, by the symmetry of the scene
    broken: str | None = None  # why its segments end early, where the last one completes it
    solver: str = ""  # name of the solver of Newton's method; "" without a solve
    bifurcations: list[Bifurcation] | None = None  # where stability changes, and folds; None without multipliers
    peaks: list[Peak] | None = None  # maxima of the outputs, each solved for; None where they are not

    @property
    def peak(self) -> int:
        """The number of the point of largest response of the first output; there must be a point."""
        return max(range(len(self.points)), key=lambda i: float(np.hypot(*self.points[i].response[0, 1:3])))

    @property
    def why_ended(self) -> str:
        """Where it ended early, and why."""
        return f"{self.level:g} N ends after {counted(len(self.points), 'point')}: {self.failure}"

    def without_motion(self) -> list[Point]:
        """Return the points, all except the peak without the motion and forces of their pairs.  Local."""
        top = self.peak if self.points else -1
        return [point if i == top else replace(point, U=NOTHING, p=NOTHING) for i, point in enumerate(self.points)]

    def with_segment(self, other: Branch, way: str) -> Branch:
        """Return the branch, which ended early, joined with one that was followed in another ``way``."""
        failure = other.failure and f"{self.failure}; and {way}: {other.failure}"
        return replace(
            self, points=self.points + other.points, failure=failure, is_linear=False, broken=None if failure else self.failure
        )
