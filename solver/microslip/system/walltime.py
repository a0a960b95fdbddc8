"""How long the program may run: what the command line says, or the scheduler of a cluster.  Local."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

_UNITS = {"d": 86400.0, "h": 3600.0, "m": 60.0, "s": 1.0}
_LONGEST = 1e9  # s
_PATIENCE = 10.0  # s for a scheduler to answer

Ask = Callable[[list[str]], str]


@dataclass(frozen=True)
class TimeLimit:
    """The time that is left, and who says so."""

    seconds: float  # left at ``since``
    source: str
    since: float = field(default_factory=time.monotonic)

    def __reduce__(self):
        """Say to another machine what is left: its clock counts from elsewhere."""
        return TimeLimit, (self.left, self.source)

    @property
    def left(self) -> float:
        """The seconds left now."""
        return self.seconds - (time.monotonic() - self.since)


def seconds_of(text: str) -> float | None:
    """Return a time in seconds, or None if it is none: 3600, 90m, 1h30m, MM:SS, HH:MM:SS, D-HH, D-HH:MM, D-HH:MM:SS."""
    text = text.strip().lower()
    if re.fullmatch(r"[0-9]{1,9}(\.[0-9]*)?", text):
        return float(text)
    if re.fullmatch(r"([0-9]{1,9}d)?([0-9]{1,9}h)?([0-9]{1,9}m)?([0-9]{1,9}s)?", text) and text:
        return sum(float(number) * _UNITS[unit] for number, unit in re.findall(r"([0-9]+)([dhms])", text))
    found = re.fullmatch(r"(?:([0-9]{1,5})-)?([0-9]{1,6}(?::[0-9]{1,2}){0,2})", text)
    if found is None:
        return None
    days, clock = int(found[1] or 0), [int(part) for part in found[2].split(":")]
    units = (3600.0, 60.0, 1.0) if found[1] or len(clock) == 3 else (60.0, 1.0)
    return 86400.0 * days + sum(unit * part for unit, part in zip(units, clock))


def time_limit(asked: float | None, environment: Mapping[str, str] = os.environ, ask: Ask | None = None) -> TimeLimit | None:
    """Return the time left: the shorter of what is ``asked`` for [s] and what a scheduler allows; None: nothing limits it."""
    limits = [TimeLimit(asked, f"--walltime, {asked:g} s")] if asked is not None else []
    for scheduler in (_slurm, _pbs):
        found = scheduler(environment, ask or _ask)
        if found is not None and 0.0 < found[0] < _LONGEST:  # a time that is over is not that of this job
            limits.append(TimeLimit(*found))
    return min(limits, key=lambda limit: limit.seconds, default=None)


def _slurm(environment: Mapping[str, str], ask: Ask) -> tuple[float, str] | None:
    """Return the seconds that Slurm leaves the job that this is, and its name."""
    job = environment.get("SLURM_JOB_ID")
    if not job:
        return None
    end = environment.get("SLURM_JOB_END_TIME", "")
    left = (
        float(end) - time.time()
        if re.fullmatch(r"[0-9]{1,12}", end)
        else seconds_of(ask(["squeue", "-h", "-j", job, "-o", "%L"]))
    )
    return None if left is None else (left, f"the time limit of Slurm job {job}")


def _pbs(environment: Mapping[str, str], ask: Ask) -> tuple[float, str] | None:
    """Return the seconds that PBS leaves the job that this is, and its name."""
    job = environment.get("PBS_JOBID")
    if not job:
        return None
    left = _pbs_left(ask(["qstat", "-f", "-F", "json", job]))
    if left is None:  # Torque states the whole
        left = seconds_of(environment.get("PBS_WALLTIME", ""))
    return None if left is None else (left, f"the time limit of PBS job {job}")


def _pbs_left(answer: str) -> float | None:
    """Return what is left by qstat's words on one job."""
    try:
        (job,) = json.loads(answer)["Jobs"].values()
        whole = seconds_of(job["Resource_List"]["walltime"])
        used = seconds_of(job.get("resources_used", {}).get("walltime", "0"))
        if "stime" in job:  # what is used is counted every few minutes only
            used = time.time() - time.mktime(time.strptime(job["stime"]))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return None if whole is None or used is None else whole - used


def _ask(command: list[str]) -> str:
    """Return what a command says, or nothing if there is none, it fails or takes too long."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_PATIENCE, check=False, stdin=subprocess.DEVNULL, errors="replace"
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
