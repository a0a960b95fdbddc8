"""What every entry of the catalogue must come to: its status, one message in human words, in time, earlier results untouched."""

from __future__ import annotations

import re
from dataclasses import dataclass

from microslip.guards.ending import DEFECT

from .case import Case
from .faults import ENDED_BY_LAUNCHER, Fault

MARK = "microslip: error: "
_NOT_FOR_PEOPLE = re.compile(
    r"Traceback|\b\w+(?:Error|Exception|Warning)\b|\[?Errno|errno =|<class|object at 0x|NoneType|PETSC ERROR|microslip: error: \s*$"
)
_LONGEST = 1500  # characters of a message: a screen, all mistakes of a scene together


@dataclass(frozen=True)
class Ended:
    """How the program ended."""

    status: int | None  # None: it had to be killed, as it took too long
    said: str  # on standard error, by all ranks
    seconds: float


def violations(ended: Ended, case: Case, earlier: dict[str, str], computed: dict[str, str], limit: float) -> list[str]:
    """Return what is wrong with how a bad input ended, a text each; none is as it should be.  Local.

    ``earlier`` and ``found`` are the results of an earlier run before and after, by :func:`.sound.fingerprint`.
    """
    wrong = [] if ended.status == case.status else [f"status {ended.status}, not {case.status}"]
    if ended.said.count(MARK) != 1:
        wrong.append(f"{ended.said.count(MARK)} messages")
    message = ended.said.partition(MARK)[2]
    wrong += [f"{word!r} is missing" for word in case.words if word not in message]
    if (strange := _NOT_FOR_PEOPLE.search(ended.said)) is not None:
        wrong.append(f"{strange[0]!r} is nothing for people")
    if len(message) > _LONGEST:
        wrong.append(f"a message of {len(message)} characters")
    if ended.seconds > limit:
        wrong.append(f"{ended.seconds:.1f} s")
    return wrong + _touched(earlier, computed)


def violations_of_fault(
    ended: Ended, after: float | None, fault: Fault, n_ranks: int, earlier: dict[str, str], computed: dict[str, str]
) -> list[str]:
    """Return what is wrong with how a run with a fault ended, a text each.  Local.

    ``after`` is the time from the fault to the end [s], None where that did not come about.
    """
    right = ended.status not in (0, None) if fault.status is ENDED_BY_LAUNCHER else ended.status == fault.status
    wrong = [] if right else [f"status {ended.status}, not {'above 0' if fault.status is ENDED_BY_LAUNCHER else fault.status}"]
    if fault.is_said and ended.said.count(MARK) != 1:
        wrong.append(f"{ended.said.count(MARK)} messages")
    if not ended.said.strip() and ended.status != 0 and n_ranks > 1:
        wrong.append("nothing was said")
    wrong += [f"{word!r} is missing" for word in fault.words if word not in ended.said]
    if fault.is_said and fault.status != DEFECT and (strange := _NOT_FOR_PEOPLE.search(ended.said)) is not None:
        wrong.append(f"{strange[0]!r} is nothing for people")
    if fault.moment and after is None:
        wrong.append("the fault did not come about")
    if fault.moment and fault.status != 0 and (after or 0.0) > fault.within:
        wrong.append(f"{after:.1f} s until the end")
    return wrong + (_touched(earlier, computed) if fault.status != 0 else [])


def _touched(earlier: dict[str, str], computed: dict[str, str]) -> list[str]:
    return [f"{name} of an earlier run was touched" for name, digest in earlier.items() if computed.get(name) != digest]
