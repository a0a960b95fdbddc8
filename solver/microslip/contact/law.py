"""What a contact law offers: the one interface through which every other room asks for contact forces and their limits.

A law holds the parameters of n pairs.  Its force is measured beyond the springs K_J of a pair that sticks, p = f_nl - K_J du
(docs/theory.md, section 3), from the state of rest, about which the structure vibrates.  A further law is one more file beside
``elastic_coulomb.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..fourier.harmonics import Harmonics
from .sliders import Sliders

STICK, SLIP, OPEN = 0, 1, 2


@dataclass(frozen=True)
class ContactCycle:
    """Harmonics of p over a period for n pairs, m of which are active."""

    p: np.ndarray  # (n, 3, N_H) N; exactly 0 for pairs that are not active
    state: np.ndarray  # (n,) uint8, in the kept period: STICK, SLIP, OPEN
    active: np.ndarray  # (m,) pairs with p or dp/dU not identically zero, ascending
    P: np.ndarray | None  # (m, 3 N_H, 3 N_H) dp/dU [N/m], row and column = direction * N_H + coefficient
    creeps: np.ndarray  # (n,) bool: the slider still moves on from period to period when the march is given up


class Law(Protocol):
    """The law of n contact pairs, p of docs/theory.md, eq. (1.3).  Local, NumPy only.

    ``amplitudes`` (..., n, 3) [m] are what no component of a pair's motion exceeds: the sums over its harmonics.
    """

    @property
    def n_pairs(self) -> int: ...

    @property
    def stiffness(self) -> np.ndarray:
        """The springs K_J of a pair that sticks, (n, 3) [N/m]."""

    @property
    def springs(self) -> np.ndarray:
        """The same, of pairs that are open at rest and have no part in K_J, too: the stiffness of a pair that touches."""

    @property
    def order(self) -> int:
        """The order in 1 / N_t at which the harmonics of a cycle converge."""

    def take(self, indices: np.ndarray | slice) -> Law:
        """Return the law of some of the pairs: an index array, a mask or a slice."""

    def followed(self, path: bool) -> Law:
        """Return the law that follows the path between samples, or one that knows samples alone."""

    @property
    def elements_order(self) -> int:
        """The order at which p converges with the number of elements that a pair is divided into; 0: it is one."""

    @property
    def refined(self) -> Law:
        """The law with at least twice the elements of each pair that is divided into several; else the law itself."""

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None) -> ContactCycle:
        """Return the harmonics of p under the periodic motion ``U`` (n, 3, N_H) [m], with their exact derivative.

        The set of ``harmonics`` is 0 to H unless given; ``n_samples`` is at least 2 H + 1; without ``tangents`` P is left out.
        """

    def with_parameters(self, name: str, pairs: np.ndarray, values: np.ndarray) -> Law:
        """Return the law in which some of the pairs (m,) have other values (m,) of a parameter of parameters.PARAMETERS.

        The others, and where sliders start, stay as they are.  ValueError if the law has no such parameter, or not such values.
        """

    def parameter_rate(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter of each pair under a motion that stays as it is, (n, 3, N_H); p as :meth:`cycle` has it."""

    @property
    def n_memory(self) -> int:
        """Numbers of a pair that a step of time remembers beside p [N]; all are 0 at rest."""

    def step(self, du: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p and memory after a step of time to the relative displacement ``du``, the derivative of p, and the states.

        Shapes: du (..., n, 3) [m]; p with the memory, before the step and after it, (..., n, 3 + n_memory) [N]; derivative
        d p / d du (..., n, 3, 3) [N/m]; states (..., n).
        """

    @property
    def sliders(self) -> tuple[Sliders, ...]:
        """The sliders of the pairs, the part of p_t that remembers: those of each kind of pairs."""

    def memoryless_rate(self, du: np.ndarray) -> np.ndarray:
        """Return d p / d du of the part of p that remembers nothing, component by component, (..., n, 3) [N/m], at ``du``."""

    def slip_safety(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the factor by which motions may grow while each pair is sure to stick, closed, (..., n)."""

    def utilisation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the share of its limits that the motion of each pair takes up while it sticks, (..., n)."""

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float) -> np.ndarray:
        """Return the share of the stuck force that p takes away at most, (..., n, 3), if limits count with ``of_limit``."""

    def keeps_half_wave_symmetry(self, moves: np.ndarray) -> np.ndarray:
        """Return which pairs keep u(t + T/2) = -u(t), p with u, if the components ``moves`` (n, 3) bool move, (n,)."""
