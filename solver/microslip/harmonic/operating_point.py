"""The operating point of harmonic balance, its rates with a parameter, and the contact forces under a motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class LawParameter:
    """A parameter of the contact law of some pairs, of a joint or of one pair: its value sets their column to value times shape.

    With the present columns as shape, the value is a factor (1 in the scene); with ones, it is the value of the column.
    """

    name: str  # of contact.parameters.PARAMETERS
    pairs: np.ndarray  # (m,) global numbers of the pairs
    shape: np.ndarray  # (m,) their column at the value 1

    @property
    def is_stiffness(self) -> bool:
        """Whether the parameter changes the springs K_J, and with them the stuck structure."""
        return self.name in ("k_t", "k_n")


@dataclass(frozen=True)
class OperatingPoint:
    """The parameters of the equation, without the motion."""

    omega: float  # rad/s, of the excitation
    level: float  # N, multiplies the loads
    sigma: float = 0.0  # 1/s, additional damping sigma M; negative where it excites
    law: tuple[tuple[LawParameter, float], ...] = ()  # parameters of the law with values that differ from the equation's law
    damping: float = 1.0  # -, multiplies the damping that the scene states

    @property
    def text(self) -> str:
        """The point in messages."""
        return f"{self.omega / 2 / np.pi:.6g} Hz ({self.omega:.6g} rad/s) at level {self.level:.4g} N"


Rates = Mapping[
    str | LawParameter, float
]  # d / d nu of an operating point, by "omega", "level", "sigma", "damping" or a law parameter


def law_rates(rates: Rates) -> list[tuple[LawParameter, float]]:
    """Return the rates by parameters of the contact law."""
    return [(parameter, rate) for parameter, rate in rates.items() if isinstance(parameter, LawParameter)]


def stiffness_rates(rates: Rates) -> list[tuple[LawParameter, float]]:
    """Return the rates by the parameters that change the stuck structure."""
    return [(parameter, rate) for parameter, rate in law_rates(rates) if parameter.is_stiffness]


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Contact forces at one motion: evaluated on this rank, and gathered from all ranks."""

    U: np.ndarray  # (n_owned, 3, N_H) m, the motion
    selected: np.ndarray  # (n_pairs,) bool, the pairs that may slip or open
    state: np.ndarray  # (n_owned,) STICK, SLIP, OPEN
    drifts: bool  # a slider of this rank's pairs still drifts from period to period
    active_owned: np.ndarray  # (m,) pairs of this rank, counted from its first, with p or dp/dU not zero
    P: np.ndarray | None  # (m, 3 N_H, 3 N_H) dp/dU of these pairs [N/m]
    active: np.ndarray  # (n_active,) the active pairs of all ranks, in rank order
    p: np.ndarray  # (3 n_active, N_H) their forces [N]
    extras: tuple[float, ...]  # sums over the ranks of the extras passed in
