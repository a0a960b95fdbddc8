"""Memory leaks over thousands of points: the memory of each rank, point by point, compared with that of the recorded points.

    [mpirun -n 2] python jobs/bench/leak.py [SCENE.toml] [--points 3000] [--settled 500] [--limit 0.02] [--out DIR]

SCENE is jobs/fan_small.toml by default.  Its levels are followed repeatedly, in one run with the usual log and files, until the
number of points is reached.  The memory of a rank after the first points (``--settled``) may grow by ``--limit`` in addition to the
recorded points, which stay in memory by design: on rank 0 with the motion of their pairs until their level is written, afterwards
(and on other ranks) without it, except that of the peak.  Prints a line of JSON; exit status 1 if a rank grows by more.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MICROSLIP_CACHE", "off")  # no set-up comes from the cache
import argparse
import contextlib
import json
import sys
import tempfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from microslip.parallel.petsc import initialise

initialise()
from mpi4py import MPI

from microslip.observe.observer import Observers
from microslip.parallel.agree import on_root
from microslip.points.branch import Branch
from microslip.run import RunOptions, run
from microslip.scene.read import read_scene
from microslip.system.memory import give_back, resident_memory

LEAST = 10  # least number of points of a level


class Enough(Exception):
    """The requested number of points is reached."""


class Meter:
    """Memory of this rank after each point, and the bytes of the points so far [bytes]; wraps ``Observers.notify`` in its context.

    With ``has_motion``, as on rank 0, points hold the motion of their pairs until their level is written; the peak keeps it.
    """

    _patched: Any = Observers

    def __init__(self, points: int, has_motion: bool = True):
        self.points, self.has_motion = points, has_motion
        self.resident, self.recorded = np.full((2, points), np.nan)  # allocated now, so that it does not count as growth
        self._n, self._held, self._motion, self._notify = 0, 0.0, 0.0, Observers.notify

    def __enter__(self) -> Meter:
        meter = self

        def notify(observers: Observers, event: str, *news) -> None:
            meter._notify(observers, event, *news)
            if event == "point":
                meter.take(news[1])
            if event == "level_finished":
                meter.let_go(news[1])

        self._patched.notify = notify
        return self

    def __exit__(self, *_) -> None:
        self._patched.notify = self._notify

    def take(self, point) -> None:
        """Record the memory after a point.  Local; the same number of points on every rank."""
        motion = motion_of(point)
        self._held += size_of(point) - (0.0 if self.has_motion else motion)
        self._motion += motion if self.has_motion else 0.0
        give_back()
        self.resident[self._n], self.recorded[self._n] = resident_memory(), self._held
        self._n += 1
        if self._n == self.points:
            raise Enough

    def let_go(self, branch: Branch) -> None:
        """Subtract the motion of a level that is written, except that of its peak.  Local."""
        stays = motion_of(branch.points[branch.peak]) if self.has_motion and branch.points else 0.0
        self._held, self._motion = self._held - self._motion + stays, 0.0


def motion_of(point) -> float:
    """Return the bytes of a point's motion and forces."""
    return sum(size_of_value(value) for value in (point.U, point.p))


def size_of(point) -> float:
    """Return the bytes of a recorded point."""
    return sys.getsizeof(point) + sum(size_of_value(getattr(point, one.name)) for one in fields(point))


def size_of_value(value) -> float:
    """Return the bytes of a value and of the memory that it refers to."""
    return sys.getsizeof(value) + (value.base.nbytes if held_by_another(value) else 0)


def held_by_another(value) -> bool:
    """Return whether an array is a view of another one."""
    return isinstance(value, np.ndarray) and isinstance(value.base, np.ndarray)


def measured(comm: MPI.Comm, path: str, points: int, folder: Path) -> Meter:
    """Return the memory over the points of a run that repeats the levels of a scene.  Collective."""
    levels = read_scene(path).response.levels
    cycles = 1 + points // (LEAST * len(levels))
    many = ", ".join(repr(level * (1.0 + 1e-9 * cycle)) for cycle in range(cycles) for level in levels)
    scene, meter = read_scene(path, (f"response.levels=[{many}]",)), Meter(points, comm.rank == 0)
    with contextlib.suppress(Enough), meter:
        run(scene, comm, folder, RunOptions(screen=False))
    return meter


def growth(meter: Meter, settled: int) -> dict[str, float]:
    """Return a rank's memory after the first points and at the end, and its growth in addition to the points."""
    first, recorded = meter.resident[settled - 1], meter.recorded[-1] - meter.recorded[settled - 1]
    return {
        "settled_MB": first / 1e6,
        "end_MB": meter.resident[-1] / 1e6,
        "points_MB": recorded / 1e6,
        "bytes_a_point": recorded / (len(meter.resident) - settled),
        "growth": unexplained(meter, settled) / first,
        "more_in_second_half_MB": unexplained(meter, len(meter.resident) // 2) / 1e6,
    }


def unexplained(meter: Meter, first: int) -> float:
    """Return a rank's growth after its first points, in addition to the recorded points [bytes]."""
    return (meter.resident[-1] - meter.resident[first - 1]) - (meter.recorded[-1] - meter.recorded[first - 1])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("scene", nargs="?", default="jobs/fan_small.toml")
    parser.add_argument("--points", type=int, default=3000)
    parser.add_argument("--settled", type=int, default=500)
    parser.add_argument("--limit", type=float, default=0.02)
    parser.add_argument("--out", type=Path, default=None)
    arguments = parser.parse_args()
    comm = MPI.COMM_WORLD
    folder = on_root(comm, lambda: arguments.out or Path(tempfile.mkdtemp(prefix="leak_")))
    meter = measured(comm, arguments.scene, arguments.points, folder)
    growths = comm.allgather(growth(meter, arguments.settled))
    if comm.rank == 0:
        print(json.dumps({"scene": arguments.scene, "points": arguments.points, "ranks": growths}))
    return int(max(rank["growth"] for rank in growths) > arguments.limit)


if __name__ == "__main__":
    sys.exit(main())
