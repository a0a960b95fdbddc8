"""Errors that a user, a mesh, a solver or a machine can cause; each knows its exit status (docs/guide.md)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class MicroslipError(Exception):
    """Base of the errors that end the program with one message and no traceback."""

    exit_status = 70


class CaseError(MicroslipError):
    """The scene, an option or an input file is at fault."""

    exit_status = 2


class MeshError(CaseError):
    """The mesh, its groups or the contact surfaces are at fault."""


class ConvergenceError(MicroslipError):
    """A solver did not reach its tolerance; what converged before is kept."""

    exit_status = 3


class ResourceError(MicroslipError):
    """Memory or disk did not suffice."""

    exit_status = 4


class Interrupted(MicroslipError):
    """A signal or the time limit stopped the run; what converged before is kept."""

    exit_status = 5


@contextmanager
def naming(file: str) -> Iterator[None]:
    """Put the scene's file before a problem that begins with one of its tables, met where the file is not known.  Local."""
    try:
        yield
    except CaseError as problem:
        if not str(problem).startswith("["):
            raise
        raise type(problem)(f"{file}: {problem}") from problem
