"""Entries of the catalogue in separate processes, on some ranks, with a time limit."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from processes import MPIRUN, environment

from .case import Case
from .faults import FIRST, Fault
from .judge import Ended, violations, violations_of_fault
from .sound import EARLIER, fingerprint

LIMIT = 300.0  # s; a longer run hangs
FAULTS = Path(__file__).parents[1] / "faults.py"


def run(
    arguments: Sequence[str], ranks: int, cwd: Path, launcher: Sequence[str] = (), variables: dict[str, str] | None = None
) -> Ended:
    """Run Python with arguments on some ranks and return its outcome.  Local."""
    command = [MPIRUN, "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
    began = time.monotonic()
    process = subprocess.Popen(
        [*command, *launcher, sys.executable, *arguments],
        cwd=cwd,
        env=environment(ranks) | (variables or {}),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # jobs in the background ignore it
    )
    try:
        stderr, status = process.communicate(timeout=LIMIT)[1], process.returncode
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGTERM)  # the launcher ends its ranks
        stderr, status = process.communicate()[1], None
    return Ended(status, stderr, time.monotonic() - began)


def bad_input(case: Case, sound: Path, folder: Path, ranks: int) -> tuple[Ended, list[str]]:
    """Run a bad input in a new folder; return its outcome and violations.  Local."""
    shutil.copytree(sound, folder)
    if case.spoil is not None:
        case.spoil(folder)
    earlier = fingerprint(folder / EARLIER)
    ended = run(["-m", "microslip", *case.line.split()], ranks, folder)
    return ended, violations(ended, case, earlier, fingerprint(folder / EARLIER), LIMIT)


def fault(case: Fault, sound: Path, folder: Path, ranks: int, repeat: bool = True) -> tuple[Ended, list[str]]:
    """Run with a fault in a new folder, then without; return the first outcome and the violations of both.  Local.

    The seconds of the outcome are those from the fault to the end, if the fault occurred.
    """
    shutil.copytree(sound, folder)
    if case.before is not None:
        case.before(folder)
    earlier = fingerprint(folder / EARLIER)
    line = ["run", f"{case.scene}.toml", *(case.options if "--out" in case.options else ("--out", EARLIER, *case.options))]
    rank = 0 if case.rank == FIRST else ranks - 1
    start = [str(FAULTS), case.moment, case.fault, str(rank)] if case.moment else ["-m", "microslip"]
    mark = folder / "at"
    ended = run([*start, *line], ranks, folder, case.launcher, case.variables | {"FAULT_AT": str(mark)})
    after = time.time() - float(mark.read_text()) if mark.exists() else None
    wrong = violations_of_fault(ended, after, case, ranks, earlier, fingerprint(folder / EARLIER))
    if repeat and (then := run(["-m", "microslip", *line], ranks, folder)).status != 0:
        wrong.append(f"the same command fails afterwards: status {then.status}, {then.stderr[-200:]!r}")
    return (ended if after is None else replace(ended, seconds=after)), wrong
