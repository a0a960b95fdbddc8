"""The largest number of modes: reported by `check`, and enforced by `run` before any factorisation."""

from __future__ import annotations

from ..messages.errors import CaseError

FEW = 20  # DOFs up to which a structure retains all of its modes
SMALL = 4_000  # DOFs up to which LAPACK may compute the whole spectrum: minutes, and 0.13 GB per matrix
SHARE = 3  # beyond n_dof / SHARE modes a Krylov space is as large as the structure: LAPACK is used instead


def most_modes(n_dof: int) -> int:
    """Return the largest number of modes computed for a structure of ``n_dof`` degrees of freedom.  Local."""
    return n_dof if n_dof <= SMALL else n_dof // SHARE


def refuse_too_many(n_modes: int | None, n_dof: int, path: object, mode: int | None = None) -> None:
    """Raise CaseError if [solver] ``modes`` (None: chosen by the program) or [response] ``mode`` of a scene is too large.  Local.

    ``path`` is the path of the scene file, for the message.
    """
    if mode is not None and mode > n_dof:
        raise CaseError(f"{path}: [response] mode = {mode}: the structure has only {n_dof} degrees of freedom, and as many modes")
    if n_modes is None or n_modes <= most_modes(n_dof):
        return
    where = f"{path}: [solver] modes = {n_modes}"
    if n_modes > n_dof:
        raise CaseError(
            f"{where}: the structure has only {n_dof} degrees of freedom, and as many modes; state 1 to "
            f"{most_modes(n_dof)}, or leave modes out: the program then picks as many as its accuracy needs"
        )
    raise CaseError(
        f"{where}: more than a third of the {n_dof} modes there are. That takes full matrices of {n_dof} x {n_dof} "
        f"({8e-9 * n_dof**2:.2g} GB each) and up to hours, and cannot be interrupted; state at most "
        f"{most_modes(n_dof)}, or leave modes out: the program then picks as many as its accuracy needs"
    )
