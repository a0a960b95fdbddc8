"""The derivative of the map of one cycle, and its multipliers (docs/theory.md, section 16).

The state is that of the modes and the forces of the sliders that slip in the cycle.  A step takes the modes exactly; the motion
of the pairs at its end follows from their forces there, and these from it.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse
from scipy.linalg import expm
from scipy.linalg.lapack import dgetrf, dgetrs

from ..receptance.damping import Damping
from .contact_variation import ContactVariation


class ModalStep:
    """eta'' + C eta' + Omega^2 eta = q over a step ``h`` [s], in the scaled coordinates x = (Omega eta, eta') (2, m, n).

    With modal damping every mode steps by itself: the matrices are (.., .., m), otherwise (.., .., m, m).
    """

    def __init__(self, omega_n: np.ndarray, damping: Damping, h: float):
        self.omega_n, m = omega_n, len(omega_n)
        if damping.couples_modes:
            one, none, squares = np.eye(m), np.zeros((m, m)), np.diag(omega_n)
            rows = [[none, squares, none, none], [-squares, -damping.C, one, none], [none, none, none, one / h], [none] * 4]
            E = expm(h * np.block(rows)).reshape(4, m, 4, m).transpose(0, 2, 1, 3)
        else:
            rates = np.zeros((m, 4, 4))
            rates[:, 0, 1], rates[:, 1, 0], rates[:, 1, 1], rates[:, 1, 2] = omega_n, -omega_n, -damping.C, 1.0
            rates[:, 2, 3] = 1.0 / h
            E = np.moveaxis(expm(h * rates), 0, -1)
        self.free, self.by_last = E[:2, :2], E[:2, 3]  # by x; by q at the end, (2, ...)
        self.by_first = E[:2, 2] - self.by_last  # by q at the begin

    def take(self, x: np.ndarray) -> np.ndarray:
        """Return x after a step without forces, (2, m, n).  Local."""
        (a, b), (c, d) = self.free
        return np.stack([_times(a, x[0]) + _times(b, x[1]), _times(c, x[0]) + _times(d, x[1])])

    def forced(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Return what forces q, ``first`` at the begin and ``last`` at the end (m, n), add to x.  Local."""
        return np.stack([_times(a, first) + _times(b, last) for a, b in zip(self.by_first, self.by_last)])

    def multipliers(self) -> np.ndarray:
        """Return the eigenvalues of a step without forces, (2 m,) complex.  Local."""
        step = np.moveaxis(self.free, (0, 1), (-2, -1)) if self.free.ndim == 3 else np.block([list(row) for row in self.free])
        return np.linalg.eigvals(step).ravel()

    def between(self, R_phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return R d eta / d q R^T at the end of a step, by q at its begin and at its end, (k, k) each.  Local."""
        R = R_phi / self.omega_n
        both = self.by_first[0], self.by_last[0]
        return tuple((R * c if c.ndim == 1 else R @ c) @ R_phi.T for c in both)  # type: ignore[return-value]


def _times(c: np.ndarray, y: np.ndarray) -> np.ndarray:
    return c @ y if c.ndim == 2 else c[:, None] * y


_MOST = 150  # numbers of memory of which a cycle is computed for each
_CUT = 1e-7  # of the largest: what a cycle leaves of memory below it is nothing


@dataclass(frozen=True, eq=False)
class StepMatrices:
    """The contact of one step: what is implicit in it, and its factor."""

    moving: np.ndarray  # rows of the pairs whose forces change with their motion at the end of the step
    factor: tuple[np.ndarray, np.ndarray]  # LU and pivots of 1 + what the forces of these do to their motion, by LAPACK
    blocks: np.ndarray  # (3, m_moving, 3, 3) d p / d d1: at the end, begin and end of the course


class CycleMap:
    """The map of a variation of the state over one cycle, for many at once.

    Parameters
    ----------
    omega : frequency [rad/s]
    omega_n, damping : of the modes
    R_phi : (3 m, n_modes) participation of the pairs of ``contact``
    G : (3 m, 3 m) their residual flexibility beside the modes [m/N]
    """

    def __init__(
        self, omega: float, omega_n: np.ndarray, damping: Damping, R_phi: np.ndarray, G: np.ndarray, contact: ContactVariation
    ):
        self.contact, self.R_phi, self.G, self.omega_n, self.damping = contact, R_phi, G, omega_n, damping
        self.period = 2.0 * np.pi / omega
        self.step = ModalStep(omega_n, damping, self.period / contact.n_steps)
        self.R = R_phi / omega_n  # of Omega eta
        self.root = np.sqrt(
            np.where(contact.stiffness > 0.0, contact.stiffness, 1.0)
        ).ravel()  # memory over it: root of an energy
        m, n = len(contact.pairs), len(contact.slider_pair)
        self.sum = scipy.sparse.csr_array((np.ones(n), (contact.slider_pair, np.arange(n))), shape=(m, n))

    @property
    def n_modes(self) -> int:
        """Modes, of two numbers each."""
        return len(self.omega_n)

    @property
    def n_memory(self) -> int:
        """Numbers that the sliders remember."""
        return 2 * len(self.contact.slider_pair)

    # -- forces of the pairs ----------------------------------------------------------------------------------------

    def _of_pairs(self, of_sliders: np.ndarray) -> np.ndarray:
        """Return the sum over the sliders of each pair, (m, ...), of (n_sliders, ...).  Local."""
        if np.array_equal(self.contact.slider_pair, np.arange(len(self.contact.pairs))):
            return of_sliders
        shape = of_sliders.shape[1:]
        return (self.sum @ of_sliders.reshape(len(of_sliders), math.prod(shape))).reshape(len(self.contact.pairs), *shape)

    @cached_property
    def _by_motion(self) -> tuple[np.ndarray, np.ndarray]:
        """d p of pairs by d0 and by d1, (n_steps, 3, m, 3, 3) each [N/m]."""
        c, both = self.contact, []
        for of_sliders, memoryless in ((c.by_first, c.memoryless_by_first), (c.by_last, c.memoryless_by_last)):
            blocks = np.zeros((*memoryless.shape, 3))
            blocks[..., :2, :] = np.moveaxis(self._of_pairs(np.moveaxis(of_sliders, 2, 0)), 0, 2)
            blocks[..., (0, 1, 2), (0, 1, 2)] += memoryless
            both.append(blocks)
        return both[0], both[1]

    @cached_property
    def _steps(self) -> list[StepMatrices]:
        """The implicit part of each step."""
        m = len(self.contact.pairs)
        flexibilities = np.stack([self.G, *self.step.between(self.R_phi)]).reshape(3, 3 * m, m, 3)
        by_pair = np.ascontiguousarray(flexibilities.transpose(2, 1, 0, 3)).reshape(m, 3 * m, 9)  # of all rows, by its forces
        return [self._matrices(blocks, by_pair) for blocks in self._by_motion[1]]

    @staticmethod
    def _matrices(blocks: np.ndarray, by_pair: np.ndarray) -> StepMatrices:
        pairs = np.flatnonzero(blocks.any(axis=(0, 2, 3)))
        rows, moving = (3 * pairs[:, None] + np.arange(3)).ravel(), blocks[:, pairs]
        if len(rows) == 0:
            return StepMatrices(rows, (rows, rows), moving)
        J = np.matmul(by_pair[np.ix_(pairs, rows)], np.moveaxis(moving, 0, 1).reshape(-1, 9, 3))  # (pairs, rows, 3)
        J = np.moveaxis(J, 0, 1).reshape(len(rows), -1)
        J[np.diag_indices(len(rows))] += 1.0
        lu, pivots, _ = dgetrf(J, overwrite_a=True)
        return StepMatrices(rows, (lu, pivots), moving)

    # -- the map ------------------------------------------------------------------------------------------------------

    def apply(self, x: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return modes (2, n_modes, k) and memory (n_memory, k) after a cycle, both in the root of an energy.

        Local.  docs/theory.md, eq. (16.1).
        """
        c, k = self.contact, x.shape[-1]
        p_t = (memory * self.root[:, None]).reshape(-1, 2, k)
        d = self._begin(x, p_t)
        for i, matrices in enumerate(self._steps):
            by_first = self._by_motion[0][i]
            of_memory = np.matmul(c.by_memory[i], p_t)  # (3, n_sliders, 2, k)
            motion = d.reshape(-1, 3, k)
            p = np.matmul(by_first, motion)  # (3, m, 3, k): at the end, begin and end of the course
            p[:, :, :2] += np.moveaxis(self._of_pairs(np.moveaxis(of_memory, 1, 0)), 0, 1)
            q = -np.tensordot(self.R_phi, p[1:].reshape(2, -1, k), axes=(0, 1))  # (n_modes, 2, k)
            x = self.step.take(x) + self.step.forced(q[:, 0], q[:, 1])
            p_t = of_memory[0] + np.matmul(c.by_first[i, 0], motion[c.slider_pair])
            d = self.R @ x[0] - self.G @ p[0].reshape(-1, k)
            if len(matrices.moving):
                x, d = self._implicit(matrices, x, d)
                p_t += np.matmul(c.by_last[i, 0], d.reshape(-1, 3, k)[c.slider_pair])
        return x, p_t.reshape(-1, k) / self.root[:, None]

    def _implicit(self, matrices: StepMatrices, x: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return modes and motion at the end of a step with the forces that follow from that motion."""
        k, rows = x.shape[-1], matrices.moving
        moved = dgetrs(*matrices.factor, d[rows])[0].reshape(-1, 3, k)
        at_end, first, last = np.matmul(matrices.blocks, moved).reshape(3, -1, k)
        q = self.R_phi[rows].T
        change = self.step.forced(-(q @ first), -(q @ last))
        return x + change, d + self.R @ change[0] - self.G[:, rows] @ at_end

    def _begin(self, x: np.ndarray, p_t: np.ndarray) -> np.ndarray:
        """Return the motion of the pairs at the begin of the cycle, (3 m, k), from modes and memory."""
        k, m = x.shape[-1], len(self.contact.pairs)
        p = np.zeros((m, 3, k))
        p[:, :2] = self._of_pairs(p_t)
        rate = self.contact.memoryless_by_last[-1, 0].ravel()
        return np.linalg.solve(np.eye(3 * m) + self.G * rate, self.R @ x[0] - self.G @ p.reshape(-1, k))

    # -- its multipliers ----------------------------------------------------------------------------------------------

    def multipliers(self) -> np.ndarray:
        """Return the multipliers of modes and sliders, (n,) complex by falling modulus; those that are 0 may be left out.

        Local.  docs/theory.md, eq. (16.4).  Of much memory what a cycle makes of the modes is a basis, with what the next ones
        make of that.
        """
        m = self.n_modes
        if len(self.contact.pairs) == 0:
            return _by_modulus(ModalStep(self.omega_n, self.damping, self.period).multipliers())
        x, memory = self.apply(np.eye(2 * m).reshape(2, m, -1), np.zeros((self.n_memory, 2 * m)))
        basis, x_of_basis, memory_of_basis = np.zeros((self.n_memory, 0)), np.zeros((2 * m, 0)), np.zeros((self.n_memory, 0))
        moves = (self.contact.by_first.any(axis=(0, 1, 4)) | self.contact.by_last.any(axis=(0, 1, 4))).ravel()
        n_moving = int(np.count_nonzero(moves))  # a direction in which a slider never slips has the multiplier 1
        new = memory if n_moving > _MOST else np.eye(self.n_memory)[:, moves]
        while basis.shape[1] < n_moving:
            largest = float(np.linalg.norm(new, axis=0).max(initial=0.0))
            for _ in range(2):
                new = new - basis @ (basis.T @ new)
            u, s, _ = np.linalg.svd(new, full_matrices=False)
            u = u[:, : min(np.count_nonzero(s > _CUT * max(1.0, largest)), n_moving - basis.shape[1])]
            if u.shape[1] == 0:
                break
            x_new, new = self.apply(np.zeros((2, m, u.shape[1])), u)
            basis = np.hstack([basis, u])
            x_of_basis = np.hstack([x_of_basis, x_new.reshape(2 * m, -1)])
            memory_of_basis = np.hstack([memory_of_basis, new])
        matrix = np.block([[x.reshape(2 * m, -1), x_of_basis], [basis.T @ memory, basis.T @ memory_of_basis]])
        return _by_modulus(np.linalg.eigvals(matrix))


def _by_modulus(values: np.ndarray) -> np.ndarray:
    return values[np.argsort(-np.abs(values), kind="stable")]
