"""One measurement of costs.py, in its own process or MPI job so that memory is measured separately: prints a line of JSON.

[mpirun -n 2] python jobs/bench/cost_measurement.py '{"kind": "joint", "n_pairs": 200, "share": 0.3, "H": 3, "points": 6}'
[mpirun -n 2] python jobs/bench/cost_measurement.py '{"kind": "scene", "scene": "jobs/fan_small.toml", "level": 15, "points": 98}'
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()
from mpi4py import MPI
from prepared import prepare
from stopwatch import Stopwatch
from synthetic import frequencies, joint_model, joint_problem

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.law import STICK
from microslip.continuation import acceptance, corrector, follow
from microslip.continuation.grid import at_frequencies
from microslip.continuation.task import BranchTask
from microslip.harmonic import balance, linearisation, newton_solver, preconditioner, subdomain_preconditioners
from microslip.points.selection import AllPairs
from microslip.receptance import columns
from microslip.receptance.static_columns import StaticColumns

# timed functions, each without the others in this list that it calls
GROUPS = [
    (ElasticCoulomb, "cycle", "AFT"),
    (balance.HarmonicBalance, "contact_forces", "choosing pairs, gathering p"),
    (columns.ReceptanceColumns, "__init__", "columns of G: picking"),
    (StaticColumns, "require", "columns of G: static solves"),
    (columns.ReceptanceColumns, "apply", "G p: residuals, steps"),
    (columns.ActiveColumns, "__init__", "columns of G: in single precision"),
    (columns.ActiveColumns, "apply", "G p"),
    (balance.HarmonicBalance, "linear_motion", "linear motion"),
    (linearisation.Gatherer, "__call__", "gathers of Krylov products"),
    (newton_solver.NewtonSolver, "_multiply", "Krylov products, besides G p"),
    (newton_solver.NewtonSolver, "_precondition", "preconditioner: applying"),
    (preconditioner.HarmonicPreconditioner, "__init__", "preconditioner: factoring"),
    (subdomain_preconditioners.SubdomainPreconditioner, "__init__", "preconditioner: factoring"),
    (newton_solver.NewtonSolver, "solve", "Newton step, besides"),
    (corrector.Corrector, "_residual", "residual, besides"),
    (corrector.Corrector, "_linearise", "Jacobian, besides"),
    (corrector.Corrector, "correct", "PETSc: GMRES, SNES, calls"),
    (acceptance, "point_record", "record of the point"),
]


class Meter:
    """Wall and processor time of the points of a run, by group of functions."""

    def __init__(self, comm, watch: Stopwatch):
        self.comm, self.watch = comm, watch
        self.points: list[tuple] = []
        self.restart()

    def restart(self) -> None:
        self.watch.reset()
        self.start = time.perf_counter(), time.process_time()

    def point(self, point) -> None:
        now = time.perf_counter(), time.process_time()
        wall, cpu = now[0] - self.start[0], now[1] - self.start[1]
        self.points.append((wall, cpu, point, dict(self.watch.seconds), dict(self.watch.calls)))
        self.restart()

    def report(self, skip: int) -> dict:
        """Return means per point, without the first ``skip``.  Collective: times of the slowest rank, memory of all."""
        counted = self.points[skip:]
        groups = {group for *_, seconds, _ in counted for group in seconds}
        wall, cpu = (float(np.mean([entry[k] for entry in counted])) for k in (0, 1))
        by_group = {group: float(np.mean([entry[3].get(group, 0.0) for entry in counted])) for group in sorted(groups)}
        by_group["the rest"] = cpu - sum(by_group.values())
        calls = {group: float(np.mean([entry[4].get(group, 0) for entry in counted])) for group in sorted(groups)}
        points = [entry[2] for entry in counted]
        memory = self.comm.allreduce(peak_memory())
        return {
            "points": len(points),
            "seconds": self.comm.allreduce(wall, op=MPI.MAX),
            "cpu": self.comm.allreduce(cpu, op=MPI.MAX),
            "groups": by_group,
            "calls": calls,
            "newton": mean(points, "newton"),
            "krylov": mean(points, "krylov"),
            "not_sticking": float(np.mean([np.count_nonzero(point.state != STICK) for point in points])),
            "memory_MiB": memory,
        }


def peak_memory() -> float:
    """Return the peak resident memory of this process [MiB]; getrusage may report that of the parent process."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) / 1024.0


def mean(points, name: str) -> float:
    return float(np.mean([getattr(point, name) for point in points]))


def of_joint(comm, n_pairs: int, share: float, H: int, points: int) -> dict:
    """Return the costs per point of a synthetic joint, without the first point, which starts from the stuck motion.

    The columns of the slipping pairs are computed at the first point, as in any run.
    """
    model = joint_model(comm, n_pairs, H)
    problem = joint_problem(model, share)
    with Stopwatch(GROUPS) as watch:
        meter = Meter(comm, watch)
        branch = at_frequencies(problem, AllPairs(), frequencies(points + 1).tolist(), tolerance=1e-8, on_point=meter.point)
    report = meter.report(skip=1)
    return {"n_pairs": n_pairs, "share": share, "H": H, "unknowns": 3 * n_pairs * model.N_H, "failure": branch.failure, **report}


def of_scene(comm, scene: str, level: float, points: int) -> dict:
    """Return the costs of set-up and response of a scene at one level, followed by arc length."""
    prepared = prepare(scene, comm, points)
    problem, tolerance = prepared.problem(level), prepared.scene.solver.tolerance
    with Stopwatch(GROUPS) as watch:
        meter = Meter(comm, watch)
        task = BranchTask(problem, AllPairs(), prepared.sweep, prepared.steps, tolerance)
        branch = follow.follow_branch(task, 10 * points, meter.point)
    model, report = prepared.model, meter.report(skip=0)
    return {
        "level": level,
        "n_dof": prepared.structure.linearised.system.n_dof,
        "n_pairs": model.n_pairs,
        "n_modes": model.n_modes,
        "H": model.N_H // 2,
        "unknowns": 3 * model.n_pairs * model.N_H,
        "failure": branch.failure,
        "stages": [asdict(stage) for stage in prepared.stages],
        **report,
    }


def main() -> None:
    request, comm = json.loads(sys.argv[1]), MPI.COMM_WORLD
    kinds: dict[str, Callable[..., dict]] = {"joint": of_joint, "scene": of_scene}
    report = kinds[request.pop("kind")](comm, **request)
    if comm.rank == 0:
        print(json.dumps({"ranks": comm.size, **report}), flush=True)


if __name__ == "__main__":
    main()
