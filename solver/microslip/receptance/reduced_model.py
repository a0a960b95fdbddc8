"""The model of harmonic balance: a reduced structure under its loads, in a set of harmonics.

Coefficients are real, in the order of fourier/harmonics.py; the complex amplitude of harmonic n is cos - i sin.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..fourier.harmonics import Harmonics
from ..messages.errors import CaseError
from .damping import Damping, DynamicFlexibility, Flexibility, StatedDamping
from .excitation import Excitation
from .receptance import Receptance
from .reduced_structure import ReducedStructure

_CACHED = 4  # frequencies for which a model caches the flexibilities


@dataclass(frozen=True, eq=False)
class HarmonicGroup:
    """The harmonics of a set that belong to one group."""

    receptance: Receptance
    harmonics: Harmonics
    columns: slice | np.ndarray  # of their coefficients in the whole set; a slice if the group has all of them


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedModel(ReducedStructure):
    """A reduced structure, the Fourier coefficients of its loads and the harmonics of every motion."""

    f: np.ndarray  # (n_loads, N_H) at unit level
    harmonics: Harmonics  # in the order of the coefficients
    H_recorded: int = 1  # results have at least the harmonics 0 to this one
    stated_damping: StatedDamping | None = None  # for the modes, also with a changed contact stiffness; None: a matrix
    _flexibilities: dict[float, tuple[DynamicFlexibility, ...]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, structure: ReducedStructure, excitation: Excitation, damping: StatedDamping | None = None) -> ReducedModel:
        """Return the model of a structure under an excitation.  Local; all arrays of the structure are shared.

        Raises
        ------
        CaseError : a load acts in a harmonic that is not in the set, or constant loads on a free structure are not in balance
        """
        parts = _parts(structure)
        if excitation.harmonics.has_mean and any(n == 0 for n, _ in excitation.shapes):
            rigid = structure.receptance_of(0).rigid
            if rigid is not None:
                rigid.refuse_mean(excitation.coefficients, excitation.harmonics)
        return cls(**parts, f=excitation.coefficients, harmonics=excitation.harmonics, stated_damping=damping)

    def on(self, structure: ReducedStructure) -> ReducedModel:
        """Return the model of another structure under the same loads, in the same harmonics.  Local."""
        return replace(self, **_parts(structure))

    @cached_property
    def N_H(self) -> int:
        """The number of Fourier coefficients."""
        return self.harmonics.n_coefficients

    @property
    def recorded(self) -> Harmonics:
        """The full set 0, 1, ..., H of results: all harmonics ever used and harmonic 1; unused ones are zero."""
        return Harmonics.up_to(max(self.H_recorded, self.harmonics.highest))

    def with_harmonics(self, harmonics: Harmonics) -> ReducedModel:
        """Return the same model with another set of harmonics; everything else is shared, including static columns.  Local.

        Raises
        ------
        CaseError : a load acts in a harmonic that is not in the set
        """
        if harmonics == self.harmonics:
            return self
        loaded = [n for n in self.harmonics.chosen if self.f[:, self.harmonics.columns(n)].any()]
        left_out = [n for n in loaded if n not in harmonics]
        if left_out:
            raise CaseError(f"[[loads]] acts in harmonic {left_out[0]}, which is not one of the harmonics {harmonics}")
        f = self.harmonics.carry(self.f, harmonics)
        return replace(self, f=f, harmonics=harmonics, H_recorded=self.recorded.highest)

    def with_damping(self, sigma: float, factor: float = 1.0) -> ReducedModel:
        """Return the same model with its stated damping times a factor, plus sigma M [1/s].  Local."""
        stated = self.stated_damping
        return replace(self, receptances=self.receptances.mapped(lambda each: each.with_damping(sigma, factor, stated)))

    # -- products by harmonic group --------------------------------------------------------------------------------

    @cached_property
    def groups(self) -> tuple[HarmonicGroup, ...]:
        """The groups of the set, ordered by their first harmonics.  Collective if one is not computed yet."""
        harmonics, group_of = self.harmonics, self.receptances.group_of
        chosen: dict[Hashable, list[int]] = {}
        for n in harmonics.chosen:
            chosen.setdefault(group_of(n), []).append(n)
        receptances = [self.receptances.of_group(group) for group in chosen]
        if len(chosen) == 1:
            return (HarmonicGroup(receptances[0], harmonics, slice(None)),)
        columns = [np.concatenate([np.r_[harmonics.columns(n)] for n in some]) for some in chosen.values()]
        return tuple(HarmonicGroup(*each) for each in zip(receptances, map(Harmonics, map(tuple, chosen.values())), columns))

    @property
    def omega_n(self) -> np.ndarray:
        """Natural frequencies of all groups of the set, concatenated, (n,) [rad/s].  Collective if one is not computed yet."""
        return np.concatenate([group.receptance.modes.omega_n for group in self.groups])

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios of the same modes, (n,) [-]."""
        return np.concatenate([group.receptance.modes.zeta for group in self.groups])

    @property
    def loaded_modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Natural frequencies [rad/s] and damping ratios of the groups with loads, (n,) each.  Collective as :attr:`omega_n`."""
        loaded = [group.receptance.modes for group in self.groups if self.f[:, group.columns].any()]
        none = [np.zeros(0)]
        return np.concatenate([m.omega_n for m in loaded] or none), np.concatenate([m.zeta for m in loaded] or none)

    @property
    def n_modes(self) -> int:
        """The largest number of modes of a harmonic."""
        return max(len(group.receptance.modes.omega_n) for group in self.groups)

    def flexibilities(self, omega: float) -> tuple[DynamicFlexibility, ...]:
        """Return c_n of each group.  Cached for the last few frequencies; collective if a group is not computed yet."""
        flexibilities = self._flexibilities.pop(omega, None) or tuple(
            group.receptance.modes.flexibility(group.harmonics, omega) for group in self.groups
        )
        self._flexibilities[omega] = flexibilities  # now the most recent
        if len(self._flexibilities) > _CACHED:
            del self._flexibilities[next(iter(self._flexibilities))]
        return flexibilities

    def flexibility_rates(
        self, omega: float, d_omega: float, d_sigma: float, d_C: Sequence[Damping] | None = None
    ) -> list[Flexibility]:
        """Return the rates of c_n of each group, see :meth:`DynamicFlexibility.rate`; ``d_C`` has one entry per group."""
        c_n = self.flexibilities(omega)
        if d_C is None:
            return [c.rate(d_omega, d_sigma) for c in c_n]
        return [c.rate(d_omega, d_sigma, of_group) for c, of_group in zip(c_n, d_C)]

    def joined(self, terms: Sequence[np.ndarray]) -> np.ndarray:
        """Return terms of the groups, each (..., N_H of the group), as one array (..., N_H); a single term itself.  Local."""
        if len(terms) == 1:
            return terms[0]
        joined_terms = np.empty((*terms[0].shape[:-1], self.N_H))
        for group, term in zip(self.groups, terms):
            joined_terms[..., group.columns] = term
        return joined_terms

    def index_of(self, n: int) -> tuple[int, int]:
        """Return the index of the group of harmonic n, and the index of n in this group.  Local."""
        return next((k, group.harmonics.chosen.index(n)) for k, group in enumerate(self.groups) if n in group.harmonics)

    def output_receptance(self, omega: float, n: int) -> np.ndarray:
        """Return A_n between the outputs and the pairs, (n_outputs, 3 n_pairs), complex [unit of the output/N].  Local."""
        k, i = self.index_of(n)
        A = self.groups[k].receptance.of_outputs(self.flexibilities(omega)[k], i)
        return A if self.observed is None else self.observed.of_forces(A, n * omega)

    def expect_to_slip(self, pairs: np.ndarray) -> None:
        """Set the order in which batches are filled with static columns of further pairs.  Local; the same on every rank."""
        for group in self.groups:
            group.receptance.static.G_static.expect(pairs)


def _parts(structure: ReducedStructure) -> dict[str, Any]:
    """Return the fields of a structure, which may be a model."""
    return {item.name: getattr(structure, item.name) for item in fields(ReducedStructure)}
