"""The lowest modes by block Lanczos iteration on K_L^-1 M, in a space that grows until as many as are asked for have converged.

docs/theory.md, section 4.  A block of right-hand sides costs little more than one of them, and what was found for few modes is
the beginning of the search for more.  All vectors are kept orthogonal: there are no copies of modes, and no restarts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..linear.dense import diagonal_owned, gram, multiply
from ..linear.random_signs import random_signs
from ..messages.errors import ConvergenceError
from ..system.watchdog import moved

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

TOLERANCE = 1e-8  # |K_L^-1 M phi - theta phi| / theta of a mode, in the norm of M; the error of theta is the square of it
_BLOCK = (4, 16)  # vectors: a small block converges in fewer of them, in a large one each is cheaper
_FROM_DISK = 16  # vectors, where each block reads the factor from disk
_MODES_A_VECTOR = 3  # modes asked for at first, for each vector of a block
_DEPENDENT = 1e-12  # part of a vector beyond the space, over the vector, that is rounding
_SLANTED = 1e-11  # product of two unit vectors that should be orthogonal
_MOST_PASSES = 4
_KEY = 40  # of the random vectors that the search starts from
_PATIENCE = (20, 200)  # vectors for each mode asked for, and besides, after which the search is given up


def basis_size(n_wanted: int, n_dof: int) -> int:
    """Return the size of the space in which so many modes are usually found.  Local."""
    return min(n_dof, 2 * n_wanted + 6 * block_size(n_wanted))


def block_size(n_wanted: int) -> int:
    """Return how many vectors are solved for at once in search of so many modes.  Local."""
    return int(np.clip(n_wanted // _MODES_A_VECTOR, *_BLOCK))


class BlockLanczos:
    """A space V with V^T M V = I and V^T M K_L^-1 M V = T, which grows by a block of vectors at a time.

    All methods are collective on the matrices' communicator.
    """

    def __init__(self, linearised: Linearised):
        self.linearised, self.comm = linearised, linearised.system.comm
        self.n_dof = linearised.M.getSize()[0]
        self._V = np.zeros((linearised.M.getLocalSize()[0], 0), order="F")  # with room for more columns
        self._T = np.zeros((0, 0))  # (m, m); V has m columns in use
        self._last = 0  # columns of the last block
        self._next = self._M_next = self._V  # the block to come, orthonormal and orthogonal to V, and M times it
        self._coupling = np.zeros((0, 0))  # (columns of the next block, of the last one)
        self._n_random = 0  # blocks that were drawn at random
        self._is_whole = False  # K_L^-1 M leads to nothing beyond V

    @property
    def V(self) -> np.ndarray:
        """The basis, (n_owned, m)."""
        return self._V[:, : len(self._T)]

    def lowest(self, n_wanted: int) -> tuple[np.ndarray, np.ndarray, dict]:
        """Return at least ``n_wanted`` (theta, phi) of K_L^-1 M, theta = 1 / omega_n^2 falling, phi^T M phi = I nearly.

        All there are, where fewer motions have mass: "complete" in the dictionary of what is worth knowing.

        Raises
        ------
        ConvergenceError : fewer converged in a space far larger than that should take; on every rank
        """
        if self._n_random == 0:
            self._draw(_FROM_DISK if self.linearised.factor.info.get("out_of_core") else block_size(n_wanted))
        while True:
            theta, Z, n_found = self._converged()
            if n_found >= n_wanted or self._is_whole:
                break
            if len(theta) > _PATIENCE[0] * n_wanted + _PATIENCE[1]:
                raise ConvergenceError(
                    f"modes: {n_found} of {n_wanted} converged in a space of {len(theta)}; ask for fewer [solver] modes"
                )
            self._grow()
        info = {"method": "block Lanczos", "basis": len(theta), "complete": self._is_whole}
        return theta[:n_found], self._vectors(theta[:n_found], Z[:, :n_found]), info

    def renew(self) -> None:
        """Take new random directions into the space, and grow it to twice its size.

        A multiple mode of which it lacks copies comes into it no other way.
        """
        Q, M_Q, coupling = self._next, self._M_next, self._coupling
        X = self._random_motions(Q.shape[1])
        for _ in range(2):
            X = X - Q @ gram(self.comm, M_Q, X)
        more, M_more, _ = self._beyond(X, self._size_of(X))
        self._next, self._M_next = np.hstack([Q, more]), np.hstack([M_Q, M_more])
        self._coupling = np.vstack([coupling, np.zeros((more.shape[1], coupling.shape[1]))])
        enough = 2 * len(self._T)
        while len(self._T) < enough and not self._is_whole:
            self._grow()

    def _converged(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Return Ritz values falling, their vectors in V, and how many of the first have converged: the same on all ranks."""
        theta, Z = self.comm.bcast(np.linalg.eigh(self._T))
        theta, Z = theta[::-1], Z[:, ::-1]
        if self._is_whole:
            return theta, Z, len(theta)
        error = np.linalg.norm(self._coupling @ Z[len(Z) - self._last :], axis=0)
        return theta, Z, self.comm.bcast(int(np.argmin(np.append(error <= TOLERANCE * theta, False))))

    def _vectors(self, theta: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """Return K_L^-1 M V Z / theta, (n_owned, n): a step closer to the modes than V Z, and known already.  Local."""
        return self.V @ Z + self._next @ (self._coupling @ Z[len(Z) - self._last :] / theta)

    def _grow(self) -> None:
        """Take the next block into the space, and find the one after it: one block of solves."""
        Q, M_Q, before = self._next, self._M_next, self._coupling
        X = self.linearised.factor.solver.solve(M_Q)
        moved()
        inner = gram(self.comm, M_Q, X)
        previous = self.V[:, len(self._T) - self._last :]
        self._take(Q, before, 0.5 * (inner + inner.T))
        X -= Q @ inner + previous @ before.T
        size = np.hypot(np.linalg.norm(inner), np.linalg.norm(before))
        self._next, self._M_next, self._coupling = self._beyond(X, size)
        if self._next.shape[1] == 0:
            self._draw(Q.shape[1])

    def _take(self, Q: np.ndarray, before: np.ndarray, inner: np.ndarray) -> None:
        """Add a block to V, and its products to T.  Local."""
        m, b = len(self._T), Q.shape[1]
        if m + b > self._V.shape[1]:
            room = np.zeros((len(self._V), max(m + b, (3 * m) // 2, 8 * b)), order="F")
            room[:, :m] = self.V
            self._V = room
        self._V[:, m : m + b] = Q
        T = np.zeros((m + b, m + b))
        T[:m, :m], T[m:, m:] = self._T, inner
        T[m:, m - self._last : m], T[m - self._last : m, m:] = before, before.T
        self._T, self._last = T, b

    def _draw(self, b: int) -> None:
        """Begin with a random block; none is found where the space is all that has mass: then the space is whole."""
        X = self._random_motions(b)
        self._next, self._M_next, _ = self._beyond(X, self._size_of(X))
        self._coupling = np.zeros((self._next.shape[1], self._last))
        self._is_whole = self._next.shape[1] == 0

    def _random_motions(self, b: int) -> np.ndarray:
        """Return K_L^-1 times random forces, others at each call, (n_owned, b).  Collective: one block of solves."""
        mass, first = np.maximum(diagonal_owned(self.linearised.M), 0.0), self.linearised.M.getOwnershipRange()[0]
        random = np.sqrt(mass)[:, None] * random_signs(first, len(mass), b, _KEY + self._n_random)
        self._n_random += 1
        return self.linearised.factor.solver.solve(np.asfortranarray(random))

    def _size_of(self, X: np.ndarray) -> float:
        """Return the size of a block, by M.  Collective."""
        return float(np.sqrt(np.linalg.norm(gram(self.comm, X, multiply(self.linearised.M, X)))))

    def _beyond(self, X: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return Q with X = V C + Q B, Q^T M Q = I and V^T M Q = 0, M Q, and B; of X what exceeds rounding of ``size``."""
        V, comm, B = self.V, self.comm, np.eye(X.shape[1])
        M_X = multiply(self.linearised.M, X)
        for _ in range(_MOST_PASSES):
            C = gram(comm, V, M_X)
            X = X - V @ C
            squares = gram(comm, X, M_X)
            squares, W = comm.bcast(np.linalg.eigh(0.5 * (squares + squares.T)))
            kept = squares > comm.bcast(_DEPENDENT * size) ** 2
            root = np.sqrt(squares[kept])
            X, B = np.asfortranarray(X @ (W[:, kept] / root)), (W[:, kept] * root).T @ B
            M_X = multiply(self.linearised.M, X)
            slant = max(
                np.abs(gram(comm, V, M_X)).max(initial=0.0), np.abs(gram(comm, X, M_X) - np.eye(len(root))).max(initial=0.0)
            )
            size = 1.0
            if comm.bcast(slant <= _SLANTED):
                break
        return X, M_X, B
