"""Errors and results that all ranks agree on before they continue."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..messages.errors import CaseError, MicroslipError
from ..system.watchdog import moved, unwatched

if TYPE_CHECKING:
    from mpi4py import MPI


def raise_together(comm: MPI.Comm, problem: str | None, error: type[MicroslipError]) -> None:
    """Raise ``error`` on every rank if any rank passes a ``problem`` text.

    Collective on ``comm``.  The message comes from the lowest rank with a problem.
    """
    moved()
    problems = [(rank, text) for rank, text in enumerate(comm.allgather(problem)) if text]
    if problems:
        rank, text = problems[0]
        where = "" if comm.size == 1 else f" (rank {rank}; {len(problems)} of {comm.size} ranks affected)"
        raise error(text + where)


def on_root(comm: MPI.Comm, function: Callable[..., Any], *args: Any, share: bool = True) -> Any:
    """Call ``function(*args)`` on rank 0; return its result on every rank, or with ``share=False`` on rank 0 only.

    Collective on ``comm``: one broadcast.

    Raises
    ------
    Any exception of ``function``, on every rank: the same type of error with the same text.
    A ``SystemExit`` from a library becomes a ``CaseError``.
    """
    value: Any = None
    shared: Any = None
    problem: Exception | None = None
    if comm.rank == 0:
        try:
            value = function(*args)
        except SystemExit as stop:  # libraries that exit instead of raising
            problem = CaseError(f"{getattr(function, '__name__', 'a library')} gave up: {stop}")
        except Exception as error:  # re-raised below, on every rank
            problem = error
    moved()
    if comm.size > 1:
        problem, shared = comm.bcast((problem, value if share else None))
    if problem is not None:
        raise problem
    return shared if share and comm.size > 1 else value


def on_each(comm: MPI.Comm, function: Callable[..., Any], *args: Any) -> Any:
    """Call ``function(*args)`` on every rank, for a part of the work each, and return this rank's result.

    Collective on ``comm``: one gather.  ``function`` itself must not be collective.

    Raises
    ------
    On every rank, the error that ``function`` raises on the lowest rank with an error.
    """
    with unwatched():  # a rank may take long, and longer than the others
        value, problems = _each(comm, function, args)
    for error in problems:
        if error is not None:
            raise error
    return value


def _each(comm: MPI.Comm, function: Callable[..., Any], args: tuple) -> tuple[Any, list[Exception | None]]:
    """Return the result of ``function`` on this rank, and its error on each rank, if any.  Collective."""
    value: Any = None
    problem: Exception | None = None
    try:
        value = function(*args)
    except Exception as error:  # re-raised by the caller, on every rank
        problem = error
    return value, comm.allgather(problem)
