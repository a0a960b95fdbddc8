"""Faults within a run: a fault of a process, or of its environment, at a stated moment, and the expected outcome.

``tests/faults.py`` causes them; each needs a separate process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

FIRST, LAST = "first", "last"
ENDED_BY_LAUNCHER = None  # any status but 0: a signal, or the status that mpirun returns
WITHIN = 10.0  # s from the fault to the end


@dataclass(frozen=True)
class Fault:
    """A fault in a run of a scene of the catalogue."""

    name: str
    moment: str  # argument of tests/faults.py; "" where the environment is at fault
    fault: str  # argument of tests/faults.py
    rank: str  # FIRST or LAST
    status: int | None
    words: tuple[str, ...] = ()  # of standard error
    scene: str = "chain"
    options: tuple[str, ...] = ()  # of the command line
    once: tuple[str, ...] = ()  # options of the first command that the second one omits
    launcher: tuple[str, ...] = ()  # before the program: limits of the system
    variables: dict[str, str] = field(default_factory=dict)  # of the environment
    before: Callable[[Path], None] | None = None  # changes the folder
    within: float = WITHIN  # s from the fault to the end
    has_message: bool = True  # one error message of the program; else of the system, of PETSc, of the launcher, or none


def in_stage(stage: str, fault: str, rank: str, status: int | None, *words: str, **more) -> Fault:
    return Fault(f"{fault} on the {rank} rank in {stage!r}", f"stage:{stage}", fault, rank, status, words, **more)


def in_point(number: int, fault: str, rank: str, status: int | None, *words: str, **more) -> Fault:
    return Fault(f"{fault} on the {rank} rank in point {number}", f"point:{number}", fault, rank, status, words, **more)


def while_writing(number: int, fault: str, rank: str, status: int | None, *words: str, **more) -> Fault:
    return Fault(f"{fault} while file {number} is written", f"written:{number}", fault, rank, status, words, **more)


DEFECT = ("a defect of the program", "ZeroDivisionError: a mistake")
FULL = ("No space left on device", "make room")
LAP = {"scene": "lap", "options": ("--set", "response.frequencies=[10.0, 12.0]", "--set", "solver.error_bars=false")}
STAGES = [
    Fault("defect before MPI", "start", "defect", FIRST, 1, ("ZeroDivisionError",), has_message=False),
    Fault("kill before MPI", "start", "kill", LAST, ENDED_BY_LAUNCHER, has_message=False),
    in_stage("model file", "defect", FIRST, 70, *DEFECT, **LAP),
    in_stage("mesh", "exit3", LAST, 70, "sys.exit(3)", **LAP),
    in_stage("mesh", "memory", FIRST, 4, "not enough memory", **LAP),
    in_stage("partition", "kill", LAST, ENDED_BY_LAUNCHER, has_message=False, **LAP),
    in_stage("assembly", "segfault", FIRST, ENDED_BY_LAUNCHER, "Segmentation", has_message=False, **LAP),
    in_stage("matrices", "defect", LAST, 70, *DEFECT),
    in_stage("matrices", "_exit1", FIRST, ENDED_BY_LAUNCHER, has_message=False),
    in_stage("factor", "petsc-memory", LAST, 4, "not enough memory"),
    in_stage("factor", "petsc-error", FIRST, 70, "a defect of the program"),
    in_stage("factor", "kill", FIRST, ENDED_BY_LAUNCHER, has_message=False),
    in_stage("modes", "memory", LAST, 4, "not enough memory"),
    in_stage("modes", "abort", FIRST, ENDED_BY_LAUNCHER, has_message=False),
    in_stage("modes", "case", LAST, 2, "met by one rank alone"),
    in_stage("reduction", "recursion", FIRST, 70, "RecursionError"),
    in_stage("reduction", "exit0", LAST, 70, "sys.exit(0)"),
    in_stage("reduction", "segfault", LAST, ENDED_BY_LAUNCHER, has_message=False),
    in_stage("response", "defect", FIRST, 70, *DEFECT),
    in_stage("response", "exit-text", LAST, 70, "a library gave up"),
    in_stage("fields", "kill", FIRST, ENDED_BY_LAUNCHER, has_message=False),
    in_stage("fields", "disk", FIRST, 4, *FULL),
    in_stage("pictures", "defect", LAST, 70, *DEFECT),
    in_stage("pictures", "memory", FIRST, 4, "not enough memory"),
    in_stage("pictures", "kill", LAST, ENDED_BY_LAUNCHER, has_message=False),
]
POINTS = [
    in_point(0, "defect", LAST, 70, *DEFECT),
    in_point(0, "kill", FIRST, ENDED_BY_LAUNCHER, has_message=False),
    in_point(1, "memory", LAST, 4, "not enough memory"),
    in_point(1, "case", FIRST, 2, "met by one rank alone"),
    in_point(2, "segfault", LAST, ENDED_BY_LAUNCHER, has_message=False),
    in_point(2, "term", FIRST, 5, "SIGTERM"),
    in_point(2, "int", FIRST, 5, "SIGINT"),
    in_point(2, "keyboard", FIRST, 5, "keyboard"),
    in_point(2, "usr1", FIRST, 0, has_message=False),
    in_point(3, "slow", LAST, 0, has_message=False),
    in_point(3, "exit0", FIRST, 70, "sys.exit(0)"),
    in_point(3, "petsc-memory", FIRST, 4, "not enough memory"),
    in_point(
        2, "hang", LAST, ENDED_BY_LAUNCHER, "in _hang", variables={"MICROSLIP_WATCHDOG": "30"}, within=45.0, has_message=False
    ),
]
WRITING = [
    while_writing(0, "kill", FIRST, ENDED_BY_LAUNCHER, has_message=False),
    while_writing(1, "kill", FIRST, ENDED_BY_LAUNCHER, has_message=False),
    while_writing(0, "disk", FIRST, 4, *FULL),
    while_writing(1, "disk", FIRST, 4, *FULL),
    while_writing(0, "term", FIRST, 5, "SIGTERM"),
    while_writing(1, "defect", FIRST, 70, *DEFECT),
]


def _log_on_a_full_disk(folder: Path) -> None:
    """Make run.log a link to a full disk; no results are lost."""
    (folder / "new").mkdir()
    (folder / "new" / "run.log").symlink_to("/dev/full")


OTHER_FOLDER = ("--out", "new")
ENVIRONMENT = [
    Fault(
        "24 open files at most",
        "",
        "",
        FIRST,
        ENDED_BY_LAUNCHER,
        ("Too many open files",),
        launcher=("prlimit", "--nofile=24"),
        has_message=False,
    ),
    Fault(
        "an address space of 400 MB",
        "",
        "",
        FIRST,
        4,
        ("400 MB (ulimit -v)", "00 MB before there is a model"),
        launcher=("prlimit", "--as=400000000"),
    ),
    *(
        Fault(
            f"files of {size} bytes at most",
            "",
            "",
            FIRST,
            4,
            ("File too large", "make room"),
            options=("--out", "new"),
            launcher=("prlimit", f"--fsize={size}"),
        )
        for size in (1000, 10_000, 25_000)
    ),
    Fault("no home", "", "", FIRST, 0, variables={"HOME": "/none", "MPLCONFIGDIR": "/proc/none"}, has_message=False),
    Fault("a locale without UTF-8", "", "", FIRST, 0, variables={"LC_ALL": "C", "PYTHONUTF8": "0"}, has_message=False),
    Fault(
        "the disk of the log is full",
        "",
        "",
        FIRST,
        0,
        ("run.log: no longer written: No space left on device",),
        options=OTHER_FOLDER,
        before=_log_on_a_full_disk,
        has_message=False,
    ),
    Fault("a watch of words", "", "", FIRST, 2, ("MICROSLIP_WATCHDOG=soon",), variables={"MICROSLIP_WATCHDOG": "soon"}),
    Fault("no time at all", "", "", FIRST, 5, ("time",), once=("--walltime", "00:00:01")),
]

FAULTS = [*STAGES, *POINTS, *WRITING, *ENVIRONMENT]
