"""A level divided into parts on groups of ranks, compared with the undivided level: wall time, and predicted gain of more groups.

    python jobs/bench/divided.py jobs/fan_paper.toml [--level 15] [--set KEY=VALUE]
    mpirun -n 2 python jobs/bench/divided.py jobs/fan_paper.toml

The first command records the processor time of the coarse curve, the first points of the parts and the parts on one rank, and
assigns them to up to 64 groups as the program does.  The second command measures: the whole level on one rank (all ranks compute
the same at the same time), on all ranks together, and divided among groups of one rank.  The first response of each, which solves
for static columns, is not measured.
"""

from __future__ import annotations

import argparse
import heapq
import time
from functools import partial

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from mpi4py import MPI

import microslip
from microslip.continuation.divided import PARTS, beginning, coarse_curve, follow_part, places
from microslip.continuation.levels import follow_level
from microslip.library.prepare import prepare
from microslip.library.respond import scene_with

GROUPS = (2, 4, 8, 16, 64)


def timed(function, clock=time.process_time):
    """Return what a function returns, and the seconds that it takes."""
    began = clock()
    return function(), clock() - began


def dealt(seconds: list[float], n_groups: int) -> float:
    """Return when the last task ends if the groups take the tasks in their order."""
    free = [0.0] * n_groups
    for duration in seconds:
        heapq.heapreplace(free, free[0] + duration)
    return max(free)


def simulate(scene, level: float) -> None:
    """Print the speed-up on each number of groups, from processor times on one rank."""
    with microslip.build(scene, MPI.COMM_SELF) as structure:
        of = prepare(structure, scene_with(scene, {"levels": (level,)}, {})).response
        whole = follow_level(of, level)
        print(f"in turn: {len(whole.points)} points, measured again before each row")
        print("groups  in turn, s  coarse curve, s  beginnings, s  parts, s  points  longest part, s  speed-up")
        for n_groups in GROUPS:
            _, in_turn = timed(lambda: follow_level(of, level))
            curve, coarse = timed(lambda: coarse_curve(of, level))
            begun = [timed(partial(beginning, of, level, curve, i)) for i in places(curve, PARTS * n_groups)]
            beginnings = [begin for begin, _ in begun if begin is not None]
            parts = [timed(partial(follow_part, of, level, beginnings, k)) for k in range(len(beginnings) + 1)]
            first, then = ([seconds for _, seconds in tasks] for tasks in (begun, parts))
            n_points = sum(len(part.points) for part, _ in parts)
            gain = in_turn / (coarse + dealt(first, n_groups) + dealt(then, n_groups))
            shown = f"{coarse:16.2f} {sum(first):14.2f} {sum(then):9.2f} {n_points:7} {max(then):16.2f} {gain:9.2f}"
            print(f"{n_groups:6} {in_turn:11.2f} {shown}")


def measure(scene, level: float, comm) -> None:
    """Print the wall times of a level on one rank, on all of them, and divided among them.  Collective."""
    ways = (
        ("one rank", MPI.COMM_SELF, False),
        ("all ranks together", comm, False),
        (f"divided among {comm.size} groups", comm, True),
    )
    for name, ranks, divides in ways:
        with microslip.build(scene, ranks) as structure:
            n_groups = comm.size if divides else 1
            again = partial(microslip.respond, structure, levels=(level,), n_groups=n_groups, divides=divides)
            for _ in range(2):
                comm.barrier()
                response, seconds = timed(again, time.perf_counter)
        longest = comm.reduce(seconds, op=MPI.MAX)
        if comm.rank == 0:
            print(f"{name}: {len(response.branches[0].points)} points, {longest:.2f} s")


def main() -> None:
    """Simulate on one rank, measure on several."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("scene")
    options.add_argument("--level", type=float, default=15.0, help="N")
    options.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the scene")
    given, comm = options.parse_args(), MPI.COMM_WORLD
    scene = microslip.read(given.scene, given.set)
    if comm.size == 1:
        simulate(scene, given.level)
    else:
        measure(scene, given.level, comm)


if __name__ == "__main__":
    main()
