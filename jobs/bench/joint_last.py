"""What the columns of G_static cost with the joint last in the order of elimination, and in the order that MUMPS chooses.

    python jobs/bench/joint_last.py [SCENE] [--times 2] [--solves]        (or under mpirun -n 2)

Needs the mesh of the scene, jobs/fan_paper.toml unless told.  Prints a line each: entries of the factor, and the processor time, the
least of so many times, of the factorisation, of 16 solves, of all columns R K_L^-1 R^T, and of the proof by inertia; with --solves
also of the columns by a solve for each; of several ranks that of the slowest, waiting included.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import machine
import numpy as np

from microslip.parallel.petsc import everyone, initialise

initialise()

from petsc4py import PETSc

import microslip
from microslip.library.build import from_mesh
from microslip.linear.joint_springs import linearise
from microslip.modes import constraint
from microslip.modes.constraint import static_columns
from microslip.modes.inertia import count_below
from microslip.observe.log import RunLog

SCENE = Path(__file__).parents[1] / "fan_paper.toml"
ORDERS = {"MUMPS' own": 7, "METIS, joint last": None}  # ICNTL(7)
HIGH = 2.0 * np.pi * 3000.0  # rad/s: modes below it are counted


def measure(system, pairs, order: int | None, has_solves: bool) -> tuple[float, np.ndarray, np.ndarray]:
    """Return entries of the factor, seconds of each step, and G_static.  Collective."""
    comm, R, found = system.comm, system.R, []

    def timed(work: Callable):
        comm.Barrier()
        start = time.process_time()
        result = work()
        found.append(comm.allreduce(time.process_time() - start, max))
        return result

    options, names = PETSc.Options(), [f"{prefix}_mat_mumps_icntl_7" for prefix in ("static", "modes_inertia")]
    for name in names if order is not None else ():
        options[name] = order
    linearised = timed(lambda: linearise(system, pairs))
    factor = linearised.factor
    B = np.random.default_rng(1).standard_normal((linearised.K_L.getLocalSize()[0], 16))
    timed(lambda: factor.solver.solve(B))
    G = timed(lambda: static_columns(linearised, R, R.T.tocsc()))
    timed(lambda: count_below(linearised.K_L, linearised.M, HIGH**2, factor.solver.order))
    if has_solves:
        timed(lambda: constraint._by_solves(linearised, R, R.T.tocsc(), slice(None)))
    for name in names if order is not None else ():
        options.delValue(name)
    entries = factor.info["entries"]
    linearised.destroy()
    return entries, np.array(found), G


def main() -> None:
    """Print the table.  Collective."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--times", type=int, default=2)
    parser.add_argument("--solves", action="store_true")
    asked, comm = parser.parse_args(), everyone()
    _, rest, _ = from_mesh(microslip.read(asked.scene), None, comm, RunLog(comm, screen=False))
    system, pairs = rest.system, rest.pairs
    runs = [{name: measure(system, pairs, order, asked.solves) for name, order in ORDERS.items()} for _ in range(asked.times)]
    if comm.rank > 0:
        return
    G, other = (runs[0][name][2] for name in ORDERS)
    print(*machine.lines(machine.facts()), f"{system.n_dof} DOF, {pairs.n_pairs} pairs, {comm.size} ranks", "", sep="\n")
    by_solves = " by a solve each |" if asked.solves else ""
    print(f"| order | entries of the factor, 10^6 | factor, CPU s | 16 solves | all columns | proof by inertia |{by_solves}")
    print(f"| --- | ---: | ---: | ---: | ---: | ---: |{' ---: |' if asked.solves else ''}")
    for name in ORDERS:
        seconds = np.min([run[name][1] for run in runs], axis=0)
        print(f"| {name} | {runs[0][name][0] / 1e6:.1f} | {' | '.join(f'{s:.2f}' for s in seconds)} |")
    print(f"\nLargest difference of the columns, over the largest entry: {np.abs(G - other).max() / np.abs(G).max():.0e}")


if __name__ == "__main__":
    main()
