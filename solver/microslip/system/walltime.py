"""The time limit of a run: that of the command line, or of the scheduler of a cluster.  Local."""

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

Query = Callable[[list[str]], str]


@dataclass(frozen=True)
class TimeLimit:
    """The remaining time, and its source."""

    seconds: float  # left at ``since``
    source: str
    since: float = field(default_factory=time.monotonic)

    def __reduce__(self):
        """Pickle the remaining time: the monotonic clock of another machine has another origin."""
        return TimeLimit, (self.remaining, self.source)

    @property
    def remaining(self) -> float:
        """The seconds left now."""
        return self.seconds - (time.monotonic() - self.since)


def seconds_of(text: str) -> float | None:
    """Return a time in seconds, or None if it is none: 3600, 90m, 1h30m, MM:SS, HH:MM:SS, D-HH, D-HH:MM, D-HH:MM:SS."""
    text = text.strip().lower()
    if re.fullmatch(r"[0-9]{1,9}(\.[0-9]*)?", text):
        return float(text)
    if re.fullmatch(r"([0-9]{1,9}d)?([0-9]{1,9}h)?([0-9]{1,9}m)?([0-9]{1,9}s)?", text) and text:
        return sum(float(number) * _UNITS[unit] for number, unit in re.findall(r"([0-9]+)([dhms])", text))
    match = re.fullmatch(r"(?:([0-9]{1,5})-)?([0-9]{1,6}(?::[0-9]{1,2}){0,2})", text)
    if match is None:
        return None
    days, clock = int(match[1] or 0), [int(part) for part in match[2].split(":")]
    units = (3600.0, 60.0, 1.0) if match[1] or len(clock) == 3 else (60.0, 1.0)
    return 86400.0 * days + sum(unit * part for unit, part in zip(units, clock))


def time_limit(
    requested: float | None, environment: Mapping[str, str] = os.environ, query: Query | None = None
) -> TimeLimit | None:
    """Return the time limit: the shorter of the ``requested`` one [s] and that of a scheduler; None: no limit."""
    limits = [TimeLimit(requested, f"--walltime, {requested:g} s")] if requested is not None else []
    for scheduler in (_slurm, _pbs):
        limit = scheduler(environment, query or _query)
        if limit is not None and 0.0 < limit[0] < _LONGEST:  # a time that is over is not that of this job
            limits.append(TimeLimit(*limit))
    return min(limits, key=lambda each: each.seconds, default=None)


def _slurm(environment: Mapping[str, str], query: Query) -> tuple[float, str] | None:
    """Return the seconds that Slurm leaves the job that this is, and its name."""
    job = environment.get("SLURM_JOB_ID")
    if not job:
        return None
    end = environment.get("SLURM_JOB_END_TIME", "")
    remaining = (
        float(end) - time.time()
        if re.fullmatch(r"[0-9]{1,12}", end)
        else seconds_of(query(["squeue", "-h", "-j", job, "-o", "%L"]))
    )
    return None if remaining is None else (remaining, f"the time limit of Slurm job {job}")


def _pbs(environment: Mapping[str, str], query: Query) -> tuple[float, str] | None:
    """Return the seconds that PBS leaves the job that this is, and its name."""
    job = environment.get("PBS_JOBID")
    if not job:
        return None
    remaining = _pbs_remaining(query(["qstat", "-f", "-F", "json", job]))
    if remaining is None:  # Torque states the whole
        remaining = seconds_of(environment.get("PBS_WALLTIME", ""))
    return None if remaining is None else (remaining, f"the time limit of PBS job {job}")


def _pbs_remaining(answer: str) -> float | None:
    """Return the remaining time from qstat's output for one job."""
    try:
        (job,) = json.loads(answer)["Jobs"].values()
        total = seconds_of(job["Resource_List"]["walltime"])
        used = seconds_of(job.get("resources_used", {}).get("walltime", "0"))
        if "stime" in job:  # what is used is counted every few minutes only
            used = time.time() - time.mktime(time.strptime(job["stime"]))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return None if total is None or used is None else total - used


def _query(command: list[str]) -> str:
    """Return the output of a command, empty if it is missing, fails or takes too long."""
    try:
        result = subprocess.run(
            command, capture_output=True, text=True, timeout=_PATIENCE, check=False, stdin=subprocess.DEVNULL, errors="replace"
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return result.stdout.strip() if result.returncode == 0 else ""
