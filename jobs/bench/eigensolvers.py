"""Processor time of the lowest modes with their count check: SLEPc, and the block Lanczos iteration of version 0.1.0, same factor.

    python meshes/fan_sector.py --size paper --out meshes/fan_paper.msh
    mpirun -n 1 python jobs/bench/eigensolvers.py jobs/fan_paper.toml 9 20 [--times 2]

The two solvers alternate.  The Lanczos code is read from the history of this repository, which must be a full clone.
"""

import argparse
import subprocess
import time
import types
from pathlib import Path
from typing import Any

from microslip.parallel.petsc import initialise

initialise()

import numpy as np
from mpi4py import MPI

from microslip.library.build import assembled, factor_of
from microslip.modes import eigen
from microslip.modes.shift_invert import ModeSearch
from microslip.observe.log import RunLog
from microslip.scene.read import read_scene

LANCZOS = "8865f8b~1:solver/microslip/modes/block_lanczos.py"
COMM = MPI.COMM_WORLD


def block_lanczos() -> type:
    """Return the class of the Lanczos iteration, from the history."""
    source = subprocess.run(
        ["git", "show", LANCZOS], check=True, capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout
    module = types.ModuleType("microslip.modes.block_lanczos")
    module.__package__ = "microslip.modes"
    exec(compile(source, LANCZOS, "exec"), module.__dict__)

    earlier: Any = module.__dict__["BlockLanczos"]

    class BlockLanczos(earlier):
        """The class with the interface of ``ModeSearch``: products of the modes with K_L and M are not known."""

        def lowest(self, n_wanted: int) -> tuple:
            theta, phi_owned, info = super().lowest(n_wanted)
            return theta, phi_owned, None, info

    return BlockLanczos


def seconds(work) -> tuple[float, Any]:
    """Return the processor time of the slowest rank, and the result of the work."""
    COMM.barrier()
    began = time.process_time()
    result = work()
    return COMM.allreduce(time.process_time() - began, MPI.MAX), result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("modes", type=int, nargs="+")
    parser.add_argument("--times", type=int, default=2)
    arguments = parser.parse_args()
    linearised = factor_of(assembled(read_scene(arguments.scene), COMM, RunLog(COMM, screen=False)), RunLog(COMM, screen=False))
    searches, solver = {"Lanczos": block_lanczos(), "SLEPc": ModeSearch}, linearised.factor.solver
    spent = {"passes": 0, "vectors": 0, "solves": 0.0}
    solve = solver.solve

    def counted(B):
        began = time.process_time()
        X = solve(B)
        spent["passes"] += 1
        spent["vectors"] += B.shape[1]
        spent["solves"] += time.process_time() - began
        return X

    solver.solve = counted  # type: ignore[method-assign]
    for n_modes in arguments.modes:
        frequencies: dict[str, np.ndarray] = {}
        best: dict[str, float] = {}
        for _ in range(arguments.times):
            for name, search in searches.items():
                spent.update(passes=0, vectors=0, solves=0.0)
                whole, modes = seconds(lambda n=n_modes, s=search: eigen.lowest_modes(linearised, n, search=s(linearised)))
                frequencies[name] = modes.omega_n
                best[name] = min(best.get(name, np.inf), whole)
                if COMM.rank == 0:
                    print(
                        f"{n_modes} modes, {name:<8} {whole:6.2f} s, of which solves {spent['solves']:6.2f} s: {spent['passes']} "
                        f"passes, {spent['vectors']} vectors, residual {modes.info['residual']:.1e}",
                        flush=True,
                    )
        proof, _ = seconds(
            lambda n=n_modes, w=frequencies["SLEPc"]: eigen.count_below(linearised.K_L, linearised.M, w[-1] ** 2 * 1.0001)
        )
        if COMM.rank == 0:
            difference = np.abs(frequencies["SLEPc"] / frequencies["Lanczos"] - 1.0).max()
            print(
                f"{n_modes} modes: ratio {best['SLEPc'] / best['Lanczos']:.2f}, of which the proof {proof:.1f} s each; differ by {difference:.0e}"
            )


if __name__ == "__main__":
    main()
