"""Conditions under which the paper's order of its two methods appears: both run under many settings on an open model.

    python jobs/paper/claims.py [SCENE.toml] [--levels N ...] [--out DIR]

Without SCENE, jobs/fan_paper.toml, its first slipping level and its last, and --out docs: the tables of
`paper_claims.md` and its picture.
Any other scene goes to results/paper.  Four minutes of the processor; one process.

Original: `adaptive`, pairs with dp != 0 in the last solution.  Improved: `adaptive-energy` with epsilon = 1e-10 J.  Both update
their set once per point, as in Algorithm 1.  *Again*: every point is solved a second time, with the set of its first solution.
The reference of each setting is `receptance`, all pairs, at the same frequencies and with the same law.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import sys
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "bench")]

from microslip.parallel.petsc import initialise

initialise()
from claims_runs import all_trials, settings
from claims_tables import draw, tables
from mpi4py import MPI
from page_tables import put
from prepared import prepare

SCENE = "jobs/fan_paper.toml"
OWN = (25, 50, 98, 200)  # points of curves in each method's own steps


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=SCENE)
    parser.add_argument("--levels", type=float, nargs="+", help="N; the second and the last of the scene unless given")
    parser.add_argument("--out", type=Path, help="docs for the scene of the paper, else results/paper")
    options = parser.parse_args()
    folder = options.out or Path("docs" if options.scene == SCENE else "results/paper")
    prepared = prepare(options.scene, MPI.COMM_SELF)
    of_scene = prepared.scene.response.levels
    levels = options.levels or sorted({of_scene[min(1, len(of_scene) - 1)], of_scene[-1]})
    trials, own = all_trials(
        prepared, levels, settings(prepared.scene.response.points), OWN, lambda line: print(line, flush=True)
    )
    (folder / "img").mkdir(parents=True, exist_ok=True)
    draw(trials, prepared.scene).save(str(folder / "img" / "paper_claims.png"))
    put(folder / "paper_claims.md", tables(trials, own))
    print(f"{folder / 'paper_claims.md'}; {time.process_time():.0f} s of the processor")


if __name__ == "__main__":
    main()
