"""The receptance G_n(omega) of some pairs at one frequency: products, rate, blocks (docs/theory.md, section 4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from functools import cached_property

import numpy as np

from ..parallel.ownership import rows_of
from ._row_products import answer
from .damping import Flexibility
from .reduced_model import ReducedModel
from .rows import Rows


class ReceptanceColumns:
    """Columns of G_n(omega), all harmonics of the set, that belong to some pairs; rows are those of this rank's pairs.

    docs/theory.md, eq. (4.2).
    """

    def __init__(self, model: ReducedModel, omega: float, active: np.ndarray):
        self.model, self.omega, self.active = model, omega, active
        self.G_static = model.G_static.chosen(active)
        self.flexibilities: Sequence[Flexibility] = model.flexibilities(omega)
        rows = slice(None) if len(active) == model.n_pairs else rows_of(active)
        self.R_active = [share.family.R_phi[rows] for share in model.shares]
        self.shape = (-1, 3, model.N_H)

    @cached_property
    def rows(self) -> np.ndarray:
        """Rows of the active pairs of this rank, counted from its first, (3 m,)."""
        return rows_of(self._owned(self.active))

    def _owned(self, pairs: np.ndarray) -> np.ndarray:
        """Return those of some pairs that are this rank's, counted from its first."""
        first, last = self.model.owned.start, self.model.owned.stop
        return pairs[(pairs >= first) & (pairs < last)] - first

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p on this rank's pairs, (n_owned, 3, N_H) [m], for p (3 n_active, N_H) [N].  Local."""
        if len(p) == 0:
            return np.zeros((self.model.owned.stop - self.model.owned.start, *self.shape[1:]))
        return (self.G_static.combined(p).T + self._dynamic(self.flexibilities, p)).reshape(self.shape)

    def apply_rate(self, p: np.ndarray, d_omega: float = 1.0, d_sigma: float = 0.0) -> np.ndarray:
        """Return dG p on this rank's pairs, (n_owned, 3, N_H), dG being the rate of G where omega changes at ``d_omega`` and a
        damping sigma M at ``d_sigma``: eq. (5.2).  Local; of G itself, not of an adjoint."""
        rates = [c.rate(d_omega, d_sigma) for c in self.model.flexibilities(self.omega)]
        return self._dynamic(rates, p).reshape(self.shape)

    def _dynamic(self, flexibilities: Sequence[Flexibility], p: np.ndarray) -> np.ndarray:
        """Return R phi c_n phi^T R^T p, (3 n_owned, N_H): minus R phi eta of docs/theory.md, eq. (4.3), under p alone."""
        model, own = self.model, self.model.owned_rows
        of_shares = zip(model.shares, self.R_active, flexibilities)
        return model.joined([s.family.R_phi[own] @ c.apply(R.T @ p[:, s.columns]) for s, R, c in of_shares])

    def apply_transposed(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's part of G^T x for x (n_owned, 3, N_H), (3 n_active, N_H).  Local; to be summed over the ranks."""
        model, own, x = self.model, self.model.owned_rows, x.reshape(-1, x.shape[-1])
        of_shares = zip(model.shares, self.R_active, self.adjoint().flexibilities)
        dynamic = [R @ c.apply(s.family.R_phi[own].T @ x[:, s.columns]) for s, R, c in of_shares]
        return self.G_static.times(x) + model.joined(dynamic)

    def adjoint(self) -> ReceptanceColumns:
        """Return the columns of the transposed of G, which has the same static part.  Local."""
        other = copy(self)
        other.flexibilities = [c.adjoint() for c in self.flexibilities]
        return other

    # -- the block between the active pairs ------------------------------------------------------------------------

    def blocks(self, chosen: np.ndarray | None = None) -> Iterator[np.ndarray]:
        """Return G_n between the active pairs for each harmonic of the set, (3 n_active, 3 n_active), complex [m/N].

        Collective: one gather, before the first is asked for.  Between the ``chosen`` ones alone, (m,) numbers among the active
        pairs, rising, where they are given: (3 m, 3 m).
        """
        part, own = np.arange(3 * len(self.active)), self.rows
        if chosen is not None:
            part, own = rows_of(chosen), rows_of(self._owned(self.active[chosen]))
        static = self.G_static.part(part).columns(own).T
        if self.model.comm.size > 1:
            static = np.concatenate(self.model.comm.allgather(static))  # rank order is row order
        return (static + self._dynamic_block(n, part) for n in self.model.harmonics.chosen)

    def moved_by(self, chosen: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return G_n p_n of this rank's active pairs, complex (n_harmonics, 3 n_active_owned, k) [m].  Local.

        ``p`` (m, n_harmonics, 3, k) [N] are the amplitudes of forces on the ``chosen`` ones (m,) of the active pairs.
        """
        rows, forces = rows_of(chosen), p.swapaxes(0, 1).reshape(p.shape[1], -1, p.shape[3]).astype(complex)
        static = self.G_static.part(rows).columns(self.rows).T
        own = slice(*np.searchsorted(self.active, [self.model.owned.start, self.model.owned.stop]) * 3)
        found = np.stack([(static @ force.view(float)).view(complex) for force in forces])
        for moved, force, n in zip(found, forces, self.model.harmonics.chosen):
            k, i = self.model.index_of(n)
            moved += self.flexibilities[k].between(self.R_active[k][own], i, force.T @ self.R_active[k][rows])
        return found

    def _dynamic_block(self, n: int, part: np.ndarray) -> np.ndarray:
        """Return what the modes add to G_n between some rows of the active pairs."""
        k, i = self.model.index_of(n)
        return self.flexibilities[k].between(self.R_active[k][part], i, self.R_active[k][part])

    def matrix(self) -> np.ndarray:
        """Return G between the active pairs, all harmonics, (3 n_active N_H, 3 n_active N_H) [m/N].  Collective: one gather.

        Index = row N_H + coefficient; amplitudes are cos - i sin.
        """
        n, harmonics = 3 * len(self.active), self.model.harmonics
        G = np.zeros((n, self.model.N_H, n, self.model.N_H))
        for number, block in zip(harmonics.chosen, self.blocks()):
            c = harmonics.columns(number).start
            G[:, c, :, c] = block.real
            if number > 0:
                G[:, c + 1, :, c + 1] = block.real
                G[:, c, :, c + 1], G[:, c + 1, :, c] = block.imag, -block.imag
        return G.reshape(n * self.model.N_H, n * self.model.N_H)


class ActiveColumns:
    """Columns and rows of G_n(omega) of pairs that do not stick, in one array and of a precision to choose.

    Forces come in units of 1 / ``unit`` [N], the same on all ranks, so that single precision neither overflows nor vanishes,
    whatever the units of the scene.  Collective on the model's communicator.
    """

    def __init__(self, G: ReceptanceColumns, precision: type):
        self.model, self.precision = G.model, precision
        self.unit = max(G.model.comm.allgather(G.G_static.largest)) or 1.0  # m/N
        self._R_unit = max(float(np.abs(R).max(initial=0.0)) for R in G.R_active) or 1.0  # kg^-1/2
        self.n_rows = len(G.rows)
        ends = np.cumsum([self.n_rows] + [R.shape[1] for R in G.R_active])
        self.modes = [slice(first, last) for first, last in zip(ends, ends[1:])]  # columns of the modes of each share
        self.columns: np.ndarray = np.empty((3 * len(G.active), ends[-1]), dtype=precision)
        G.G_static.write_columns(G.rows, self.unit, self.columns[:, : self.n_rows])
        for modes, R in zip(self.modes, G.R_active):
            self.columns[:, modes] = R / self._R_unit
        self._rows = Rows.of(self.columns)
        own = [s.family.R_phi[G.model.owned_rows][G.rows] / self._R_unit for s in G.model.shares]
        self.R_rows: list[np.ndarray] = [np.ascontiguousarray(R.T, dtype=precision) for R in own]  # (n_modes, 3 m)
        numbers = [s.harmonics.chosen for s in G.model.shares]
        self.cosines = [np.array([G.model.harmonics.columns(n).start for n in of_share], dtype=np.intp) for of_share in numbers]
        self.move_to(G)

    def move_to(self, G: ReceptanceColumns) -> None:
        """Take over the frequency of ``G``, of the same pairs.  Local."""
        self._flexibilities = [Flexibility(f.c * self._R_unit * (self._R_unit / self.unit)) for f in G.flexibilities]  # no unit

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p, (3 m, N_H) [m], for p (3 n_active, N_H) in units of 1 / ``unit`` [N].  Local."""
        return self._answered(self._rows.combined(p)).T

    def apply_to_several(self, p: np.ndarray) -> np.ndarray:
        """Return G p of several forces at once, (n, 3 m, N_H) [m], for p (n, 3 n_active, N_H) in those units.  Local."""
        n, rows, N_H = p.shape
        together = p.transpose(0, 2, 1).reshape(n * N_H, rows)
        product = self._answered(together.astype(self.precision, copy=False) @ self.columns)
        return product.reshape(n, N_H, self.n_rows).swapaxes(1, 2)

    def _answered(self, product: np.ndarray) -> np.ndarray:
        """Return the pairs' columns of a product (n N_H, 3 m + n_modes), with what the modes answer to the forces beside them."""
        of_shares = zip(self.model.shares, self.modes, self.R_rows, self._flexibilities, self.cosines)
        for share, modes, R, flexibility, cosines in of_shares:
            if flexibility.couples_modes:
                forces = product[:, modes].reshape(-1, self.model.N_H, modes.stop - modes.start)[:, share.columns]
                eta = flexibility.apply(np.moveaxis(forces, 2, 0).astype(float))  # (n_modes, n, N_H of the share)
                product.reshape(-1, self.model.N_H, product.shape[1])[:, share.columns, : self.n_rows] += (
                    np.moveaxis(eta, 0, 2) @ R
                )
            else:
                answer(product, R, flexibility.c, cosines, share.harmonics.has_mean, self.model.N_H, modes.start)
        return product[:, : self.n_rows]

    def in_units(self, P: np.ndarray) -> np.ndarray:
        """Return tangents P [N/m] that give forces in units of 1 / ``unit``, in the precision of the columns.  Local."""
        found: np.ndarray = np.empty_like(P, dtype=self.precision)
        return np.multiply(P, self.unit, out=found, casting="same_kind")
