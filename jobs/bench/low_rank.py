"""What block low rank saves of the factor of K_L, and what it costs in accuracy.

    python jobs/bench/low_rank.py [SCENE] [--tolerances 1e-12 1e-10 1e-8]

MUMPS compresses the blocks of its fronts by dropping what is below a tolerance.  Needs the mesh of the scene, jobs/fan_paper.toml
unless told.  Prints a line for each tolerance and one without: entries that the factor keeps, processor time of the factorisation
and of 16 solves, the residual |b - K_L x| / |b|, and how far the solutions are from those of the whole factor, before and after one
step of iterative refinement.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import machine
import numpy as np
from mpi4py import MPI

from microslip.parallel.petsc import initialise

initialise()

from petsc4py import PETSc

import microslip
from microslip.linear.analysis import count
from microslip.linear.dense import column_norms, multiply
from microslip.linear.mumps import factorise

SCENE = Path(__file__).parents[1] / "fan_paper.toml"
PREFIX, COLUMNS = "low_rank_", 16
COMPRESSED, KEPT = 35, 35  # ICNTL that asks for it, INFOG with the entries it leaves


def line(K_L: PETSc.Mat, tolerance: float | None, whole: np.ndarray | None) -> tuple[str, np.ndarray]:
    """Return a line of the table, and the solutions.  Collective."""
    comm, options = K_L.comm.tompi4py(), PETSc.Options()
    if tolerance is not None:
        options.setValue(f"{PREFIX}mat_mumps_icntl_{COMPRESSED}", 2)
        options.setValue(f"{PREFIX}mat_mumps_cntl_7", tolerance)
    before = time.process_time()
    solver, _ = factorise(K_L, PREFIX, "K_L")
    factored = time.process_time()
    B = np.random.default_rng(1).standard_normal((K_L.getLocalSize()[0], COLUMNS))
    X = solver.solve(B)
    solved = time.process_time()
    left = B - multiply(K_L, X)
    refined = X + solver.solve(left)
    kept = count(solver.mumps.infog(KEPT))
    solver.destroy()
    whole = refined if whole is None else whole

    def largest(found: np.ndarray, of: np.ndarray) -> float:
        return float(np.max(column_norms(comm, found) / column_norms(comm, of)))

    off = (largest(one - whole, whole) for one in (X, refined))
    numbers = [f"{kept / 1e6:.1f}", f"{factored - before:.2f}", f"{solved - factored:.2f}", f"{largest(left, B):.0e}"]
    numbers += [f"{value:.0e}" for value in off]
    return f"| {'none' if tolerance is None else f'{tolerance:.0e}'} | " + " | ".join(numbers) + " |", whole


def main() -> None:
    """Print the table.  Collective."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--tolerances", nargs="+", type=float, default=[1e-12, 1e-10, 1e-8])
    asked = parser.parse_args()
    here = MPI.COMM_WORLD.rank == 0
    with microslip.build(microslip.read(asked.scene)) as structure:
        K_L, whole = structure.linearised.K_L, None
        if here:
            print(*machine.lines(machine.facts()), f"{asked.scene}: {structure.linearised.system.n_dof} DOF", "", sep="\n")
            print("| dropped below | entries kept, 10^6 | factor, CPU s | 16 solves, CPU s | residual | off | refined, off |")
            print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |", flush=True)
        for tolerance in (None, *asked.tolerances):
            said, whole = line(K_L, tolerance, whole)
            if here:
                print(said, flush=True)


if __name__ == "__main__":
    main()
