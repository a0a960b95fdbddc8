"""Bolts in the equilibrium: stiffness at their cuts, tightening to a force, and resulting forces.

docs/theory.md, section 12.  Small matrices, the same on every rank.
"""

from dataclasses import dataclass

import numpy as np

from ..assembly.pretension import Bolts
from ..linear.dense import gram
from ..linear.joint_springs import Linearised
from ..messages.errors import CaseError
from ..parallel.ownership import summed

_UNCLAMPED = 1e-9  # stiffness at a cut over the stiffness of the shank, below which only the shank connects its two sides


@dataclass(frozen=True, eq=False)
class BoltsAtRest:
    """The bolts of a joint at rest, the same on every rank."""

    names: tuple[str, ...]
    area: np.ndarray  # (n_bolts,) m2, area of the cut
    shortening: np.ndarray  # (n_bolts,) m, constant after the tightening
    tightened: np.ndarray  # (n_bolts,) N, with all bolts tightened and no other load
    force: np.ndarray  # (n_bolts,) N, at rest under all loads


@dataclass(frozen=True, eq=False)
class Cuts:
    """The cuts of bolts in the stuck structure."""

    bolts: Bolts
    U_owned: np.ndarray  # (n_dof_owned, n_bolts) K_L^-1 F, motion of a unit shortening
    RU: np.ndarray  # (3 n_pairs, n_bolts) R K_L^-1 F
    S: np.ndarray  # (n_bolts, n_bolts) N/m, forces in the cuts of unit shortenings
    has_force: np.ndarray  # (n_bolts,) bool: a force is given, not a shortening
    stated: np.ndarray  # (n_bolts,) N or m

    def tightened(self, p: np.ndarray) -> np.ndarray:
        """Return the shortenings, (n_bolts,) [m], with the forces and lengths given, under contact forces p (3 n_pairs,) [N].

        Local.  docs/theory.md, eq. (12.8).
        """
        delta = np.where(self.has_force, 0.0, self.stated)
        missing = self.stated - self.force(delta, p)
        delta[self.has_force] = np.linalg.solve(self.S[np.ix_(self.has_force, self.has_force)], missing[self.has_force])
        return delta

    def force(self, delta: np.ndarray, p: np.ndarray, of_loads: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the forces in the cuts, eq. (12.7), (n_bolts,) [N], including those of other loads.  Local."""
        return self.S @ delta + self.RU.T @ p.ravel() + of_loads

    @property
    def release(self) -> tuple[np.ndarray, np.ndarray]:
        """R K_L^-1 F and S^-1 of the bolts with a given force, (3 n_pairs, n_given) and (n_given, n_given)."""
        return self.RU[:, self.has_force], np.linalg.inv(self.S[np.ix_(self.has_force, self.has_force)])


def cuts_of(linearised: Linearised, bolts: Bolts, where: str = "") -> Cuts:
    """Return the cuts in the stuck structure.  Collective: one solve per bolt.

    Raises
    ------
    CaseError : only the shank connects the two sides of a bolt with a given force; on every rank
    """
    system, comm = linearised.system, linearised.system.comm
    first, last = linearised.K_L.getOwnershipRange()
    U_owned = linearised.factor.solve(bolts.F_owned)
    RU = summed(comm, system.R[:, first:last] @ U_owned)
    S = np.diag(bolts.k) - gram(comm, bolts.F_owned, U_owned)
    S = comm.bcast(0.5 * (S + S.T))
    for bolt, k, s in zip(bolts.given, bolts.k, np.diag(S)):
        if bolt.force is not None and s < _UNCLAMPED * k:
            raise CaseError(
                f"{where}{': ' if where else ''}[[statics.bolts]] {bolt.label!r}: there is nothing to clamp: besides the shank "
                "nothing connects its two sides, no joint under the head and no support; add the joint that it presses on, or "
                "pull with a force"
            )
    has_force = np.array([bolt.force is not None for bolt in bolts.given])
    stated = np.array([bolt.force if bolt.force is not None else bolt.shortening for bolt in bolts.given], dtype=float)
    return Cuts(bolts, U_owned, comm.bcast(RU), S, has_force, stated)


def of_loads(cuts: Cuts, linearised: Linearised, forces_owned: np.ndarray) -> np.ndarray:
    """Return the forces in the cuts due to forces on the structure, all pairs stuck, (n_bolts,) [N].  Collective: one sum."""
    comm = linearised.system.comm
    return comm.bcast(cuts.bolts.loaded - summed(comm, cuts.U_owned.T @ forces_owned))
