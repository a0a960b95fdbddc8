"""Test that a run killed at random moments (kill -9) is continued to the same curves, and measure the lost work.

    python jobs/bench/kill_test.py [SCENE] [--times 100] [--ranks 1 2] [--seed S] [--earlier SHARE] [--set KEY=VALUE ...]
                                   [--in-a-row N] [--folder DIR]

The scene, by default that of the demo, first runs undisturbed on each number of ranks.  Then, `--times` times, it starts in a new
folder, all its processes are killed at one moment, and the same command is repeated until it ends.  Moments are of three kinds in
turn: during the *set-up*, at a time before the first point; at *points*, some time after a point was reported; while *writing*,
as a file of the run is created, written or renamed.  `--in-a-row` kills a run several times before it may end.  A share of the
runs (`--earlier`, a half) starts over the results of an earlier run at another level.

A trial fails if the run does not end with status 0; if its curves differ from those of the undisturbed run: points at the same
frequencies, responses within 1e-8 of the peak; if more than one reported point is computed again per kill; if results.h5 or
frf.csv is neither that of the earlier run nor complete and correct; or if results.h5 cannot be read.  A set-up killed before it
was stored is computed again; on several ranks it then differs by rounding, which sometimes changes whether a step is repeated.
So where the numbers of points differ, the points that only one of the two runs has are compared with a third run at their
frequencies. Any failure makes status 1.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shlex
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import machine
import numpy as np
from killing import Run, Writes

from microslip.messages.errors import CaseError
from microslip.results.read import read_results
from microslip.results.record import COMPLETE, ResultFile
from microslip.scene.read import read_scene

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "jobs" / "fan_small.toml"
KINDS = ("set-up", "points", "writing")
TOLERANCE = 1e-8  # of a level's peak
LIMIT = 900.0  # s; a longer run hangs
POINT = re.compile(r"^ +\d+ +[\d.]+ +\d\.\d+e[+-]\d+ ", re.MULTILINE)
_TAKEN = re.compile(r"(?:continues after|its) (\d+) points (?:are from|of) an earlier run")
_DONE = "nothing is left to compute"
_LEVEL = re.compile(r"^level \d+ of \d+: [^,:]+, ", re.MULTILINE)
STAGE = re.compile(r"^([a-z][\w ,]+?) +([\d.]+) s +\d+ MiB$", re.MULTILINE)


class Curve(NamedTuple):
    """The points of a level."""

    frequency: np.ndarray  # Hz
    response: np.ndarray  # (n_points, n_outputs, N_H) m


@dataclass(frozen=True)
class Undisturbed:
    """The undisturbed run on a number of ranks."""

    levels: list[Curve]
    n_rows: int  # of frf.csv
    seconds: float
    first_point: float  # s until the first point was reported
    last_point: float  # s until the last one was
    n_writes: int
    stages: dict[str, float]  # s, by their names in the log

    @property
    def n_points(self) -> int:
        return sum(len(frequency) for frequency, _ in self.levels)


@dataclass
class Trial:
    """A run that was killed, and its continuation."""

    number: int
    ranks: int
    over_earlier: bool
    hit: list[str] = field(default_factory=list)  # what was killed, a text per kill
    reported: int = 0  # points before the kills, without those from the checkpoint
    taken: int = 0  # points that the last start read from the checkpoint
    off: float = np.nan  # largest difference of the response, over the peak
    n_rows: list[int] = field(default_factory=list)  # of frf.csv after kills, where it was no longer the earlier one
    n_more: int = 0  # points that only this run has
    n_fewer: int = 0  # points that only the undisturbed run has
    wrong: list[str] = field(default_factory=list)

    @property
    def lost(self) -> int:
        """Number of reported points that were computed again."""
        return max(0, self.reported - self.taken)

    def row(self) -> str:
        cells = [
            self.number,
            self.ranks,
            "earlier" if self.over_earlier else "new",
            "; ".join(self.hit),
            self.reported,
            self.taken,
        ]
        others = f", {self.n_more} points more and {self.n_fewer} fewer" if self.n_more or self.n_fewer else ""
        verdict = "; ".join(self.wrong) or f"as it should be{others}"
        return " | ".join(map(str, ["", *cells, self.lost, f"{self.off:.1e}", verdict, ""])).strip()


class Test:
    """The kill test of a scene in a folder."""

    def __init__(self, arguments: argparse.Namespace, folder: Path):
        self.arguments, self.folder = arguments, folder
        self.scene = read_scene(arguments.scene, arguments.settings)
        self.random = random.Random(arguments.seed)

    def command(self, ranks: int, out: Path, *more: str) -> list[str]:
        launcher = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
        settings = [word for setting in self.arguments.settings for word in ("--set", setting)]
        own = ["run", str(self.arguments.scene), "--out", str(out), *settings, *more]
        return [*launcher, sys.executable, "-m", "microslip", *own]

    # -- the expected result -------------------------------------------------------------------------------------------

    def undisturbed(self, ranks: int) -> Undisturbed:
        """Run once and measure the times from which moments are drawn."""
        out = self.folder / f"undisturbed_{ranks}"
        out.mkdir()
        writes = Writes(out)
        run, n = Run(self.command(ranks, out), self.folder / "output"), 0
        reported: list[float] = []
        while not run.is_over:
            n += writes.wait(0.02)
            reported += [run.seconds] * (len(POINT.findall(run.output())) - len(reported))
        n += writes.wait(0.0)
        writes.close()
        if run.process.returncode != 0 or not reported:
            raise SystemExit(f"the undisturbed run of the scene failed, status {run.process.returncode}:\n{run.output()}")
        levels = [Curve(level.frequency, level.response) for level in read_results(str(out / "results.h5")).levels]
        stages = {name: float(seconds) for name, seconds in STAGE.findall(run.output())}
        return Undisturbed(levels, _rows(out / "frf.csv"), run.seconds, reported[0], reported[-1], n, stages)

    def earlier(self) -> Path:
        """Return the folder of a finished run of the same scene at another level."""
        out = self.folder / "earlier"
        if not out.exists():
            level = 0.5 * min(self.scene.response.levels)
            run = Run(self.command(1, out, "--set", f"response.levels=[{level!r}]"), self.folder / "output")
            if run.wait(LIMIT) != 0:
                raise SystemExit(f"the run of the scene at half of its lowest level failed:\n{run.output()}")
        return out

    # -- a trial -----------------------------------------------------------------------------------------------------

    def trial(self, number: int, ranks: int, goal: Undisturbed) -> Trial:
        """Run, kill, repeat until the end, and list what was wrong."""
        out, over_earlier = self.folder / "out", self.random.random() < self.arguments.earlier
        outcome = Trial(number, ranks, over_earlier)
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(self.earlier(), out) if over_earlier else out.mkdir()
        before = {name: (out / name).read_bytes() for name in ("results.h5", "frf.csv") if over_earlier}
        while len(outcome.hit) < self.arguments.in_a_row:
            run = self._killed(KINDS[(number + len(outcome.hit)) % 3], ranks, out, goal, outcome)
            self._check_files(out, goal, before, outcome)
            if run.process.returncode == 0:
                break
        run = Run(self.command(ranks, out), self.folder / "output")
        status = run.wait(LIMIT)
        outcome.taken = outcome.reported if _DONE in run.output() else _taken(run.output())
        if status != 0:
            outcome.wrong.append("does not end" if status is None else f"status {status}: {run.output()[-300:]}")
            return outcome
        if outcome.lost > len(outcome.hit):
            outcome.wrong.append(f"{outcome.lost} points computed twice")
        if outcome.taken > outcome.reported + len(outcome.hit):  # a point is stored just before it is reported
            outcome.wrong.append(f"{outcome.taken} points taken over, of {outcome.reported}")
        self._compare(out, goal, outcome)
        left = [path.name for path in out.iterdir() if path.name == "unfinished" or path.suffix == ".part"]
        outcome.wrong += [f"{name} is left behind" for name in left]
        return outcome

    def _killed(self, kind: str, ranks: int, out: Path, goal: Undisturbed, trial: Trial) -> Run:
        """Start a run, kill it at a moment of a kind, and note what was hit."""
        writes = Writes(out)
        run = Run(self.command(ranks, out), self.folder / "output")
        moment = {"set-up": self._in_set_up, "points": self._at_points, "writing": self._while_writing}[kind]
        moment(run, writes, goal, trial)
        run.kill()
        writes.close()
        output = run.output()
        n, taken = len(POINT.findall(output)), _taken(output)
        if n or taken:
            trial.reported = max(n, trial.reported)  # a start reports the points of the checkpoint again
        where = "set-up" if not _LEVEL.search(output) else f"point {n}" if n < goal.n_points else "pictures"
        over = "" if run.process.returncode != 0 else ", had ended"
        trial.hit.append(f"{kind}: {run.seconds:.2f} s, {where}{over}")
        return run

    def _in_set_up(self, run: Run, writes: Writes, goal: Undisturbed, trial: Trial) -> None:
        self._sleep(run, self.random.uniform(0.0, goal.first_point))

    def _at_points(self, run: Run, writes: Writes, goal: Undisturbed, trial: Trial) -> None:
        """Wait for a point that was not reported before, and for a part of the time to the next one."""
        n = self.random.randrange(min(trial.reported, goal.n_points - 1), goal.n_points) + 1
        while not run.is_over and len(POINT.findall(run.output())) < n:
            time.sleep(0.005)
        self._sleep(run, self.random.uniform(0.0, 2.0 * (goal.last_point - goal.first_point) / goal.n_points))

    def _while_writing(self, run: Run, writes: Writes, goal: Undisturbed, trial: Trial) -> None:
        """Wait for one of the writes, and then at most as long as a short write takes."""
        n, at = 0, self.random.randrange(goal.n_writes) + 1
        while not run.is_over and n < at:
            n += writes.wait(0.2)
        self._sleep(run, self.random.uniform(0.0, 0.002))

    def _sleep(self, run: Run, seconds: float) -> None:
        end = time.monotonic() + seconds
        while not run.is_over and time.monotonic() < end:
            time.sleep(max(0.0, min(0.05, end - time.monotonic())))

    # -- the files -----------------------------------------------------------------------------------------------

    def _check_files(self, out: Path, goal: Undisturbed, before: dict[str, bytes], trial: Trial) -> None:
        """Note files after a kill that are neither earlier nor correct, or look complete and are not."""
        results, table = out / "results.h5", out / "frf.csv"
        if before and not table.exists():
            trial.wrong.append("frf.csv of the earlier run is gone")
        elif before and table.read_bytes() != before["frf.csv"]:
            trial.n_rows.append(_rows(table))
        if not results.exists():
            trial.wrong += ["results.h5 of the earlier run is gone"] if before else []
            return
        if before and results.read_bytes() == before["results.h5"]:
            return
        try:
            read = read_results(str(results))
        except CaseError as problem:
            trial.wrong.append(f"after the kill {problem}")
            return
        if _looks_complete(read, len(self.scene.response.levels)):
            wrong = self._differences(read, goal, trial)[1]
            trial.wrong += [f"results.h5 looks complete and is not: {text}" for text in wrong]
        elif before:
            trial.wrong.append("results.h5 of the earlier run was replaced by incomplete ones")

    def _compare(self, out: Path, goal: Undisturbed, trial: Trial) -> None:
        """Note how far the curves differ from those of the undisturbed run."""
        read = read_results(str(out / "results.h5"))
        trial.off, wrong = self._differences(read, goal, trial)
        trial.wrong += wrong
        if not _looks_complete(read, len(self.scene.response.levels)):
            trial.wrong.append("results.h5 is not complete")
        n_rows = goal.n_rows + trial.n_more - trial.n_fewer
        if _rows(out / "frf.csv") != n_rows:
            trial.wrong.append(f"frf.csv has {_rows(out / 'frf.csv')} rows, not {n_rows}")
        if any(n != n_rows for n in trial.n_rows):
            trial.wrong.append("after a kill frf.csv was neither that of the earlier run nor whole")

    def _differences(self, read: ResultFile, goal: Undisturbed, trial: Trial) -> tuple[float, list[str]]:
        """Return the largest difference of the response over the peak of its level, and the faults of the curves."""
        off, wrong = 0.0, []
        trial.n_more = trial.n_fewer = 0
        if len(read.levels) != len(goal.levels):
            return np.nan, [f"{len(read.levels)} levels, not {len(goal.levels)}"]
        for level, of_goal in zip(read.levels, goal.levels):
            own = Curve(level.frequency, level.response)
            if len(own[0]) == len(of_goal[0]):
                off = max(off, float(np.abs(own[0] / of_goal[0] - 1.0).max()), _gap(own[1] - of_goal[1], of_goal))
                continue
            more, of_both = _apart(own, of_goal)
            fewer, _ = _apart(of_goal, own)
            trial.n_more, trial.n_fewer = trial.n_more + len(more[0]), trial.n_fewer + len(fewer[0])
            both = Curve(*map(np.concatenate, zip(more, fewer)))
            left, of_third = _apart(both, self._at_frequencies(trial.ranks, level.level, both[0]))
            wrong += [f"{len(left[0])} points at {level.level:g} N that the curve does not have"] if len(left[0]) else []
            off = max(off, of_both, of_third)
        return off, wrong + ([f"curves differ by {off:.1e} of the peak"] if off > TOLERANCE else [])

    def _at_frequencies(self, ranks: int, level: float, frequency: np.ndarray) -> Curve:
        """Return the curve of a level with points at some frequencies [Hz], by a separate run."""
        out = self.folder / "requested"
        shutil.rmtree(out, ignore_errors=True)
        at = ", ".join(repr(float(f)) for f in np.unique(frequency))
        settings = ("--set", f"response.levels=[{level!r}]", "--set", f"response.at=[{at}]")
        run = Run(self.command(ranks, out, *settings), self.folder / "output")
        if run.wait(LIMIT) != 0:
            raise SystemExit(f"the run of the scene at the requested frequencies failed:\n{run.output()}")
        (only,) = read_results(str(out / "results.h5")).levels
        return Curve(only.frequency, only.response)


def _taken(output: str) -> int:
    return sum(map(int, _TAKEN.findall(output)))


def _rows(table: Path) -> int:
    """Return the number of complete rows of a table after its header."""
    return table.read_bytes().count(b"\n") - 1 if table.exists() else -1


def _looks_complete(read: ResultFile, n_levels: int) -> bool:
    """Return whether a reader must take the results for those of a complete run."""
    return len(read.levels) == n_levels and all(level.status == COMPLETE for level in read.levels)


def _gap(difference: np.ndarray, curve: Curve) -> float:
    """Return the size of a difference of responses over the peak of a curve."""
    return float(np.abs(difference).max(initial=0.0) / np.abs(curve.response).max())


def _apart(points: Curve, curve: Curve) -> tuple[Curve, float]:
    """Return the points at whose frequencies a curve has none, and the difference of the others from it, over its peak."""
    off, left = 0.0, []
    for i, frequency in enumerate(points.frequency):
        there = np.flatnonzero(np.abs(curve.frequency / frequency - 1.0) <= TOLERANCE)
        gaps = [_gap(curve.response[j] - points.response[i], curve) for j in there]  # beyond a fold there may be two
        left += [] if gaps else [i]
        off = max(off, min(gaps, default=0.0))
    return Curve(points.frequency[left], points.response[left]), off


def summary(trials: list[Trial]) -> list[str]:
    """Return the summary of all trials."""
    good = sum(not trial.wrong for trial in trials)
    kinds = [sum(text.startswith(kind) for trial in trials for text in trial.hit) for kind in KINDS]
    hits = f", {sum(kinds)} kills ({', '.join(f'{n} {kind}' for n, kind in zip(kinds, KINDS))})" if any(kinds) else ""
    others = sum(bool(trial.n_more or trial.n_fewer) for trial in trials)
    lost, off = [trial.lost for trial in trials], [trial.off for trial in trials]
    return [
        f"{good} of {len(trials)} runs went on as they should{hits}",
        f"points computed twice: {sum(lost)} in all, {max(lost)} in a run at most; largest difference {np.nanmax(off):.1e} of the peak",
        f"runs with other numbers of points, on the same curves: {others}",
    ]


def add_arguments(parser: argparse.ArgumentParser, times: int) -> None:
    """Add the options of a kill or signal test; ``times`` is the default number of trials."""
    parser.add_argument("scene", nargs="?", type=Path, default=DEMO)
    parser.add_argument("--times", type=int, default=times, help="on each number of ranks")
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--earlier", type=float, default=0.5, metavar="SHARE")
    parser.add_argument("--set", dest="settings", metavar="KEY=VALUE", action="append", default=[])
    parser.add_argument("--folder", type=Path, help="keep the files there")


def run_trials(kind: type[Test], arguments: argparse.Namespace) -> bool:
    """Run a test on each number of ranks, show each trial in a line, and return whether any failed."""
    signal.signal(signal.SIGTERM, lambda *of: sys.exit("stopped"))  # and the run with it
    print("\n".join(machine.lines(machine.facts())))
    print(f"Seed {arguments.seed}; {arguments.scene}", flush=True)
    with tempfile.TemporaryDirectory(prefix="kill_test_") as own:
        folder = arguments.folder or Path(own)
        folder.mkdir(parents=True, exist_ok=True)
        test, trials = kind(arguments, folder), []
        for ranks in arguments.ranks:
            goal = test.undisturbed(ranks)
            print(
                f"\n{ranks} ranks, undisturbed: {goal.n_points} points, {goal.seconds:.1f} s, first point after {goal.first_point:.1f} s, {goal.n_writes} writes\n"
            )
            print("| run | ranks | folder | killed at | points reported | taken over | computed twice | off, of the peak | |")
            print("| ---: | ---: | --- | --- | ---: | ---: | ---: | ---: | --- |", flush=True)
            for number in range(arguments.times):
                trials.append(test.trial(number, ranks, goal))
                print(trials[-1].row(), flush=True)
        print("", *summary(trials), sep="\n")
    return any(trial.wrong for trial in trials)


def main() -> None:
    os.environ.setdefault("MICROSLIP_CACHE", "off")  # without a cache, so that runs are killed within their set-up, too
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, times=100)
    parser.add_argument("--in-a-row", type=int, default=1, metavar="N")
    sys.exit(run_trials(Test, parser.parse_args()))


if __name__ == "__main__":
    main()
