"""The case study of the paper, section 5, on an open model: the tables of figures 4 to 15 and table 1.

    python jobs/paper/case_study.py [SCENE.toml] [--out DIR] [--points N] [--tolerances E ...] [--steps N ...] [--no-rubin]

Without SCENE, jobs/fan_paper.toml and --out docs: the tables of `paper.md`, and
`img/paper_*.png`.  Any other scene goes to results/paper.
One process; on the paper's mesh up to 6 GB, mostly for plain Rubin (--no-rubin: 3 GB, and one LU of its size stands for a step).

Every level is computed by `receptance`, the condensed full set.  At the frequencies it selects, every other method is solved from
its own last two points: `adaptive` and `adaptive-energy` as in the paper, and with all pairs checked at each point.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import sys
import time
from functools import partial
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "bench")]

from microslip.parallel.petsc import initialise

initialise()
from mpi4py import MPI
from page_tables import put
from paper_figures import draw_all, remove_old
from paper_runs import EPSILON, Clock, study
from paper_tables import tables
from prepared import prepare

SCENE = "jobs/fan_paper.toml"
TOLERANCES = (0.0, EPSILON, 1e-7, 1e-6, 1e-5, 3e-5, 1e-4)  # J a cycle and pair
STEPS = (50, 98, 200, 400)  # points of a level


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=SCENE)
    parser.add_argument("--out", type=Path, help="docs for the scene of the paper, else results/paper")
    parser.add_argument("--points", type=int, help="of a level; those of the scene unless given")
    parser.add_argument("--tolerances", type=float, nargs="+", default=TOLERANCES, help="of adaptive-energy, J a cycle and pair")
    parser.add_argument("--steps", type=int, nargs="*", default=STEPS, help="points of a level, for the effect of the step")
    parser.add_argument("--no-rubin", action="store_true", help="do not solve plain Rubin: one LU of its size stands for a step")
    options = parser.parse_args()
    folder = options.out or Path("docs" if options.scene == SCENE else "results/paper")
    clock = Clock(partial(print, flush=True))
    prepared = prepare(options.scene, MPI.COMM_SELF, options.points)
    clock.lap("mesh to reduced model, all static columns")
    solved = study(prepared, sorted(options.tolerances), options.steps, not options.no_rubin, clock)
    (folder / "img").mkdir(parents=True, exist_ok=True)
    remove_old(folder / "img")
    figures = draw_all(solved, folder / "img")
    put(folder / "paper.md", tables(solved))
    print(f"{folder / 'paper.md'} and {len(figures)} figures; {time.process_time():.0f} s of the processor")


if __name__ == "__main__":
    main()
