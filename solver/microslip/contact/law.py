"""Interface of the contact laws: the only way in which other rooms compute contact forces and their limits.

A law stores the parameters of n pairs.  Its force p = f_nl - K_J du (docs/theory.md, section 3) excludes the force of the springs
K_J of a pair that sticks, and is relative to the state of rest, about which the structure vibrates.  A new law is a new file in
this folder, as ``elastic_coulomb.py``.
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
    state: np.ndarray  # (n,) uint8, in the last period of the march: STICK, SLIP, OPEN
    active: np.ndarray  # (m,) pairs with p or dp/dU not identically zero, ascending
    P: np.ndarray | None  # (m, 3 N_H, 3 N_H) dp/dU [N/m], row and column = direction * N_H + coefficient
    drifts: np.ndarray  # (n,) bool: the slider still drifts from period to period at the last period of the march


class Law(Protocol):
    """The law of n contact pairs, p of docs/theory.md, eq. (1.3).  Local, NumPy only.

    ``amplitudes`` (..., n, 3) [m] are upper bounds of the components of a pair's motion: sums of amplitudes over the harmonics.
    """

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""

    @property
    def stiffness(self) -> np.ndarray:
        """The springs K_J of a pair that sticks, (n, 3) [N/m]."""

    @property
    def springs(self) -> np.ndarray:
        """The springs of a pair in contact, (n, 3) [N/m], also of pairs that are open at rest and do not contribute to K_J."""

    @property
    def order(self) -> int:
        """The order in 1 / N_t at which the harmonics of a cycle converge."""

    def take(self, indices: np.ndarray | slice) -> Law:
        """Return the law of some of the pairs: an index array, a mask or a slice."""

    def followed(self, path: bool) -> Law:
        """Return the law that follows the path between samples, or the law evaluated at the samples only."""

    @property
    def elements_order(self) -> int:
        """The order at which p converges with the number of elements of a pair; 0 if a pair is a single element."""

    @property
    def refined(self) -> Law:
        """The law with at least twice as many elements per pair; the law itself if a pair is a single element."""

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None) -> ContactCycle:
        """Return the harmonics of p under the periodic motion ``U`` (n, 3, N_H) [m], with their exact derivative.

        The default of ``harmonics`` is 0 to H; ``n_samples`` is at least 2 H + 1; without ``tangents``, P is None.
        """

    def with_parameters(self, name: str, pairs: np.ndarray, values: np.ndarray) -> Law:
        """Return the law with new values (m,) of a parameter of parameters.PARAMETERS for some of the pairs (m,).

        Other parameters and the initial slider positions do not change.  ValueError if the law does not have the parameter, or
        if a value is out of range.
        """

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters of parameters.PARAMETERS that the law has."""

    def parameter_rate(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter of each pair at constant motion, (n, 3, N_H), for the p of :meth:`cycle`."""

    @property
    def n_memory(self) -> int:
        """Number of internal variables per pair that a time step stores in addition to p [N]; all are 0 at rest."""

    def step(self, du: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p and internal variables after a time step to the relative displacement ``du``, derivative of p, states.

        Shapes: du (..., n, 3) [m]; p with the internal variables, before and after the step, (..., n, 3 + n_memory) [N];
        derivative d p / d du (..., n, 3, 3) [N/m]; states (..., n).
        """

    @property
    def sliders(self) -> tuple[Sliders, ...]:
        """The sliders of the pairs, which carry the history-dependent part of p_t; one entry per kind of pair."""

    def memoryless_rate(self, du: np.ndarray) -> np.ndarray:
        """Return d p / d du of the history-independent part of p at ``du``, component by component, (..., n, 3) [N/m]."""

    def slip_safety(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the factor by which motions may grow while each pair certainly sticks and stays closed, (..., n)."""

    def utilisation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the utilisation of each pair, stuck force divided by its limit, (..., n)."""

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float) -> np.ndarray:
        """Return an upper bound of |p| / stuck force, (..., n, 3), with the limits multiplied by ``of_limit``."""

    def keeps_half_wave_symmetry(self, moves: np.ndarray) -> np.ndarray:
        """Return for which pairs u(t + T/2) = -u(t) implies the same for p if the components ``moves`` (n, 3) move, (n,) bool."""
