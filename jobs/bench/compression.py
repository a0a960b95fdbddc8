"""What compressing G_static would save: hierarchical low rank between clusters of pairs, over its tolerance.

    python jobs/bench/compression.py [SCENE.toml ...] [--pairs 500 1000 2000] [--tolerances 1e-6 1e-8 1e-10] [--leaf 64]

Pairs are halved along their longest side down to clusters of ``leaf`` pairs.  The block between two clusters that lie apart by
at least the smaller one's diameter is written as a product of two thin matrices, with the rank that its singular values
ask for: no block is wrong by more than tolerance |G_static|.  That is the best that any such method reaches; what finds the ranks
without the singular values takes some more.  Measured of each matrix: the share of the memory that remains, the largest and the
mean rank, the error of a product, and its time in double and in single precision beside the whole matrix' (7 vectors: H = 3),
each by NumPy, processor time.  The matrix is that of synthetic.py, or of a scene, all pairs.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
import argparse
import time
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from microslip.parallel.petsc import initialise

initialise()
from machine import facts
from mpi4py import MPI
from prepared import prepare
from synthetic import grid, joint_model, patch

N_H = 7  # vectors of a product


@dataclass(frozen=True)
class Block:
    """A block of the matrix, as it is, or left @ right."""

    rows: np.ndarray
    columns: np.ndarray
    factors: tuple[np.ndarray, ...]

    @property
    def size(self) -> int:
        return sum(factor.size for factor in self.factors)

    @property
    def rank(self) -> int:
        return self.factors[0].shape[1] if len(self.factors) == 2 else 0


def clusters_of(position: np.ndarray, chosen: np.ndarray, leaf: int) -> tuple:
    """Return the tree of clusters: (pairs, halves), no halves of those of up to ``leaf`` pairs."""
    if len(chosen) <= leaf:
        return chosen, ()
    sides = np.ptp(position[chosen], axis=0)
    order = chosen[np.argsort(position[chosen, np.argmax(sides)], kind="stable")]
    halves = order[: len(order) // 2], order[len(order) // 2 :]
    return chosen, tuple(clusters_of(position, half, leaf) for half in halves)


def lie_apart(position: np.ndarray, a: np.ndarray, b: np.ndarray) -> bool:
    """Tell whether the boxes around two clusters are at least the smaller one's diameter apart."""
    lowest, highest = (np.array([f(position[c], axis=0) for c in (a, b)]) for f in (np.min, np.max))
    gap = np.linalg.norm(np.maximum(0.0, np.maximum(lowest[0] - highest[1], lowest[1] - highest[0])))
    return bool(gap >= np.linalg.norm(highest - lowest, axis=1).min())


def blocks_of(G: np.ndarray, position: np.ndarray, a: tuple, b: tuple, error: float) -> list[Block]:
    """Return the blocks between two clusters, each right to ``error`` in the 2-norm."""
    rows, columns = ((3 * cluster[0][:, None] + np.arange(3)).ravel() for cluster in (a, b))
    if lie_apart(position, a[0], b[0]):
        left, values, right = scipy.linalg.svd(G[np.ix_(rows, columns)], full_matrices=False)
        rank = int(np.count_nonzero(values > error))
        if rank * (len(rows) + len(columns)) < len(rows) * len(columns):
            return [Block(rows, columns, (left[:, :rank] * values[:rank], right[:rank].copy()))]
    if not a[1] or not b[1]:
        return [Block(rows, columns, (G[np.ix_(rows, columns)],))]
    return [block for half in a[1] for other in b[1] for block in blocks_of(G, position, half, other, error)]


def product(blocks: list[Block], x: np.ndarray) -> np.ndarray:
    y = np.zeros_like(x)
    for block in blocks:
        part = x[block.columns]
        for factor in block.factors[::-1]:
            part = factor @ part
        y[block.rows] += part
    return y


def single(blocks: list[Block]) -> list[Block]:
    return [Block(b.rows, b.columns, tuple(factor.astype(np.float32) for factor in b.factors)) for b in blocks]


def milliseconds(call) -> float:
    """Return the least processor time of five calls."""
    times = []
    for _ in range(5):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def row(name: str, G: np.ndarray, blocks: list[Block], tolerance: float, whole: list[float]) -> str:
    """Return a row of the table."""
    x = np.random.default_rng(0).standard_normal((len(G), N_H))
    exact = G @ x
    error = np.linalg.norm(product(blocks, x) - exact) / np.linalg.norm(exact)
    ranks = [block.rank for block in blocks if len(block.factors) == 2] or [0]
    thin = single(blocks)
    x_single = x.astype(np.float32)
    times = milliseconds(lambda: product(blocks, x)), milliseconds(lambda: product(thin, x_single))
    cells = [name, f"{len(G) // 3:,}", f"{tolerance:.0e}", f"{sum(b.size for b in blocks) / G.size:.2f}"]
    cells += [f"{max(ranks)}; {np.mean(ranks):.0f}", f"{error:.0e}", *(f"{t:.1f} ({w:.1f})" for t, w in zip(times, whole))]
    return "| " + " | ".join(cells) + " |"


def measure(name: str, G: np.ndarray, position: np.ndarray, tolerances, leaf: int) -> None:
    """Print the rows of one matrix."""
    tree, norm = clusters_of(position, np.arange(len(position)), leaf), scipy.linalg.norm(G[:, :300], 2)
    x = np.random.default_rng(0).standard_normal((len(G), N_H))
    G_single, x_single = G.astype(np.float32), x.astype(np.float32)
    whole = [milliseconds(lambda: G @ x), milliseconds(lambda: G_single @ x_single)]
    for tolerance in tolerances:
        print(row(name, G, blocks_of(G, position, tree, tree, tolerance * norm), tolerance, whole), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--pairs", type=int, nargs="*", default=[500, 1000, 2000])
    parser.add_argument("--tolerances", type=float, nargs="+", default=[1e-6, 1e-8, 1e-10])
    parser.add_argument("--leaf", type=int, default=64)
    given = parser.parse_args()
    comm = MPI.COMM_SELF
    print(
        f"{facts()['processor']}\n\n| matrix | pairs | tolerance | memory, share | rank: most; mean | error of a product |",
        end="",
    )
    print(" ms, double (whole) | ms, single (whole) |\n| --- |" + " ---: |" * 7)
    for n in given.pairs:
        columns = joint_model(comm, n, 1).receptance_of(1).static.G_static.transposed(np.arange(n))
        measure("synthetic", np.ascontiguousarray(columns.T), patch(grid(n)), given.tolerances, given.leaf)
    for scene in given.scenes:
        found = prepare(scene, comm)
        G = np.ascontiguousarray(found.model.receptance_of(1).static.G_static.transposed(np.arange(found.model.n_pairs)).T)
        measure(scene, G, found.structure.pairs.position, given.tolerances, given.leaf)


if __name__ == "__main__":
    main()
