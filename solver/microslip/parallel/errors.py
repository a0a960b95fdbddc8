"""Errors that a user, a mesh, a solver or a machine can cause; each knows its exit status (docs/guide.md)."""


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
