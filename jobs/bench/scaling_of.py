"""One measurement of scaling.py, in a job of its own that mpi_counter.c is preloaded to: prints a line of JSON.

'{"scene": "jobs/fan_small.toml", "level": 15, "points": 24}': times, messages, memory and shares of the work of each stage, by rank.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import numpy as np

from microslip.parallel.petsc import initialise

initialise()
from mpi4py import MPI
from mpi_counter import KINDS, counters
from prepared import of_bench

from microslip.continuation.follow import follow_branch
from microslip.continuation.levels import arc_length_steps
from microslip.continuation.task import BranchTask
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.linear import mumps
from microslip.linear.analysis import count
from microslip.linear.mumps import MumpsFactor
from microslip.modes import eigen
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.points.selection import AllPairs
from microslip.scene.read import read_scene

NAMES = ("wall", "cpu", "mpi_wall", "mpi_cpu", *(f"{kind}, {what}" for what in ("calls", "bytes") for kind in KINDS))
STAGES = {  # of the log: what they are called here
    "model file": "reading",
    "mesh and contact pairs": "reading",
    "factor of the stuck structure": "factor",
    "static columns of all pairs": "static columns",
}
# parts of stages that differ in how they scale: a factorisation is analysed on rank 0 and computed on all ranks
PARTS = [(mumps, "analysed", "{}: analysis"), (eigen, "count_below", "proof of modes")]


def clock() -> np.ndarray:
    """Return wall and processor time, in all and in MPI, and the messages, as in ``NAMES``.  Local."""
    return np.concatenate([[time.perf_counter(), time.process_time()], counters()])


class Ledger:
    """What each stage took, without the stages in it."""

    def __init__(self, clock: Callable[[], np.ndarray] = clock):
        self.clock, self._open = clock, list[tuple[str, Any]]()
        self.taken: dict[str, Any] = defaultdict(float)

    @contextmanager
    def entry(self, name: str) -> Iterator[None]:
        """Book what is taken under a name; {} in it is the stage that it lies in.  Local."""
        name = name.format(self._open[-1][0] if self._open else "")
        self._open.append((name, 0.0))
        start = self.clock()
        try:
            yield
        finally:
            whole = self.clock() - start
            self.taken[name] = self.taken[name] + whole - self._open.pop()[1]
            if self._open:
                outer, inner = self._open[-1]
                self._open[-1] = outer, inner + whole

    @contextmanager
    def parts(self, functions: list[tuple[Any, str, str]]) -> Iterator[None]:
        """Book calls of functions (owner, attribute, name of the entry) while the context lasts.  Local."""
        originals = [(owner, attribute, vars(owner)[attribute]) for owner, attribute, _ in functions]
        for (owner, attribute, original), (*_, name) in zip(originals, functions):
            setattr(owner, attribute, self._booked(original, name))
        try:
            yield
        finally:
            for owner, attribute, original in originals:
                setattr(owner, attribute, original)

    def _booked(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        @wraps(function)
        def booked(*args, **kwargs):
            with self.entry(name):
                return function(*args, **kwargs)

        return booked


class BookedLog(RunLog):
    """A log whose stages are booked; their ends are collective, so that who waits for others does so within the stage."""

    def __init__(self, comm, ledger: Ledger):
        super().__init__(comm, screen=False)
        self.ledger = ledger

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        with self.ledger.entry(STAGES.get(name, name)), super().stage(name):
            yield


def of_scene(comm: MPI.Comm, scene: str, level: float, points: int) -> dict:
    """Return what every stage took on every rank, at one level of the response.  Collective."""
    ledger, found = Ledger(), on_root(comm, read_scene, scene)
    with BookedLog(comm, ledger) as log, ledger.parts(PARTS):
        structure = build(of_bench(found, points), comm, log)
        with log.stage("reduction"):
            response = prepare(structure, has_bars=False).response
        with log.stage("static columns of all pairs"):
            response.model.receptance_of(1).static.G_static.require(np.arange(response.model.n_pairs))
        task = BranchTask(
            response.at_level(level), AllPairs(), response.sweep, arc_length_steps(response.settings, response.curve), 1e-8
        )
        with log.stage("response"):
            branch = follow_branch(task, 10 * points)
    solver = structure.linearised.factor.solver
    assert isinstance(solver, MumpsFactor)
    mumps, n_own = solver.mumps, len(range(comm.rank, response.model.n_pairs, comm.size))
    own = {"flops": mumps.rinfo(3), "entries": float(count(mumps.info(9))), "pairs": float(n_own)}
    return {
        "n_dof": structure.linearised.system.n_dof,
        "n_pairs": response.model.n_pairs,
        "n_modes": response.model.n_modes,
        "points": len(branch.points),
        "failure": branch.failure,
        "memory_MiB": {STAGES.get(stage.name, stage.name): stage.memory for stage in log.stages},
        "stages": by_rank(comm, {name: dict(zip(NAMES, taken.tolist())) for name, taken in ledger.taken.items()}),
        "shares": by_rank(comm, {"": own})[""],
    }


def by_rank(comm: MPI.Comm, own: dict[str, dict[str, float]]) -> dict[str, dict[str, list[float]]]:
    """Return numbers of all ranks, in lists.  Collective; a rank may lack a name that others have."""
    everyone = comm.allgather(own)
    names = {name: list(keys) for one in everyone for name, keys in one.items()}
    return {name: {key: [one.get(name, {}).get(key, 0.0) for one in everyone] for key in keys} for name, keys in names.items()}


def main() -> None:
    comm = MPI.COMM_WORLD
    found = of_scene(comm, **json.loads(sys.argv[1]))
    if comm.rank == 0:
        print(json.dumps({"ranks": comm.size, **found}), flush=True)


if __name__ == "__main__":
    main()
