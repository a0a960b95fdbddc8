"""The cost of a run's checkpoints, and of continuing from them, compared with that of the run and of its set-up.

    [mpirun -n 2] python jobs/bench/restart_costs.py [SCENE.toml ...]

Each scene is run twice in a new folder: first from the beginning, then with the set-up of its folder and without its points.
Pictures are left out.  Prints a line of JSON for each scene; times are wall times of rank 0, with processor time in brackets.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MICROSLIP_CACHE", "off")  # the first set-up does not come from a cache
import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from microslip.parallel.petsc import initialise

initialise()
from mpi4py import MPI

import microslip.run as whole_run
from microslip.parallel.agree import on_root
from microslip.restart import folder as restart_folder
from microslip.restart.branch_files import BranchFiles
from microslip.restart.columns_file import ColumnsFile
from microslip.restart.set_up import SetUp
from microslip.restart.stored_structure import StoredStructure
from microslip.scene.read import read_scene

KEEPING = (
    (BranchFiles, "save"),
    (BranchFiles, "finish"),
    (ColumnsFile, "_keep"),
    (StoredStructure, "write"),
    (restart_folder.Restart, "finish"),
)


class Clock:
    """Wall and processor time spent in some functions [s]."""

    def __init__(self) -> None:
        self.wall = self.processor = 0.0

    def around(self, function: Callable) -> Callable:
        """Return a function that is timed."""

        def timed(*arguments: Any, **named: Any) -> Any:
            wall, processor = time.perf_counter(), time.process_time()
            try:
                return function(*arguments, **named)
            finally:
                self.wall += time.perf_counter() - wall
                self.processor += time.process_time() - processor

        return timed

    def __str__(self) -> str:
        return f"{self.wall:.3f} ({self.processor:.3f})"


def timed_run(scene: Any, comm: MPI.Comm, folder: Path) -> dict[str, Clock]:
    """Return the times of a run: the whole, its set-up, checkpoints, continuation from the stored set-up.  Collective."""
    clocks = {name: Clock() for name in ("run", "set-up", "keeping", "identity", "going on")}
    patched: list[tuple[Any, str, str]] = [(owner, name, "keeping") for owner, name in KEEPING]
    patched += [(whole_run, "build", "set-up"), (restart_folder, "identity_of", "identity"), (SetUp, "_restored", "going on")]
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in patched]
    try:
        for owner, name, of in patched:
            setattr(owner, name, clocks[of].around(getattr(owner, name)))
        clocks["run"].around(whole_run.run)(scene, comm, folder, whole_run.RunOptions(screen=False))
    finally:
        for owner, name, function in before:
            setattr(owner, name, function)
    return clocks


def forget_points(folder: Path) -> None:
    """Remove the levels of a run, and the mark that it is complete."""
    for path in (folder / restart_folder.NAME).glob("level-*/*"):
        path.unlink()
    (folder / restart_folder.NAME / "done").unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["jobs/fan_small.toml"], metavar="SCENE.toml")
    comm = MPI.COMM_WORLD
    whole_run.draw = lambda *_: None
    for file in parser.parse_args().scenes:
        with tempfile.TemporaryDirectory() as own:
            folder, scene = Path(comm.bcast(own)), on_root(comm, read_scene, file)
            first = timed_run(scene, comm, folder)
            on_root(comm, forget_points, folder)
            again = timed_run(scene, comm, folder)
            comm.barrier()
        if comm.rank == 0:
            times: dict[str, str | int] = {name: str(first[name]) for name in ("run", "set-up", "keeping", "identity")}
            times |= {"going on": str(again["going on"]), "ranks": comm.size, "scene": scene.name}
            times["keeping over run"] = f"{first['keeping'].wall / first['run'].wall:.2%}"
            whole = again["going on"].wall + again["identity"].wall
            times["going on over set-up"] = f"{whole / first['set-up'].wall:.2%}"
            print(json.dumps(times), flush=True)


if __name__ == "__main__":
    main()
