"""What every entry of the catalogue must come to: its status, one message in human words, in time, earlier results untouched."""

from __future__ import annotations

import re

MARK = "microslip: error: "
_NOT_FOR_PEOPLE = re.compile(
    r"Traceback|\b\w+(?:Error|Exception|Warning)\b|\[?Errno|errno =|<class|object at 0x|NoneType|PETSC ERROR|microslip: error: \s*$"
)
_LONGEST = 1500  # characters of a message: a screen, all mistakes of a scene together


def violations(
    status: int | None,
    said: str,
    expected: int,
    words: tuple[str, ...],
    earlier: dict[str, str],
    found: dict[str, str],
    seconds: float,
    limit: float,
) -> list[str]:
    """Return what is wrong with how the program ended, a text each; none is as it should be.  Local.

    Parameters
    ----------
    status, said : the exit status, None where it had to be killed, and what came on standard error, of all ranks
    expected, words : the status that is promised, and what the message must hold
    earlier, found : the results of an earlier run before and after, by :func:`.sound.fingerprint`
    seconds, limit : what it took, and may take
    """
    wrong = [] if status == expected else [f"status {status}, not {expected}"]
    if said.count(MARK) != 1:
        wrong.append(f"{said.count(MARK)} messages")
    message = said.partition(MARK)[2]
    wrong += [f"{word!r} is missing" for word in words if word not in message]
    if (strange := _NOT_FOR_PEOPLE.search(said)) is not None:
        wrong.append(f"{strange[0]!r} is nothing for people")
    if len(message) > _LONGEST:
        wrong.append(f"a message of {len(message)} characters")
    wrong += [f"{name} of an earlier run was touched" for name, digest in earlier.items() if found.get(name) != digest]
    if seconds > limit:
        wrong.append(f"{seconds:.1f} s")
    return wrong
