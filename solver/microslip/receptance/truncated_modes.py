"""Estimate of the response of truncated modes, without computing them (docs/theory.md, section 11).

The receptance (4.1) lacks E_n = sum over k > m of phi_k c_kn phi_k^H of the truncated modes.  Below their resonances

    E_n ~ (n omega)^2 W,        W = sum over k > m of phi_k phi_k^H / omega_k^4 = Z M Z,        Z = K_L^-1 - phi Omega^-2 phi^H,

and W is sampled: with random vectors s of covariance M, W is the mean of (Z s)(Z s)^H.  This needs a few static solutions once,
for any number of pairs.  A damping alpha M + beta K adds -i n omega (alpha W + beta Z), structural damping -i eta Z, and a ratio
zeta -2 i n omega zeta times a matrix between W and Z, which in x^H E_n x is at most their geometric mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..fourier.amplitudes import adjoint_times, matrix_times
from .damping import DynamicFlexibility
from .on_ranks import on_ranks
from .per_group import PerGroup
from .receptance import Receptance
from .reduced_model import HarmonicGroup, ReducedModel
from .reduced_structure import ReducedStructure
from .structural_coupling import StructuralCoupling

if TYPE_CHECKING:
    from mpi4py import MPI

SAMPLES = 32  # random vectors: norms are accurate to about a quarter
KEY = 20  # of the random vectors
LAST = 3  # highest computed modes, to whose kinetic energy the vectors are scaled
_NEAR = 0.9  # upper bound of n omega relative to ``TruncatedModes.omega``


@dataclass(frozen=True)
class DampingBeyond:
    """Damping of the truncated modes: phi_k^H C phi_k ~ alpha + 2 zeta omega_k + beta omega_k^2, plus a loss factor."""

    alpha: float = 0.0  # 1/s
    ratio: float = 0.0  # zeta
    beta: float = 0.0  # s
    loss_factor: float = 0.0  # eta of structural damping; the static part has none


@dataclass(frozen=True)
class TruncatedModes:
    """The samples Z s of one harmonic group, projected on pairs, outputs and loads; replicated."""

    omega: float  # rad/s: effective frequency at which the loads excite the truncated modes
    highest: float  # rad/s, of the highest retained mode
    damping: DampingBeyond
    of_pairs: np.ndarray  # (3 n_pairs, SAMPLES)
    of_outputs: np.ndarray  # (n_outputs, SAMPLES)
    of_loads: np.ndarray  # (n_loads, SAMPLES)
    direct: np.ndarray  # (n_outputs, n_loads) W between outputs and loads, exactly
    drive_point: np.ndarray  # (n_loads,) W of each load with itself, exactly
    residual: np.ndarray  # (n_outputs, n_loads) Z between outputs and loads, exactly [m/N]
    coupling: StructuralCoupling | None  # by structural damping with a joint

    def with_damping(self, sigma: float, factor: float = 1.0) -> TruncatedModes:
        """Return the same modes with their damping times a factor, plus sigma M [1/s].  Local."""
        if sigma == 0.0 and factor == 1.0:
            return self
        of = self.damping
        damping = DampingBeyond(factor * of.alpha + sigma, factor * of.ratio, factor * of.beta, factor * of.loss_factor)
        return replace(self, damping=damping, coupling=self.coupling and self.coupling.times(factor))

    def gains(self, n_omega: np.ndarray) -> np.ndarray:
        """Return the factor of W in E_n at the frequencies n omega, (n_harmonics,) [1/s2].  Local."""
        s = np.minimum(n_omega / self.omega, _NEAR)
        return np.hypot(n_omega**2, self._of_mass * n_omega) / (1.0 - s**2)

    @property
    def _of_mass(self) -> float:
        """Factor of -i n omega W in E_n, if only W is known [1/s]."""
        return self.damping.alpha + 2.0 * self.damping.ratio * self.highest

    def _lost(self, n_omega: np.ndarray) -> np.ndarray:
        """Return the factor of Z in E_n at the frequencies n omega, (n_harmonics,) [-]."""
        return self.damping.loss_factor + self.damping.beta * n_omega

    def through_joint(
        self, group: HarmonicGroup, omega: float, f: np.ndarray, p: np.ndarray, samples: np.ndarray, factors: np.ndarray
    ) -> np.ndarray:
        """Return a bound of the changes of the outputs through the pairs, all harmonics of the group, (2 n_outputs,).  Local.

        By the Cauchy-Schwarz inequality for each harmonic.  ``f`` (n_loads, N_H), ``p`` (3 n_pairs, N_H) and ``samples``
        (2 n_outputs, SAMPLES, N_H) are coefficients of the group, ``factors`` (n_outputs,) the factors of the outputs' rows.
        """
        loads, pairs = adjoint_times(self.of_loads, f), adjoint_times(self.of_pairs, p)
        numbers = group.harmonics.numbers
        straight = np.zeros((len(samples), len(numbers)))  # direct part, in harmonic 1 only
        straight[:, numbers == 1] = np.tile(np.linalg.norm(self.of_outputs, axis=1) * factors, 2)[:, None]
        through = straight * _norms(pairs, group) + _norms(samples, group) * _norms(loads - pairs, group)
        lost = np.where(numbers > 0, self._lost(omega * numbers), 0.0)
        return through @ (self.gains(omega * numbers) + lost * self.omega**2)  # Z is about omega^2 W

    def direct_changes(self, omega: float, f_1: np.ndarray) -> np.ndarray:
        """Return the changes of cos 1 and then sin 1 of the output rows under the loads only, (2 n_outputs,).  Local.

        Exact except for terms of higher order than W.  ``f_1`` (n_loads, 2) are cosine and sine of the loads.
        """
        n_omega = np.array([omega])
        of_W, of_Z = (np.abs(matrix_times(each, f_1)).T.ravel() for each in (self.direct, self.residual))
        between = 2.0 * self.damping.ratio * omega * np.sqrt(of_W * of_Z)
        return self.gains(n_omega) * of_W + np.maximum(between - self._of_mass * omega * of_W, 0.0) + self._lost(n_omega) * of_Z


@dataclass(frozen=True)
class Truncation:
    """The truncated modes of each group of a model's harmonics; None for a group with all of its modes."""

    model: ReducedModel
    of_groups: tuple[TruncatedModes | None, ...]

    @property
    def is_exact(self) -> bool:
        """Whether no mode is truncated."""
        return all(truncated is None for truncated in self.of_groups)

    def samples_of(self, tau: np.ndarray) -> np.ndarray:
        """Return this rank's part of the samples of R^H tau, (n, SAMPLES, N_H), for rows tau (n, 3 n_owned, N_H).  Local."""
        samples, owned = np.zeros((len(tau), SAMPLES, self.model.N_H)), self.model.owned_rows
        for group, truncated in zip(self.model.groups, self.of_groups):
            if truncated is not None:
                rows = truncated.of_pairs[owned]
                samples[..., group.columns] = [adjoint_times(rows, x[:, group.columns]) for x in tau]
        return samples

    def changes(self, level: float, omega: float, p: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Return the changes of cos 1 and then sin 1 of the outputs by the truncated modes, (2 n_outputs,) [m].  Local.

        The part directly from loads to outputs is exact except for terms of higher order than W; the part through the pairs is
        an upper bound.  docs/theory.md, eq. (11.2).

        Parameters
        ----------
        p : (3 n_pairs, N_H) forces of the pairs [N]
        samples : (2 n_outputs, SAMPLES, N_H) samples of R^H tau, the adjoint forces of an output on the pairs
        """
        model, f, acts = self.model, level * self.model.f, p.any() or samples.any()  # not where all pairs stick
        factors, total = np.broadcast_to(model.output_factors(omega), model.n_outputs), np.zeros(2 * model.n_outputs)
        for group, truncated, c in zip(model.groups, self.of_groups, model.flexibilities(omega)):
            if truncated is None:
                continue
            of_group = f[:, group.columns], p[:, group.columns]
            if 1 in group.harmonics:
                total = total + np.tile(factors, 2) * _straight(truncated, group, c, omega, *of_group)
            if acts:
                total = total + truncated.through_joint(group, omega, *of_group, samples[..., group.columns], factors)
        return total


def _straight(
    truncated: TruncatedModes, group: HarmonicGroup, c: DynamicFlexibility, omega: float, f: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Return the direct changes of harmonic 1 of the output rows, by loads and retained modes, (2 n_outputs,)."""
    first = group.harmonics.columns(1)
    changes = truncated.direct_changes(omega, f[:, first])
    if truncated.coupling is not None:
        changes = changes + truncated.coupling.changes(group, c, f, p)
    return changes


def _norms(samples: np.ndarray, group: HarmonicGroup) -> np.ndarray:
    """Return the norm of each harmonic, (..., n_harmonics), of samples (..., SAMPLES, N_H).  Local."""
    squares, harmonics = np.einsum("...sh,...sh->...h", samples, samples), group.harmonics
    mean, cos, sin = (squares[..., columns] for columns in (harmonics.mean, harmonics.cos, harmonics.sin))
    return np.sqrt(np.concatenate([mean, cos + sin], axis=-1))


def of_samples(
    receptance: Receptance,
    rows: np.ndarray,
    direct: np.ndarray,
    drive_point: np.ndarray,
    damping: DampingBeyond,
    coupling: StructuralCoupling | None,
) -> TruncatedModes:
    """Return the truncated modes of a receptance from samples.  Local.

    Parameters
    ----------
    rows : (3 n_pairs + n_outputs + n_loads, SAMPLES) the samples Z s projected on pairs, outputs and loads
    direct, drive_point : (n_outputs, n_loads), (n_loads,) of W, as stored
    """
    modes, static = receptance.modes, receptance.static
    n_rows, n_out = len(static.du_static), len(static.out_static)
    # Rayleigh quotients of the loads in the truncated modes: x^H Z x / x^H W x
    energy = np.diag(static.load_static).real - (np.abs(modes.b) ** 2 / modes.omega_n[:, None] ** 2).sum(axis=0)
    squares = np.maximum(energy, 0.0) / np.maximum(drive_point, np.finfo(float).tiny)
    effective = np.sqrt(squares[squares > 0.0].min(initial=np.inf))
    omega = np.clip(effective, modes.omega_n[-1], 1e3 * modes.omega_n[-1])
    return TruncatedModes(
        float(omega),
        float(modes.omega_n[-1]),
        damping,
        rows[:n_rows],
        rows[n_rows : n_rows + n_out],
        rows[n_rows + n_out :],
        direct,
        drive_point,
        static.out_static - (modes.o / modes.omega_n**2) @ modes.b,
        coupling,
    )


@dataclass(frozen=True)
class EnrichedModel:
    """The receptance with an exact static residual, and samples of the truncated modes of each group; None without any."""

    structure: ReducedStructure
    truncated: PerGroup[TruncatedModes | None]
    is_solved: bool  # whether the solved model has the same structure

    @classmethod
    def of_all_modes(cls, structure: ReducedStructure) -> EnrichedModel:
        """Return a structure without truncated modes as its own enriched model.  Local."""
        return cls(structure, structure.receptances.mapped(lambda _: None), True)

    def truncation(self, model: ReducedModel, sigma: float = 0.0, factor: float = 1.0) -> Truncation:
        """Return the truncated modes for a model's harmonics, their damping times a factor, plus sigma M [1/s].

        Collective if a group is new.
        """
        of_groups = (self.truncated.of(group.harmonics.chosen[0]) for group in model.groups)
        return Truncation(model, tuple(each and each.with_damping(sigma, factor) for each in of_groups))

    def on_ranks(self, solved: ReducedStructure, comm: MPI.Comm) -> EnrichedModel:
        """Return the same model for a subset of the ranks, which solves ``solved``.  Collective on ``structure.comm``."""
        made = {group: self.truncated.of_group(group) for group in self.truncated.groups}
        truncated = PerGroup(made.__getitem__, self.truncated.group_of, self.truncated.groups)
        return replace(self, structure=solved if self.is_solved else on_ranks(self.structure, comm), truncated=truncated)
