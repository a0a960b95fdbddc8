"""The modes of a complex Hermitian pencil from its real form, in which each mode spans a plane: z and i z."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..assembly.real_form import complex_columns
from ..linear.dense import gram, multiply
from .eigen import Modes, largest_components, lowest_modes
from .shift_invert import ModeSearch
from .user_order import user_order

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

_EQUAL = 1e-6  # relative difference of squared frequencies up to which modes are separated together


def lowest_complex_modes(
    linearised: Linearised, n_modes: int, verify: bool = True, fewer_will_do: bool = False, search: ModeSearch | None = None
) -> Modes:
    """Return the ``n_modes`` lowest modes of a complex (K_L, M) that ``linearised`` has in real form.

    Collective on the system's communicator.  :func:`.eigen.lowest_modes` computes twice as many real modes, checked and proved
    complete; each pair of them gives one complex mode.

    Returns
    -------
    Modes : phi^H M phi = I, complex; the largest component of each mode is real and positive, independent of the partition

    Raises
    ------
    CaseError, ConvergenceError : as :func:`.eigen.lowest_modes`
    """
    real = lowest_modes(linearised, 2 * n_modes, verify, fewer_will_do, search)
    n, info = len(real.omega_n) // 2, dict(real.info)
    parts = [_of_planes(linearised, real, slice(*ends)) for ends in _together(real.omega_n[: 2 * n] ** 2)]
    eigenvalues = np.concatenate([part[0] for part in parts])
    phi_owned = np.hstack([part[1] for part in parts])
    order = np.argsort(eigenvalues, kind="stable")
    if "proved" in info:
        n_below, words = info["proof"].split(" ", 1)
        info |= {"proved": info["proved"] // 2, "proof": f"{int(n_below) // 2} {words}"}
    phi_owned = phi_owned[:, order]
    return Modes(np.sqrt(eigenvalues[order]), np.asfortranarray(phi_owned * _phases(linearised, phi_owned)), info)


def lowest_modes_of(
    linearised: Linearised, n_modes: int, verify: bool = True, fewer_will_do: bool = False, search: ModeSearch | None = None
) -> Modes:
    """Return the ``n_modes`` lowest modes, complex if the matrices are in real form.  Collective."""
    lowest = lowest_complex_modes if linearised.maps.is_complex else lowest_modes
    return lowest(linearised, n_modes, verify, fewer_will_do, search)


def conjugated(modes: Modes) -> Modes:
    """Return the modes of the conjugate matrices.  Local."""
    return replace(modes, phi_owned=modes.phi_owned.conj())


def _together(squares: np.ndarray) -> list[tuple[int, int]]:
    """Return the ranges of real modes with equal frequencies, each with an even number of modes."""
    apart = np.flatnonzero(np.diff(squares) > _EQUAL * squares[1:]) + 1
    ends = [0, *(int(end) for end in apart if end % 2 == 0), len(squares)]
    return list(zip(ends, ends[1:]))


def _of_planes(linearised: Linearised, real: Modes, some: slice) -> tuple[np.ndarray, np.ndarray]:
    """Return (eigenvalues, phi) of half as many complex modes as there are real ones in ``some``.  Collective: sums.

    docs/theory.md, eq. (14.5).  As complex vectors the real modes span a space of half their number.  If the last ones belong to
    a multiple frequency, some partners may be missing; the space is then larger, and any subspace of it is valid.
    """
    comm, Z_owned = linearised.system.comm, complex_columns(real.phi_owned[:, some])
    m = Z_owned.shape[1] // 2
    sizes, X = comm.bcast(np.linalg.eigh(gram(comm, Z_owned, multiply(linearised.M, Z_owned))))
    phi_owned = Z_owned @ (X[:, m:] / np.sqrt(sizes[m:]))
    if m == 1:
        return real.omega_n[some][:1] ** 2, phi_owned
    K = gram(comm, phi_owned, multiply(linearised.K_L, phi_owned))
    _, Q = comm.bcast(np.linalg.eigh(0.5 * (K + K.conj().T)))
    return np.sort(real.omega_n[some])[::2] ** 2, phi_owned @ Q


def _phases(linearised: Linearised, phi_owned: np.ndarray) -> np.ndarray:
    """Return factors of size 1 that make the largest component of each mode real and positive, (n,).  Collective."""
    largest = largest_components(linearised, phi_owned, user_order(linearised)[0::2])
    return largest.conj() / np.abs(largest)
