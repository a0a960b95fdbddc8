"""Natural frequencies with Coriolis forces, in the modes without them (docs/theory.md, section 12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from ..linear.dense import gram, multiply

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc

    from ..linear.joint_springs import Linearised
    from .eigen import Modes


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
    """Return the ``count`` lowest solutions with positive and with negative omega, in the space of the ``computed`` modes.

    Collective.  docs/theory.md, eq. (12.17).  ``G`` has the rows of M.  A real structure has the same
    frequencies with both signs, and conjugate shapes.
    """
    comm, phi_owned = linearised.system.comm, computed.phi_owned
    G_phi = multiply(G, phi_owned)
    omega, q = signed_frequencies(computed.omega_n, comm.bcast(gram(comm, phi_owned, G_phi)))
    forces = multiply(linearised.K_L, phi_owned), multiply(linearised.M, phi_owned), G_phi
    n = len(computed.omega_n)
    rising, falling = np.arange(n, n + min(count, n)), np.arange(n - 1, n - 1 - min(count, n), -1)
    positive, negative = (_waves(omega[at], q[:, at], phi_owned, forces, comm) for at in (rising, falling))
    return positive, negative


def _waves(omega: np.ndarray, q: np.ndarray, phi_owned: np.ndarray, forces: tuple[np.ndarray, ...], comm: MPI.Comm) -> Waves:
    """Return solutions with their residual.  Collective: one sum."""
    K_phi, M_phi, G_phi = (force @ q for force in forces)
    inertia = omega**2 * M_phi
    residual = K_phi - inertia + 1j * omega * G_phi
    squares = comm.allreduce(np.array([(np.abs(each) ** 2).sum(axis=0) for each in (residual, inertia)]))
    return Waves(np.abs(omega), phi_owned @ q, M_phi, float(np.sqrt(squares[0] / squares[1]).max()))
