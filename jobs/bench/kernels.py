"""Times of the compiled kernels: contact law, products with columns of the receptance, sparse matrix products.

    python jobs/bench/kernels.py [--pairs 8 55 218] [--H 3 9] [--samples 128]

Processor microseconds per call, the least of several runs, one process.  The columns are those of all pairs of the joint in the
rows of all; NumPy's product is in the next column.  The sparse matrix is that of a lattice of hexahedra, compared with PETSc's
and SciPy's products.  To compare versions, run it in each: it needs only the package.
"""

import argparse
import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import time

import numpy as np
import scipy.sparse as sp
from machine import facts

from microslip.parallel.petsc import initialise

initialise()  # finds PETSc

from microslip.assembly.products import by_petsc, times
from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.receptance.rows import Rows

_RUNS, _SECONDS = 7, 0.1  # the least of this many runs, each of this duration
_LATTICE = (30, 30, 45)  # nodes of the sparse matrix


def least(call):
    """Return the processor microseconds of a call."""
    start = time.process_time()
    call()
    n = max(1, int(_SECONDS / max(time.process_time() - start, 1e-6)))
    times = []
    for _ in range(_RUNS):
        start = time.process_time()
        for _ in range(n):
            call()
        times.append((time.process_time() - start) / n)
    return 1e6 * min(times)


def moving(n_pairs, H, rng):
    """Return a law and a motion under which pairs stick, slip and open."""
    U = np.zeros((n_pairs, 3, 2 * H + 1))
    U[:, :, 0] = 0.1 * rng.standard_normal((n_pairs, 3))
    U[:, :, 1:3] = rng.standard_normal((n_pairs, 3, 2))
    U[:, :, 3:] = 0.1 * rng.standard_normal((n_pairs, 3, 2 * H - 2))
    U[:, 2] *= 0.2
    one = np.ones(n_pairs)
    return ElasticCoulomb(0.3 * one, 2.0 * one, one, one, np.zeros(n_pairs, dtype=bool)), U


def sparse(rng):
    """Return a matrix of 3 rows per node, coupled with the rows of neighbour nodes, in PETSc and in SciPy."""
    from petsc4py import PETSc

    A = sp.identity(1)
    for n in _LATTICE:
        A = sp.kron(A, sp.diags([1.0, 1.0, 1.0], [-1, 0, 1], shape=(n, n)))
    A = sp.kron(A, np.ones((3, 3)), "csr")
    A.sort_indices()
    A.data = rng.standard_normal(A.nnz)
    return PETSc.Mat().createAIJ(A.shape, csr=(A.indptr.astype(PETSc.IntType), A.indices.astype(PETSc.IntType), A.data)), A


def print_sparse(rng):
    """Print times of products with few and many columns."""
    A, S = sparse(rng)
    print(f"\nsparse matrix of {S.shape[0]} rows, {S.nnz} entries\n{'columns':>7} {'A X':>9} {'PETSc':>9} {'SciPy':>9}  us")
    for m in (1, 8, 24, 48):
        X, product = np.asfortranarray(rng.standard_normal((S.shape[0], m))), np.empty((S.shape[0], m), order="F")
        calls = (lambda: times(A, X)), (lambda: by_petsc(A, X, product)), (lambda: S @ X)  # noqa: B023  called here
        print(f"{m:7d} " + " ".join(f"{least(call):9.0f}" for call in calls), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, nargs="+", default=[8, 55, 218])
    parser.add_argument("--H", type=int, nargs="+", default=[3, 9])
    parser.add_argument("--samples", type=int, default=128)
    given = parser.parse_args()
    rng = np.random.default_rng(1)
    print(f"{facts()['processor']}; {given.samples} samples")
    print(f"{'pairs':>6} {'H':>3} {'cycle':>9} {'tangents':>9} {'p^T A':>9} {'single':>9} {'A x':>9} {'NumPy A x':>10}  us")
    for n_pairs in given.pairs:
        A = rng.standard_normal((3 * n_pairs, 3 * n_pairs))
        rows, single = Rows.of(A), Rows.of(A.astype(np.float32))
        for H in given.H:
            law, U = moving(n_pairs, H, rng)
            x = rng.standard_normal((3 * n_pairs, 2 * H + 1))
            us = [
                least(lambda: law.cycle(U, given.samples, tangents=False)),  # noqa: B023  called here
                least(lambda: law.cycle(U, given.samples)),  # noqa: B023
                *(least(lambda: product(x)) for product in (rows.combined, single.combined, rows.times, A.__matmul__)),  # noqa: B023
            ]
            print(f"{n_pairs:6d} {H:3d} " + " ".join(f"{t:9.0f}" for t in us[:-1]) + f" {us[-1]:10.0f}", flush=True)
    print_sparse(rng)


if __name__ == "__main__":
    main()
