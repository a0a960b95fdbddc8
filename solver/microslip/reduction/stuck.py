"""The structure with all pairs stuck, one object for each harmonic group; all methods start from it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ..assembly.real_form import complex_columns, real_columns, real_matrix
from ..assembly.system import System
from ..guards.memory import refuse_beyond
from ..linear.dense import column_norms, diagonal_owned, gram, multiply
from ..linear.factor import Factor
from ..linear.joint_springs import Linearised
from ..linear.rigid_modes import RigidModes
from ..mesh.data import ContactPairs, Mesh
from ..messages.errors import CaseError
from ..modes.constraint import RowSums, static_columns
from ..modes.eigen import Modes, conjugated, first_of, is_complete, lowest_modes
from ..modes.shift_invert import ModeSearch
from ..modes.user_order import in_user_order
from ..parallel.ownership import rows_of, split_evenly
from ..receptance.modes import ProjectedModes
from ..receptance.observed import Observed
from ..receptance.per_group import PerGroup, only_group
from ..receptance.rigid_motion import RigidMotion
from ..receptance.static_columns import BATCH, FROM_DISK, StaticColumns
from ..receptance.static_response import StaticResponse

if TYPE_CHECKING:
    from typing import Self

    from mpi4py import MPI
    from petsc4py import PETSc

_CHECKED_FROM = 1e8  # bytes of columns from which the available memory is checked first
_COUPLED = 1e-7  # of a damping matrix: less of it that couples rigid-body motion to vibration is rounding
_FEWER = "fewer pairs slip at lower [response] levels; more ranks on more machines hold more of them"


@dataclass(frozen=True, eq=False)
class Factored:
    """The parts of a stuck structure that are as large as its mesh."""

    linearised: Linearised  # K_L, M, and the factor of K_L
    modes: Modes  # all computed modes
    mesh: Mesh | None = None  # rank 0 only; None for matrices whose rows do not belong to nodes


ModesOf = Callable[[Linearised], Modes]  # computes or restores the modes of a factored structure; collective


class OnDemand:
    """The large parts of a structure, computed on demand.

    Parameters
    ----------
    make : collective
    is_stored : whether they are stored once computed; otherwise ``make`` is called each time
    """

    def __init__(self, make: Callable[[], Factored], is_stored: bool = True):
        self._make, self._is_stored = make, is_stored
        self.value: Factored | None = None  # None: not computed

    @classmethod
    def of(cls, factored: Factored) -> OnDemand:
        """Return existing parts.  Local."""
        new = cls(lambda: factored)
        new.value = factored
        return new

    def __call__(self) -> Factored:
        """Return the parts.  Collective if they must be computed."""
        if self.value is not None:
            return self.value
        factored = self._make()
        if self._is_stored:
            self.value = factored
        return factored

    def pair_columns(self, comm: MPI.Comm, row_sums: np.ndarray, is_complex: bool) -> StaticColumns:
        """Return the columns of R K_L^-1 R^H, for which the parts are computed when a pair needs one.  Local."""
        return pair_columns(lambda: self().linearised, comm, row_sums, is_complex=is_complex)


@dataclass(frozen=True, eq=False, kw_only=True)
class StuckStructure:
    """The structure of one group of harmonics with all pairs stuck.

    The projections on pairs, loads and outputs are small arrays, the same on every rank except the static columns.  Matrices,
    factor and modes over all DOFs come from ``factored``: a structure restored from a file computes them on demand.

    For a disc at one nodal diameter all quantities may be complex; matrices and factor are then in real form
    (assembly/real_form.py), and vectors over the DOFs complex.  The group of the opposite direction has the conjugates.
    """

    comm: MPI.Comm
    n_dof: int
    pairs: ContactPairs
    statics: StaticResponse
    projected: ProjectedModes  # all computed modes, of which the first ``n_modes`` are used
    n_modes: int
    n_proved: int  # number of the first computed modes that are proved to be the lowest
    observed: Observed | None  # map from rows to outputs; None: all are displacements
    factored: OnDemand
    rigid: RigidMotion | None = None  # of a structure without supports, with the damping of its dampers only
    groups: PerGroup[StuckStructure] | None = None  # of all harmonics; None: this structure for every harmonic
    group: Hashable = only_group(0)  # the group of this structure
    conjugate: Hashable | None = None  # the group with the conjugate matrices; None: none, or this one
    is_conjugate: bool = False  # whether the matrices and the factor are those of the conjugate group
    results: dict[Hashable, Any] = field(default_factory=dict, repr=False)  # cached results of this structure, by key

    @classmethod
    def of(
        cls,
        linearised: Linearised,
        pairs: ContactPairs,
        statics: StaticResponse,
        modes: Modes | None = None,
        mesh: Mesh | None = None,
        **more: Any,
    ) -> Self:
        """Return the stuck structure from a factor and modes, if there are any.  Collective: one or two sums."""
        system = linearised.maps
        if modes is None:
            n_owned = system.rows.stop - system.rows.start
            modes = Modes(np.empty(0), np.empty((n_owned, 0), dtype=complex if system.is_complex else float))
        return cls(
            comm=system.comm,
            n_dof=system.n_dof,
            pairs=pairs,
            statics=statics,
            projected=project_modes(system, modes.omega_n, modes.phi_owned),
            n_modes=len(modes.omega_n),
            n_proved=modes.n_proved,
            observed=observed(system),
            factored=OnDemand.of(Factored(linearised, modes, mesh)),
            rigid=project_rigid(system, linearised.factor.rigid),
            **more,
        )

    @property
    def per_group(self) -> PerGroup[StuckStructure]:
        """The stuck structure of each group of harmonics.  Local."""
        groups = self.groups
        if groups is None:
            return PerGroup.single(self)

        def of(group: Hashable) -> StuckStructure:
            if group == self.group:
                return self
            if group == self.conjugate and not groups.knows(group):  # it would be made of this one, which is being made itself
                return self.of_conjugate(group)
            return groups.of_group(group)

        return PerGroup(of, groups.group_of, groups.groups)

    def with_harmonics_of(self, harmonics: Iterable[int]) -> list[StuckStructure]:
        """Return this structure and that of the conjugate matrices, as far as a harmonic belongs to them.  Local."""
        wanted = set(map(self.per_group.group_of, harmonics))
        both = [self] if self.group in wanted else []
        return [*both, self.of_conjugate(self.conjugate)] if self.conjugate is not None and self.conjugate in wanted else both

    @property
    def computed_groups(self) -> dict[Hashable, StuckStructure]:
        """The structures of the groups computed so far, including this one, by group.  Local."""
        others = () if self.groups is None else self.groups.computed
        return {stuck.group: stuck for stuck in others} | {self.group: self}

    def has(self, n: int) -> bool:
        """Return whether harmonic n belongs to the group of this structure.  Local."""
        return self.per_group.group_of(n) == self.group

    @property
    def omega_n(self) -> np.ndarray:
        """Natural frequencies of the modes in use, (n_modes,) [rad/s]."""
        return self.projected.omega_n[: self.n_modes]

    @property
    def excited(self) -> StuckStructure:
        """The structure to whose modes mode numbers in a response range and in results refer."""
        return self

    @property
    def n_elastic(self) -> int:
        """The number of all elastic modes, including those without mass."""
        return self.n_dof - (0 if self.rigid is None else len(self.rigid.b))

    @property
    def linearised(self) -> Linearised:
        """The matrices and the factor; collective if they must be computed first."""
        return self.factored().linearised

    @property
    def system(self) -> System:
        """The structure's matrices and maps; collective if they must be computed first."""
        maps = self.linearised.maps
        return maps.with_conjugate_maps() if self.is_conjugate else maps

    @property
    def is_complex(self) -> bool:
        """Whether vectors over the DOFs, and their projections, are complex."""
        return self.statics.G_static.is_complex

    @property
    def modes(self) -> Modes:
        """The modes in use, over all DOFs; collective if they must be computed first."""
        return first_of(self.factored().modes, self.n_modes)

    @property
    def n_computed(self) -> int:
        """Number of computed modes, of which the first ``n_modes`` are in use."""
        return len(self.projected.omega_n)

    def using(self, n_modes: int) -> Self:
        """Return the structure with the first ``n_modes`` computed modes in use.  Local."""
        return replace(self, n_modes=n_modes)

    # -- matrices and factor; collective ---------------------------------------------------------------------------

    @property
    def K_L(self) -> PETSc.Mat:
        """The stiffness with all pairs stuck; collective if it must be computed first."""
        return self.linearised.K_L

    @property
    def M(self) -> PETSc.Mat:
        """The mass matrix; collective if it must be computed first."""
        return self.linearised.M

    @property
    def rows(self) -> slice:
        """Degrees of freedom that this rank owns."""
        return self.linearised.maps.rows

    def product(self, A: PETSc.Mat, X_owned: np.ndarray) -> np.ndarray:
        """Return this rank's rows of A X, (n_owned, q), for one of the structure's matrices A and X real or complex."""
        if self.is_complex:
            return self._conjugated(multiply(A, self._conjugated(X_owned.astype(complex, copy=False))))
        if not np.iscomplexobj(X_owned):
            return multiply(A, X_owned)
        real, imaginary = np.hsplit(multiply(A, np.hstack([X_owned.real, X_owned.imag])), 2)
        return real + 1j * imaginary

    def _conjugated(self, X: np.ndarray) -> np.ndarray:
        """Return X, or its conjugate if the matrices are those of the conjugate group.  Local."""
        return X.conj() if self.is_conjugate else X

    @property
    def masses(self) -> np.ndarray:
        """Diagonal of M, this rank's rows, (n_owned,) [kg]."""
        diagonal = diagonal_owned(self.M)
        return diagonal[0::2] if self.is_complex else diagonal

    @property
    def factor(self) -> Factor:
        """The factor of K_L."""
        return self.linearised.factor

    def in_user_order(self, owned: np.ndarray) -> np.ndarray | None:
        """Return fields (n_owned, m) in the order of the user's nodes, on rank 0: see modes/user_order.py."""
        if not self.is_complex:
            return in_user_order(self.linearised, owned)
        whole = in_user_order(self.linearised, real_columns(owned))
        return None if whole is None else complex_columns(whole)

    def load_forces(self, f: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the forces of loads, (n_owned, q), for their coefficients f (n_loads, q)."""
        return self.system.loads.tocsr()[self.rows] @ f

    def pair_forces(self, p: np.ndarray) -> np.ndarray:
        """Return this rank's rows of R^H p, (n_owned, q), for forces p of all pairs (3 n_pairs, q)."""
        return self.system.R.conj(copy=False).T.tocsr()[self.rows] @ p

    def participation(self, forces_owned: np.ndarray) -> np.ndarray:
        """Return phi^H times columns (n_owned, q) on every rank, (n_modes, q): one sum."""
        return gram(self.comm, self.modes.phi_owned, forces_owned)

    def solve(self, forces_owned: np.ndarray) -> np.ndarray:
        """Return K_L^-1 times columns, real or complex, (n_owned, q) each, this rank's rows."""
        if self.is_complex:
            forces = self._conjugated(forces_owned.astype(complex, copy=False))
            return self._conjugated(complex_columns(self.factor.solve(real_columns(forces))))
        if not np.iscomplexobj(forces_owned):
            return self.factor.solve(forces_owned)
        q = forces_owned.shape[1]
        parts = self.factor.solve(np.hstack([forces_owned.real, forces_owned.imag]))
        return parts[:, :q] + 1j * parts[:, q:]

    def lowest_modes(
        self, n_modes: int, verify: bool = True, allows_fewer: bool = False, search: ModeSearch | None = None
    ) -> Modes:
        """Return the lowest modes; arguments and errors as in :func:`~microslip.modes.eigen.lowest_modes`."""
        modes = lowest_modes(self.linearised, n_modes, verify, allows_fewer, search)
        return conjugated(modes) if self.is_conjugate else modes

    def with_lowest(self, n_modes: int, verify: bool = True, allows_fewer: bool = False) -> Self:
        """Return the structure with its lowest ``n_modes`` in use: computed already, or by :meth:`lowest_modes`.

        Collective.
        """
        if n_modes <= self.n_computed:
            structure = self.using_proved(n_modes) if verify else self.using(n_modes)
            if structure is not None:
                return structure
        return self.with_modes(self.lowest_modes(n_modes, verify, allows_fewer))

    def using_proved(self, n_modes: int) -> Self | None:
        """Return the structure with its first ``n_modes`` in use, None if they cannot be proved to be the lowest.

        Collective: a factorisation, unless they are already proved.
        """
        if n_modes <= self.n_proved:
            return self.using(n_modes)
        factored = self.factored()
        if not is_complete(factored.linearised, factored.modes, n_modes):
            return None
        return replace(self, n_modes=n_modes, n_proved=factored.modes.n_proved)

    def with_modes(self, modes: Modes) -> Self:
        """Return the same structure with other modes.  Collective: one sum, with a damping matrix two."""
        projected = project_modes(self.linearised.maps, modes.omega_n, self._conjugated(modes.phi_owned))
        projected, factored = projected.conjugated() if self.is_conjugate else projected, replace(self.factored(), modes=modes)
        n_modes = len(modes.omega_n)
        return replace(self, projected=projected, n_modes=n_modes, n_proved=modes.n_proved, factored=OnDemand.of(factored))

    def of_conjugate(self, group: Hashable) -> Self:
        """Return the structure of the group with the conjugate matrices, without memory of their size.  Local."""

        def factored() -> Factored:
            here = self.factored()
            return replace(here, modes=conjugated(here.modes))

        return replace(
            self,
            projected=self.projected.conjugated(),
            statics=self.statics.conjugated(),
            factored=OnDemand(factored, is_stored=False),
            group=group,
            conjugate=self.group,
            is_conjugate=not self.is_conjugate,
            results={},
        )

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the result of ``make``, computed once for each key.  Collective if ``make`` is."""
        if key not in self.results:
            self.results[key] = make()
        return self.results[key]


def static_response(linearised: Linearised) -> StaticResponse:
    """Return the static response: n_loads + n_outputs + 1 solves now, solves of pairs when they first slip or open.

    Collective on the system's communicator.  One solve has random forces on all pairs, for the check of their columns.
    """
    system = linearised.maps
    n_rows, n_out, n_load = system.R.shape[0], system.outputs.shape[0], system.loads.shape[1]
    weighted = sp.csc_matrix(system.R.conj().T @ random_weights(n_rows)).T
    forces = sp.hstack([system.loads, system.outputs.conj().T, weighted], format="csc")
    product = flexibility_between(linearised, projection_rows(system), forces)
    static, of_weights = np.split(product, [n_load + n_out], axis=1)
    sums, is_on_disk = of_weights[:n_rows, 0].copy(), linearised.factor.info.get("out_of_core")
    batch = FROM_DISK if is_on_disk else BATCH
    return StaticResponse(
        G_static=pair_columns(lambda: linearised, system.comm, sums, batch, system.is_complex),
        du_static=static[:n_rows, :n_load].copy(),
        out_static=static[n_rows : n_rows + n_out, :n_load].copy(),
        out_R=static[:n_rows, n_load:].conj().T.copy(),
        load_static=static[n_rows + n_out :, :n_load].copy(),
        outputs_static=np.diag(static[n_rows : n_rows + n_out, n_load:]).real.copy(),
        row_sums=sums,
    )


def flexibility_between(
    linearised: Linearised,
    left: sp.csr_matrix,
    right: sp.csc_matrix,
    row_ranges: np.ndarray | None = None,
    known: RowSums | None = None,
) -> np.ndarray:
    """Return left @ K_L^-1 @ right as :func:`~microslip.modes.constraint.static_columns`, also for complex matrices.

    Collective: one solve per column, also in real form.
    """
    if not linearised.maps.is_complex:
        return static_columns(linearised, left, right, row_ranges, known)
    ranges = None if row_ranges is None else 2 * row_ranges
    if known is not None:
        known = RowSums(np.repeat(known.weights, 2), known.sums.real + known.sums.imag)
    return complex_columns(static_columns(linearised, real_matrix(left), real_matrix(right).tocsc()[:, 0::2], ranges, known))


def random_weights(n_rows: int) -> np.ndarray:
    """Return the weights of the row sums for the check of static columns, (n_rows,).  Local."""
    return np.random.default_rng(n_rows).choice([-1.0, 1.0], n_rows)


def projection_rows(system: System) -> sp.csr_matrix:
    """Return the projection on pairs, outputs and loads, (3 n_pairs + n_outputs + n_loads, n_dof)."""
    return sp.vstack([system.R, system.outputs, system.loads.conj().T], format="csr")


def project_modes(system: System, omega_n: np.ndarray, phi_owned: np.ndarray) -> ProjectedModes:
    """Return modes projected on pairs, loads and outputs.  Collective: one sum, with a damping matrix two."""
    participation = owned_product(projection_rows(system), phi_owned, system)
    R_phi, o, b_H = np.split(participation, np.cumsum([system.R.shape[0], system.outputs.shape[0]]))
    C = None
    if system.C is not None and len(omega_n) > 0:
        C = gram(system.comm, phi_owned, multiply(system.C, phi_owned))
        C = 0.5 * (C + C.conj().T)
    return ProjectedModes(omega_n, R_phi, b_H.conj().T.copy(), o, C)


def project_rigid(system: System, modes: RigidModes | None) -> RigidMotion | None:
    """Return the rigid-body modes projected on loads and outputs, None if there are none.

    Collective: one sum, with a damping matrix two.

    Raises
    ------
    CaseError : dampers connect the structure to ground; on every rank
    """
    if modes is None:
        return None
    n_out, C = system.outputs.shape[0], np.zeros((modes.n, modes.n))
    o, b_T = np.split(owned_product(sp.vstack([system.outputs, system.loads.T], format="csr"), modes.phi_owned, system), [n_out])
    if system.C is not None:
        C_phi_owned = multiply(system.C, modes.phi_owned)
        C = gram(system.comm, modes.phi_owned, C_phi_owned)
        left, size = column_norms(system.comm, np.hstack([C_phi_owned - modes.M_phi_owned @ C, modes.phi_owned])).reshape(2, -1)
        if (left > _COUPLED * system.C.norm() * size).any():
            raise CaseError(
                "dampers to ground on a structure without supports: they couple its rigid-body motion to its vibration, which is "
                "not foreseen; connect them to the structure on both sides, or add [[supports]] or springs"
            )
    return RigidMotion(b_T.T.copy(), o, 0.5 * (C + C.T))


def owned_product(rows: sp.csr_matrix, phi_owned: np.ndarray, system: System) -> np.ndarray:
    """Return rows @ phi on every rank, (n_rows, n_phi).  Collective: one sum."""
    return system.comm.allreduce(rows[:, system.rows] @ phi_owned)


def observed(system: System) -> Observed | None:
    """Return the map from rows to outputs; None if all are displacements.  Local."""
    parts = system.output_orders, system.output_pairs, system.output_base
    if all(part is None for part in parts):
        return None
    n_outputs, (n_rows, n_loads) = system.outputs.shape[0], (system.R.shape[0], system.loads.shape[1])
    empty = np.zeros(n_outputs, dtype=int), np.zeros((n_outputs, n_rows)), np.zeros((n_outputs, n_loads))
    return Observed(*(none if part is None else part for part, none in zip(parts, empty)))


def pair_columns(
    linearised: Callable[[], Linearised], comm: MPI.Comm, row_sums: np.ndarray, batch: int = BATCH, is_complex: bool = False
) -> StaticColumns:
    """Return the columns of R K_L^-1 R^H, which the factor computes on demand.  Local.

    ``row_sums`` (3 n_pairs,) are G_static times the random weights, for the check of the columns.  Without enough memory for
    columns, their computation raises ResourceError on every rank.
    """
    n_rows = len(row_sums)
    pair_ranges, sums = split_evenly(n_rows // 3, comm.size), RowSums(random_weights(n_rows), row_sums.conj())
    n_owned = int(pair_ranges[comm.rank + 1] - pair_ranges[comm.rank])

    def solve(pairs: np.ndarray) -> np.ndarray:
        chosen, R = rows_of(pairs), linearised().maps.R
        if 8.0 * len(chosen) * n_rows > _CHECKED_FROM:
            refuse_beyond(comm, 16.0 * len(chosen) * 3 * n_owned, f"static columns of {len(pairs)} more pairs", _FEWER)
        return flexibility_between(linearised(), R, R.conj().T.tocsc()[:, chosen], 3 * pair_ranges, sums.of(chosen))

    return StaticColumns(n_rows // 3, n_owned, solve, batch, is_complex)
