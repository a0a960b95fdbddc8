"""Where harmonic balance is asked: the operating point, how it changes, and the contact forces at a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class OperatingPoint:
    """What the equation depends on beside the motion."""

    omega: float  # rad/s, of the excitation
    level: float  # N, multiplies the loads
    sigma: float = 0.0  # 1/s, further damping sigma M

    @property
    def text(self) -> str:
        """The point as messages name it."""
        return f"{self.omega / 2 / np.pi:.6g} Hz ({self.omega:.6g} rad/s) at level {self.level:.4g} N"


@dataclass(frozen=True)
class Rate:
    """How an operating point changes with a parameter."""

    omega: float = 0.0
    level: float = 0.0
    sigma: float = 0.0


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
