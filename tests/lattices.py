"""Structures with known solutions: lattices of masses and springs, and trusses, distributed over the ranks.

A lattice has n_x x n_y x n_z masses with three DOFs each; springs join neighbours and act in all three directions, with
stiffness ``STIFFNESS[d]`` in direction d.  The masses at both ends of every line along x are attached to a wall; along y and z the
ends are free.  Cut in two at the middle of x, and joined again by contact pairs with the stiffness of the cut springs, the
stuck structure is the whole lattice, whose frequencies are known.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from oracles.scenes import make_system
from petsc4py import PETSc

from microslip.assembly.system import System
from microslip.mesh.data import ContactPairs

STIFFNESS = np.array([1.7e6, 1.0e6, 1.0e6])  # N/m, in direction x, y, z; y and z equal, so that their modes are double
MASS = 0.25  # kg


def split_rows(n: int, size: int, empty_rank: int | None = None) -> np.ndarray:
    """Return (size + 1,) row ranges; ``empty_rank`` has none if there is more than one rank."""
    workers = [rank for rank in range(size) if size == 1 or rank != empty_rank]
    counts = np.zeros(size, dtype=int)
    for k, rank in enumerate(workers):
        counts[rank] = n * (k + 1) // len(workers) - n * k // len(workers)
    return np.concatenate([[0], np.cumsum(counts)])


def distributed(comm, A, ranges: np.ndarray) -> PETSc.Mat:
    """Return a SciPy matrix, present on every rank, as a symmetric AIJ matrix.  Collective on ``comm``."""
    first, last = ranges[comm.rank], ranges[comm.rank + 1]
    owned = sp.csr_matrix(A)[first:last]
    owned.sort_indices()
    csr = (owned.indptr.astype(PETSc.IntType), owned.indices.astype(PETSc.IntType), owned.data.astype(float))
    matrix = PETSc.Mat().createAIJ(((last - first, A.shape[1]), (last - first, A.shape[1])), csr=csr, comm=comm)
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return matrix


def chain(n: int, walls: bool, cut: int | None = None) -> sp.csr_matrix:
    """Return the stiffness of n masses in a row with unit springs, without spring ``cut`` (between cut - 1 and cut)."""
    B = sp.diags([-np.ones(n), np.ones(n)], [-1, 0], shape=(n + 1, n)).tolil()  # elongations, including walls
    if not walls:
        B[0] = B[n] = 0.0
    if cut is not None:
        B[cut] = 0.0
    B = B.tocsr()
    return (B.T @ B).tocsr()


def lattice_stiffness(shape, cut=None, walls=True) -> sp.csr_matrix:
    """Return K of the lattice [N/m], DOF = 3 * node + direction, x slowest."""
    eyes = [sp.identity(n) for n in shape]
    scalar = sp.kron(sp.kron(chain(shape[0], walls, cut), eyes[1]), eyes[2])
    scalar += sp.kron(sp.kron(eyes[0], chain(shape[1], False)), eyes[2])
    scalar += sp.kron(sp.kron(eyes[0], eyes[1]), chain(shape[2], False))
    return sp.kron(scalar, sp.diags(STIFFNESS)).tocsr()


def lattice_frequencies(shape) -> np.ndarray:
    """Return all omega_n [rad/s], ascending, from the product form."""
    n_x, n_y, n_z = shape
    x = 4.0 * np.sin(np.arange(1, n_x + 1) * np.pi / (2 * (n_x + 1))) ** 2
    y, z = (4.0 * np.sin(np.arange(n) * np.pi / (2 * n)) ** 2 for n in (n_y, n_z))
    scalar = (x[:, None, None] + y[:, None] + z).ravel()
    return np.sort(np.sqrt(np.outer(scalar, STIFFNESS).ravel() / MASS))


def lattice(comm, shape=(6, 3, 2), *, k_t=None, k_n=None, walls=True, empty_rank=None, mass=None):
    """Return (system, pairs) of a lattice cut at the middle of x and joined by a pair per cut line.

    The pairs' frames have z along x (normal to the cut), so ``k_n`` acts in direction x and ``k_t`` in y and z; by default
    they are the stiffness of the cut springs.  Without walls only the first half is supported.
    """
    n_x, n_yz = shape[0], shape[1] * shape[2]
    cut = n_x // 2
    K = lattice_stiffness(shape, cut)
    if not walls:
        K = K.tolil()
        last = 3 * n_yz * (n_x - 1)
        for row in range(last, K.shape[0]):
            K[row, row] -= STIFFNESS[row % 3]
    n_dof = K.shape[0]
    ranges = split_rows(n_dof, comm.size, empty_rank)
    line = np.arange(n_yz)
    lower, upper = (cut - 1) * n_yz + line, cut * n_yz + line
    frame = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    R = sp.lil_matrix((3 * n_yz, n_dof))
    for pair in range(n_yz):
        R[3 * pair : 3 * pair + 3, 3 * upper[pair] : 3 * upper[pair] + 3] = frame
        R[3 * pair : 3 * pair + 3, 3 * lower[pair] : 3 * lower[pair] + 3] = -frame
    pairs = ContactPairs(
        joint=("cut",) * n_yz,
        node1=upper,
        node2=lower,
        position=np.zeros((n_yz, 3)),
        frame=np.tile(frame, (n_yz, 1, 1)),
        area=np.ones(n_yz),
        mu=np.full(n_yz, 0.3),
        N0=np.ones(n_yz),
        k_t=np.full(n_yz, STIFFNESS[1] if k_t is None else k_t),
        k_n=np.full(n_yz, STIFFNESS[0] if k_n is None else k_n),
        separate=np.zeros(n_yz, dtype=bool),
        faces=(),
    )
    first, last = ranges[comm.rank], ranges[comm.rank + 1]
    M = MASS * sp.identity(n_dof) if mass is None else mass
    loads = sp.csc_matrix(([1.0], ([5], [0])), shape=(n_dof, 1))
    system = System(
        comm=comm,
        K=distributed(comm, K, ranges),
        M=distributed(comm, M, ranges),
        C=None,
        R=R.tocsr(),
        loads=loads,
        outputs=loads.T.tocsr(),
        dof=np.arange(n_dof).reshape(-1, 3),
        parts=(np.arange(first, last) >= 3 * n_yz * cut).astype(int),
        part_names=("body 'left'", "body 'right'"),
    )
    return system, pairs


def truss(n_x=3, n_y=2, n_z=2) -> tuple[np.ndarray, sp.csr_matrix]:
    """Return (points, K) of a braced box of unit bars: free in space, with six motions without strain."""
    points = np.stack(np.meshgrid(range(n_x), range(n_y), range(n_z), indexing="ij"), -1).reshape(-1, 3).astype(float)
    a, b = np.triu_indices(len(points), 1)
    length = np.linalg.norm(points[b] - points[a], axis=1)
    near = length < 1.8
    a, b, axis = a[near], b[near], ((points[b] - points[a]) / length[:, None])[near]
    rows = np.arange(len(a))
    elongation = sum(
        sp.csr_matrix((axis[:, d], (rows, 3 * b + d)), (len(a), points.size))
        - sp.csr_matrix((axis[:, d], (rows, 3 * a + d)), (len(a), points.size))
        for d in range(3)
    )
    return points, (1.0e7 * elongation.T @ elongation).tocsr()


def softly_held_truss(held: float, elastic: float, omega: np.ndarray, **damping):
    """Return load, output, free stiffness, ground stiffness and the system of a truss with one pair, on soft springs.

    ``held``: frequency on the springs relative to ``elastic``, the lowest elastic frequency [rad/s].
    """
    _, free = truss()
    n, soft = free.shape[0], (held * elastic) ** 2
    load, output = np.eye(n)[5], np.eye(n)[31]
    system = make_system(
        "truss",
        np.eye(n),
        free.toarray() + soft * np.eye(n),
        [[0, 1, 2, 33, 34, 35]],
        mu=0.3,
        N0=1e6,
        k_t=2e6,
        k_n=3e6,
        loads=[{"harmonic": 1, "vector": load}],
        output=output,
        omega=(omega[0], omega[-1]),
        levels=[1.0],
        **damping,
    )
    return load, output, free, soft, system
