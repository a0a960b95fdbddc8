"""What the preconditioners of wide slip cost and save in a joint of which every pair slips.

    python jobs/bench/preconditioners.py [--pairs 250 500 1000 1500] [--limit 0.05] [--whole 1000]

The joint is that of synthetic.py, its friction limits ``limit`` times the largest forces while stuck, H = 3, at a solution.  Of none, the
factors of the whole B_n (5.5), up to ``--whole`` pairs, and clusters (5.7): processor time to make, iterations of GMRES down to
1e-3 from a random right-hand side, and the time of a solve.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
import argparse
import time

import numpy as np
from machine import facts

from microslip.parallel.petsc import initialise

initialise()
import synthetic
from mpi4py import MPI

from microslip.continuation.grid import at_frequencies
from microslip.harmonic.clustered import ClusteredPreconditioner
from microslip.harmonic.gmres import Gmres
from microslip.harmonic.linearisation import Linearisation
from microslip.harmonic.newton_solver import RTOL
from microslip.harmonic.preconditioner import HarmonicPreconditioner
from microslip.points.selection import AllPairs
from microslip.receptance.columns import ActiveColumns

COMM, H = MPI.COMM_SELF, 3


def at_a_solution(n_pairs: int) -> Linearisation:
    """Return the linearisation of the joint where all of it slips."""
    problem = synthetic.joint_problem(synthetic.joint_model(COMM, n_pairs, H), 1.0)
    (point,) = at_frequencies(problem, AllPairs(), synthetic.frequencies(1).tolist(), tolerance=1e-8).points
    equation, at = problem.equation, problem.at((synthetic.OMEGA,))
    forces = equation.contact_forces(point.U.reshape(equation.shape), equation.every_pair, tangents=True)
    return Linearisation.of(equation, at, forces)


def solved(at: Linearisation, precondition) -> tuple[int, float]:
    """Return the iterations and the processor time of one solve with I + G P."""
    m, N_H = len(at.forces.active), at.equation.model.N_H
    columns = ActiveColumns(at.G, np.float32)
    P = columns.in_units(at.P)

    def multiply(x, out):
        dp = np.matmul(P, x.astype(np.float32).reshape(m, 3 * N_H, 1)).reshape(3 * m, N_H)
        out[:] = x + columns.apply(dp).ravel()

    def apply(x, out):
        out[:] = precondition.apply(x.reshape(m, 3, N_H)).ravel()

    gmres = Gmres(COMM, 3 * m * N_H, multiply, apply, RTOL)
    start = time.process_time()
    outcome = gmres.solve(np.random.default_rng(0).standard_normal(3 * m * N_H), precondition is not None)[1]
    seconds = time.process_time() - start
    gmres.destroy()
    return outcome.iterations, seconds


def cells(at: Linearisation, make) -> list[str]:
    """Return time to make, iterations and time of a solve."""
    start = time.process_time()
    made = make(at) if make else None
    seconds = time.process_time() - start
    iterations, solving = solved(at, made)
    return ([f"{seconds:.2g}"] if make else []) + [str(iterations), f"{solving:.2g}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, nargs="+", default=[250, 500, 1000, 1500])
    parser.add_argument("--limit", type=float, default=0.05)
    parser.add_argument("--whole", type=int, default=1000)
    given = parser.parse_args()
    synthetic.SLIPS = given.limit
    print(
        f"{facts()['processor']}\n\n| pairs | none: GMRES | s | whole: s to make | GMRES | s | clusters: s to make | GMRES | s |"
    )
    print("|" + " ---: |" * 9)
    for n in given.pairs:
        at = at_a_solution(n)
        whole = cells(at, HarmonicPreconditioner) if n <= given.whole else ["", "", ""]
        print("| " + " | ".join([f"{n:,}", *cells(at, None), *whole, *cells(at, ClusteredPreconditioner)]) + " |", flush=True)


if __name__ == "__main__":
    main()
