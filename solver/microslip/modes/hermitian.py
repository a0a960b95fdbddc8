"""The modes of a complex Hermitian pencil from those of its real form, where each mode spans a plane: z and i z."""

import numpy as np
from petsc4py import PETSc

from ..assembly.real_form import complex_columns
from ..linear.dense import gram, multiply

_EQUAL = 1e-6  # relative difference of squared frequencies up to which modes are separated together
_MISSING = 0.5  # squared norm below which a combination of modes is none: with the partner of each mode it is 2, otherwise 1


def complex_modes(K_L: PETSc.Mat, M: PETSc.Mat, theta: np.ndarray, real_owned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (theta, phi) of a complex (K_L, M), theta descending, from those of its real form, where each theta appears twice.

    Collective: sums.  As complex vectors the real modes span a space of half their number, or of
    more where partners of the last ones are missing.
    """
    order = np.argsort(-theta, kind="stable")
    theta, real_owned = theta[order], real_owned[:, order]
    ends = [0, *(np.flatnonzero(theta[:-1] - theta[1:] > _EQUAL * theta[1:]) + 1), len(theta)]
    parts = [_of_planes(K_L, M, theta[start:end], real_owned[:, start:end]) for start, end in zip(ends, ends[1:])]
    return np.concatenate([part[0] for part in parts]), np.hstack([part[1] for part in parts])


def _of_planes(K_L: PETSc.Mat, M: PETSc.Mat, theta: np.ndarray, real_owned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (theta, phi) of the complex modes that real ones of equal frequencies span, eq. (14.5).  Collective: sums."""
    comm, Z_owned = K_L.comm.tompi4py(), complex_columns(real_owned)
    sizes, X = comm.bcast(np.linalg.eigh(gram(comm, Z_owned, multiply(M, Z_owned))))
    is_there = sizes > _MISSING
    phi_owned = Z_owned @ (X[:, is_there] / np.sqrt(sizes[is_there]))
    m = phi_owned.shape[1]
    if m == 1:
        return theta[:1], phi_owned
    K = gram(comm, phi_owned, multiply(K_L, phi_owned))
    squares, Q = comm.bcast(np.linalg.eigh(0.5 * (K + K.conj().T)))
    return theta[::2] if 2 * m == len(theta) else 1.0 / squares, phi_owned @ Q
