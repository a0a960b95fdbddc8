"""What every method starts from: the structure with all pairs stuck, one object for each group of harmonics."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ..assembly.system import System
from ..guards.memory import refuse_beyond
from ..linear.dense import gram, multiply
from ..linear.factor import Factor
from ..linear.joint_springs import Linearised
from ..mesh.data import ContactPairs
from ..modes.constraint import RowSums, static_columns
from ..modes.eigen import Modes, is_complete, lowest_modes
from ..modes.rayleigh import sharpened
from ..modes.shift_invert import ModeSearch
from ..modes.user_order import in_user_order
from ..parallel.ownership import rows_of, split_evenly
from ..receptance.modes import SeenModes
from ..receptance.observed import Observed
from ..receptance.per_group import PerGroup
from ..receptance.static_columns import BATCH, FROM_DISK, StaticColumns
from ..receptance.static_response import StaticResponse

if TYPE_CHECKING:
    from typing import Self

    from mpi4py import MPI
    from petsc4py import PETSc

_ASKED_FROM = 1e8  # bytes of columns from which memory is asked for before they are solved for
_FEWER = "fewer pairs slip at lower [response] levels; more ranks on more machines hold more of them"


@dataclass(frozen=True, eq=False)
class Factored:
    """What of a stuck structure is as large as its mesh."""

    linearised: Linearised  # K_L, M, and the factor of K_L
    modes: Modes


@dataclass(frozen=True, eq=False, kw_only=True)
class StuckStructure:
    """The structure of one group of harmonics with all pairs stuck.

    What pairs, loads and outputs see of it is held as small arrays, the same on every rank but for the static columns.  Matrices,
    factor and modes over all DOFs come from ``factored``: at once where they were made, and made when they are first needed where
    the rest was read from disk.
    """

    comm: MPI.Comm
    n_dof: int
    pairs: ContactPairs
    statics: StaticResponse
    seen: SeenModes  # all that were computed; the first ``n_modes`` are used
    n_modes: int
    observed: Observed | None  # what makes outputs of their rows; None: all are displacements
    factored: Callable[[], Factored]  # collective
    groups: PerGroup[StuckStructure] | None = None  # of all harmonics; None: it is that of every harmonic itself
    kept: dict[Hashable, Any] = field(default_factory=dict, repr=False)  # what was made of it

    @classmethod
    def of(
        cls, linearised: Linearised, pairs: ContactPairs, statics: StaticResponse, modes: Modes | None = None, **more: Any
    ) -> Self:
        """Return the stuck structure of a factor and its modes, if there are any.  Collective: one sum or two."""
        system = linearised.system
        if modes is None:
            modes = Modes(np.empty(0), np.empty((linearised.K_L.getLocalSize()[0], 0)))
        computed, factored = modes.found or modes, Factored(linearised, modes)
        return cls(
            comm=system.comm,
            n_dof=system.n_dof,
            pairs=pairs,
            statics=statics,
            seen=seen_modes(system, computed.omega_n, computed.phi_owned),
            n_modes=len(modes.omega_n),
            observed=observed(system),
            factored=lambda: factored,
            **more,
        )

    @property
    def per_group(self) -> PerGroup[StuckStructure]:
        """The stuck structure of each group of harmonics.  Local."""
        return PerGroup.single(self) if self.groups is None else self.groups

    @property
    def omega_n(self) -> np.ndarray:
        """Natural frequencies of the modes used, (n_modes,) [rad/s]."""
        return self.seen.omega_n[: self.n_modes]

    @property
    def linearised(self) -> Linearised:
        """The matrices and the factor; collective where they must be made first."""
        return self.factored().linearised

    @property
    def system(self) -> System:
        """The structure's matrices and maps; collective where they must be made first."""
        return self.linearised.system

    @property
    def modes(self) -> Modes:
        """The modes used, over all DOFs; collective where they must be made first."""
        return self.factored().modes

    # -- what takes the factor; collective -------------------------------------------------------------------------

    @property
    def K_L(self) -> PETSc.Mat:
        return self.linearised.K_L

    @property
    def M(self) -> PETSc.Mat:
        return self.linearised.M

    @property
    def rows(self) -> slice:
        """Rows of K_L that this rank owns."""
        return slice(*self.K_L.getOwnershipRange())

    @property
    def factor(self) -> Factor:
        """That of K_L."""
        return self.linearised.factor

    def in_user_order(self, owned: np.ndarray) -> np.ndarray | None:
        """Return fields (n_owned, m) in the order of the user's nodes, on rank 0: see modes/user_order.py."""
        return in_user_order(self.linearised, owned)

    def solve(self, forces_owned: np.ndarray) -> np.ndarray:
        """Return K_L^-1 times columns, (n_owned, m) both, this rank's rows."""
        return self.factor.solve(forces_owned)

    def solve_sparse(self, forces: sp.csc_matrix) -> np.ndarray:
        """Return K_L^-1 times sparse columns (n_dof, m), the same on every rank: this rank's rows (n_owned, m)."""
        return self.factor.solve_sparse(forces)

    def search(self) -> ModeSearch:
        """Return a search for modes that goes on where it ended."""
        return ModeSearch(self.linearised)

    def lowest_modes(
        self, n_modes: int, verify: bool = True, fewer_will_do: bool = False, search: ModeSearch | None = None
    ) -> Modes:
        """Return the lowest modes, see :func:`~microslip.modes.eigen.lowest_modes`; it raises what that does."""
        return lowest_modes(self.linearised, n_modes, verify, fewer_will_do, search)

    def is_complete(self, modes: Modes, n_modes: int) -> bool:
        """Return whether the first ``n_modes`` of some modes are proved to be the lowest."""
        return is_complete(self.linearised, modes, n_modes)

    def sharpened(self, eigenvalues: np.ndarray, phi_owned: np.ndarray) -> np.ndarray:
        """Return the eigenvalues of modes again, as exact as their vectors allow: :func:`~microslip.modes.rayleigh.sharpened`."""
        return sharpened(self.linearised, eigenvalues, phi_owned)

    def bring_K_back(self) -> None:
        """Make ``system.K`` again, where it was freed."""
        self.linearised.bring_K_back()

    def with_modes(self, modes: Modes) -> Self:
        """Return the same structure with other modes.  Collective: one sum, with a damping matrix another."""
        computed, factored = modes.found or modes, Factored(self.linearised, modes)
        seen = seen_modes(self.system, computed.omega_n, computed.phi_owned)
        return replace(self, seen=seen, n_modes=len(modes.omega_n), factored=lambda: factored)

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what ``make`` makes, made once for the same key.  Collective where ``make`` is."""
        if key not in self.kept:
            self.kept[key] = make()
        return self.kept[key]


def static_response(linearised: Linearised) -> StaticResponse:
    """Return the static response: n_loads + n_outputs + 1 solves now, those of the pairs when they first leave sticking.

    Collective on the system's communicator.  The further solve is of random forces on all pairs: by it their columns are checked.
    """
    system = linearised.system
    n_rows, n_out, n_load = system.R.shape[0], system.outputs.shape[0], system.loads.shape[1]
    signs = np.random.default_rng(n_rows).choice([-1.0, 1.0], n_rows)
    forces = sp.hstack([system.loads, system.outputs.T, sp.csc_matrix(system.R.T @ signs).T], format="csc")
    static, of_signs = np.split(static_columns(linearised, seen_rows(system), forces), [n_load + n_out], axis=1)
    return StaticResponse(
        G_static=pair_columns(linearised, RowSums(signs, of_signs[:n_rows, 0])),
        du_static=static[:n_rows, :n_load].copy(),
        out_static=static[n_rows : n_rows + n_out, :n_load].copy(),
        out_R=static[:n_rows, n_load:].T.copy(),
        load_static=static[n_rows + n_out :, :n_load].copy(),
        outputs_static=np.diag(static[n_rows : n_rows + n_out, n_load:]).copy(),
    )


def seen_rows(system: System) -> sp.csr_matrix:
    """Return the rows that are seen of a motion: of pairs, outputs and loads."""
    return sp.vstack([system.R, system.outputs, system.loads.T], format="csr")


def seen_modes(system: System, omega_n: np.ndarray, phi_owned: np.ndarray) -> SeenModes:
    """Return what pairs, loads and outputs see of modes.  Collective: one sum, with a damping matrix another."""
    participation = owned_product(seen_rows(system), phi_owned, system)
    R_phi, o, b_T = np.split(participation, np.cumsum([system.R.shape[0], system.outputs.shape[0]]))
    C = None
    if system.C is not None and len(omega_n) > 0:
        C = gram(system.comm, phi_owned, multiply(system.C, phi_owned))
        C = 0.5 * (C + C.T)
    return SeenModes(omega_n, R_phi, b_T.T.copy(), o, C)


def owned_product(rows: sp.csr_matrix, phi_owned: np.ndarray, system: System) -> np.ndarray:
    """Return rows @ phi on every rank, (n_rows, n_phi).  Collective: one sum."""
    first, last = system.M.getOwnershipRange()
    return system.comm.allreduce(rows[:, first:last] @ phi_owned)


def observed(system: System) -> Observed | None:
    """Return what makes outputs of their rows; None where all are displacements.  Local."""
    parts = system.output_orders, system.output_pairs, system.output_base
    if all(part is None for part in parts):
        return None
    n_outputs, (n_rows, n_loads) = system.outputs.shape[0], (system.R.shape[0], system.loads.shape[1])
    empty = np.zeros(n_outputs, dtype=int), np.zeros((n_outputs, n_rows)), np.zeros((n_outputs, n_loads))
    return Observed(*(none if part is None else part for part, none in zip(parts, empty)))


def pair_columns(linearised: Linearised, known: RowSums) -> StaticColumns:
    """Return the columns of R K_L^-1 R^T, to be solved for with the kept factor when they are needed.  Local.

    ``known`` are random sums of the rows of all of them.  Where there is no memory for them, that raises ResourceError on every
    rank.
    """
    R, comm = linearised.system.R, linearised.system.comm
    pair_ranges = split_evenly(R.shape[0] // 3, comm.size)
    R_T, n_owned = R.T.tocsc(), int(pair_ranges[comm.rank + 1] - pair_ranges[comm.rank])

    def solve(pairs: np.ndarray) -> np.ndarray:
        chosen = rows_of(pairs)
        if 8.0 * len(chosen) * R.shape[0] > _ASKED_FROM:
            refuse_beyond(comm, 16.0 * len(chosen) * 3 * n_owned, f"static columns of {len(pairs)} more pairs", _FEWER)
        return static_columns(linearised, R, R_T[:, chosen], 3 * pair_ranges, known.of(chosen))

    batch = FROM_DISK if linearised.factor.info.get("out_of_core") else BATCH
    return StaticColumns(R.shape[0] // 3, n_owned, solve, batch)
