"""A disc of alike sectors: the system of each nodal diameter from one sector (docs/theory.md, section 14).

Sector s moves as exp(i d s alpha) times sector 0, in axes turned with it, so that the high face follows the low one as
u_high = exp(i d alpha) Q u_low: u = T(d) w, K(d) = T(d)^H K T(d) and M(d) are Hermitian.  Real for d = 0 and half of the sectors.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..fourier.amplitudes import to_complex, to_real
from .constrained import constrained, reduced_matrices
from .constraints import Constraints
from .system import Disc, System
from .wave_matrix import Unfolding, WaveMatrix, projected


@dataclass(frozen=True, eq=False)
class Sectors:
    """One sector with both faces free, and the data for the system of each nodal diameter.

    K and M of ``sector`` have a row for each row of ``unfolding``, its maps a column for each row of T of the ``constraints``.
    """

    n_sectors: int
    wave_number: int  # h: sector s + 1 leads sector s by h alpha in harmonic 1
    sector: System
    R_next: sp.csr_matrix  # (3 n_pairs, n) of second sides in the next sector, which are not in R of ``sector``
    constraints: Constraints  # of nodal diameter 0
    part: np.ndarray  # (n_nodes,) connected part of each node
    high: np.ndarray  # (n_high,) nodes of the high face
    unfolding: Unfolding  # from the rows of a nodal diameter to those of the sector with both faces
    T: sp.csr_matrix  # (n, n_v) u = T v of the sector with both faces
    shared: dict[Hashable, Any] = field(default_factory=dict, repr=False)  # data common to all nodal diameters, by key
    blades: tuple[PETSc.Mat, PETSc.Mat] | None = None  # K and M of the bodies that differ alone, on the rows of nodes

    @classmethod
    def of(
        cls,
        n_sectors: int,
        wave_number: int,
        sector: System,
        R_next: sp.csr_matrix,
        constraints: Constraints,
        part: np.ndarray,
        high: np.ndarray,
    ) -> Sectors:
        """Return the sectors of a sector whose K and M have the rows of its nodes.  Collective; destroys these."""
        unfolding, T = _unfolded(constraints, high)
        K, M = reduced_matrices(sector, replace(constraints, T=T, row_ranges=unfolding.v_ranges))
        return cls(n_sectors, wave_number, replace(sector, K=K, M=M), R_next, constraints, part, high, unfolding, T)

    @property
    def with_both_faces(self) -> Constraints:
        """The constraints of the sector with both faces free: the rows of its K and M."""
        return replace(self.constraints, T=self.T, row_ranges=self.unfolding.v_ranges)

    def about(self, system: System, change: PETSc.Mat) -> System:
        """Return the system of nodal diameter 0 with a ``change`` (n_v, n_v) of the sector's K, in the K of all diameters.

        Collective: a product of sparse matrices.  docs/theory.md, eq. (14.10).  ``system`` is that without, whose
        M and maps are shared.
        """
        K = self.sector.K.duplicate(copy=True)
        K.axpy(1.0, change, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        sectors = replace(self, sector=replace(self.sector, K=K), shared={})
        return replace(system, K=projected(K, self.unfolding, 1.0), sectors=sectors)

    def at_rest(self, u_owned: np.ndarray, moved: np.ndarray | None) -> Sectors:
        """Return the sectors with the displacement at rest, this rank's rows of nodal diameter 0, (n_w_owned,) [m].  Local.

        ``moved`` (n_nodes, 3) [m] is how far supports are moved.
        """
        return replace(self, sector=replace(self.sector, rest_owned=u_owned, moved=moved))

    def rest_at_nodes(self, w: np.ndarray) -> np.ndarray:
        """Return the displacement of the sector's nodes at rest, (n_nodes, 3), from the rows of nodal diameter 0.  Local."""
        return self.constraints.at_nodes(w)

    def phase(self, d: int) -> complex:
        """Return exp(i d alpha), the phase by which sector 1 leads sector 0.  Local."""
        if d % self.n_sectors == 0:
            return 1.0
        return -1.0 if 2 * d % self.n_sectors == 0 else complex(np.exp(2j * np.pi * d / self.n_sectors))

    def system(self, d: int, explicit: bool = True) -> System:
        """Return the system of nodal diameter d, 0 to ``n_sectors`` - 1, docs/theory.md, eq. (14.2).

        Collective: products of sparse matrices.  Matrices of a real phase have entries if ``explicit``; the others never have.

        Raises
        ------
        CaseError : nothing can move, or a load moves nothing; on every rank
        """
        phase, sector = self.phase(d), self.sector
        T = (self.T @ self.unfolding.at(phase)).tocsr()
        of_d = replace(sector, R=sector.R - phase * self.R_next)
        matrices = self.at_diameter(sector.K, phase, explicit), self.at_diameter(sector.M, phase, explicit)
        return replace(constrained(of_d, replace(self.constraints, T=T), self.part, matrices), sectors=self, phase=phase)

    def at_diameter(self, A: PETSc.Mat, phase: complex, explicit: bool = True) -> PETSc.Mat:
        """Return P(d)^H A P(d), with entries if ``explicit`` and the phase is real, otherwise as products with A.  Collective."""
        if np.iscomplexobj(phase) or not explicit:
            return WaveMatrix.matrix(A, self.unfolding, phase)
        return projected(A, self.unfolding, float(np.real(phase)))

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

    def free_shared(self) -> None:
        """Free the nodal diameters' common factor of the sector; it is computed again when needed.  Collective."""
        for item in self.shared.values():
            item.destroy()
        self.shared.clear()

    def destroy(self, other: Disc | None = None) -> None:
        """Free the matrices of the sector and the shared data of its nodal diameters; a second call does nothing.  Collective.

        Those that an ``other`` state of rest of the same sectors shares stay.
        """
        if isinstance(other, Sectors) and other.shared is self.shared:
            return
        self.free_shared()
        if isinstance(other, Sectors):
            self.sector.destroy(other.sector)
            return
        self.sector.destroy()
        self.unfolding.destroy()
        for matrix in self.blades or ():
            matrix.destroy()


@dataclass(frozen=True, eq=False)
class AllSectors:
    """A disc whose motion has a row for each DOF of a sector and each sector, the sectors of a DOF one after the other."""

    disc: Disc
    turns: np.ndarray  # (N, 3, 3) of the sectors about the axis

    @property
    def n_sectors(self) -> int:
        """The number of sectors."""
        return self.disc.n_sectors

    @property
    def blades(self) -> tuple[PETSc.Mat, PETSc.Mat] | None:
        """K and M of the bodies that differ alone, on the rows of nodes."""
        return self.disc.blades

    def system(self, d: int, explicit: bool = True) -> System:
        """Return the system of nodal diameter d.  Collective."""
        return self.disc.system(d, explicit)

    def at_nodes(self, w: np.ndarray) -> np.ndarray:
        """Return the motion of the nodes, sector after sector, (N n_nodes, 3, N_H), for w (n_dof N, N_H).  Local."""
        assert isinstance(self.disc, Sectors), "what makes the systems"
        N, N_H = self.n_sectors, w.shape[1]
        u = self.disc.constraints.at_nodes(w.reshape(-1, N * N_H)).reshape(-1, 3, N, N_H)
        u[self.disc.high] = np.roll(u[self.disc.high], -1, axis=2)  # nodes of the low face of the next sector
        return np.einsum("sij,njsh->snih", self.turns, u).reshape(-1, 3, N_H)

    def rest_at_nodes(self, w: np.ndarray) -> np.ndarray:
        """Return the displacement of the nodes of sector 0 at rest, that of alike sectors, (n_nodes, 3).  Local."""
        return self.disc.rest_at_nodes(w)

    def destroy(self, other: Disc | None = None) -> None:
        """Free the matrices of the sector.  Collective."""
        self.disc.destroy(other.disc if isinstance(other, AllSectors) else other)


def _unfolded(constraints: Constraints, high: np.ndarray) -> tuple[Unfolding, sp.csr_matrix]:
    """Return P_0 and P_1 of eq. (14.6), and T of the sector with both faces, (n, n_v).  Local; the same on every rank."""
    T, w_ranges, nodal_ranges = constraints.T.tocsr(), constraints.row_ranges, constraints.nodal_ranges
    rows = constraints.dof[high].ravel()
    rows = np.sort(rows[rows >= 0])
    counts = np.diff(np.searchsorted(rows, nodal_ranges))
    v_ranges = w_ranges + np.concatenate([[0], np.cumsum(counts)])
    n, n_w, n_v = T.shape[0], int(w_ranges[-1]), int(v_ranges[-1])
    columns, rank = np.arange(n_w), np.repeat(np.arange(len(counts)), np.diff(w_ranges))
    of_w = columns + (v_ranges - w_ranges)[rank]
    of_high = np.arange(len(rows)) + w_ranges[1:][np.repeat(np.arange(len(counts)), counts)]
    P_0 = sp.csr_matrix((np.ones(n_w), (of_w, columns)), (n_v, n_w))
    E = sp.csr_matrix((np.ones(len(rows)), (rows, of_high)), (n, n_v))
    is_high: np.ndarray = np.zeros(n)
    is_high[rows] = 1.0
    P_1 = (E.T @ T).tocsr()
    sided = (sp.diags(1.0 - is_high) @ T @ P_0.T + E).tocsr()
    sided.eliminate_zeros()
    return Unfolding((P_0, P_1), w_ranges, v_ranges), sided
