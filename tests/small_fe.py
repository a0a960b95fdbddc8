"""A serial finite-element program of a few lines, for tests and studies of the elements."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from microslip import elements
from microslip.elements import Solids


def assemble(kind, points, nodes, young, poisson, density, integration="full", incompatible_modes=True):
    """Return sparse K and M (3 n_points, 3 n_points) of elements of one kind; ``nodes`` (n_elements, n)."""
    return assemble_of(elements.Isotropic(young, poisson), kind, points, nodes, density, integration, incompatible_modes)


def assemble_of(material, kind, points, nodes, density, integration="full", incompatible_modes=True):
    """Return K and M of elements of any material, as :func:`assemble`."""
    K = elements.stiffness(Solids(kind, points[nodes], material, integration, incompatible_modes))
    M = elements.mass(kind, points[nodes], density, integration)
    dof = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
    return _sum(K, dof), sp.kron(_sum(M, nodes), sp.eye(3), format="csr")


def _sum(matrices: np.ndarray, rows: np.ndarray) -> sp.csr_matrix:
    n = rows.shape[1]
    row, column = np.repeat(rows, n, axis=1), np.tile(rows, (1, n))
    return sp.csr_matrix((matrices.ravel(), (row.ravel(), column.ravel())))


def dofs(claim: np.ndarray, axes="xyz") -> np.ndarray:
    """Return the DOFs of the points where ``claim`` holds, in the directions ``axes``."""
    return (3 * np.flatnonzero(claim)[:, None] + ["xyz".index(axis) for axis in axes]).ravel()


def frequencies(K, M, fixed, n, n_rigid=0):
    """Return the ``n`` lowest natural frequencies [Hz] above ``n_rigid`` rigid-body motions, DOFs ``fixed`` held."""
    free = np.setdiff1d(np.arange(K.shape[0]), fixed)
    K, M = K[free][:, free].tocsc(), M[free][:, free].tocsc()
    # A shift below zero lets a free body be factored; a millionth of the stiffest DOF's frequency is small enough.
    shift = -1e-6 * (K.diagonal() / M.diagonal()).max() if n_rigid else 0.0
    start = np.random.default_rng(0).standard_normal(len(free))
    squares = sla.eigsh(K, n + n_rigid, M, sigma=shift, v0=start, return_eigenvectors=False)
    return np.sqrt(np.maximum(np.sort(squares)[n_rigid:], 0.0)) / (2.0 * np.pi)  # zero for rounding of a mechanism


def bent(points: np.ndarray) -> np.ndarray:
    """Return points of the box 1 x 1.5 x 4 mapped to a curved, twisted, tapered bar (smooth, one to one)."""
    x, y, z = points.T
    s = z / 4.0
    angle, taper = 0.6 * s, 1.0 - 0.3 * s
    x, y = taper * (x - 0.5), taper * (y - 0.75)
    return np.stack(
        [
            x * np.cos(angle) - y * np.sin(angle) + 0.5 * s**2,
            x * np.sin(angle) + y * np.cos(angle),
            z + 0.1 * np.sin(3.0 * y) * s,
        ],
        axis=1,
    )
