"""A preconditioner for wide slip of large joints: B_n of (5.5) within subdomains of pairs, with a coarse space of mean motions.

docs/theory.md, section 5.  Factors of the whole B_n cost the cube of the number of pairs.  B_n is ill-conditioned for two
reasons: coupling of neighbouring pairs, and motions of whole regions, for which the structure without its joint is soft.  The
blocks D_n within subdomains of at most ``LOCAL`` pairs treat the first, the mean motions Z of about ``REGIONS`` larger regions
the second:

    B_n^-1 r  ~  m + D_n^-1 (r - B_n m),        m = Z (Z^T B_n Z)^-1 Z^T r.        (5.7)

The cost of both is about proportional to the number of pairs; B_n Z is a product with G_n, computed once.
"""

from collections.abc import Iterator

import numpy as np
import scipy.linalg
from scipy.linalg.lapack import zgetrs

from ..parallel.ownership import rows_of
from ..receptance.subdomains import bisected
from .linearisation import Linearisation
from .preconditioner import REGULAR, HarmonicPreconditioner, Inverse, PairsPreconditioner, complex_linear

LOCAL = 64  # largest number of pairs of a subdomain
REGIONS = 32  # approximate number of regions of the coarse space
LARGEST_SECTOR = 110  # active pairs of a sector of a disc that are solved for exactly
LARGE = 500  # active pairs beyond which the factors of the whole B_n cost more than they save


def of_wide_slip(at: Linearisation) -> PairsPreconditioner:
    """Return the preconditioner of wide slip for this number of active pairs.  Collective."""
    if at.equation.model.n_sectors > 1:
        return SectorsPreconditioner(at)
    return (SubdomainPreconditioner if len(at.forces.active) > LARGE else HarmonicPreconditioner)(at)


class SectorsPreconditioner(PairsPreconditioner):
    """The blocks of B_n, eq. (5.5), within each sector of a whole disc: the pairs of two sectors are coupled by the disc only.

    Collective.  A sector of more than ``LARGEST_SECTOR`` active pairs is bisected.  A rank solves for the blocks with its pairs.
    """

    def __init__(self, at: Linearisation):
        super().__init__(at)
        P = REGULAR * at.equation.gather(complex_linear(at.P, at.equation.model.N_H))  # (n_active, n_harmonics, 3, 3)
        sector = at.forces.active // (at.equation.model.n_pairs // at.equation.model.n_sectors)
        of_sectors = [np.flatnonzero(sector == s) for s in np.unique(sector)]
        self.subdomains, inverses = _of_rank(at, P, bisected(at.G, of_sectors, LARGEST_SECTOR), self.local_rows)
        self.local = [np.array([each.of_B for each in of_harmonics]) for of_harmonics in inverses]

    def solve_all(self, b: np.ndarray) -> np.ndarray:
        """Return the solutions for the right-hand sides b, those of all harmonics of a sector at once; of other ranks 0."""
        of_harmonics, x = np.ascontiguousarray(b.T), np.zeros_like(b.T, order="C")
        for rows, inverses in zip(self.subdomains, self.local):
            is_range = rows[-1] - rows[0] == len(rows) - 1  # of a sector that is not bisected: a view
            places = slice(rows[0], rows[-1] + 1) if is_range else rows
            x[:, places] = (inverses @ of_harmonics[:, places, None].astype(inverses.dtype))[:, :, 0]
        return x.T


class SubdomainPreconditioner(PairsPreconditioner):
    """The approximate B_n^-1, eq. (5.7), for the active pairs of a linearisation; reused for nearby ones.

    Collective.  A rank solves for the subdomains with its pairs.
    """

    def __init__(self, at: Linearisation):
        super().__init__(at)
        P = REGULAR * at.equation.gather(complex_linear(at.P, at.equation.model.N_H))  # (n_active, n_harmonics, 3, 3)
        regions = bisected(at.G, [np.arange(len(P))], max(LOCAL, -(-len(P) // REGIONS)))
        self.subdomains, self.local = _of_rank(at, P, bisected(at.G, regions, LOCAL), self.local_rows)
        self.regions = _Regions(at, P, regions)

    def solve(self, n: int, b: np.ndarray) -> np.ndarray:
        """Return the solution for the right-hand side b of harmonic n; of the pairs of other ranks its mean only."""
        mean, rest = self.regions.solve(n, b)
        for rows, inverses in zip(self.subdomains, self.local):
            mean[rows] += inverses[n].times(rest[rows])
        return mean


class _Regions:
    """The coarse space: columns of Z move a region in one direction; B_n Z and the factors of Z^T B_n Z.  Collective."""

    def __init__(self, at: Linearisation, P: np.ndarray, regions: list[np.ndarray]):
        self.rows = [rows_of(region).reshape(-1, 3) for region in regions]
        self.sizes = [len(region) ** -0.5 for region in regions]
        moved = [at.G.moved_by(region, size * P[region]) for region, size in zip(regions, self.sizes)]
        self.B_Z = list(at.equation.gather(np.concatenate(moved, axis=2).swapaxes(0, 1)).swapaxes(0, 1))  # by harmonic
        for B_Z in self.B_Z:
            for k, (rows, size) in enumerate(zip(self.rows, self.sizes)):
                for direction in range(3):
                    B_Z[rows[:, direction], 3 * k + direction] += size
        self.factors = [scipy.linalg.lu_factor(self._means(B_Z), check_finite=False) for B_Z in self.B_Z]

    def _means(self, r: np.ndarray) -> np.ndarray:
        """Return Z^T r, (3 n_regions, ...)."""
        return np.concatenate([size * r[rows].sum(axis=0) for rows, size in zip(self.rows, self.sizes)])

    def solve(self, n: int, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return m of eq. (5.7) and r - B_n m, (3 n_active,) each, for the n-th harmonic of the set.  Local."""
        y, _ = zgetrs(*self.factors[n], self._means(r))
        motion = np.empty_like(r)
        for k, (rows, size) in enumerate(zip(self.rows, self.sizes)):
            motion[rows] = size * y[3 * k : 3 * k + 3]
        return motion, r - self.B_Z[n] @ y


def _of_rank(
    at: Linearisation, P: np.ndarray, subdomains: list[np.ndarray], local_rows: slice
) -> tuple[list[np.ndarray], list[list[Inverse]]]:
    """Return the rows of the subdomains with pairs of this rank, and the inverses of their blocks by harmonic.

    Collective: one gather for each of all ``subdomains`` (k,) of active pairs; ``local_rows`` are the rows of this rank's.
    """
    of_rank, inverses = [], []
    for rows in map(rows_of, subdomains):
        blocks = at.G.blocks(rows[::3] // 3)
        if ((rows >= local_rows.start) & (rows < local_rows.stop)).any():
            of_rank.append(rows)
            inverses.append(_inverses(blocks, P, rows))
    return of_rank, inverses


def _inverses(blocks: Iterator[np.ndarray], P: np.ndarray, rows: np.ndarray) -> list[Inverse]:
    """Return the inverse of the block of B_n of one subdomain, for each harmonic, from blocks of G_n.  Local."""
    pairs, inverses = rows[::3] // 3, []
    for n, G_n in enumerate(blocks):
        G_P = np.einsum("rmi,mij->rmj", G_n.reshape(len(rows), -1, 3), P[pairs, n]).reshape(G_n.shape)
        inverses.append(Inverse(np.eye(len(rows)) + G_P))
    return inverses
