"""Test that a run stopped by a signal at a random moment ends in time with the right status, and that the same command continues it.

    python jobs/bench/signal_test.py [SCENE] [--times 200] [--ranks 1 2] [--seed S] [--earlier SHARE] [--set KEY=VALUE ...]
                                     [--stages NAME ...] [--folder DIR]

The scene, by default a short form of the demo, first runs undisturbed on each number of ranks.  Then, `--times` times, it runs in
a new folder and gets one signal (in a third of the trials two in quick succession).  The moment is anywhere in the job, start and
end included, or, in half of the trials, in a stage of the log, each equally likely.  On one rank the signal goes to the process;
on several ranks in turn to one rank, to all ranks, and to mpirun.  The same command is then repeated until the end.

A trial fails if the run, with all processes of its session, has not ended 10 s after the signal (SIGUSR1 ends nothing); if its
status is not 5 (0 if the run was already complete; 1 if mpirun got the signal itself); if it did not write exactly one message;
or if the checks of :mod:`kill_test` fail for the files or for the continued run.  Any failure makes status 1.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import kill_test
from kill_test import POINT, STAGE, Test, Trial, Undisturbed
from killing import Run, members

SHORT = ("response.levels=[5.0]", "response.points=20", "solver.error_bars=false")  # of the demo
SIGNALS = (*3 * (signal.SIGTERM,), signal.SIGINT, signal.SIGHUP, signal.SIGUSR1)
WITHIN = 10.0  # s
STOPPED, OF_MPIRUN, BY_PYTHON = 5, 1, 1  # statuses; the last of SIGINT while Python starts
BEFORE_PYTHON = 0.6  # s, about, until Python reaches the program
_MESSAGE = "microslip: error: "


class SignalTest(Test):
    """The test of a scene in a folder: :class:`kill_test.Test`, with signals that can be caught instead of SIGKILL."""

    def _killed(self, kind: str, ranks: int, out: Path, goal: Undisturbed, trial: Trial) -> Run:
        """Start a run, send it a signal at some moment, and note how it ended."""
        number, run = self.random.choice(SIGNALS), Run(self.command(ranks, out), self.folder / "output")
        self._wait_for_moment(run, goal)
        where = (["start"] + [name for name, _ in STAGE.findall(run.output())])[-1]
        to, at = self._send(run, number, ranks, trial.number), run.seconds
        if self.random.random() < 1.0 / 3.0:
            time.sleep(self.random.uniform(0.0, 1.5))
            self._send(run, number, ranks, trial.number)
        status = run.wait(kill_test.LIMIT if number == signal.SIGUSR1 else WITHIN)
        while status is not None and members(run.process.pid) and run.seconds - at < WITHIN:  # mpirun ends before its ranks
            time.sleep(0.05)
        seconds, left = run.seconds - at, [] if status is None else members(run.process.pid)
        run.kill()
        n = trial.reported = max(len(POINT.findall(text)) for text in (run.output(), _log(out)))
        trial.hit.append(f"{number.name} to {to}: {at:.2f} s, after {where}, point {n}: {status} after {seconds:.1f} s")
        if status is None:
            trial.wrong.append(f"had not ended {WITHIN:.0f} s after the signal")
        trial.wrong += [f"{len(left)} processes were left"] if left else []
        trial.wrong += _wrong(status, run.output(), number, to, at)
        if trial.wrong:
            (self.folder / f"output_{ranks}_{trial.number}").write_text(run.output())
        return run

    def _wait_for_moment(self, run: Run, goal: Undisturbed) -> None:
        """Wait for a moment of the whole job, or for one within a stage."""
        stages = list(goal.stages)
        if not self.arguments.stages and self.random.random() < 0.5:
            self._sleep(run, self.random.uniform(0.0, goal.seconds))
            return
        i = self.random.choice([i for i, name in enumerate(stages) if name.startswith(tuple(self.arguments.stages or [""]))])
        while i and not run.is_over and stages[i - 1] not in dict(STAGE.findall(run.output())):
            time.sleep(0.002)
        self._sleep(run, self.random.uniform(0.0, 1.2 * goal.stages[stages[i]]))

    def _send(self, run: Run, number: signal.Signals, ranks: int, trial: int) -> str:
        """Send a signal, and return its receiver as text."""
        of_ranks = _children(run.process.pid)
        if ranks == 1 or trial % 3 == 2 or not of_ranks:
            to, processes = "the process" if ranks == 1 else "mpirun", [run.process.pid]
        elif trial % 3 == 1:
            to, processes = "all ranks", of_ranks
        else:
            rank = self.random.randrange(len(of_ranks))
            to, processes = f"rank {rank}", of_ranks[rank : rank + 1]
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, number)
        return to


def _log(out: Path) -> str:
    """Return the log of the unfinished run or of the folder: a stopped mpirun forwards no more output."""
    logs = [out / "unfinished" / "run.log"] if (out / "restart" / "done").exists() else [out / "run.log"]
    return "".join(log.read_text() for log in logs if log.exists())


def _wrong(status: int | None, output: str, number: signal.Signals, to: str, at: float) -> list[str]:
    """Return what is wrong with the end of a run after a signal."""
    if number == signal.SIGUSR1:
        expected = {0} | ({-number, OF_MPIRUN, 128 + number} if at < BEFORE_PYTHON else set())
    else:
        expected = {0, STOPPED} | ({OF_MPIRUN} if to == "mpirun" else set())
        expected |= {-number, 128 + number, BY_PYTHON} if at < BEFORE_PYTHON else set()
    wrong = [] if status in expected or status is None else [f"status {status}: {output[-300:]!r}"]
    n = output.count(_MESSAGE)
    if status == STOPPED and n != 1 or status == 0 and n or n > 1:
        wrong.append(f"{n} messages")
    return wrong


def _children(process: int) -> list[int]:
    """Return the children of a process in the order of their start."""
    with suppress(OSError):
        return sorted(map(int, Path(f"/proc/{process}/task/{process}/children").read_text().split()))
    return []


def main() -> None:
    os.environ.setdefault("MICROSLIP_CACHE", "off")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kill_test.add_arguments(parser, times=200)
    parser.add_argument("--stages", nargs="+", metavar="NAME", help="of the log, in which alone signals are sent")
    arguments = parser.parse_args()
    arguments.in_a_row = 1
    if arguments.scene == kill_test.DEMO and not arguments.settings:
        arguments.settings = list(SHORT)
    sys.exit(kill_test.run_trials(SignalTest, arguments))


if __name__ == "__main__":
    main()
