"""Jumps of cycles: the depth of wear over many cycles from the response of a few (docs/theory.md, section 18).  NumPy only."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np

from ..messages.errors import ConvergenceError

SAFETY, LONGEST, SHORTEST = 0.9, 2.0, 0.2  # ratio of the next jump to the largest allowed one; to the last jump
MOST_JUMPS = 2000
STABLE = 0.5  # most change of a rate within half a jump, over the largest rate: beyond twice that the rule is unstable
NEGLIGIBLE = 0.1  # of the allowed error: where all remaining cycles add less than that, one jump leads to their end


class Cycle(Protocol):
    """A cycle of a worn joint."""

    @property
    def rate(self) -> np.ndarray:
        """Depth that each pair loses in a cycle, (n_pairs,) [m]."""

    @property
    def energy(self) -> np.ndarray:
        """Friction loss of each pair in a cycle, (n_pairs,) [J]."""


C = TypeVar("C", bound=Cycle)


@dataclass(frozen=True)
class JumpControl:
    """Limits of the jumps."""

    cycles: float  # at which wear ends
    most: float  # m, depth that a jump may add to any pair
    tolerance: float  # error of a jump over the depth
    most_jumps: int = MOST_JUMPS


@dataclass(frozen=True, eq=False)
class WornState(Generic[C]):
    """A joint after some cycles, with its cycle there."""

    cycles: float
    depth: np.ndarray  # (n_pairs,) m
    energy: np.ndarray  # (n_pairs,) J, friction loss since the first cycle
    cycle: C
    jump: float = np.inf  # cycles, as the next jump is tried
    error: float = 0.0  # m, of the last jump, by its halves
    number: int = field(default=0)  # of jumps so far


def wear_on(evaluate: Callable[[np.ndarray], C], control: JumpControl, state: WornState[C]) -> WornState[C]:
    """Return a joint after a jump of cycles.  Collective if ``evaluate``, the cycle at a depth (n_pairs,) [m], is.

    docs/theory.md, eq. (18.5) and eq. (18.6): a jump in one piece and in two halves, within the limit of stability.
    """
    rate, remaining = state.cycle.rate, control.cycles - state.cycles
    is_last = remaining * rate.max() <= NEGLIGIBLE * control.tolerance * max(float(state.depth.max()), control.most)
    jump = remaining if is_last else min(state.jump, control.most / rate.max(), remaining)
    while True:
        halfway = evaluate(state.depth + 0.5 * jump * rate)
        change = float(np.abs(halfway.rate - rate).max())
        error = 0.5 * jump * change
        depth = state.depth + jump * halfway.rate
        allowed = control.tolerance * max(float(depth.max()), control.most)
        fits = SAFETY * np.sqrt(allowed / error) if error > 0.0 else LONGEST
        if change > 0.0 and not is_last:
            fits = min(fits, SAFETY * STABLE * rate.max() / change)
        if fits >= SAFETY:
            break
        jump *= max(fits, SHORTEST)
    reached = control.cycles if jump == remaining else state.cycles + jump
    energy = state.energy + jump * halfway.energy
    following = jump * float(np.clip(fits, SHORTEST, LONGEST))
    return WornState(reached, depth, energy, evaluate(depth), following, error, state.number + 1)


def follow_wear(evaluate: Callable[[np.ndarray], C], control: JumpControl, state: WornState[C]) -> Iterator[WornState[C]]:
    """Yield the joint after each jump of cycles until their end; where nothing slides, at once.  Collective if ``evaluate`` is.

    Raises
    ------
    ConvergenceError : there are too many jumps
    """
    while state.cycles < control.cycles and state.cycle.rate.any():
        if state.number >= control.most_jumps:
            raise ConvergenceError(
                f"wear: {state.number} jumps have led to {state.cycles:.6g} of {control.cycles:.6g} cycles; raise [wear] jump, "
                f"now {control.most:.2g} m, or tolerance, or lower cycles"
            )
        state = wear_on(evaluate, control, state)
        yield state
