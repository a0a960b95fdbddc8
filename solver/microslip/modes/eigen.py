"""The lowest modes phi of (K_L, M): computed with the stored factor, checked, and proved complete."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..linear.dense import column_norms, gram, multiply
from ..linear.lockstep import after_others
from ..linear.sector_factor import DiameterFactor
from ..messages.errors import CaseError, ConvergenceError
from ..messages.words import counted
from .hermitian import complex_modes
from .inertia import count_below, find_gap
from .lapack import dense_modes
from .limits import SHARE
from .rayleigh import Forces, iterated_once, orthonormalised, sharpened
from .shift_invert import ModeSearch
from .user_order import user_order

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

RESIDUAL_LIMIT = 1e-5  # |K_L phi - omega_n^2 M phi| / |omega_n^2 M phi|
_ROUNDING = 1e-13  # the same relative to |diag(K_L) phi|, for rounding errors of K_L phi
_DENSE = 400  # DOFs up to which LAPACK is fastest
_GUARD = 2  # modes beyond the wanted ones, to find a gap for the proof; of complex matrices an estimate of the next one is enough
_MAX_TRIES = 5
_CORRECTIONS = 2  # largest number of corrections of modes with residuals above the limit
_EQUAL = 1e-6  # relative difference of components that count as equally large


@dataclass(frozen=True, eq=False)
class Modes:
    """Undamped modes of the stuck structure, M-normalised, in ascending order."""

    omega_n: np.ndarray  # (n,) rad/s
    phi_owned: np.ndarray  # (n_owned, n) this rank's rows [kg^-1/2]
    info: dict[str, Any] = field(default_factory=dict)  # method, seconds, residual, proof

    @property
    def frequency(self) -> np.ndarray:
        """Natural frequencies, (n,) [Hz]."""
        return self.omega_n / (2.0 * np.pi)

    @property
    def n_proved(self) -> int:
        """Number of leading modes that are proved to be the lowest."""
        return len(self.omega_n) if self.info.get("complete", True) else min(self.info.get("proved", 0), len(self.omega_n))

    @property
    def completeness(self) -> str:
        """Whether the modes are proved to be the lowest, in words."""
        if "proof" in self.info:
            return f"proved complete by the inertia of K_L - sigma M: {self.info['proof']}"
        if self.info.get("complete", True):
            return "computed from the whole spectrum: none is missing"
        return "not proved complete: [solver] verify_modes = false"


def lowest_modes(
    linearised: Linearised, n_modes: int, verify: bool = True, allows_fewer: bool = False, search: ModeSearch | None = None
) -> Modes:
    """Return the ``n_modes`` lowest modes of (K_L, M), for a free structure the lowest elastic modes.

    Collective on the system's communicator.  Of complex matrices, which ``linearised`` has in real form, the modes are complex.

    Parameters
    ----------
    linearised : ``K_L``, ``M``, ``factor`` of K_L, ``system``
    verify : prove by the inertia of K_L - sigma M that no mode is missing: one additional factorisation
    allows_fewer : return all existing modes if fewer motions have mass
    search : search of an earlier call, to be continued

    Returns
    -------
    Modes : phi^H M phi = I; the largest component of each mode is real and positive, independent of the partition

    Raises
    ------
    CaseError : ``n_modes`` exceeds the number of DOFs, or of motions with mass
    ConvergenceError : no convergence, a residual too large, or a mode missing after all tries; on every rank
    """
    start = perf_counter()
    n_dof = linearised.M.getSize()[0] // _copies(linearised) - linearised.factor.n_rigid
    if allows_fewer:
        n_modes = min(n_modes, n_dof)
    if not 1 <= n_modes <= n_dof:
        raise CaseError(f"[solver] modes = {n_modes}, but the structure has {n_dof} degrees of freedom; state 1 to {n_dof} modes")
    eigenvalues, phi_owned, info = _solve(linearised, n_modes, 1 if allows_fewer else n_modes, verify, search)
    eigenvalues = linearised.system.comm.bcast(sharpened(linearised, eigenvalues, phi_owned))
    order = np.argsort(eigenvalues)
    eigenvalues, phi_owned = eigenvalues[order], phi_owned[:, order]
    largest = largest_components(linearised, phi_owned, user_order(linearised)[:: _copies(linearised)])
    phi_owned = phi_owned * (largest.conj() / np.abs(largest))
    info["seconds"] = perf_counter() - start
    return Modes(np.sqrt(eigenvalues), np.asfortranarray(phi_owned), info)


def first_of(modes: Modes, n_modes: int) -> Modes:
    """Return the first ``n_modes`` of ``modes``, as views of their arrays.  Local."""
    return Modes(modes.omega_n[:n_modes], modes.phi_owned[:, :n_modes], modes.info)


def _copies(linearised: Linearised) -> int:
    """Return the number of modes in the real form, for each one.  Local."""
    return 2 if linearised.maps.is_complex else 1


def conjugated(modes: Modes) -> Modes:
    """Return the modes of the conjugate matrices.  Local."""
    return replace(modes, phi_owned=modes.phi_owned.conj())


def is_complete(linearised: Linearised, modes: Modes, n_modes: int) -> bool:
    """Return whether the first ``n_modes`` of some unproved modes are the lowest.  Collective: up to two factorisations.

    If possible, all computed modes except the last are proved at once, as another run may need more of them.  Of a nodal
    diameter this waits for all others in lockstep, and a shift of another diameter is preferred.
    """
    if modes.info.get("complete", True):
        return True  # all of the spectrum
    _before_proof(linearised)
    squares = modes.omega_n**2
    least, shared = find_gap(squares, n_modes), find_gap(squares, n_modes, _shifts(linearised))
    most = max(least, find_gap(squares, len(squares) - 1)) if n_modes < len(squares) else least
    for n_below, sigma in dict.fromkeys((most if shared == least else shared, least)):
        if _count_below(linearised, sigma) == n_below:
            modes.info.update(_proof(n_below, sigma))
            return True
    return False


def _before_proof(linearised: Linearised) -> None:
    """In lockstep, wait for the end of all searches: their spaces are freed, and all diameters use one shift.  Local."""
    if isinstance(linearised.factor.solver, DiameterFactor):
        after_others(linearised.factor.solver.forget)


def _count_below(linearised: Linearised, sigma: float) -> int:
    """Return how many elastic modes have omega_n^2 below ``sigma`` [rad2/s2].  Collective: one factorisation."""
    factor = linearised.factor
    if isinstance(factor.solver, DiameterFactor):
        return factor.solver.count_below(sigma)
    n_below = count_below(linearised.K_L, linearised.M, sigma, factor.solver.order) - factor.n_rigid
    return n_below // _copies(linearised)


def _shifts(linearised: Linearised) -> tuple[float, ...]:
    """Return the shifts at which a count needs no factorisation.  Local."""
    solver = linearised.factor.solver
    return solver.of_sector.shifts if isinstance(solver, DiameterFactor) else ()


def _proof(n_below: int, sigma: float) -> dict[str, Any]:
    """Return the entries on a proof for the information on the modes."""
    return {"proof": f"{counted(n_below, 'mode')} below {np.sqrt(sigma) / (2 * np.pi):.6g} Hz", "proved": n_below}


def _solve(
    linearised: Linearised, n_modes: int, n_least: int, verify: bool, search: ModeSearch | None
) -> tuple[np.ndarray, np.ndarray, dict]:
    """Return ``n_modes`` (eigenvalues, phi), checked, proved complete if ``verify``, and information on the search.  Collective.

    If fewer motions have mass, all of them, which must be at least ``n_least``.  Modes are checked before the proof, as products
    with them are not stored until then.
    """
    n_dof, copies = linearised.M.getSize()[0], _copies(linearised)
    if n_dof <= _DENSE or SHARE * copies * n_modes > n_dof:  # all of the spectrum: nothing can be missing
        K_L, M = linearised.K_L, linearised.M
        theta, phi_owned, info = dense_modes(K_L, M, linearised.factor.rigid, copies * n_modes, copies * n_least)
        if copies == 2:
            theta, phi_owned = complex_modes(K_L, M, theta, phi_owned)
        return _checked(linearised, theta[:n_modes], phi_owned[:, :n_modes], None, info)
    n_wanted, search = n_modes + _GUARD * (verify and copies == 1), search or ModeSearch(linearised)
    for _ in range(_MAX_TRIES):
        theta, phi_owned, forces, info = search.lowest(n_wanted)
        if len(theta) < n_least:
            raise CaseError(
                f"[solver] modes = {n_least}, but the structure has only {len(theta)}: its mass matrix leaves "
                f"{n_dof - len(theta)} motions without mass"
            )
        found, info = _with_following(1.0 / theta, info)
        if verify and len(found) == n_modes and not info.get("complete"):  # no value above them, which the proof needs
            n_wanted = n_modes + 1
            continue
        forces = None if forces is None else (forces[0][:, :n_modes], forces[1][:, :n_modes])
        checked = _checked(linearised, theta[:n_modes], phi_owned[:, :n_modes], forces, info)
        if not verify or info.get("complete"):
            return checked
        del forces  # memory: other searches are under way
        _before_proof(linearised)
        n_below, sigma = find_gap(found, n_modes, _shifts(linearised))
        missing = _count_below(linearised, sigma) - n_below
        if missing == 0:
            checked[2].update(_proof(n_below, sigma))
            return checked
        n_wanted += max(missing, _GUARD)
        search.renew(max(missing, _GUARD))
    raise ConvergenceError(
        f"modes: {counted(n_below, 'mode')} found below {np.sqrt(sigma) / (2 * np.pi):.6g} Hz, where {n_below + missing} lie; "
        "state more [solver] modes"
    )


def _with_following(eigenvalues: np.ndarray, info: dict[str, Any]) -> tuple[np.ndarray, dict[str, Any]]:
    """Return eigenvalues, with an estimate of the next one if it is larger, and the information without that.  Local."""
    following = [1.0 / theta for theta in info.get("following", ()) if theta < 1.0 / eigenvalues.max()]
    return np.append(eigenvalues, following), {name: value for name, value in info.items() if name != "following"}


def _checked(
    linearised: Linearised, theta: np.ndarray, phi_owned: np.ndarray, forces: Forces | None, info: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Return (eigenvalues, phi, info), corrected where residuals are too large, "residual" the largest relative one.

    Collective.  Without ``forces`` phi is made M-orthonormal to roundoff: an eigensolver reaches only its tolerance.

    Raises
    ------
    ConvergenceError : a residual is too large, or modes are not M-orthonormal
    """
    eigenvalues = 1.0 / theta
    if forces is None:
        phi_owned, M_phi_owned = orthonormalised(linearised, phi_owned)
        forces = multiply(linearised.K_L, phi_owned), M_phi_owned
    residual, relative = _residuals(linearised, eigenvalues, phi_owned, forces)
    for _ in range(_CORRECTIONS):
        if not np.any(relative > 1.0):
            break
        eigenvalues, phi_owned, forces = iterated_once(linearised, phi_owned)
        residual, relative = _residuals(linearised, eigenvalues, phi_owned, forces)
    wrong = ~(relative <= 1.0)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ConvergenceError(
            f"mode {k + 1} at {np.sqrt(eigenvalues[k]) / (2 * np.pi):.6g} Hz: |K_L phi - omega^2 M phi| = "
            f"{residual[k]:.1e} |omega^2 M phi|, limit {RESIDUAL_LIMIT:.0e}"
        )
    skewness = float(np.max(np.abs(gram(linearised.system.comm, phi_owned, forces[1]) - np.eye(len(eigenvalues)))))
    if not skewness <= 1e-8:
        raise ConvergenceError(f"modes: |phi^H M phi - I| = {skewness:.1e}, limit 1e-8; state fewer [solver] modes")
    return eigenvalues, phi_owned, info | {"residual": float(np.max(residual))}


def _residuals(
    linearised: Linearised, eigenvalues: np.ndarray, phi_owned: np.ndarray, forces: Forces
) -> tuple[np.ndarray, np.ndarray]:
    """Return |K_L phi - omega^2 M phi| / |omega^2 M phi| of modes, and its ratio to the limit, (n,) each.  Collective.

    The limit includes the expected rounding error of K_L phi.
    """
    comm, elastic_owned, M_phi_owned = linearised.system.comm, linearised.factor.without_inertia(forces[0]), forces[1]
    inertia_owned = M_phi_owned * eigenvalues
    error = column_norms(comm, elastic_owned - inertia_owned)
    size = column_norms(comm, inertia_owned)
    rounding = column_norms(comm, linearised.factor.diagonal_owned[:: _copies(linearised), None] * phi_owned)
    return error / size, error / (RESIDUAL_LIMIT * size + _ROUNDING * rounding)


def largest_components(linearised: Linearised, phi_owned: np.ndarray, order_owned: np.ndarray) -> np.ndarray:
    """Return the largest component of each mode, (n,).  Collective.

    Of equally large components, as in a symmetric structure, the first in the order of the user's nodes, ``order_owned`` of the
    rows, is used, not the first row, which depends on the partition.
    """
    comm, columns = linearised.system.comm, np.arange(phi_owned.shape[1])
    padded = np.vstack([phi_owned, np.ones(len(columns))])  # an additional row, last in the order, as a rank may own no rows
    nobody = np.iinfo(np.int64).max
    number = np.append(order_owned, nobody)
    largest = np.max(comm.allgather(np.abs(phi_owned).max(axis=0, initial=0.0)), axis=0)
    order = np.where(np.abs(padded) >= (1.0 - _EQUAL) * largest, number[:, None], nobody)
    first = np.argmin(order, axis=0)
    numbers, values = map(np.array, zip(*comm.allgather((order[first, columns], padded[first, columns]))))
    return values[np.argmin(numbers, axis=0), columns]
