"""A Galerkin reduction as explicit matrices over the joint's relative displacements and modes with the joint held.

docs/theory.md, eq. (8.8): Craig-Bampton coordinates with relative interface DOFs.  NumPy only; local.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ...receptance.modes import DampedModes

INDEPENDENT = 1e-7  # relative energy norm of the part independent of the others, below which a displacement is dependent


@dataclass(frozen=True, eq=False)
class InterfaceModel:
    """M q'' + C q' + K q + R^T f_nl = F f, with q = [du_b, xi]; docs/theory.md, eq. (8.8)."""

    M: np.ndarray  # (n, n) kg; identity in the block of xi
    C: np.ndarray  # (n, n) N s/m
    K: np.ndarray  # (n, n) N/m, without the springs of the pairs
    S: np.ndarray | None  # (n, n) N/m, structural damping: i S in all harmonics above 0; None: no structural damping
    R: np.ndarray  # (3 n_pairs, n) du = R q: x, y, z of each pair
    F: np.ndarray  # (n, n_loads)
    outputs: np.ndarray  # (n_outputs, n)
    T: np.ndarray  # (m, n) eta = T q, the coordinates of the modes phi
    independent: np.ndarray  # (n_b,) rows of R that are coordinates

    @property
    def n_b(self) -> int:
        """The number of interface coordinates."""
        return len(self.independent)


def interface_model(modes: DampedModes, K_J: np.ndarray) -> InterfaceModel:
    """Return the matrices of a Galerkin reduction from its modes and the springs of the pairs K_J (3 n_pairs,) [N/m].

    Local.  docs/theory.md, eq. (8.8).
    """
    flexible = modes.R_phi / modes.omega_n  # in coordinates y = Omega eta, in which K_L is the identity
    independent, E, psi = constraint_shapes(flexible)
    chi, squares = held_modes(psi, modes.omega_n)
    Y = np.hstack([psi, chi])
    T = Y / modes.omega_n[:, None]
    n_b = len(independent)
    R = np.zeros((len(K_J), Y.shape[1]))
    R[:, :n_b] = E
    K = np.zeros((Y.shape[1],) * 2)
    K[:n_b, :n_b] = psi.T @ psi - E.T @ (K_J[:, None] * E)
    K[np.arange(n_b, len(K)), np.arange(n_b, len(K))] = squares
    model = InterfaceModel(
        M=T.T @ T,
        C=T.T @ modes.damping.apply(T),
        K=0.5 * (K + K.T),
        S=None if modes.damping.S is None else T.T @ modes.damping.apply_structural(T),
        R=R,
        F=T.T @ modes.b,
        outputs=modes.o @ T,
        T=T,
        independent=independent,
    )
    return turned(model, signs(model))


def constraint_shapes(B: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (independent, E, psi) of B (3 n_pairs, m): independent rows, all rows in terms of them, static shapes.  Local.

    docs/theory.md, eq. (8.8): B = E B[independent], each row independent of the earlier ones; ``psi`` (m, n_b): smallest y
    with B[independent] psi = 1.
    """
    independent = independent_rows(B)
    Q, L_T = np.linalg.qr(B[independent].T)
    psi = scipy.linalg.solve_triangular(L_T, Q.T, lower=False).T if len(independent) else np.zeros((B.shape[1], 0))
    E = B @ psi
    E[independent] = np.eye(len(independent))
    E[~B.any(axis=1)] = 0.0
    return independent, E, psi


def independent_rows(B: np.ndarray) -> np.ndarray:
    """Return the rows of B, in order, that are not combinations of earlier rows, to ``INDEPENDENT``.  Local."""
    size, independent = np.linalg.norm(B, axis=1), list[int]()
    Q = np.zeros((min(B.shape), B.shape[1]))
    for i in np.flatnonzero(size > 0.0):
        known, row = Q[: len(independent)], B[i] / size[i]
        for _ in range(2):  # two passes of Gram-Schmidt suffice
            row = row - known.T @ (known @ row)
        rest = float(np.linalg.norm(row))
        if rest > INDEPENDENT and len(independent) < len(Q):
            Q[len(independent)] = row / rest
            independent.append(i)
    return np.array(independent, dtype=int)


def held_modes(psi: np.ndarray, omega_n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (chi, squares): the modes without relative displacement, M-normalised (m, n_i), and their frequencies squared.

    Local.  docs/theory.md, eq. (8.8).  In coordinates y, in which K_L is the identity, motions without relative displacement are
    orthogonal to all static shapes.
    """
    m, n_b = psi.shape
    Z = scipy.linalg.qr(psi)[0][:, n_b:] if n_b else np.eye(m)
    theta, v = np.linalg.eigh(Z.T @ (Z / omega_n[:, None] ** 2))
    squares = 1.0 / np.maximum(theta[::-1], (1e-8 / omega_n.max(initial=1.0)) ** 2)
    return (Z @ v[:, ::-1]) * np.sqrt(squares), squares


def signs(model: InterfaceModel) -> np.ndarray:
    """Return +1 or -1 for each coordinate, (n,), that makes the signs of modes independent of their computation.  Local."""
    projection = np.vstack([model.M[: model.n_b], model.F.T, model.outputs])
    largest = np.abs(projection).max(axis=1, initial=0.0)
    weight = np.divide(
        1.0 + np.cos(np.arange(len(projection))) / 2.0, largest, out=np.zeros(len(projection)), where=largest > 0.0
    )
    sign = np.where(weight @ projection < 0.0, -1.0, 1.0)
    sign[: model.n_b] = 1.0
    return sign


def turned(model: InterfaceModel, sign: np.ndarray) -> InterfaceModel:
    """Return the model with the signs of its coordinates changed by ``sign``.  Local."""
    both = np.outer(sign, sign)
    return InterfaceModel(
        M=model.M * both,
        C=model.C * both,
        K=model.K * both,
        S=None if model.S is None else model.S * both,
        R=model.R * sign,
        F=model.F * sign[:, None],
        outputs=model.outputs * sign,
        T=model.T * sign,
        independent=model.independent,
    )
