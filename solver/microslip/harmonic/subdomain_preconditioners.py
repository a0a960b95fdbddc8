"""A preconditioner for wide slip of large joints: B_n of (5.5) within subdomains of pairs, with a coarse space of mean motions.

docs/theory.md, section 5.  Factors of the whole B_n cost the cube of the number of pairs.  B_n is ill-conditioned for two
reasons: coupling of neighbouring pairs, and motions of whole regions, for which the structure without its joint is soft.  The
blocks D_n within subdomains of at most ``LOCAL`` pairs treat the first, the mean motions Z of about ``REGIONS`` larger regions
the second:

    B_n^-1 r  ~  m + D_n^-1 (r - B_n m),        m = Z (Z^T B_n Z)^-1 Z^T r.        (5.7)

The cost of both is about proportional to the number of pairs; B_n Z is a product with G_n, computed once.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from scipy.linalg.lapack import zgetrs

from ..fourier.harmonics import Harmonics
from ..parallel.ownership import rows_of
from ..receptance.subdomains import bisected
from .linearisation import Linearisation
from .preconditioner import REGULAR, HarmonicPreconditioner, Inverse, PairsPreconditioner, complex_linear

LOCAL = 64  # largest number of pairs of a subdomain
REGIONS = 32  # approximate number of regions of the coarse space
LARGEST_SECTOR = 110  # active pairs of a sector of a disc that are solved for exactly
LEAST = 1e-4  # of the static motion: modes of a disc that add less to a block are omitted
LARGE = 500  # active pairs beyond which the factors of the whole B_n cost more than they save


def of_wide_slip(at: Linearisation) -> PairsPreconditioner:
    """Return the preconditioner of wide slip for this number of active pairs.  Collective."""
    if at.equation.model.n_sectors > 1:
        return SectorsPreconditioner(at)
    return (SubdomainPreconditioner if len(at.forces.active) > LARGE else HarmonicPreconditioner)(at)


@dataclass(frozen=True, eq=False)
class _Sweep:
    """The part of a sweep over the harmonics, eq. (17.8), that solves for one of them."""

    columns: slice  # of the coefficients
    P: np.ndarray  # (m, 3 k, 3 N_H) the rows of the harmonic in dp/dU of the pairs, without unit
    K: list[np.ndarray]  # of each subdomain, without unit: real (3 k n, 3 k n), or conjugate complex (3 n, 3 n)
    kind: np.dtype  # of K

    def solve(self, x: np.ndarray) -> None:
        """Replace the right-hand side b_n in x (m, 3, N_H) by x_n; later harmonics of x are 0."""
        p = np.matmul(self.P, x.reshape(-1, self.P.shape[2], 1)).ravel().view(self.kind)  # cos + i sin of complex amplitudes
        moved, first = np.empty_like(p), 0
        for K in self.K:
            there = slice(first, first + len(K))
            np.matmul(K, p[there], out=moved[there])
            first = there.stop
        x[..., self.columns] -= moved.view(x.dtype).reshape(-1, 3, self.P.shape[1] // 3)


class SectorsPreconditioner(PairsPreconditioner):
    """A sweep over the harmonics, eq. (17.8), within each sector of a whole disc: the disc couples two sectors only weakly.

    Collective.  A sector of more than ``LARGEST_SECTOR`` active pairs is bisected.  A rank solves for the blocks with its pairs.
    """

    def __init__(self, at: Linearisation):
        super().__init__(at)
        P, harmonics = REGULAR * at.equation.gather(at.P), at.equation.harmonics
        sector = at.forces.active // (at.equation.model.n_pairs // at.equation.model.n_sectors)
        of_sectors = [np.flatnonzero(sector == s) for s in np.unique(sector)]
        self.unit = float(np.abs(P).max(initial=0.0)) or 1.0  # N/m
        self.subdomains, responses = _of_rank(
            at,
            bisected(at.G, of_sectors, LARGEST_SECTOR),
            self.local_rows,
            lambda G, pairs: _responses(G, P[pairs], harmonics, self.unit),
            LEAST,
        )
        self.pairs = np.concatenate([np.zeros(0, dtype=int), *(rows[::3] // 3 for rows in self.subdomains)])
        mine = np.arange(self.local_rows.start, self.local_rows.stop, 3) // 3
        self.places = np.argsort(self.pairs)[np.searchsorted(np.sort(self.pairs), mine)]
        is_single = all(K.dtype in (np.float32, np.complex64) for of_harmonics in responses for K in of_harmonics)
        self.kind = np.dtype(np.float32 if is_single else np.float64)
        self.sweep = [
            self._part(n, P[self.pairs], [each[harmonics.chosen.index(n)] for each in responses]) for n in _order(harmonics)
        ]

    def _part(self, n: int, P: np.ndarray, K: list[np.ndarray]) -> _Sweep:
        """Return the part of harmonic n from the tangents of the pairs (m, 3 N_H, 3 N_H) [N/m] and K_n of each subdomain."""
        harmonics, n_columns = self.made_at.equation.harmonics, P.shape[2]
        columns, kind = harmonics.columns(n), self.kind if _is_whole(harmonics, n) else np.result_type(self.kind, np.complex64)
        rows = P.reshape(-1, 3, n_columns // 3, n_columns)[:, :, columns].reshape(
            -1, 3 * (columns.stop - columns.start), n_columns
        )
        P_n = np.ascontiguousarray(rows / self.unit, dtype=self.kind)
        return _Sweep(columns, P_n, [each.astype(kind, copy=False) for each in K], kind)

    def apply(self, b: np.ndarray) -> np.ndarray:
        """Return the approximate solution of (1 + G P) x = b within the sectors, (m, 3, N_H).  Collective: one gather."""
        b = self.made_at.equation.gather(b)[self.pairs]
        x = np.zeros(b.shape, dtype=self.kind)
        for part in self.sweep:
            x[..., part.columns] = b[..., part.columns]
            part.solve(x)
        return x[self.places].astype(float)


def _order(harmonics: Harmonics) -> list[int]:
    """Return the harmonics of a sweep: from the fundamental up, then the mean."""
    return [*map(int, harmonics.above_mean), *harmonics.chosen[harmonics.mean]]


def _is_whole(harmonics: Harmonics, n: int) -> bool:
    """Return whether the sweep solves for a harmonic with its whole tangent, in real numbers: the fundamental and the mean."""
    return n in (0, _order(harmonics)[0])


def _responses(blocks: Iterator[np.ndarray], P: np.ndarray, harmonics: Harmonics, unit: float) -> list[np.ndarray]:
    """Return K_n of one subdomain for each harmonic, without unit, from blocks of G_n and dp/dU (m, 3 N_H, 3 N_H).  Local.

    Of a harmonic with its whole tangent it is real; of the others conjugate complex, with the complex-linear part.
    """
    N_H, responses = harmonics.n_coefficients, []
    by_row, complex_P = P.reshape(len(P), 3, N_H, 3, N_H), complex_linear(P, N_H).conj()
    for i, (n, G_n) in enumerate(zip(harmonics.chosen, blocks)):
        if _is_whole(harmonics, n):
            columns = harmonics.columns(n)
            P_n = by_row[:, :, columns, :, columns].reshape(len(P), 3 * (columns.stop - columns.start), -1)
            responses.append(_response(G_n.real if n == 0 else _of_coefficients(G_n), P_n, unit))
        else:
            responses.append(_response(G_n.conj(), complex_P[:, i], unit))
    return responses


def _of_coefficients(G: np.ndarray) -> np.ndarray:
    """Return the real map of the coefficients cos, sin of each row, (2 r, 2 r), that multiplies their amplitudes by G (r, r)."""
    parts = np.array([[G.real, G.imag], [-G.imag, G.real]])
    return parts.transpose(2, 0, 3, 1).reshape(2 * len(G), -1)


def _response(G: np.ndarray, P: np.ndarray, unit: float) -> np.ndarray:
    """Return (1 + G P)^-1 G times ``unit``, with P (m, a, a) block-diagonal; in single precision where that suffices.  Local."""
    inverse = Inverse(np.eye(len(G)) + _times_blocks(G, P)).of_B
    K: np.ndarray = inverse @ (unit * G).astype(inverse.dtype)
    return K


def _times_blocks(G: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return G P of a block-diagonal P, (m, a, a).  Local."""
    columns = G.reshape(len(G), *P.shape[:2]).swapaxes(0, 1)
    product: np.ndarray = np.matmul(columns, P).swapaxes(0, 1).reshape(G.shape)
    return product


class SubdomainPreconditioner(PairsPreconditioner):
    """The approximate B_n^-1, eq. (5.7), for the active pairs of a linearisation; reused for nearby ones.

    Collective.  A rank solves for the subdomains with its pairs.
    """

    def __init__(self, at: Linearisation):
        super().__init__(at)
        P = REGULAR * at.equation.gather(complex_linear(at.P, at.equation.model.N_H))  # (n_active, n_harmonics, 3, 3)
        regions = bisected(at.G, [np.arange(len(P))], max(LOCAL, -(-len(P) // REGIONS)))
        subdomains = bisected(at.G, regions, LOCAL)
        self.subdomains, self.local = _of_rank(at, subdomains, self.local_rows, lambda G, pairs: _inverses(G, P[pairs]))
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
    at: Linearisation,
    subdomains: list[np.ndarray],
    local_rows: slice,
    of_blocks: Callable[[Iterator[np.ndarray], np.ndarray], list[Any]],
    least: float = 0.0,
) -> tuple[list[np.ndarray], list[list[Any]]]:
    """Return the rows of the subdomains with pairs of this rank, and what is made of their blocks of G_n and their pairs.

    Collective: one gather for each of all ``subdomains`` (k,) of active pairs; ``local_rows`` are the rows of this rank's.
    """
    of_rank = []
    for pairs in subdomains:  # the gathers first: no rank waits for the work of another one
        blocks, rows = at.G.blocks(pairs, least), rows_of(pairs)
        if ((rows >= local_rows.start) & (rows < local_rows.stop)).any():
            of_rank.append((rows, pairs, blocks))
    return [rows for rows, _, _ in of_rank], [of_blocks(blocks, pairs) for _, pairs, blocks in of_rank]


def _inverses(blocks: Iterator[np.ndarray], P: np.ndarray) -> list[Inverse]:
    """Return the inverse of the block of B_n of one subdomain, for each harmonic, from blocks of G_n and P_n.  Local."""
    return [Inverse(np.eye(len(G_n)) + _times_blocks(G_n, P[:, n])) for n, G_n in enumerate(blocks)]
