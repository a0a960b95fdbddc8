"""The receptance G_n(omega) of some pairs at one frequency: products, rate, blocks (docs/theory.md, section 4)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import cached_property

import numpy as np

from ..fourier.amplitudes import adjoint_times, matrix_times, to_complex, to_real
from ..parallel.ownership import rows_of
from ._row_products import answer
from .circulant import CirculantColumns, ColumnsOfOtherModes
from .damping import Damping, Flexibility
from .reduced_model import HarmonicGroup, ReducedModel
from .rows import Rows
from .static_columns import ChosenColumns


class GroupColumns:
    """Columns of G_n(omega) of one harmonic group for some pairs, with the rows of this rank's pairs.

    Forces and motions are the N_H real coefficients of the group's harmonics.  Products of a whole disc are collective;
    everything else is local.
    """

    def __init__(self, group: HarmonicGroup, c: Flexibility, active: np.ndarray, owned: slice):
        self.group, self.c, self.is_complex = group, c, group.receptance.is_complex
        self.active, self.R_owned = active, group.receptance.modes.R_phi[owned]
        self.largest = self._largest_static()  # m/N, on this rank

    @cached_property
    def G_static(self) -> ChosenColumns:
        """The static columns of the active pairs.  Collective if some are missing."""
        return self.group.receptance.static.G_static.chosen(self.active)

    def _largest_static(self) -> float:
        return self.G_static.largest

    @cached_property
    def R_active(self) -> np.ndarray:
        """The modes at the active pairs, (3 n_active, m)."""
        R_phi = self.group.receptance.modes.R_phi
        return R_phi if 3 * len(self.active) == len(R_phi) else R_phi[rows_of(self.active)]

    def dynamic(self, c: Flexibility, p: np.ndarray) -> np.ndarray:
        """Return R phi c_n phi^H R^H p, (3 n_owned, N_H): minus R phi eta of docs/theory.md, eq. (4.3), under p only."""
        return matrix_times(self.R_owned, c.apply(adjoint_times(self.R_active, p)))

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p on this rank's pairs, (3 n_owned, N_H) [m], for p (3 n_active, N_H) [N]."""
        return self.G_static.apply(p) + self.dynamic(self.c, p)

    def apply_adjoint(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's part of G^H x, (3 n_active, N_H), for x (3 n_owned, N_H)."""
        eta = self.c.adjoint().apply(adjoint_times(self.R_owned, x))
        return self.G_static.apply_adjoint(x) + matrix_times(self.R_active, eta)

    def adjoint(self) -> GroupColumns:
        """Return the columns of G^H, which has the same static part."""
        other = copy(self)
        other.c = self.c.adjoint()
        return other

    def static_block(self, part: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return G_static between ``rows`` of this rank and the rows ``part`` of the active pairs, (k, l)."""
        return self.G_static.part(part).columns(rows).T

    def dynamic_block(self, i: int, part: np.ndarray, least: float = 0.0) -> np.ndarray:
        """Return the dynamic part of G_n for the i-th harmonic between the rows ``part`` of the active pairs.

        Without modes that move pairs by less than ``least`` of the largest static motion.
        """
        R, c = self.R_active[part], self.c
        if least > 0.0 and not c.couples_modes:
            moves = np.abs(c.c[:, i]) * self._most > least * self.largest
            R, c = R[:, moves], Flexibility(c.c[moves])
        return c.between(R, i, R)

    @cached_property
    def _most(self) -> np.ndarray:
        """The largest square of each mode at a pair, (m,) [1/kg]."""
        most: np.ndarray = np.abs(self.group.receptance.modes.R_phi).max(axis=0, initial=0.0) ** 2
        return most


class SectorColumns(GroupColumns):
    """Columns of G_n of a whole disc, multiplied by transforms over its sectors.  Products are collective."""

    def __init__(self, group: HarmonicGroup, c: Flexibility, active: np.ndarray, owned: slice):
        assert group.receptance.sectors is not None, "a whole disc"
        self.products, self.rows_active, self.rows_owned = group.receptance.sectors, rows_of(active), owned
        super().__init__(group, c, active, owned)

    def _largest_static(self) -> float:
        return self.products.unit

    def static_block(self, part: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return G_static as the base class, without static columns."""
        static = self.group.receptance.static.G_static
        assert isinstance(static, (CirculantColumns, ColumnsOfOtherModes)), "a whole disc"
        return static.block(self.rows_owned.start + rows, self.rows_active[part])

    def dynamic(self, c: Flexibility, p: np.ndarray) -> np.ndarray:
        """Return the part of the modes as the base class."""
        return self._moved(p, self.products.rate(c), of_modes_only=True)

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p as the base class."""
        return self._moved(p, self.products.flexibility(self.c))

    def apply_adjoint(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's part of G^H x as the base class: that of its diameters."""
        c = self.products.flexibility(self.c.adjoint())
        motions = np.concatenate(self.products.comm.allgather(x))  # rank order is row order
        return self.products.unit * self.products.apply(motions, c, is_part=True)[self.rows_active]

    def _moved(self, p: np.ndarray, c: Flexibility, of_modes_only: bool = False) -> np.ndarray:
        """Return the motion of this rank's rows under forces on the active pairs."""
        forces = np.zeros((self.products.n_rows, p.shape[1]))
        forces[self.rows_active] = p
        return self.products.unit * self.products.apply(forces, c, of_modes_only)[self.rows_owned]


def _group_columns(
    model: ReducedModel, group: HarmonicGroup, c: Flexibility, active: np.ndarray, for_blocks: bool
) -> GroupColumns:
    """Return the columns of a group; by transforms over the sectors where these are fewer, or for blocks.  Collective."""
    sectors, m = group.receptance.sectors, len(group.receptance.modes.omega_n)
    n_dense = _n_products(3 * len(active), 3 * model.n_pairs // model.comm.size, m)  # the same on all ranks
    if sectors is not None and (for_blocks or sectors.n_products(model.comm.size) < n_dense):
        return SectorColumns(group, c, active, model.owned_rows)
    return GroupColumns(group, c, active, model.owned_rows)


def _n_products(n_active: int, n_rows: int, n_modes: int) -> int:
    """Return the number of real products of dense columns for each column of forces."""
    return n_active * n_rows + n_modes * (n_active + n_rows)


class ReceptanceColumns:
    """Columns of G_n(omega), all harmonics of the set, for some pairs, with the rows of this rank's pairs.

    docs/theory.md, eq. (4.2).  Without products, ``for_blocks``, those of a whole disc need no static columns.
    """

    def __init__(self, model: ReducedModel, omega: float, active: np.ndarray, for_blocks: bool = False):
        self.model, self.omega, self.active = model, omega, active
        of_groups = zip(model.groups, model.flexibilities(omega))
        self.groups: Sequence[GroupColumns] = [_group_columns(model, group, c, active, for_blocks) for group, c in of_groups]
        self.shape = (-1, 3, model.N_H)

    @cached_property
    def rows(self) -> np.ndarray:
        """Rows of the active pairs of this rank, counted from its first, (3 m,)."""
        return rows_of(self._owned(self.active))

    def _owned(self, pairs: np.ndarray) -> np.ndarray:
        """Return the pairs of this rank among ``pairs``, counted from its first."""
        first, last = self.model.owned.start, self.model.owned.stop
        return pairs[(pairs >= first) & (pairs < last)] - first

    def _joined(self, terms: list[Callable[[np.ndarray], np.ndarray]], x: np.ndarray) -> np.ndarray:
        """Return the products of the groups with their coefficients of x, joined to (n, N_H)."""
        return self.model.joined([term(x[:, group.group.columns]) for term, group in zip(terms, self.groups)])

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p on this rank's pairs, (n_owned, 3, N_H) [m], for p (3 n_active, N_H) [N].

        Local; of a whole disc collective.
        """
        if len(p) == 0:
            return np.zeros((self.model.owned.stop - self.model.owned.start, *self.shape[1:]))
        return self._joined([group.apply for group in self.groups], p).reshape(self.shape)

    def apply_rate(
        self, p: np.ndarray, d_omega: float = 1.0, d_sigma: float = 0.0, d_C: Sequence[Damping] | None = None
    ) -> np.ndarray:
        """Return dG p on this rank's pairs, (n_owned, 3, N_H): eq. (5.2); not for an adjoint.

        Local; of a whole disc collective.  dG is the rate of G for the rates ``d_omega`` of omega, ``d_sigma`` of a damping
        sigma M, ``d_C`` of each group's damping.
        """
        if d_omega == d_sigma == 0.0 and d_C is None:
            return np.zeros((self.model.owned.stop - self.model.owned.start, *self.shape[1:]))
        rates = self.model.flexibility_rates(self.omega, d_omega, d_sigma, d_C)
        terms = [group.dynamic(rate, p[:, group.group.columns]) for group, rate in zip(self.groups, rates)]
        return self.model.joined(terms).reshape(self.shape)

    def apply_transposed(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's part of G^T x for x (n_owned, 3, N_H), (3 n_active, N_H); to be summed over the ranks.

        Local; of a whole disc collective.  G^T is the transposed map of real coefficients, which is G^H for complex amplitudes.
        """
        return self._joined([group.apply_adjoint for group in self.groups], x.reshape(-1, x.shape[-1]))

    def adjoint(self) -> ReceptanceColumns:
        """Return the columns of the transpose of G as a map of real coefficients.  Local."""
        other = copy(self)
        other.groups = [group.adjoint() for group in self.groups]
        return other

    # -- the block between the active pairs ------------------------------------------------------------------------

    def blocks(self, chosen: np.ndarray | None = None, least: float = 0.0) -> Iterator[np.ndarray]:
        """Return G_n between the active pairs for each harmonic of the set, (3 n_active, 3 n_active), complex [m/N].

        Collective: one gather for each group, before the first block.  With ``chosen``, ascending numbers (m,) among the active
        pairs, only between these pairs: (3 m, 3 m); ``least`` is that of :meth:`GroupColumns.dynamic_block`.
        """
        part, rows = np.arange(3 * len(self.active)), self.rows
        if chosen is not None:
            part, rows = rows_of(chosen), rows_of(self._owned(self.active[chosen]))
        static = [group.static_block(part, rows) for group in self.groups]
        if self.model.comm.size > 1:
            static = [np.concatenate(self.model.comm.allgather(rows)) for rows in static]  # rank order is row order
        at = (self.model.index_of(n) for n in self.model.harmonics.chosen)
        return (static[k] + self.groups[k].dynamic_block(i, part, least) for k, i in at)

    def moved_by(self, chosen: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return G_n p_n on this rank's active pairs, complex (n_harmonics, 3 n_active_owned, k) [m].  Local.

        ``p`` (m, n_harmonics, 3, k) [N] are the amplitudes of forces on the pairs ``chosen`` (m,) among the active ones.
        """
        rows, forces = rows_of(chosen), p.swapaxes(0, 1).reshape(p.shape[1], -1, p.shape[3]).astype(complex)
        static = [group.static_block(rows, self.rows) for group in self.groups]
        owned = slice(*np.searchsorted(self.active, [self.model.owned.start, self.model.owned.stop]) * 3)
        moved = np.empty((len(forces), len(self.rows), p.shape[3]), dtype=complex)
        for j, (force, n) in enumerate(zip(forces, self.model.harmonics.chosen)):
            k, i = self.model.index_of(n)
            R, block = self.groups[k].R_active, static[k]
            moved[j] = block @ force if np.iscomplexobj(block) else (block @ force.view(float)).view(complex)
            moved[j] += self.groups[k].c.between(R[owned], i, (R[rows].conj().T @ force).conj().T)
        return moved

    def static_coupling(self, pair: int, chosen: np.ndarray) -> np.ndarray:
        """Return the size of the static motion of some of the active pairs under forces on one active ``pair``, (m,).

        Collective: one gather.  ``chosen`` (m,) are ascending numbers among the active pairs; the first group is used for all.
        """
        rows = rows_of(self._owned(self.active[chosen]))
        block = self.groups[0].static_block(rows_of(np.array([pair])), rows).T  # (3, 3 m_owned)
        size = np.linalg.norm(block.reshape(3, -1, 3), axis=(0, 2))
        return size if self.model.comm.size == 1 else np.concatenate(self.model.comm.allgather(size))  # rank order is row order

    def matrix(self) -> np.ndarray:
        """Return G between the active pairs, all harmonics, (3 n_active N_H, 3 n_active N_H) [m/N].  Collective: see ``blocks``.

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
    """Columns and rows of G_n(omega) of active pairs, in single or double precision.

    Forces have the unit 1 / ``unit`` [N], the same on all ranks, so that single precision neither overflows nor underflows,
    independent of the units of the scene.  Collective on the model's communicator.
    """

    def __init__(self, G: ReceptanceColumns, precision: type):
        self.precision, self.n_rows = precision, len(G.rows)
        largest = max(group.largest for group in G.groups)
        self.unit = max(G.model.comm.allgather(largest)) or 1.0  # m/N
        size = G.model.comm.size
        self._parts = [_product_class(groups, size)(groups, G.rows, self.unit, precision) for groups in _grouped(G)]
        self.move_to(G)

    def move_to(self, G: ReceptanceColumns) -> None:
        """Update to the frequency of ``G``, which has the same pairs.  Local."""
        for part, groups in zip(self._parts, _grouped(G)):
            part.move_to(groups, self.unit)

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p, (3 m, N_H) [m], for p (3 n_active, N_H) in units of 1 / ``unit`` [N]."""
        if len(self._parts) == 1:
            return self._parts[0].apply(p)
        motion = np.empty((self.n_rows, p.shape[1]))
        for part in self._parts:
            motion[:, part.coefficients] = part.apply(p[:, part.coefficients])
        return motion

    def apply_to_several(self, p: np.ndarray) -> np.ndarray:
        """Return G p for several forces at once, (n, 3 m, N_H) [m], for p (n, 3 n_active, N_H) in these units."""
        p = p.astype(self.precision, copy=False)
        if len(self._parts) == 1:
            return self._parts[0].apply_to_several(p)
        motion = np.empty((len(p), self.n_rows, p.shape[2]))
        for part in self._parts:
            motion[..., part.coefficients] = part.apply_to_several(p[..., part.coefficients])
        return motion

    def in_units(self, P: np.ndarray) -> np.ndarray:
        """Return tangents P [N/m] scaled to forces in units of 1 / ``unit``, in the precision of the columns.  Local."""
        unitless: np.ndarray = np.empty_like(P, dtype=self.precision)
        return np.multiply(P, self.unit, out=unitless, casting="same_kind")


def _grouped(G: ReceptanceColumns) -> list[list[GroupColumns]]:
    """Return the groups whose products are computed together: each real group alone, all complex groups."""
    complex_groups = [group for group in G.groups if group.is_complex]
    return [[group] for group in G.groups if not group.is_complex] + ([complex_groups] if complex_groups else [])


def _product_class(groups: list[GroupColumns], n_ranks: int) -> type[_RealGroup | _ComplexGroups | _SectorsGroup]:
    """Return the kind of products of some groups with the fewest of them, if each rank has as many active pairs."""
    first, n_active = groups[0], 3 * len(groups[0].active)
    n_dense = _n_products(n_active, n_active // n_ranks, first.R_owned.shape[1])
    if isinstance(first, SectorColumns) and first.products.n_products(n_ranks) < n_dense:
        return _SectorsGroup
    return _ComplexGroups if first.is_complex else _RealGroup


class _SectorsGroup:
    """The columns of a whole disc, multiplied by transforms over its sectors."""

    def __init__(self, groups: list[GroupColumns], rows: np.ndarray, unit: float, precision: type):
        (G,) = groups
        assert isinstance(G, SectorColumns)
        self.coefficients, self.products = G.group.columns, G.products.in_precision(precision)
        self.rows_active, self.rows_owned = G.rows_active, G.rows_owned.start + rows
        self.scale = precision(G.products.unit / unit)

    def move_to(self, groups: list[GroupColumns], unit: float) -> None:
        self.flexibility = self.products.flexibility(groups[0].c)

    def apply(self, p: np.ndarray) -> np.ndarray:
        return self.apply_to_several(p[None])[0]

    def apply_to_several(self, p: np.ndarray) -> np.ndarray:
        forces = np.zeros((self.products.n_rows, len(p), p.shape[2]), dtype=self.products.Y.dtype)
        forces[self.rows_active] = p.swapaxes(0, 1)
        return self.scale * self.products.apply(forces, self.flexibility)[self.rows_owned].swapaxes(0, 1)


class _RealGroup:
    """The columns of a real group: static columns followed by modes, multiplied by compiled products."""

    c: Flexibility  # without unit

    def __init__(self, groups: list[GroupColumns], rows: np.ndarray, unit: float, precision: type):
        (G,) = groups
        self.harmonics, self.n_rows, n_modes = G.group.harmonics, len(rows), G.R_active.shape[1]
        self.N_H, self.coefficients = self.harmonics.n_coefficients, G.group.columns
        self.R_unit = _largest(G.R_active)  # kg^-1/2
        self.columns: np.ndarray = np.empty((len(G.R_active), self.n_rows + n_modes), dtype=precision)
        G.G_static.write_columns(rows, unit, self.columns[:, : self.n_rows])
        self.columns[:, self.n_rows :] = G.R_active / self.R_unit
        self._rows = Rows.of(self.columns)
        self.R_rows: np.ndarray = np.ascontiguousarray(G.R_owned[rows].T / self.R_unit, dtype=precision)  # (n_modes, 3 m)
        self.cosines = np.array([self.harmonics.columns(n).start for n in self.harmonics.chosen], dtype=np.intp)

    def move_to(self, groups: list[GroupColumns], unit: float) -> None:
        self.c = Flexibility(groups[0].c.c * self.R_unit * (self.R_unit / unit))

    def apply(self, p: np.ndarray) -> np.ndarray:
        return self._with_modal_response(self._rows.combined(p)).T

    def apply_to_several(self, p: np.ndarray) -> np.ndarray:
        n, rows, N_H = p.shape
        product = self._with_modal_response(p.transpose(0, 2, 1).reshape(n * N_H, rows) @ self.columns)
        return product.reshape(n, N_H, self.n_rows).swapaxes(1, 2)

    def _with_modal_response(self, product: np.ndarray) -> np.ndarray:
        """Return the pairs' columns of a product (n N_H, 3 m + n_modes), with the response of the modes to their modal forces."""
        if self.c.couples_modes:
            forces = product[:, self.n_rows :].reshape(-1, self.N_H, product.shape[1] - self.n_rows)
            eta = self.c.apply(np.moveaxis(forces, 2, 0).astype(float))  # (n_modes, n, N_H)
            product.reshape(-1, self.N_H, product.shape[1])[:, :, : self.n_rows] += np.moveaxis(eta, 0, 2) @ self.R_rows
        else:
            answer(product, self.R_rows, self.c.c, self.cosines, self.harmonics.has_mean, self.N_H, self.n_rows)
        return product[:, : self.n_rows]


class _ComplexGroups:
    """The columns of all complex groups (g,), multiplied together by complex products of NumPy.

    A group with fewer harmonics than another repeats its last one, a group with fewer modes has further ones that vanish.
    """

    def __init__(self, groups: list[GroupColumns], rows: np.ndarray, unit: float, precision: type):
        self.n_rows, kind = len(rows), np.complex64 if precision is np.float32 else np.complex128
        self.coefficients = np.concatenate([np.atleast_1d(np.r_[group.group.columns]) for group in groups])
        counts = np.array([len(group.group.harmonics) for group in groups])
        steps = np.arange(counts.max())
        self.amplitudes = (np.cumsum(counts) - counts)[:, None] + np.minimum(steps, counts[:, None] - 1)  # (g, h) places in p
        self.first_places = np.flatnonzero(steps < counts[:, None])  # of the harmonics in (g h,)
        self.R_units = [_largest(group.R_active) for group in groups]  # kg^-1/2
        n_modes = max(group.R_active.shape[1] for group in groups)
        self.columns: np.ndarray = np.empty((len(groups), len(groups[0].R_active), self.n_rows + n_modes), dtype=kind)
        self.R_rows: np.ndarray = np.zeros((len(groups), n_modes, self.n_rows), dtype=kind)
        for columns, R_rows, group, R_unit in zip(self.columns, self.R_rows, groups, self.R_units):
            m = group.R_active.shape[1]
            group.G_static.write_columns(rows, unit, columns[:, : self.n_rows])
            columns[:, self.n_rows : self.n_rows + m] = group.R_active.conj() / R_unit
            columns[:, self.n_rows + m :] = 0.0
            R_rows[:m] = group.R_owned[rows].T / R_unit

    def move_to(self, groups: list[GroupColumns], unit: float) -> None:
        (g, h), m = self.amplitudes.shape, self.R_rows.shape[1]
        self.couple = any(group.c.couples_modes for group in groups)
        self.c: np.ndarray = np.zeros((g, h, m, m) if self.couple else (g, h, m), dtype=self.columns.dtype)
        for c, group, R_unit, places in zip(self.c, groups, self.R_units, self.amplitudes - self.amplitudes[:, :1]):
            of_group = (group.c.matrices if self.couple else group.c.c.T)[places] * (R_unit * (R_unit / unit))  # no unit
            c[tuple(map(slice, of_group.shape))] = of_group

    def apply(self, p: np.ndarray) -> np.ndarray:
        return self.apply_to_several(p[None])[0]

    def apply_to_several(self, p: np.ndarray) -> np.ndarray:
        (n, rows, N_H), (g, h), m = p.shape, self.amplitudes.shape, self.R_rows.shape[1]
        amplitudes = to_complex(p.reshape(n * rows, N_H)).reshape(n, rows, N_H // 2).transpose(2, 0, 1)
        product = amplitudes[self.amplitudes].astype(self.columns.dtype).reshape(g, h * n, rows) @ self.columns
        forces = product[..., self.n_rows :].reshape(g, h, n, m)
        eta = np.einsum("ghij,ghnj->ghni", self.c, forces) if self.couple else forces * self.c[:, :, None]
        motion = product[..., : self.n_rows] + eta.reshape(g, h * n, m) @ self.R_rows
        of_harmonics = motion.reshape(g * h, n, self.n_rows)[self.first_places].transpose(1, 2, 0)
        return to_real(of_harmonics.reshape(n * self.n_rows, N_H // 2), N_H).reshape(n, self.n_rows, N_H)


def _largest(R: np.ndarray) -> float:
    """Return the largest magnitude of participations, 1 if all vanish."""
    return float(np.abs(R).max(initial=0.0)) or 1.0
