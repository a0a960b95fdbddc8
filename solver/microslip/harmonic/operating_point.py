"""The operating point of harmonic balance, how it changes with a parameter, and the contact forces under a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class LawParameter:
    """A number of the contact law of some pairs, of a joint or of one pair: a value of it sets their column to value times shape.

    With the shape of the columns at hand the value is a factor, 1 as the scene has it; with ones it is the column itself.
    """

    name: str  # of contact.parameters.PARAMETERS
    pairs: np.ndarray  # (m,) numbers of the pairs among all
    shape: np.ndarray  # (m,) their columns where the value is 1

    @property
    def is_stiffness(self) -> bool:
        """Whether the stuck structure has it, too: its springs K_J change with it."""
        return self.name in ("k_t", "k_n")


@dataclass(frozen=True)
class OperatingPoint:
    """What the equation depends on beside the motion."""

    omega: float  # rad/s, of the excitation
    level: float  # N, multiplies the loads
    sigma: float = 0.0  # 1/s, further damping sigma M; negative where it excites
    law: tuple[tuple[LawParameter, float], ...] = ()  # values of law parameters that differ from those of the equation's law

    @property
    def text(self) -> str:
        """The point as messages name it."""
        return f"{self.omega / 2 / np.pi:.6g} Hz ({self.omega:.6g} rad/s) at level {self.level:.4g} N"


Rates = Mapping[str | LawParameter, float]  # d / d nu of an operating point, by "omega", "level", "sigma" or a law parameter


def law_rates(rates: Rates) -> list[tuple[LawParameter, float]]:
    """Return the rates by parameters of the contact law."""
    return [(parameter, rate) for parameter, rate in rates.items() if isinstance(parameter, LawParameter)]


def stiffness_rates(rates: Rates) -> list[tuple[LawParameter, float]]:
    """Return those that the stuck structure knows, too."""
    return [(parameter, rate) for parameter, rate in law_rates(rates) if parameter.is_stiffness]


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Contact forces at one motion: what this rank evaluated and what all ranks gathered."""

    U: np.ndarray  # (n_owned, 3, N_H) m, the motion
    selected: np.ndarray  # (n_pairs,) bool, the pairs that may slip or open
    state: np.ndarray  # (n_owned,) STICK, SLIP, OPEN
    creeps: bool  # a slider of this rank's pairs moves on from period to period
    active_owned: np.ndarray  # (m,) pairs of this rank, counted from its first, with p or dp/dU not zero
    P: np.ndarray | None  # (m, 3 N_H, 3 N_H) dp/dU of those [N/m]
    active: np.ndarray  # (n_active,) the active pairs of all ranks, in rank order
    p: np.ndarray  # (3 n_active, N_H) their forces [N]
    extras: tuple[float, ...]  # sums over the ranks of what each passed along
