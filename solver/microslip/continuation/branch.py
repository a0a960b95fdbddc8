"""The record of a branch: what continuation hands on to the results."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Point:
    """A converged point of a curve.  Arrays are gathered on rank 0; counts and floats agree on all ranks.

    Harmonic coefficients run mean, cos 1, sin 1, ..., cos H, sin H (N_H = 2 H + 1), whatever set of harmonics was solved for: the
    others are zero.  H is the same for all points of a run, and at least 1.
    """

    omega: float  # rad/s
    response: np.ndarray  # (n_outputs, N_H) m
    U: np.ndarray  # (n_pairs, 3, N_H) m
    p: np.ndarray  # (n_pairs, 3, N_H) N
    energy: np.ndarray  # (n_pairs,) friction loss J per cycle
    state: np.ndarray  # (n_pairs,) uint8: STICK, SLIP, OPEN
    unknowns: int  # of the reduced model at this point
    newton: int  # Newton iterations
    krylov: int  # GMRES iterations
    friction: float  # J per cycle
    damping: float  # J per cycle
    input: float  # J per cycle
    seconds: float  # wall time of this point
    harmonics: int = 0  # the highest it was solved with
    samples: int = 0  # a period
    asked: bool = False  # one of [response] at
    segment: int = 0  # of the curve: 0 from its start, 1 from the other end of the range, where 0 ended early
    notes: tuple[str, ...] = ()
    error: np.ndarray | None = None  # (n_outputs, parts) m, of the amplitude of harmonic 1; None where not estimated


@dataclass
class Branch:
    """The points of one level, in the order of the branch; of both segments where it was followed from both ends."""

    level: float  # N
    points: list[Point] = field(default_factory=list)
    failure: str | None = None  # why the branch ends early; None if it is complete
    scaled: bool = False  # no pair leaves sticking: the linear response at this level, nothing was solved
    closes_to: float = 1e-6  # of the energy balance, what the tolerance of its points asks for
    odd: bool = False  # solved in odd harmonics alone, by the symmetry of the scene
    broken: str | None = None  # why its first segment ends early, where a second one completes it

    def with_segment_from_the_other_end(self, other: Branch) -> Branch:
        """Return the branch, which ended early, and what was followed from the other end of the range, as one."""
        failure = other.failure and f"{self.failure}; and from the other end of the range: {other.failure}"
        return replace(
            self, points=self.points + other.points, failure=failure, scaled=False, broken=None if failure else self.failure
        )
