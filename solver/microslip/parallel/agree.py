"""Errors and results agreed on by all ranks before any of them reads on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .errors import MicroslipError


def raise_together(comm, problem: str | None, error: type[MicroslipError]) -> None:
    """Raise ``error`` on every rank if any rank passes a ``problem`` text.

    Collective on ``comm``.  The message is that of the lowest rank with a problem.
    """
    found = [(rank, text) for rank, text in enumerate(comm.allgather(problem)) if text]
    if found:
        rank, text = found[0]
        where = "" if comm.size == 1 else f" (rank {rank}; {len(found)} of {comm.size} ranks affected)"
        raise error(text + where)


def on_root(comm, function: Callable[..., Any], *args: Any) -> Any:
    """Call ``function(*args)`` on rank 0 and return its result on every rank.

    Collective on ``comm``: one broadcast.

    Raises
    ------
    Whatever ``function`` raises, on every rank: the same type of error with the same text.
    A ``SystemExit`` from a library becomes a ``CaseError``.
    """
    from .errors import CaseError

    outcome: tuple[bool, Any] = (True, None)
    if comm.rank == 0:
        try:
            outcome = (True, function(*args))
        except SystemExit as stop:                       # libraries that exit instead of raising
            outcome = (False, CaseError(f"{getattr(function, '__name__', 'a library')} gave up: {stop}"))
        except Exception as problem:                     # re-raised below, on every rank
            outcome = (False, problem)
    good, value = comm.bcast(outcome)
    if not good:
        raise value
    return value
