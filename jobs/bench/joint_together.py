"""What the columns of G_static cost with the joint kept together in the elimination tree, and without.

    python jobs/bench/joint_together.py [SCENE] [--times 2]        (or under mpirun -n 2)

Needs the mesh of the scene, jobs/fan_paper.toml unless told.  Factors K_L with the zeros that couple the joint (`with_ties`) and
without, in turn.  Prints a line each: entries of K_L and of its factor, and the processor time, the least of so many times, of the
factorisation, of 16 solves and of all columns R K_L^-1 R^T; of several ranks that of the slowest, waiting included.
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
from microslip.linear import joint_springs
from microslip.linear.joint_springs import linearise
from microslip.linear.mumps import solve_block
from microslip.modes.constraint import static_columns
from microslip.observe.log import RunLog

SCENE = Path(__file__).parents[1] / "fan_paper.toml"
FEWEST = {"without": np.inf, "together": joint_springs._FEW}  # DOFs of a joint that is kept together


def measure(system, pairs, fewest: float) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Return entries of K_L and of its factor, seconds of factor, solves and columns, and G_static.  Collective."""
    comm, R, found = system.comm, system.R, []

    def timed(work: Callable):
        comm.Barrier()
        start = time.process_time()
        result = work()
        found.append(comm.allreduce(time.process_time() - start, max))
        return result

    joint_springs._FEW = fewest
    linearised = timed(lambda: linearise(system, pairs))
    B = np.random.default_rng(1).standard_normal((linearised.K_L.getLocalSize()[0], 16))
    timed(lambda: solve_block(linearised.factor.ksp, B))
    G = timed(lambda: static_columns(linearised, R, R.T.tocsc()))
    sizes = linearised.K_L.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"], linearised.factor.info["entries"]
    linearised.destroy()
    return *sizes, np.array(found), G


def main() -> None:
    """Print the table.  Collective."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--times", type=int, default=2)
    asked, comm = parser.parse_args(), everyone()
    _, system, pairs, _, _ = from_mesh(microslip.read(asked.scene), None, comm, RunLog(comm, screen=False))
    runs = [{name: measure(system, pairs, fewest) for name, fewest in FEWEST.items()} for _ in range(asked.times)]
    if comm.rank > 0:
        return
    G, other = (runs[0][name][3] for name in FEWEST)
    print(*machine.lines(machine.facts()), f"{system.n_dof} DOF, {pairs.n_pairs} pairs, {comm.size} ranks", "", sep="\n")
    print("| joint | entries of K_L, 10^6 | of the factor | factor, CPU s | 16 solves | all columns |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for name in FEWEST:
        seconds = np.min([run[name][2] for run in runs], axis=0)
        sizes = (f"{number / 1e6:.1f}" for number in runs[0][name][:2])
        print(f"| {name} | {' | '.join(sizes)} | {' | '.join(f'{s:.2f}' for s in seconds)} |")
    print(f"\nLargest difference of the columns, over the largest entry: {np.abs(G - other).max() / np.abs(G).max():.0e}")


if __name__ == "__main__":
    main()
