"""The battery of extremes: every case is solved, refused or fails with a reason; every returned point is checked separately.

    PYTHONPATH=solver:tests python tests/verification/extremes.py [--docs DIR] [--processes 2] [--family TEXT] [--name TEXT] [--limit 180]

Writes extremes.md and img/extremes.png, img/fold.png into DIR.  A case that exceeds ``--limit`` seconds is stopped and counts
as a defect.  The exit status is 1 if a point is wrong, or the program failed without a message.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import multiprocessing
import sys
import time
from multiprocessing.connection import wait

CONTEXT = multiprocessing.get_context("spawn")


def serve(pipe) -> None:
    """Run the cases whose numbers are received through the pipe, until None is received."""
    from verification.extreme_cases import all_cases
    from verification.extreme_run import run_case

    cases = all_cases()
    while (number := pipe.recv()) is not None:
        pipe.send((number, run_case(cases[number])))


class Worker:
    """A process that runs cases one at a time, and is terminated if a case does not end."""

    def __init__(self):
        self.start()

    def start(self) -> None:
        self.pipe, theirs = CONTEXT.Pipe()
        self.process = CONTEXT.Process(target=serve, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()
        self.number: int | None = None
        self.since = 0.0

    def give(self, number: int) -> None:
        self.pipe.send(number)
        self.number, self.since = number, time.perf_counter()

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def run_all(numbers, cases, n_processes: int, limit: float, on_outcome=lambda outcome: None) -> list:
    """Return the outcomes of the cases with these numbers, in their order."""
    from verification.extreme_run import DEFECT, Outcome

    waiting, values = list(numbers)[::-1], {}
    workers = [Worker() for _ in range(min(n_processes, len(waiting)))]
    for worker in workers:
        worker.give(waiting.pop())
    while any(worker.number is not None for worker in workers):
        ready = wait([worker.pipe for worker in workers if worker.number is not None], timeout=1.0)
        for worker in workers:
            if worker.number is None:
                continue
            outcome, case = None, cases[worker.number]
            spent = time.perf_counter() - worker.since
            if worker.pipe in ready:
                try:
                    _, outcome = worker.pipe.recv()
                except EOFError:
                    outcome = Outcome(
                        case.name, case.family, DEFECT, f"the process died with status {worker.process.exitcode}", seconds=spent
                    )
            elif spent > limit:
                outcome = Outcome(case.name, case.family, DEFECT, f"no end after {limit:g} s", seconds=spent)
            if outcome is None:
                continue
            values[worker.number] = outcome
            on_outcome(outcome)
            if outcome.status == DEFECT and ("died" in outcome.words or "no end" in outcome.words):
                worker.end()
                worker.start()
            worker.number = None
            if waiting:
                worker.give(waiting.pop())
    for worker in workers:
        worker.pipe.send(None)
        worker.process.join(10.0)
        worker.end()
    return [values[number] for number in sorted(values)]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--docs", help="folder of extremes.md and img/")
    options.add_argument("--processes", type=int, default=2)
    options.add_argument("--family", default="")
    options.add_argument("--name", default="")
    options.add_argument("--limit", type=float, default=180.0, help="seconds a case")
    chosen = options.parse_args()

    from verification.extreme_cases import all_cases
    from verification.extreme_run import DEFECT, SOLVED, WRONG

    cases = all_cases()
    numbers = [i for i, case in enumerate(cases) if chosen.family in case.family and chosen.name in case.name]

    def report(outcome) -> None:
        if outcome.status != SOLVED and not outcome.expected:
            print(f"{outcome.status}: {outcome.family}: {outcome.name}: {outcome.words}", flush=True)

    start = time.perf_counter()
    outcomes = run_all(numbers, cases, chosen.processes, chosen.limit, report)
    seconds = time.perf_counter() - start
    counts = {
        status: sum(outcome.status == status for outcome in outcomes) for status in ("solved", "refused", "failed", WRONG, DEFECT)
    }
    print(f"{len(outcomes)} cases, {sum(outcome.n_points for outcome in outcomes)} points in {seconds:.0f} s: {counts}")
    if chosen.docs:
        from verification.extreme_page import write_page

        write_page(chosen.docs, outcomes, seconds, chosen.processes)
    if counts[WRONG] or counts[DEFECT]:
        sys.exit(1)


if __name__ == "__main__":
    main()
