"""A change of the contact stiffness in a reduced structure: exact low-rank update of the receptance (docs/theory.md, section 4).

With K' = K_L + R^H dK R, where dK is diagonal, J the components with non-zero dK, and G = G_static,

    R K'^-1 = R K_L^-1 - G[:, J] T (R K_L^-1)[J],        T = dK (1 + G_JJ dK)^-1,                                   (4.7)

and the same T for loads and outputs.  Modes are updated as well: Y = phi^H M K'^-1 M phi follows from (4.7), Y Q = Q Omega'^-2,
and the motions K'^-1 M phi Q Omega'^2 with frequencies Omega' have exactly the receptance of the modes phi under forces -dK R u
of the pairs.  The update needs no factorisation of K', only the static columns of J.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..fourier.amplitudes import to_complex, to_real
from ..guards.memory import refuse_beyond
from ..parallel.agree import on_root
from ..parallel.ownership import rows_of
from .damping import Damping, StatedDamping, added, diagonal_if_possible, structural_damping
from .modes import DampedModes
from .receptance import Receptance
from .static_columns import ChosenColumns, StaticColumns
from .static_response import StaticResponse

if TYPE_CHECKING:
    from mpi4py import MPI

SYMMETRIC = 1e-9  # bound of the relative asymmetry of the updated receptance, a measure of lost digits
UNSTATED = 1e-12  # relative difference from the stated damping below which a structure has no dampers
MULTIPLE = 1e-9  # relative distance of squared frequencies that count as equal
_LARGE = 1e8  # bytes of the update from which the memory is checked


@dataclass(frozen=True, eq=False)
class SpringChange:
    """A change of the springs of the pairs; replicated."""

    dK: np.ndarray  # (3 n_pairs,) change of K_J [N/m]
    K_J: np.ndarray  # (3 n_pairs,) with that change [N/m]
    damping: StatedDamping | None = None  # modal damping as stated; None: constant damping matrix


class SpringUpdate:
    """The update, docs/theory.md, eq. (4.7), of one group of harmonics.

    Collective on ``comm``: static columns of the changed pairs, a gather and a broadcast.

    Raises
    ------
    ValueError : the update loses too many digits, or leaves a body without support; on every rank
    ResourceError : not enough memory; on every rank
    """

    def __init__(self, comm: MPI.Comm, receptance: Receptance, change: SpringChange):
        self.comm, self.before, self.change = comm, receptance, change
        self.J = np.flatnonzero(change.dK)
        needed = 40.0 * len(self.J) ** 2 * (2 if receptance.is_complex else 1)
        if needed > _LARGE:
            refuse_beyond(
                comm, needed, f"change of the contact stiffness of {len(self.J)} components", "build the structure again with it"
            )
        pairs, G = np.unique(self.J // 3), receptance.static.G_static
        n_owned = np.array(comm.allgather(G.n_owned))
        first, last = 3 * n_owned[: comm.rank].sum(), 3 * n_owned[: comm.rank + 1].sum()
        self.J_owned = self.J[(self.J >= first) & (self.J < last)] - first
        self.columns: ChosenColumns = G.chosen(pairs).part(np.flatnonzero(np.isin(rows_of(pairs), self.J)))  # G[owned, J]
        self.T = on_root(comm, _inverse_change, self._gathered(self.columns.columns(self.J_owned).T), change.dK[self.J])

    def _gathered(self, owned: np.ndarray) -> np.ndarray:
        """Return rows of all ranks in rank order.  Collective: one gather."""
        return owned if self.comm.size == 1 else np.concatenate(self.comm.allgather(owned))

    def _moved_owned(self, forces: np.ndarray) -> np.ndarray:
        """Return G[owned, J] times forces (n_J, k), (3 n_owned, k).  Local."""
        if not np.iscomplexobj(forces):
            return self.columns.apply(forces)
        return to_complex(self.columns.apply(to_real(forces, 2 * forces.shape[1])))

    def of_pairs(self, v: np.ndarray) -> np.ndarray:
        """Return R K'^-1 x, (3 n_pairs, k), for v = R K_L^-1 x.  Collective: one gather."""
        return v - self._gathered(self._moved_owned(self.T @ v[self.J]))

    def of_outputs(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return o K'^-1 x, (n_outputs, k), for u = o K_L^-1 x and v = R K_L^-1 x.  Local."""
        return u - self.before.static.out_R[:, self.J] @ (self.T @ v[self.J])

    def of_loads(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return f^H K'^-1 x, (n_loads, k), for u = f^H K_L^-1 x and v = R K_L^-1 x.  Local."""
        return u - self.before.static.du_static[self.J].conj().T @ (self.T @ v[self.J])

    # -- updated quantities --------------------------------------------------------------------------------------

    @cached_property
    def receptance(self) -> Receptance:
        """The receptance with the change.  Collective at the first access."""
        return replace(self.before, modes=self._modes(), static=self._static(), sectors=None)

    def _modes(self) -> DampedModes:
        modes, squares = self.before.modes, self.before.modes.omega_n**2
        R_phi, o, b_H = modes.R_phi / squares, modes.o / squares, modes.b.conj().T / squares
        x = R_phi[self.J]
        omega_n, Q = on_root(self.comm, _frequencies, squares, x.conj().T @ self.T @ x)
        scaled = Q * omega_n**2
        pairs = self.of_pairs(R_phi) @ scaled
        damping = _damping(modes, Q, omega_n, pairs, self.change)
        return DampedModes(
            omega_n, damping, pairs, (self.of_loads(b_H, R_phi) @ scaled).conj().T, self.of_outputs(o, R_phi) @ scaled
        )

    def _static(self) -> StaticResponse:
        static = self.before.static
        G, du, out_R = static.G_static, static.du_static, static.out_R.conj().T
        return StaticResponse(
            G_static=StaticColumns(len(G.known), G.n_owned, self._columns_of, G.batch, G.is_complex),
            du_static=self.of_pairs(du),
            out_static=self.of_outputs(static.out_static, du),
            out_R=self.of_pairs(out_R).conj().T,
            load_static=self.of_loads(static.load_static, du),
            outputs_static=static.outputs_static
            - np.einsum("ji,jk,ki->i", out_R[self.J].conj(), self.T, out_R[self.J], optimize=True).real,
        )

    def _columns_of(self, pairs: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the static columns of some pairs (m,), (3 n_owned, 3 m).  Collective: one gather."""
        columns = self.before.static.G_static.transposed(pairs).T
        return columns - self._moved_owned(self.T @ self._gathered(columns[self.J_owned]))


def _inverse_change(G_JJ: np.ndarray, dK: np.ndarray) -> np.ndarray:
    """Return T of eq. (4.7), Hermitian.  Local.

    Raises
    ------
    ValueError : the updated G is not positive, or its asymmetry, a measure of lost digits, exceeds ``SYMMETRIC``
    """
    A = np.eye(len(dK)) + G_JJ * dK
    try:
        T, G = np.linalg.solve(A.T, np.diag(dK)).T, np.linalg.solve(A, G_JJ)
    except np.linalg.LinAlgError:
        T, G = np.full((2, *A.shape), np.nan)
    size = np.abs(G).max(initial=0.0)
    loss = np.abs(G - G.conj().T).max(initial=0.0) / (size or 1.0)
    if not loss <= SYMMETRIC or (len(dK) and np.linalg.eigvalsh(G)[0] < -SYMMETRIC * size):
        raise ValueError(
            f"contact stiffness of {len(dK)} springs differs so much that the static receptance has an asymmetry of {loss:.1e} "
            f"(bound {SYMMETRIC:.0e}), or a body has no support: build the structure again with that stiffness"
        )
    return 0.5 * (T + T.conj().T)


def _frequencies(squares: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Omega' (m,), ascending, and Q (m, m) of Y = Omega^-2 - B.  Local.

    Raises
    ------
    ValueError : Y is not positive: a body is without support
    """
    y, Q = np.linalg.eigh(np.diag(1.0 / squares) - 0.5 * (B + B.conj().T))
    if len(y) and not y[0] > 0.0:
        raise ValueError("the changed contact stiffness leaves a mode without stiffness: build the structure again with it")
    return y[::-1] ** -0.5, Q[:, ::-1]


def _damping(modes: DampedModes, Q: np.ndarray, omega_n: np.ndarray, R_phi: np.ndarray, change: SpringChange) -> Damping:
    """Return the damping of the motions Q of some modes: stated damping of modes plus damping by dampers.  Local."""
    stated, C, S = change.damping, modes.damping.C, modes.damping.S
    if stated is None:
        return Damping(_between(Q, C), None if S is None else _between(Q, S))
    dampers = added(C, -stated.modal(modes.omega_n))
    of_modes = stated.modal(omega_n)
    if np.abs(dampers).max(initial=0.0) > UNSTATED * np.abs(C).max(initial=0.0):
        of_modes = added(_between(Q, dampers), of_modes)
    return Damping(of_modes, None if S is None else structural_damping(omega_n, R_phi, change.K_J, stated.structural))


def stated_damping_rate(modes: DampedModes, stated: StatedDamping, dK: np.ndarray) -> np.ndarray:
    """Return the rate of phi^H C phi [1/s] of a stated damping for springs with the rate ``dK`` (3 n_pairs,), (m, m).  Local.

    Derivative of a matrix function: (g_i - g_j) / (l_i - l_j) phi_i^H R^H dK R phi_j, l = omega_n^2, g the stated damping.
    """
    return damping_quotients(modes, stated) * (modes.R_phi.conj().T @ (dK[:, None] * modes.R_phi))


def damping_quotients(modes: DampedModes, stated: StatedDamping) -> np.ndarray:
    """Return (g_i - g_j) / (l_i - l_j) of :func:`stated_damping_rate`, (m, m) [s].  Local."""
    g, squares, h = stated.modal(modes.omega_n), modes.omega_n**2, 1e-3
    slope = (stated.modal((1.0 + h) * modes.omega_n) - stated.modal((1.0 - h) * modes.omega_n)) / (4.0 * h * squares)
    difference = squares[:, None] - squares
    is_multiple = np.abs(difference) <= MULTIPLE * squares
    return np.divide(g[:, None] - g, difference, out=0.5 * (slope[:, None] + slope), where=~is_multiple)


def _between(Q: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return Q^H C Q, (m, m), or its diagonal (m,) if it does not couple the motions; C (m,) or (m, m).  Local."""
    product = Q.conj().T @ (C @ Q if C.ndim == 2 else C[:, None] * Q)
    return diagonal_if_possible(0.5 * (product + product.conj().T))
