"""The derivative of the map of one cycle, and its multipliers (docs/theory.md, section 16).

The state is that of the modes and the forces of the sliders that slip in the cycle.  A step takes the modes exactly; the motion
of the pairs at its end follows from their forces there, and these from it.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse
from scipy.linalg import eig, expm
from scipy.linalg.lapack import dgetrf, dgetrs

from ..points.multipliers import N_MULTIPLIERS
from ..receptance.damping import Damping
from .contact_variation import ContactVariation


class ModalStep:
    """eta'' + C eta' + Omega^2 eta = q over a step ``h`` [s], in the scaled coordinates x = (Omega eta, eta') (2, m, n).

    With modal damping each mode steps separately: the matrices are (.., .., m), otherwise (.., .., m, m).
    """

    def __init__(self, omega_n: np.ndarray, damping: Damping, h: float):
        self.omega_n, m = omega_n, len(omega_n)
        if damping.couples_modes:
            one, zero, squares = np.eye(m), np.zeros((m, m)), np.diag(omega_n)
            rows = [[zero, squares, zero, zero], [-squares, -damping.C, one, zero], [zero, zero, zero, one / h], [zero] * 4]
            E = expm(h * np.block(rows)).reshape(4, m, 4, m).transpose(0, 2, 1, 3)
        else:
            rates = np.zeros((m, 4, 4))
            rates[:, 0, 1], rates[:, 1, 0], rates[:, 1, 1], rates[:, 1, 2] = omega_n, -omega_n, -damping.C, 1.0
            rates[:, 2, 3] = 1.0 / h
            E = np.moveaxis(expm(h * rates), 0, -1)
        self.free = E[:2, :2]  # (2, 2, ...): x by x
        self.by_forces = np.stack([E[:2, 2] - E[:2, 3], E[:2, 3]], axis=1)  # x by q at the begin and at the end

    def take(self, x: np.ndarray) -> np.ndarray:
        """Return x after a step without forces, (2, m, n).  Local."""
        return _times(self.free, x)

    def forced(self, q: np.ndarray) -> np.ndarray:
        """Return the contribution to x of forces q at the begin and at the end, (2, m, n).  Local."""
        return _times(self.by_forces, q)

    def shifted(self, q: np.ndarray) -> np.ndarray:
        """Return their contribution to Omega eta, (m, n).  Local."""
        return _times(self.by_forces[:1], q)[0]

    def multipliers(self) -> np.ndarray:
        """Return the eigenvalues of a step without forces, (2 m,) complex.  Local."""
        step = np.moveaxis(self.free, (0, 1), (-2, -1)) if self.free.ndim == 3 else np.block([list(row) for row in self.free])
        return np.linalg.eigvals(step).ravel()


def _times(c: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return sum_j c_ij y_j, (i, m, n), where c has (i, j, m) or (i, j, m, m) and y (j, m, n).  Local."""
    products: np.ndarray = np.matmul(c, y) if c.ndim == 4 else c[..., None] * y
    return products.sum(axis=1)


def _sums(place: np.ndarray, n: int) -> scipy.sparse.csr_array | None:
    """Return the sum over the sliders of each of ``n`` pairs, (n, n_sliders); ``place`` (n_sliders,) ascending.  Local."""
    if np.array_equal(place, np.arange(n)):
        return None
    starts = np.searchsorted(place, np.arange(n + 1))
    return scipy.sparse.csr_array((np.ones(len(place)), np.arange(len(place)), starts), shape=(n, len(place)))


def _summed(of_pairs: scipy.sparse.csr_array | None, of_sliders: np.ndarray) -> np.ndarray:
    """Return the sums over the sliders of each pair, (m, ...), of (n_sliders, ...).  Local."""
    if of_pairs is None:
        return of_sliders
    shape = of_sliders.shape[1:]
    return (of_pairs @ of_sliders.reshape(len(of_sliders), math.prod(shape))).reshape(-1, *shape)


def _rows(pairs: np.ndarray) -> np.ndarray:
    """Return the rows of the motion of pairs (n,), (3 n,).  Local."""
    rows: np.ndarray = (3 * pairs[:, None] + np.arange(3)).ravel()
    return rows


_MOST = 100  # numbers of memory of which a cycle is computed for each
_LASTS = 0.1  # of a disturbance of a slider after a cycle
_ERROR = 1e-6  # of multipliers, first order
_CUT = 1e-7  # residuals of eigenvectors of length 1 below it are no new direction


@dataclass(frozen=True, eq=False)
class ContactStep:
    """The contact of one step: the n pairs whose forces vary in it, with their sliders, and the factor of the implicit part."""

    rows: np.ndarray  # (3 n,) of the motion of these pairs
    fresh: np.ndarray  # of these rows, those that the step before does not have
    sliders: np.ndarray  # (n_sliders,) of these pairs
    place: np.ndarray  # (n_sliders,) their pairs among the n
    sum: scipy.sparse.csr_array | None  # (n, n_sliders); None where each pair has one slider
    components: np.ndarray  # (c,) places of the forces of these pairs in ``CycleMap.components``
    chosen: np.ndarray  # (c,) the same among the 3 n rows
    motion: np.ndarray  # (3 n, c + n_modes) motion by forces of these components and by Omega eta
    R_phi: np.ndarray  # (n_modes, c) participation of these components
    courses: np.ndarray  # (n_sliders, 6, 5) p_t at the end, begin and end of the course, by p_t and motion at the begin
    memoryless: np.ndarray  # (3, n, 3, 1) d p / d d0 of the part without memory
    by_last: np.ndarray  # (n_sliders, 2, 3) d p_t / d d1 at the end
    blocks: np.ndarray  # (n, 9, 3) d p / d d1 of the pairs: at the end, begin and end of the course
    to_modes: np.ndarray  # (n_modes, 3 n) what motion d1 takes from Omega eta
    factor: tuple[np.ndarray, np.ndarray]  # LU and pivots of (1 + (d p, modes by motion) (motion by p, modes))^T, by LAPACK


class CycleMap:
    """The map of a variation of the state over one cycle, for many at once.

    Parameters
    ----------
    omega : frequency [rad/s]
    omega_n, damping : of the modes
    R_phi : (3 m, n_modes) participation of the pairs of ``contact``
    G : (3 m, 3 m) their residual flexibility in addition to the modes [m/N]
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
        vary = contact.memoryless_by_first.any(axis=(1, 2)) | contact.memoryless_by_last.any(axis=(1, 2))  # (m, 3)
        vary[contact.slider_pair, :2] = True
        self.varies = vary.ravel()  # (3 m,) which components of the forces ever vary
        self.components = np.flatnonzero(self.varies)
        self.G_p, self.R_p = np.ascontiguousarray(G[:, self.components]), R_phi[self.components]
        self.G_and_R = np.hstack([self.G_p, self.R])
        self.places_of_modes = np.arange(len(self.components), self.G_and_R.shape[1])

    @property
    def n_modes(self) -> int:
        """Modes, of two numbers each."""
        return len(self.omega_n)

    @property
    def n_memory(self) -> int:
        """Numbers that the sliders remember."""
        return 2 * len(self.contact.slider_pair)

    # -- steps --------------------------------------------------------------------------------------------------------

    @cached_property
    def _steps(self) -> list[ContactStep | None]:
        """The contact of each step; None where no force varies."""
        c = self.contact
        moves = c.memoryless_by_first.any(axis=(2, 3)) | c.memoryless_by_last.any(axis=(2, 3))  # (m, n_steps)
        np.logical_or.at(moves, c.slider_pair, c.of_sliders[..., 4:].any(axis=(2, 3)))
        steps = [self._contact_step(0, moves[:, 0], moves[:, 0])]
        for i, repeats in enumerate(c.repeats, start=1):
            if repeats:  # as while a pair is open
                steps.append(steps[-1] and replace(steps[-1], fresh=np.zeros(0, dtype=int)))
            else:
                steps.append(self._contact_step(i, moves[:, i], moves[:, i] & ~moves[:, i - 1]))
        return steps

    def _contact_step(self, i: int, moves: np.ndarray, begins: np.ndarray) -> ContactStep | None:
        """Return the contact of a step in which pairs ``moves`` (m,) vary, of which ``begins`` (m,) do not in the step before."""
        c, pairs, sliders = self.contact, np.flatnonzero(moves), np.flatnonzero(moves[self.contact.slider_pair])
        if len(pairs) == 0:
            return None
        n, place = len(pairs), np.searchsorted(pairs, c.slider_pair[sliders])
        of_pairs = _sums(place, n)
        rows = _rows(pairs)
        chosen = np.flatnonzero(self.varies[rows])
        components = np.searchsorted(self.components, rows[chosen])

        by_last = c.by_last[sliders, i]  # (n_sliders, 3, 2, 3)
        blocks = np.zeros((n, 3, 3, 3))
        blocks[:, :, :2] = _summed(of_pairs, by_last)
        blocks[..., (0, 1, 2), (0, 1, 2)] += c.memoryless_by_last[pairs, i]
        of_modes = self.R_phi[rows].reshape(n, 1, 3, -1).swapaxes(-1, -2)
        forces = np.matmul(of_modes, blocks[:, 1:])  # (n, 2, n_modes, 3)
        to_modes = self.step.shifted(forces.transpose(1, 2, 0, 3).reshape(2, -1, 3 * n))
        motion = self.G_and_R.take(rows, axis=0).take(np.append(components, self.places_of_modes), axis=1)
        p_by_both = np.matmul(blocks[:, 0], motion.reshape(n, 3, -1)).reshape(3 * n, -1)
        J = np.vstack([p_by_both.take(chosen, axis=0), to_modes @ motion])
        np.einsum("ii->i", J)[:] += 1.0
        lu, pivots, _ = dgetrf(J.T, overwrite_a=True)  # in LAPACK's order
        courses = np.concatenate([c.by_memory[sliders, i], c.by_first[sliders, i]], axis=-1)  # (n_sliders, 3, 2, 5)
        return ContactStep(
            rows=rows,
            fresh=_rows(np.flatnonzero(begins)),
            sliders=sliders,
            place=place,
            sum=of_pairs,
            components=components,
            chosen=chosen,
            motion=motion,
            R_phi=np.ascontiguousarray(self.R_p[components].T),
            courses=courses.reshape(-1, 6, 5),
            memoryless=c.memoryless_by_first[pairs, i].swapaxes(0, 1)[..., None],
            by_last=by_last[:, 0],
            blocks=blocks.reshape(n, 9, 3),
            to_modes=to_modes,
            factor=(lu, pivots),
        )

    # -- the map ------------------------------------------------------------------------------------------------------

    def apply(self, x: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return modes (2, n_modes, k) and memory (n_memory, k) after a cycle, both in the root of an energy.

        Local.  docs/theory.md, eq. (16.1).
        """
        p_t = (memory * self.root[:, None]).reshape(-1, 2, x.shape[-1])
        d, p = self._begin(x, p_t)
        q = self.R_p.T @ p
        for contact in self._steps:
            if contact is None:
                x = self.step.take(x) - self.step.forced(np.stack([q, q]))
            else:
                d[contact.fresh] = self.R[contact.fresh] @ x[0] - self.G_p[contact.fresh] @ p
                x, change = self._through(contact, x, d, p, p_t, q)
                q += change
        return x, p_t.reshape(-1, x.shape[-1]) / self.root[:, None]

    def _through(
        self, contact: ContactStep, x: np.ndarray, d: np.ndarray, p: np.ndarray, p_t: np.ndarray, q: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return modes and the change of the modal forces ``q`` after a step; ``d``, ``p`` and ``p_t`` are changed in place."""
        k, n_p, R_phi = x.shape[-1], len(contact.components), contact.R_phi
        begin = d.take(contact.rows, axis=0).reshape(-1, 3, k)
        known = np.concatenate([p_t.take(contact.sliders, axis=0), begin.take(contact.place, axis=0)], axis=1)
        of_sliders = np.matmul(contact.courses, known)
        courses = contact.memoryless * begin  # (3, n, 3, k)
        courses[:, :, :2] += _summed(contact.sum, of_sliders).reshape(-1, 3, 2, k).swapaxes(0, 1)
        change = courses.reshape(3, -1, k).take(contact.chosen, axis=1)
        change -= p.take(contact.components, axis=0)

        forces, free = q + np.matmul(R_phi, change[1:]), self.step.take(x)
        eta = free[0] - self.step.shifted(forces)
        moved = begin + (contact.motion[:, n_p:] @ (eta - x[0])).reshape(-1, 3, k)
        by_moved = np.matmul(contact.blocks[:, :3], moved).reshape(-1, k).take(contact.chosen, axis=0)
        by_moved += change[0]
        solved, _ = dgetrs(*contact.factor, np.concatenate([by_moved, contact.to_modes @ moved.reshape(-1, k)]), trans=1)
        p[contact.components] += solved[:n_p]
        end = moved - (contact.motion @ solved).reshape(-1, 3, k)
        d[contact.rows] = end.reshape(-1, k)

        of_end = np.matmul(contact.blocks[:, 3:], end).reshape(-1, 2, 3, k).swapaxes(0, 1).reshape(2, -1, k)
        forces += np.matmul(R_phi, of_end.take(contact.chosen, axis=1))
        p_t[contact.sliders] = of_sliders[:, :2] + np.matmul(contact.by_last, end.take(contact.place, axis=0))
        return free - self.step.forced(forces), R_phi @ solved[:n_p]

    def _begin(self, x: np.ndarray, p_t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return motion (3 m, k) and forces of the pairs at the begin of the cycle, from modes and memory."""
        k, m = x.shape[-1], len(self.contact.pairs)
        of_sliders = np.zeros((m, 3, k))
        of_sliders[:, :2] = _summed(_sums(self.contact.slider_pair, m), p_t)
        of_sliders = of_sliders.reshape(-1, k)
        rate = self.contact.memoryless_by_last[:, -1, 0].ravel()
        d = np.linalg.solve(np.eye(3 * m) + self.G * rate, self.R @ x[0] - self.G @ of_sliders)
        return d, (of_sliders + rate[:, None] * d)[self.components]

    # -- its multipliers ----------------------------------------------------------------------------------------------

    def multipliers(self) -> np.ndarray:
        """Return the N_MULTIPLIERS largest of modes and sliders, complex by falling modulus; those that are 0 may be left out.

        Local.  docs/theory.md, eq. (16.4).  Of much memory a basis begins with the modes and with what lasts; each further cycle
        takes the residuals of these multipliers, until their estimated errors are below 1e-6.
        """
        m = self.n_modes
        if len(self.contact.pairs) == 0:
            values = ModalStep(self.omega_n, self.damping, self.period).multipliers()
            return values[np.argsort(-np.abs(values), kind="stable")][:N_MULTIPLIERS]
        moves = (self.contact.by_first.any(axis=(1, 2, 4)) | self.contact.by_last.any(axis=(1, 2, 4))).ravel()
        n_moving = int(np.count_nonzero(moves))  # a direction in which a slider never slips has the multiplier 1
        basis = np.eye(self.n_memory)[:, moves] if n_moving <= _MOST else self._lasting(moves)
        n_new = basis.shape[1]
        x, memory = self.apply(
            np.eye(2 * m, 2 * m + n_new).reshape(2, m, -1), np.hstack([np.zeros((self.n_memory, 2 * m)), basis])
        )
        while True:
            inside = basis.T @ memory
            values, left, right = eig(np.vstack([x.reshape(2 * m, -1), inside]), left=True)
            chosen = np.argsort(-np.abs(values), kind="stable")[:N_MULTIPLIERS]
            left, right = left[:, chosen], right[:, chosen]
            outside = memory - basis @ inside
            outside -= basis @ (basis.T @ outside)
            residuals = outside @ right
            overlaps = np.abs((left.conj() * right).sum(axis=0))
            sizes = np.linalg.norm(residuals, axis=0) * np.linalg.norm(left[-n_new:], axis=0)  # the next ones are no larger
            u, s, _ = np.linalg.svd(np.hstack([residuals.real, residuals.imag]), full_matrices=False)
            u = u[:, : min(np.count_nonzero(s > _CUT), n_moving - basis.shape[1])]
            n_new = u.shape[1]
            if n_new == 0 or (sizes < _ERROR * overlaps).all():
                return values[chosen]
            x_new, new = self.apply(np.zeros((2, m, n_new)), u)
            basis, x, memory = np.hstack([basis, u]), np.concatenate([x, x_new], axis=-1), np.hstack([memory, new])

    def _lasting(self, moves: np.ndarray) -> np.ndarray:
        """Return directions of the memory of which a tenth or more is left after a cycle with the motion as it is, (n_memory, k).

        Local.  At least N_MULTIPLIERS where so many last at all; ``moves`` (n_memory,) excludes others.
        """
        left, root = np.eye(2) * moves.reshape(-1, 1, 2), self.root.reshape(-1, 2, 1)
        for by_memory in self.contact.by_memory[:, :, 0].swapaxes(0, 1):
            left = by_memory @ left
        _, sizes, directions = np.linalg.svd(left / root * root.swapaxes(1, 2))
        k = min(np.count_nonzero(sizes), max(N_MULTIPLIERS, np.count_nonzero(sizes > _LASTS)))
        slider, direction = np.unravel_index(np.argsort(-sizes, axis=None)[:k], sizes.shape)
        basis = np.zeros((len(sizes), 2, k))
        basis[slider, :, np.arange(k)] = directions[slider, direction]
        return basis.reshape(self.n_memory, -1)
