"""A bound of the change of the response by the truncated modes, which determines the number of modes.

docs/theory.md, eq. (4.4) and eq. (4.5).  Forces are the loads and R^T p; motions are those of the outputs and, through the joint,
of the pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..contact.law import Law
from ..fourier.amplitudes import to_complex
from ..fourier.harmonics import Harmonics
from ..messages.errors import CaseError
from ..parallel.ownership import rows_of, split_evenly, summed
from ..points.band import frequency_band
from ..receptance.modes import DampedModes
from ..receptance.motions import linear_motion, output_motion
from ..receptance.receptance import Receptance
from ..receptance.reduced_model import ReducedModel
from .modal_structure import reduce_structure
from .settings import ReductionSettings
from .stuck import StuckStructure

_EARLY = 0.5  # fraction of the limit from which a pair counts as slipping or open, as slip of its neighbours adds load
_RESONANCES = 3  # number of resonances with most energy in the joint at which the part through the joint is evaluated
_FAINT = 1e-3  # smallest reference amplitude of an output, relative to the peak of the largest output
_COLUMNS = 32  # complex right-hand sides at a time


@dataclass(frozen=True)
class TruncationBound:
    """Bounds for 1 to n retained modes, (n,) each, relative to the linear peak of an output; maximum over the outputs."""

    direct: np.ndarray  # directly from the loads to the outputs
    joint: np.ndarray  # through the contact forces

    @property
    def total(self) -> np.ndarray:
        """The sum of both parts."""
        return self.direct + self.joint


@dataclass(frozen=True)
class Resonance:
    """Residual norms (n,) of the forces at one frequency for one load harmonic h, at the highest level."""

    omega: float
    p: np.ndarray  # of R^T p
    damping_force: np.ndarray  # of n omega C u + eta K u: a full damping matrix couples the truncated modes to the motion
    pairs: np.ndarray  # (n, n_outputs) of the adjoint forces of each output on the pairs
    damping_force_adjoint: np.ndarray  # (n, n_outputs) of their damping forces


@np.errstate(divide="ignore", invalid="ignore")  # resonances without damping
def truncation_bound(stuck: StuckStructure, settings: ReductionSettings) -> TruncationBound:
    """Return the bounds of (4.5) with the first 1 to n of the n modes of a harmonic group retained.

    Collective on the system's communicator: a few static solves.  A bound needs the first truncated mode, so that the entry for
    all n modes is infinite.  Loads may also act in other groups, which have the modes of ``stuck.per_group``.

    docs/theory.md, eq. (4.5).

    Raises
    ------
    CaseError : an accuracy is stated, and nothing damps a resonance in the range; on every rank
    """
    model, law, comm = model_for(stuck, settings), stuck.pairs.law, stuck.comm
    norms = Norms(stuck, model.receptances.of_group(stuck.group), settings)
    modes = norms.receptance.modes
    n = len(modes.omega_n)
    low, high = 2.0 * np.pi * np.array(frequency_band(settings.band, model.receptance_of(1).modes.omega_n))
    resonant = model.omega_n[(model.omega_n > low) & (model.omega_n < high)]
    omegas = np.union1d(np.linspace(low, high, 60), resonant)
    loaded = [int(h) for h in model.harmonics.above_mean if model.f[:, model.harmonics.columns(h)].any()]
    peaks = comm.bcast(output_peaks(model, omegas))  # bitwise equal on all ranks: collective calls depend on it
    if settings.insists and not np.isfinite(peaks).all():
        raise CaseError(
            f"{settings.where}: [solver] accuracy = {settings.accuracy:g}: the stuck structure has a resonance without damping "
            "in the range: its linear peak, to which the number of modes refers, is infinite; state [damping], or choose a range "
            "without the resonance"
        )
    direct, joint = np.zeros((2, n))
    if not loaded or not peaks.any():
        return TruncationBound(direct, joint)  # a constant load: the static part is exact
    peaks = np.maximum(peaks, _FAINT * peaks.max())
    of_load = {h: norms.of_load(_load(model, h)) for h in loaded if stuck.has(h)}
    of_output = norms.of_outputs()
    # peaks of the output rows, at the frequency where the factors of velocities and accelerations are largest
    peaks_u = {h: peaks / model.output_factors(h * high) for h in loaded}
    for h, of_h in of_load.items():
        error = (gains(modes, h * high) * of_h)[:, None] * of_output / peaks_u[h]
        direct = np.maximum(direct, error.max(axis=1))
    if model.n_pairs or modes.damping.couples_modes:
        at_which = [(h, omega) for omega in comm.bcast(resonances(model, law, omegas)) for h in loaded]
        for (h, _), at in zip(at_which, acting(norms, model, law, at_which, settings)):
            numbers = [n for n in settings.excitation.harmonics.above_mean if stuck.has(n)]
            error = _through_the_joint(modes, numbers, at, h, of_load.get(h), of_output, settings.level) / peaks_u[h]
            joint = np.maximum(joint, error.max(axis=1))
    direct[-1] = np.inf  # the first truncated mode is unknown
    return TruncationBound(direct, joint)


def model_for(stuck: StuckStructure, settings: ReductionSettings) -> ReducedModel:
    """Return the model for the choice of modes of one harmonic group, with its harmonics and those of the loads.

    Collective if the group of a load is not computed yet.
    """
    model = ReducedModel.of(reduce_structure(stuck, settings.damping), settings.excitation)
    if len(stuck.per_group.groups) == 1:
        return model
    chosen = [n for n in model.harmonics.chosen if stuck.has(n) or model.f[:, model.harmonics.columns(n)].any()]
    return model.with_harmonics(Harmonics(tuple(chosen)))


def _through_the_joint(
    modes: DampedModes, numbers: list[int], at: Resonance, h: int, of_load: np.ndarray | None, of_output: np.ndarray, level: float
) -> np.ndarray:
    """Return the sum over the harmonics n of (4.5) without the direct part of load and output, (n, n_outputs) [m/N].  Local.

    The force of a full damping matrix is not part of the static solution and has the factor 1 + rho.
    """
    error = np.zeros_like(of_output)
    for n in numbers:
        rho = gains(modes, n * at.omega)[:, None]
        force, motion = (_content(n, h) * at.p / level)[:, None], _content(n, h) * at.pairs
        if n != h:
            error += rho * force * motion
            continue
        assert of_load is not None, "a load in a harmonic of the group"
        load, damping_force = of_load[:, None], at.damping_force[:, None] / level
        error += rho * ((load + force) * (of_output + motion) - load * of_output)
        error += (1.0 + rho) * (
            damping_force * (of_output + motion + at.damping_force_adjoint) + (load + force) * at.damping_force_adjoint
        )
    return error


def _content(n: int, h: int) -> float:
    """Return a bound of harmonic n in a slider's motion under a motion in harmonic h, relative to that motion.  Local.

    The slider moves with the pair during slip and rests otherwise, so that the total variation of its velocity over a cycle is at
    most four times the maximum, and its n-th harmonic at most 4 / pi (h / n)^2.
    """
    return 1.0 if n <= h else 4.0 / np.pi * (h / n) ** 2


def gains(modes: DampedModes, n_omega: float) -> np.ndarray:
    """Return rho of eq. (4.4) for 1 to n retained modes, (n,): the maximum over the truncated modes, at n omega.  Local.

    omega_k^2 |c_k| = |s^2 - 2i zeta s| / |1 - s^2 + 2i zeta s| with s = n omega / omega_k: below the first truncated mode its
    terms are largest for this mode or for the one with most damping; above, rho is the height of the least damped resonance.
    Structural damping adds the loss factor to 2 zeta s.
    """
    first, zeta = np.append(modes.omega_n[1:], np.inf), _of_truncated(modes.zeta, np.minimum)
    s, damped = n_omega / first, 2.0 * n_omega * _of_truncated(modes.viscous_ratio / modes.omega_n, np.maximum)
    damped = damped + _of_truncated(modes.loss_factor, np.maximum)
    with np.errstate(divide="ignore", invalid="ignore"):
        below = np.hypot(s**2, damped) / np.abs(1.0 - s**2 + 2j * zeta * s)
        at_resonance = 1.1 * np.sqrt(1.0 + 4.0 * zeta**2) / (2.0 * zeta) + damped
    return np.where(s < 1.0, below, at_resonance)


def _of_truncated(values: np.ndarray, extreme: np.ufunc) -> np.ndarray:
    """Return the extreme value over the truncated modes for 1 to n retained modes, (n,); for n, the value of the last mode."""
    return extreme.accumulate(np.append(values[1:], values[-1])[::-1])[::-1]


def output_peaks(model: ReducedModel, omegas: np.ndarray) -> np.ndarray:
    """Return the largest amplitude of each output on the linear curve, (n_outputs,) [m/N], over all harmonics n > 0.  Local."""
    nothing = np.zeros((3 * model.n_pairs, model.N_H))
    motions = [to_complex(output_motion(model, 1.0, omega, nothing)) for omega in omegas]
    return np.abs(motions)[:, :, model.harmonics.numbers > 0].max(axis=(0, 2), initial=0.0)


def resonances(model: ReducedModel, law: Law, omegas: np.ndarray) -> list[float]:
    """Return the frequencies of the highest peaks of the energy in the stuck joint, and the end of the range.  Local."""
    K_J = law.stiffness.reshape(-1, 1)
    U = [to_complex(linear_motion(model, 1.0, omega, slice(None)))[:, model.harmonics.numbers > 0] for omega in omegas]
    energy = np.nan_to_num([np.sum(K_J * np.abs(U_n) ** 2) for U_n in U], nan=0.0, posinf=0.0)  # without bound at a resonance
    rises = np.diff(energy, prepend=-1.0, append=-1.0) > 0.0
    tops = np.flatnonzero(rises[:-1] & ~rises[1:])
    highest = tops[np.argsort(-energy[tops], kind="stable")][:_RESONANCES]
    return [float(omega) for omega in np.union1d(omegas[highest], omegas[-1:])]


def acting(
    norms: Norms, model: ReducedModel, law: Law, at_which: list[tuple[int, float]], settings: ReductionSettings
) -> list[Resonance]:
    """Return the residual norms of the forces in each harmonic h at each omega of ``at_which``.  Collective: all at once."""
    everything = [_at_joint(model, law, h, omega, settings.level) for h, omega in at_which]
    of_everything = np.split(norms.of_pairs(np.hstack([p for p, _ in everything])), len(everything), axis=1)
    resonances = []
    for (h, omega), (_, z), of_p in zip(at_which, everything, of_everything):
        has_damping_force = norms.stuck.has(h) and norms.receptance.modes.damping.couples_modes
        damping_forces = norms.of_damping_force(z, h * omega) if has_damping_force else np.zeros_like(of_p)
        resonances.append(Resonance(omega, of_p[:, 0], damping_forces[:, 0], of_p[:, 1:], damping_forces[:, 1:]))
    return resonances


def _at_joint(model: ReducedModel, law: Law, h: int, omega: float, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Return complex forces of pairs (3 n_pairs, 1 + n_outputs) and modal motions z: under the loads, and adjoints of outputs.

    Local.
    """
    (k, i), column = model.index_of(h), model.harmonics.chosen.index(h)
    receptance, c = model.groups[k].receptance, model.flexibilities(omega)[k]
    modes = receptance.modes
    U = to_complex(linear_motion(model, level, omega, slice(None)))
    U_adjoint = receptance.of_outputs(c, i).conj().T  # (3 n_pairs, n_outputs)
    share = law.slipping_share(np.abs(U).sum(axis=1).reshape(-1, 3), _EARLY).ravel()
    K_J = law.stiffness.ravel()
    p = np.column_stack([share * K_J * U[:, column], ((share > 0.0) * K_J)[:, None] * U_adjoint])
    return p, c.whole(np.column_stack([level * modes.b @ to_complex(model.f)[:, column], modes.o.conj().T]), i)


def _load(model: ReducedModel, h: int) -> np.ndarray:
    """Return harmonic h of the loads' coefficients at unit level, (n_loads,), complex [N/N]."""
    return to_complex(model.f)[:, model.harmonics.chosen.index(h)]


@dataclass(frozen=True)
class Norms:
    """The residual norms |x|_m of forces on the structure of a group, for 1 to n of its n modes retained.  Collective.

    docs/theory.md, eq. (4.4).
    """

    stuck: StuckStructure
    receptance: Receptance
    settings: ReductionSettings

    def beyond(self, static: np.ndarray, of_modes: np.ndarray) -> np.ndarray:
        """Return the norms (n, q) of columns x with ``static`` (q,) x^H K_L^-1 x and ``of_modes`` (n, q) phi^H x.  Local."""
        of_computed = np.cumsum(np.abs(of_modes / self.receptance.modes.omega_n[:, None]) ** 2, axis=0)
        return np.sqrt(np.maximum(static.real - of_computed, 0.0))

    def of_load(self, f: np.ndarray) -> np.ndarray:
        """Return the norms of complex load coefficients (n_loads,), (n,).  Local."""
        static = np.array([f.conj() @ self.receptance.static.load_static @ f])
        return self.beyond(static, self.receptance.modes.b @ f[:, None])[:, 0]

    def of_outputs(self) -> np.ndarray:
        """Return the norms of the rows of the outputs, (n, n_outputs).  Local."""
        return self.beyond(self.receptance.static.outputs_static, self.receptance.modes.o.conj().T)

    def of_pairs(self, p: np.ndarray) -> np.ndarray:
        """Return the norms of R^H p, p complex (3 n_pairs, q), (n, q): from static columns if all are stored, or by solves."""
        static, comm = self.receptance.static, self.stuck.comm
        moving = comm.bcast(np.flatnonzero(p.reshape(self.stuck.pairs.n_pairs, -1).any(axis=1)))
        if not static.G_static.stored[moving].all():
            return self.of_forces(self.stuck.pair_forces(p))
        ranges = split_evenly(self.stuck.pairs.n_pairs, comm.size)
        owned = p[3 * ranges[comm.rank] : 3 * ranges[comm.rank + 1]]
        Gp_owned = static.G_static.of_stored(moving).columns(np.arange(len(owned))).T @ p[rows_of(moving)]
        of_modes = self.receptance.modes.R_phi.conj().T @ p
        return self.beyond(summed(comm, np.einsum("ij,ij->j", owned.conj(), Gp_owned)), of_modes)

    def of_damping_force(self, z: np.ndarray, n_omega: float) -> np.ndarray:
        """Return the norms of the damping forces of modal motions z, complex (n, q), at n omega, (n, q): by solves."""
        damping = self.settings.damping
        return self.of_forces(_damping_forces(self.stuck, z, n_omega, 0.0 if damping is None else damping.structural))

    def of_forces(self, X_owned: np.ndarray) -> np.ndarray:
        """Return the norms of complex columns X (n_owned, q), (n, q): 2 q static solves."""
        stuck, static = self.stuck, np.zeros(X_owned.shape[1], dtype=complex)
        for start in range(0, len(static), _COLUMNS):
            x_owned = X_owned[:, start : start + _COLUMNS]
            static[start : start + _COLUMNS] = summed(stuck.comm, np.einsum("ij,ij->j", x_owned.conj(), stuck.solve(x_owned)))
        return self.beyond(static, stuck.participation(X_owned))


def _damping_forces(stuck: StuckStructure, z: np.ndarray, n_omega: float, eta: float) -> np.ndarray:
    """Return this rank's rows of (n omega C + eta K) phi z, complex (n_owned, q), for modal motions z (n_modes, q)."""
    system, u_owned = stuck.system, stuck.modes.phi_owned @ z
    forces = np.zeros_like(u_owned, dtype=complex)
    if system.C is not None:
        forces += n_omega * stuck.product(system.C, u_owned)
    if eta > 0.0:  # of K, without the springs of the joints
        springs = stuck.pairs.law.stiffness.reshape(-1, 1) * (stuck.projected.R_phi[:, : stuck.n_modes] @ z)
        forces += eta * (stuck.product(stuck.K_L, u_owned) - stuck.pair_forces(springs))
    return forces
