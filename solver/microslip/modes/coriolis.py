"""Natural frequencies with Coriolis forces, from the modes without them (docs/theory.md, section 12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from ..assembly.real_form import complex_columns, real_columns
from ..linear.dense import gram, multiply
from .eigen import RESIDUAL_LIMIT

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc

    from ..linear.joint_springs import Linearised
    from .eigen import Modes

_ROUNDS = 8  # of widening the space
_INDEPENDENT = 1e-10  # squared norm of a combination of static responses of norm 1 that widens the space


@dataclass(frozen=True, eq=False)
class Waves:
    """Solutions u = Re(phi exp(i omega t)) of K_L - omega^2 M + i omega G, of one sign of omega, in ascending frequency."""

    omega: np.ndarray  # (n,) rad/s, positive
    phi_owned: np.ndarray  # (n_owned, n) complex, phi^H M phi = 1 [kg^-1/2]
    M_phi_owned: np.ndarray  # (n_owned, n) [kg^1/2]
    residual: float  # largest |K_L phi - omega^2 M phi + i omega G phi| / |omega^2 M phi|

    @property
    def frequency(self) -> np.ndarray:
        """Natural frequencies, (n,) [Hz]."""
        return self.omega / (2.0 * np.pi)


def signed_frequencies(omega_n: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all omega of omega_n^2 - omega^2 + i omega g, (2 n,) ascending [rad/s], and q, (n, 2 n), q^H q = 1.  Local.

    ``g`` (n, n) is skew-Hermitian [1/s].  With a = omega_n q and b = omega q this is an eigenvalue problem of a Hermitian matrix,
    docs/theory.md, eq. (12.17); ``omega_n`` (n,) are positive.
    """
    n = len(omega_n)
    pencil: np.ndarray = np.zeros((2 * n, 2 * n), dtype=complex)
    pencil[:n, n:] = pencil[n:, :n] = np.diag(omega_n)
    pencil[n:, n:] = 0.5j * (g - g.conj().T)
    omega, state = scipy.linalg.eigh(pencil)
    q = state[n:] / omega
    return omega, q / np.linalg.norm(q, axis=0)


def waves(linearised: Linearised, computed: Modes, G: PETSc.Mat, count: int) -> tuple[Waves, Waves]:
    """Return the ``count`` lowest solutions with positive and with negative omega, of a real structure conjugate to each other.

    Collective.  docs/theory.md, eq. (12.18): in the space of the ``computed`` modes, widened until the residuals
    are below the limit of modes, at most ``_ROUNDS`` times.  ``G`` has the rows of M.
    """
    omega_n, phi_owned = computed.omega_n, computed.phi_owned
    limit = max(RESIDUAL_LIMIT, 2.0 * computed.info["residual"])  # that of modes is larger where rounding explains it
    for _ in range(_ROUNDS):
        both, above_owned = _in_space(linearised, omega_n, phi_owned, G, count, limit)
        if above_owned.shape[1] == 0:
            break
        omega_n, phi_owned = _widened(linearised, computed, phi_owned, above_owned)
    return both


def _in_space(
    linearised: Linearised, omega_n: np.ndarray, phi_owned: np.ndarray, G: PETSc.Mat, count: int, limit: float
) -> tuple[tuple[Waves, Waves], np.ndarray]:
    """Return the waves in the space of ``phi_owned``, and the residuals above the ``limit``, (n_owned, m).  Collective."""
    comm = linearised.system.comm
    G_phi = multiply(G, phi_owned)
    omega, q = signed_frequencies(omega_n, comm.bcast(gram(comm, phi_owned, G_phi)))
    forces = multiply(linearised.K_L, phi_owned), multiply(linearised.M, phi_owned), G_phi
    n = len(omega_n)
    rising, falling = np.arange(n, n + min(count, n)), np.arange(n - 1, n - 1 - min(count, n), -1)
    positive, above = _waves(omega[rising], q[:, rising], phi_owned, forces, comm, limit)
    negative, above_of_negative = _waves(omega[falling], q[:, falling], phi_owned, forces, comm, limit)
    is_complex = np.iscomplexobj(phi_owned)
    return (positive, negative), np.hstack([above, above_of_negative] if is_complex else [above.real, above.imag])


def _waves(
    omega: np.ndarray, q: np.ndarray, phi_owned: np.ndarray, forces: tuple[np.ndarray, ...], comm: MPI.Comm, limit: float
) -> tuple[Waves, np.ndarray]:
    """Return solutions, and the residuals above the ``limit``, (n_owned, m).  Collective: one sum."""
    K_phi, M_phi, G_phi = (force @ q for force in forces)
    inertia = omega**2 * M_phi
    residual = K_phi - inertia + 1j * omega * G_phi
    squares = comm.allreduce(np.array([(np.abs(each) ** 2).sum(axis=0) for each in (residual, inertia)]))
    relative = np.sqrt(squares[0] / squares[1])
    return Waves(np.abs(omega), phi_owned @ q, M_phi, float(relative.max())), residual[:, relative > limit]


def _widened(
    linearised: Linearised, modes: Modes, phi_owned: np.ndarray, forces_owned: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return omega_n and phi of (K_L, M) in the space of ``phi_owned`` and K_L^-1 f, docs/theory.md, eq. (12.18).  Collective.

    The ``modes``, the first columns of ``phi_owned``, stay as they are: with phi^H f = 0 the responses are orthogonal to them
    in K_L and M, and stiff motions do not blur the low frequencies.
    """
    comm, M, n = linearised.system.comm, linearised.M, len(modes.omega_n)
    if np.iscomplexobj(phi_owned):
        X = complex_columns(linearised.factor.solve(real_columns(forces_owned)))
    else:
        X = linearised.factor.solve(forces_owned)
    M_phi = multiply(M, phi_owned)
    for _ in range(2):  # the second time removes the rounding errors of the first
        X = X - phi_owned @ gram(comm, M_phi, X)
        mass = gram(comm, X, multiply(M, X))
        scale = 1.0 / np.sqrt(np.maximum(np.diag(mass).real, np.finfo(float).tiny))
        size, Q = comm.bcast(np.linalg.eigh(scale[:, None] * mass * scale))
        independent = size > _INDEPENDENT
        X = (X * scale) @ (Q[:, independent] / np.sqrt(size[independent]))
    X = np.hstack([phi_owned[:, n:], X])
    squares, Q = comm.bcast(np.linalg.eigh(gram(comm, X, multiply(linearised.K_L, X))))
    return np.append(modes.omega_n, np.sqrt(squares)), np.hstack([modes.phi_owned, X @ Q])
