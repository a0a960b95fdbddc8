"""Checks of the outcome of an entry: status, one readable message, time, and unchanged earlier results."""

from __future__ import annotations

import re
from dataclasses import dataclass

from microslip.guards.ending import DEFECT

from .case import Case
from .faults import ENDED_BY_LAUNCHER, Fault

MARK = "microslip: error: "
_INTERNALS = re.compile(
    r"Traceback|\b\w+(?:Error|Exception|Warning)\b|\[?Errno|errno =|<class|object at 0x|NoneType|PETSC ERROR|microslip: error: \s*$"
)
_LONGEST = 1500  # characters of a message: a screen


@dataclass(frozen=True)
class Ended:
    """How the program ended."""

    status: int | None  # None: killed at the time limit
    stderr: str  # of all ranks
    seconds: float


def violations(ended: Ended, case: Case, earlier: dict[str, str], later: dict[str, str], limit: float) -> list[str]:
    """Return the violations of a bad input, a text each.  Local.

    ``earlier`` and ``later`` are the results of an earlier run before and after, by :func:`.sound.fingerprint`.
    """
    wrong = [] if ended.status == case.status else [f"status {ended.status}, not {case.status}"]
    if ended.stderr.count(MARK) != 1:
        wrong.append(f"{ended.stderr.count(MARK)} messages")
    message = ended.stderr.partition(MARK)[2]
    wrong += [f"{word!r} is missing" for word in case.words if word not in message]
    if (internals := _INTERNALS.search(ended.stderr)) is not None:
        wrong.append(f"{internals[0]!r} is not for users")
    if len(message) > _LONGEST:
        wrong.append(f"a message of {len(message)} characters")
    if ended.seconds > limit:
        wrong.append(f"{ended.seconds:.1f} s")
    return wrong + _changed(earlier, later)


def violations_of_fault(
    ended: Ended, after: float | None, fault: Fault, n_ranks: int, earlier: dict[str, str], later: dict[str, str]
) -> list[str]:
    """Return the violations of a run with a fault, a text each.  Local.

    ``after`` is the time from the fault to the end [s], None where the fault did not occur.
    """
    is_expected = ended.status not in (0, None) if fault.status is ENDED_BY_LAUNCHER else ended.status == fault.status
    wrong = (
        [] if is_expected else [f"status {ended.status}, not {'above 0' if fault.status is ENDED_BY_LAUNCHER else fault.status}"]
    )
    if fault.has_message and ended.stderr.count(MARK) != 1:
        wrong.append(f"{ended.stderr.count(MARK)} messages")
    if not ended.stderr.strip() and ended.status != 0 and n_ranks > 1:
        wrong.append("no output on standard error")
    wrong += [f"{word!r} is missing" for word in fault.words if word not in ended.stderr]
    if fault.has_message and fault.status != DEFECT and (internals := _INTERNALS.search(ended.stderr)) is not None:
        wrong.append(f"{internals[0]!r} is not for users")
    if fault.moment and after is None:
        wrong.append("the fault did not occur")
    if fault.moment and fault.status != 0 and (after or 0.0) > fault.within:
        wrong.append(f"{after:.1f} s until the end")
    return wrong + (_changed(earlier, later) if fault.status != 0 else [])


def _changed(earlier: dict[str, str], later: dict[str, str]) -> list[str]:
    return [f"{name} of an earlier run was changed" for name, digest in earlier.items() if later.get(name) != digest]
