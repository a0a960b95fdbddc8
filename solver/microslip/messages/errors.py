"""Errors that a user, a mesh, a solver or a machine can cause; each class has an exit status (docs/guide.md)."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class MicroslipError(Exception):
    """Base of the errors that end the program with one message and no traceback."""

    exit_status = 70


class CaseError(MicroslipError):
    """The scene, an option or an input file is at fault."""

    exit_status = 2


class MeshError(CaseError):
    """The mesh, its groups or the contact surfaces are at fault."""


class SeveralErrors(MeshError):
    """Independent faults of one input, in one message."""

    parts: tuple[CaseError, ...] = ()


class Faults:
    """Independent faults of one input, collected so that one message reports them all."""

    def __init__(self) -> None:
        self._faults: list[CaseError] = []

    def __bool__(self) -> bool:
        return bool(self._faults)

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Collect a CaseError of this block instead of raising it.  Local."""
        try:
            yield
        except CaseError as fault:
            self.add(fault.parts if isinstance(fault, SeveralErrors) else (fault,))

    def add(self, faults: Iterable[CaseError]) -> None:
        """Add faults, each text once.  Local."""
        for fault in faults:
            if str(fault) not in map(str, self._faults):
                self._faults.append(fault)

    def refuse(self) -> None:
        """Raise the collected faults, if any: a single one itself, several as SeveralErrors.  Local."""
        if len(self._faults) == 1:
            raise self._faults[0]
        if self._faults:
            lines = [f"{i}. {fault}".replace("\n", "\n  ") for i, fault in enumerate(self._faults, 1)]
            several = SeveralErrors("\n  ".join([f"{len(lines)} faults:", *lines]))
            several.parts = tuple(self._faults)
            raise several


def prefixed(fault: CaseError, text: str) -> CaseError:
    """Return a fault whose message starts with a text; of several faults in one message, each starts with it.  Local."""
    if not isinstance(fault, SeveralErrors):
        return type(fault)(f"{text}: {fault}")
    faults = Faults()
    faults.add(prefixed(part, text) for part in fault.parts)
    try:
        faults.refuse()
    except CaseError as several:
        return several
    return fault


class ConvergenceError(MicroslipError):
    """A solver did not reach its tolerance; earlier results remain."""

    exit_status = 3


class ResourceError(MicroslipError):
    """Memory or disk did not suffice."""

    exit_status = 4


class Interrupted(MicroslipError):
    """A signal or the time limit stopped the run; earlier results remain."""

    exit_status = 5


@contextmanager
def naming(file: str) -> Iterator[None]:
    """Add the scene's ``file`` to the message of a CaseError that starts with a [table]; other errors do not change.  Local."""
    try:
        yield
    except CaseError as problem:
        if not str(problem).startswith("["):
            raise
        raise type(problem)(f"{file}: {problem}") from problem
