"""What every method starts from: the structure with all pairs stuck, one object for each group of harmonics."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ..assembly.system import System
from ..fourier.amplitudes import to_complex, to_real
from ..guards.memory import refuse_beyond
from ..linear.dense import gram, multiply
from ..linear.factor import Factor
from ..linear.joint_springs import Linearised
from ..mesh.data import ContactPairs, Mesh
from ..modes.constraint import RowSums, static_columns
from ..modes.eigen import Modes, first_of, is_complete, lowest_modes
from ..modes.rayleigh import sharpened
from ..modes.shift_invert import ModeSearch
from ..modes.user_order import in_user_order
from ..parallel.ownership import rows_of, split_evenly
from ..receptance.modes import ProjectedModes
from ..receptance.observed import Observed
from ..receptance.per_group import PerGroup, only_group
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
    """The parts of a stuck structure that are as large as its mesh."""

    linearised: Linearised  # K_L, M, and the factor of K_L
    modes: Modes  # all that were computed
    mesh: Mesh | None = None  # rank 0 only; None of matrices whose rows belong to no nodes


class OnDemand:
    """The large parts of a structure, made when they are first needed.

    Parameters
    ----------
    make : collective
    is_stored : whether they are stored once they are made; else ``make`` is called each time
    """

    def __init__(self, make: Callable[[], Factored], is_stored: bool = True):
        self._make, self._is_stored = make, is_stored
        self.value: Factored | None = None  # None: they are not there

    @classmethod
    def of(cls, factored: Factored) -> OnDemand:
        """Return parts that are there.  Local."""
        new = cls(lambda: factored)
        new.value = factored
        return new

    def __call__(self) -> Factored:
        """Return the parts.  Collective where they are not there."""
        if self.value is not None:
            return self.value
        factored = self._make()
        if self._is_stored:
            self.value = factored
        return factored


@dataclass(frozen=True, eq=False, kw_only=True)
class StuckStructure:
    """The structure of one group of harmonics with all pairs stuck.

    What pairs, loads and outputs see of it is held as small arrays, the same on every rank but for the static columns.  Matrices,
    factor and modes over all DOFs come from ``factored``: a structure restored from a file makes them when they are first needed.
    """

    comm: MPI.Comm
    n_dof: int
    pairs: ContactPairs
    statics: StaticResponse
    projected: ProjectedModes  # all that were computed; the first ``n_modes`` are used
    n_modes: int
    n_proved: int  # of the modes computed: the first ones that are proved to be the lowest
    observed: Observed | None  # what makes outputs of their rows; None: all are displacements
    factored: OnDemand
    groups: PerGroup[StuckStructure] | None = None  # of all harmonics; None: it is that of every harmonic itself
    group: Hashable = only_group(0)  # its own
    results: dict[Hashable, Any] = field(default_factory=dict, repr=False)  # what was made of it

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
        """Return the stuck structure of a factor and its modes, if there are any.  Collective: one sum or two."""
        system = linearised.system
        if modes is None:
            modes = Modes(np.empty(0), np.empty((linearised.K_L.getLocalSize()[0], 0)))
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
            **more,
        )

    @property
    def per_group(self) -> PerGroup[StuckStructure]:
        """The stuck structure of each group of harmonics.  Local."""
        return PerGroup.single(self) if self.groups is None else self.groups

    @property
    def computed_groups(self) -> dict[Hashable, StuckStructure]:
        """The structures of the groups made so far, this one among them, by group.  Local."""
        return {self.group: self} | {stuck.group: stuck for stuck in self.per_group.computed}

    def has(self, n: int) -> bool:
        """Return whether harmonic n is one of its group.  Local."""
        return self.per_group.group_of(n) == self.group

    @property
    def omega_n(self) -> np.ndarray:
        """Natural frequencies of the modes used, (n_modes,) [rad/s]."""
        return self.projected.omega_n[: self.n_modes]

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
        return first_of(self.factored().modes, self.n_modes)

    @property
    def n_computed(self) -> int:
        """Modes computed, of which the first ones are used."""
        return len(self.projected.omega_n)

    def using(self, n_modes: int) -> Self:
        """Return the structure with the first ``n_modes`` of the modes computed in use.  Local."""
        return replace(self, n_modes=n_modes)

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

    def load_forces(self, f: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the forces of loads, (n_owned, q), for their coefficients f (n_loads, q)."""
        return self.system.loads.tocsr()[self.rows] @ f

    def pair_forces(self, p: np.ndarray) -> np.ndarray:
        """Return this rank's rows of R^H p, (n_owned, q), for forces p of all pairs (3 n_pairs, q)."""
        return self.system.R.conj(copy=False).T.tocsr()[self.rows] @ p

    def damping_forces(self, z: np.ndarray, n_omega: float, eta: float) -> np.ndarray:
        """Return this rank's rows of (n omega C + eta K) phi z, complex (n_owned, q), for modal motions z (n_modes, q)."""
        q, system = z.shape[1], self.system
        parts = np.concatenate([z.real, z.imag], axis=1)
        u_owned = self.modes.phi_owned @ parts
        Cu_owned = n_omega * multiply(system.C, u_owned) if system.C is not None else np.zeros_like(u_owned)
        if eta > 0.0:  # of K, without the springs of the joints
            springs = self.pairs.law.stiffness.reshape(-1, 1) * (self.projected.R_phi[:, : self.n_modes] @ parts)
            Cu_owned = Cu_owned + eta * (multiply(self.K_L, u_owned) - self.pair_forces(springs))
        return Cu_owned[:, :q] + 1j * Cu_owned[:, q:]

    def participation(self, forces_owned: np.ndarray) -> np.ndarray:
        """Return phi^H times columns (n_owned, q) on every rank, (n_modes, q): one sum."""
        phi_owned = self.modes.phi_owned
        return gram(self.comm, phi_owned.conj() if np.iscomplexobj(phi_owned) else phi_owned, forces_owned)

    def solve(self, forces_owned: np.ndarray) -> np.ndarray:
        """Return K_L^-1 times columns, real or complex, (n_owned, q) both, this rank's rows."""
        if not np.iscomplexobj(forces_owned):
            return self.factor.solve(forces_owned)
        q = forces_owned.shape[1]
        parts = self.factor.solve(np.hstack([forces_owned.real, forces_owned.imag]))
        return parts[:, :q] + 1j * parts[:, q:]

    def static_motions(self, at: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
        """Return K_L^-1 (f - R^H p), this rank's rows (n_owned, N_H) each, under coefficients f and p: all at once.

        Of a group with complex matrices there are two right-hand sides a harmonic and component of its forces.
        """
        is_complex = np.iscomplexobj(self.projected.R_phi)
        amplitudes = [(to_complex(f), to_complex(p)) if is_complex else (f, p) for f, p in at]
        forces = [self.load_forces(f) - self.pair_forces(p) for f, p in amplitudes]
        if not forces:
            return []
        motions = np.split(self.solve(np.hstack(forces)), np.cumsum([force.shape[1] for force in forces])[:-1], axis=1)
        return [to_real(u, f.shape[1]) for u, (f, _) in zip(motions, at)] if is_complex else motions

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

    def with_lowest(
        self, n_modes: int, verify: bool = True, fewer_will_do: bool = False, search: ModeSearch | None = None
    ) -> Self:
        """Return the structure with its lowest ``n_modes`` in use: those computed already, or as :meth:`lowest_modes` has them.

        Collective.
        """
        if n_modes <= self.n_computed:
            structure = self.using_proved(n_modes) if verify else self.using(n_modes)
            if structure is not None:
                return structure
        return self.with_modes(self.lowest_modes(n_modes, verify, fewer_will_do, search))

    def using_proved(self, n_modes: int) -> Self | None:
        """Return the structure with its first ``n_modes`` in use, None where they are not proved to be the lowest.

        Collective: one factorisation, if the proof is not there.
        """
        if n_modes <= self.n_proved:
            return self.using(n_modes)
        factored = self.factored()
        if not is_complete(factored.linearised, factored.modes, n_modes):
            return None
        return replace(self, n_modes=n_modes, n_proved=factored.modes.n_proved)

    def sharpened(self, eigenvalues: np.ndarray, phi_owned: np.ndarray) -> np.ndarray:
        """Return the eigenvalues of modes again, as exact as their vectors allow: :func:`~microslip.modes.rayleigh.sharpened`."""
        return sharpened(self.linearised, eigenvalues, phi_owned)

    def bring_K_back(self) -> None:
        """Make ``system.K`` again, where it was freed."""
        self.linearised.bring_K_back()

    def with_modes(self, modes: Modes) -> Self:
        """Return the same structure with other modes.  Collective: one sum, with a damping matrix another."""
        projected, factored = project_modes(self.system, modes.omega_n, modes.phi_owned), replace(self.factored(), modes=modes)
        n_modes = len(modes.omega_n)
        return replace(self, projected=projected, n_modes=n_modes, n_proved=modes.n_proved, factored=OnDemand.of(factored))

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what ``make`` makes, made once for the same key.  Collective where ``make`` is."""
        if key not in self.results:
            self.results[key] = make()
        return self.results[key]


def static_response(linearised: Linearised) -> StaticResponse:
    """Return the static response: n_loads + n_outputs + 1 solves now, those of the pairs when they first leave sticking.

    Collective on the system's communicator.  The further solve is of random forces on all pairs: by it their columns are checked.
    """
    system = linearised.system
    n_rows, n_out, n_load = system.R.shape[0], system.outputs.shape[0], system.loads.shape[1]
    forces = sp.hstack([system.loads, system.outputs.T, sp.csc_matrix(system.R.T @ random_weights(n_rows)).T], format="csc")
    static, of_weights = np.split(static_columns(linearised, projection_rows(system), forces), [n_load + n_out], axis=1)
    sums, is_on_disk = of_weights[:n_rows, 0].copy(), linearised.factor.info.get("out_of_core")
    return StaticResponse(
        G_static=pair_columns(lambda: linearised, system.comm, sums, FROM_DISK if is_on_disk else BATCH),
        du_static=static[:n_rows, :n_load].copy(),
        out_static=static[n_rows : n_rows + n_out, :n_load].copy(),
        out_R=static[:n_rows, n_load:].T.copy(),
        load_static=static[n_rows + n_out :, :n_load].copy(),
        outputs_static=np.diag(static[n_rows : n_rows + n_out, n_load:]).copy(),
        row_sums=sums,
    )


def random_weights(n_rows: int) -> np.ndarray:
    """Return the weights of the row sums that static columns are checked by, (n_rows,).  Local."""
    return np.random.default_rng(n_rows).choice([-1.0, 1.0], n_rows)


def projection_rows(system: System) -> sp.csr_matrix:
    """Return the rows that are seen of a motion: of pairs, outputs and loads."""
    return sp.vstack([system.R, system.outputs, system.loads.T], format="csr")


def project_modes(system: System, omega_n: np.ndarray, phi_owned: np.ndarray) -> ProjectedModes:
    """Return what pairs, loads and outputs see of modes.  Collective: one sum, with a damping matrix another."""
    participation = owned_product(projection_rows(system), phi_owned, system)
    R_phi, o, b_T = np.split(participation, np.cumsum([system.R.shape[0], system.outputs.shape[0]]))
    C = None
    if system.C is not None and len(omega_n) > 0:
        C = gram(system.comm, phi_owned, multiply(system.C, phi_owned))
        C = 0.5 * (C + C.T)
    return ProjectedModes(omega_n, R_phi, b_T.T.copy(), o, C)


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


def pair_columns(
    linearised: Callable[[], Linearised], comm: MPI.Comm, row_sums: np.ndarray, batch: int = BATCH, is_complex: bool = False
) -> StaticColumns:
    """Return the columns of R K_L^-1 R^T, to be solved for with the factor when they are needed.  Local.

    ``row_sums`` (3 n_pairs,) are the random sums of the rows of all of them, by which they are checked.  Where there is no memory
    for columns, solving for them raises ResourceError on every rank.
    """
    n_rows = len(row_sums)
    pair_ranges, sums = split_evenly(n_rows // 3, comm.size), RowSums(random_weights(n_rows), row_sums)
    n_owned = int(pair_ranges[comm.rank + 1] - pair_ranges[comm.rank])

    def solve(pairs: np.ndarray) -> np.ndarray:
        chosen, R = rows_of(pairs), linearised().system.R
        if 8.0 * len(chosen) * n_rows > _ASKED_FROM:
            refuse_beyond(comm, 16.0 * len(chosen) * 3 * n_owned, f"static columns of {len(pairs)} more pairs", _FEWER)
        return static_columns(linearised(), R, R.T.tocsc()[:, chosen], 3 * pair_ranges, sums.of(chosen))

    return StaticColumns(n_rows // 3, n_owned, solve, batch, is_complex)
