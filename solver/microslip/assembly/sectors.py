"""A disc of alike sectors: the system of each nodal diameter from one sector (docs/theory.md, section 14).

Sector s moves as exp(i d s alpha) times sector 0, in axes turned with it, so that the high face follows the low one as
u_high = exp(i d alpha) Q u_low: u = T(d) w, K(d) = T(d)^H K T(d) and M(d) are Hermitian.  Real for d = 0 and half of the sectors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..fourier.amplitudes import to_complex, to_real
from .constrained import constrained
from .constraints import Constraints
from .system import Disc, System


@dataclass(frozen=True, eq=False)
class Sectors:
    """One sector with both faces free, and what makes the system of each nodal diameter of it."""

    n_sectors: int
    wave_number: int  # h: sector s + 1 leads sector s by h alpha in harmonic 1
    sector: System  # K, M and maps with a row or a column for each row of T
    R_next: sp.csr_matrix  # (3 n_pairs, n) of second sides in the next sector, which are not in R of ``sector``
    constraints: Constraints  # of nodal diameter 0
    part: np.ndarray  # (n_nodes,) connected part of each node
    high: np.ndarray  # (n_high,) nodes of the high face

    def phase(self, d: int) -> complex:
        """Return exp(i d alpha): what leads in sector 1 before sector 0.  Local."""
        if d % self.n_sectors == 0:
            return 1.0
        return -1.0 if 2 * d % self.n_sectors == 0 else complex(np.exp(2j * np.pi * d / self.n_sectors))

    def system(self, d: int) -> System:
        """Return the system of nodal diameter d, 0 to ``n_sectors`` - 1, docs/theory.md, eq. (14.2).

        Collective: products of sparse matrices.

        Raises
        ------
        CaseError : nothing can move, or a load moves nothing; on every rank
        """
        phase, constraints = self.phase(d), self.constraints
        factors: np.ndarray = np.ones(constraints.T.shape[0], dtype=type(phase))
        rows = constraints.dof[self.high].ravel()
        factors[rows[rows >= 0]] = phase
        T = (sp.diags(factors) @ constraints.T).tocsr()
        sector = replace(self.sector, R=self.sector.R - phase * self.R_next)
        system = constrained(sector, replace(constraints, T=T), self.part, keeps=True)
        return replace(system, sectors=self)

    def diameter(self, n: int) -> int:
        """Return the sector index of harmonic n, 0 to ``n_sectors`` - 1.  Local."""
        return n * self.wave_number % self.n_sectors

    def at_nodes(self, w: np.ndarray) -> np.ndarray:
        """Return the motion of the sector's nodes, (n_nodes, 3, N_H), from coefficients of all rows, (n_dof, N_H).  Local.

        The harmonics are 0, 1, ..., of which each has its own T(d).
        """
        u = self.constraints.at_nodes(w)
        of_high = to_complex(u[self.high].reshape(-1, u.shape[-1]))
        of_high *= [self.phase(self.diameter(n)) for n in range(of_high.shape[1])]
        u[self.high] = to_real(of_high, u.shape[-1]).reshape(-1, 3, u.shape[-1])
        return u

    def destroy(self) -> None:
        """Free the matrices of the sector; once more does nothing.  Collective."""
        self.sector.destroy()


@dataclass(frozen=True, eq=False)
class AllSectors:
    """A disc whose motion has a row for each DOF of a sector and each sector, the sectors of a DOF one after the other."""

    disc: Disc
    turns: np.ndarray  # (N, 3, 3) of the sectors about the axis

    @property
    def n_sectors(self) -> int:
        """The number of sectors."""
        return self.disc.n_sectors

    def system(self, d: int) -> System:
        """Return the system of nodal diameter d.  Collective."""
        return self.disc.system(d)

    def at_nodes(self, w: np.ndarray) -> np.ndarray:
        """Return the motion of the nodes, sector after sector, (N n_nodes, 3, N_H), for w (n_dof N, N_H).  Local."""
        assert isinstance(self.disc, Sectors), "what makes the systems"
        N, N_H = self.n_sectors, w.shape[1]
        u = self.disc.constraints.at_nodes(w.reshape(-1, N * N_H)).reshape(-1, 3, N, N_H)
        u[self.disc.high] = np.roll(u[self.disc.high], -1, axis=2)  # nodes of the low face of the next sector
        return np.einsum("sij,njsh->snih", self.turns, u).reshape(-1, 3, N_H)

    def destroy(self) -> None:
        """Free the matrices of the sector.  Collective."""
        self.disc.destroy()
