"""Laws of pairs with a preload or a gap: their springs at rest, and their parameters."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..fourier.harmonics import Harmonics
from .parameters import column_with, not_among

if TYPE_CHECKING:
    from typing import Self


@dataclass(frozen=True)
class Preloaded:
    """Base of the laws of ``n`` pairs with a preload or a gap: elastic-Coulomb friction and rough surfaces."""

    described: ClassVar[str]  # the law in messages
    mu: np.ndarray  # (n,) friction coefficient [-]
    N0: np.ndarray  # (n,) normal preload [N]; a negative value is an initial gap -N0 / k_n
    k_t: np.ndarray  # (n,) tangential stiffness [N/m]
    k_n: np.ndarray  # (n,) normal stiffness [N/m]
    open_at_rest: np.ndarray = field(
        default_factory=lambda: np.zeros(1, dtype=bool), kw_only=True
    )  # (n,) bool: open at rest, without springs (3.8)

    @property
    def springs(self) -> np.ndarray:
        """The springs of a pair in contact, (n, 3) [N/m], also of pairs that are open at rest."""
        raise NotImplementedError

    @cached_property
    def stiffness(self) -> np.ndarray:
        """The springs K_J at rest, along x, y and z, (n, 3) [N/m]; 0 for a pair that is open at rest."""
        return np.where(self.open_at_rest[:, None], 0.0, self.springs)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters that vary."""
        return "mu", "N0", "gap", "k_t", "k_n"

    def with_parameters(self, name: str, pairs: np.ndarray, values: np.ndarray) -> Self:
        """Return the law with new values of mu, N0, gap, k_t or k_n for some pairs.

        Local.  Parameters along y change in proportion to those along x; gaps stay where k_n changes.  ValueError as in
        :class:`Law`.
        """
        return replace(self, **self._changed(name, pairs, values))

    def _changed(self, name: str, pairs: np.ndarray, values: np.ndarray) -> dict[str, Any]:
        """Return the changed columns."""
        self._check(name)
        if name in ("N0", "gap"):
            N0, changed = self.N0, column_with(self.N0, pairs, values if name == "N0" else -self.k_n[pairs] * values)
            crosses = (changed > 0.0) != (N0 > 0.0)  # it would change the state of a pair and its springs at rest
            if crosses.any():
                i = np.argmax(crosses)
                raise ValueError(
                    f"N0 of pair {i} goes from {N0[i]:g} to {changed[i]:g}: a preload cannot become a gap, or a gap a preload"
                )
            return {"N0": changed}
        before = getattr(self, name)
        columns = {name: column_with(before, pairs, values)}
        if name == "k_n":
            columns["N0"] = self.N0 + self._preload_of_gaps * (columns[name] - before)
        return columns

    def _check(self, name: str) -> None:
        if name not in self.parameters:
            raise not_among(name, self.described, self.parameters)

    @property
    def _preload_of_gaps(self) -> np.ndarray:
        """The derivative of N0 (n,) by k_n at a constant gap, -gap; 0 of pairs with a preload."""
        return np.divide(np.minimum(self.N0, 0.0), self.k_n, out=np.zeros_like(self.k_n), where=self.k_n > 0.0)

    def parameter_rate(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter of each pair under the motion ``U`` (n, 3, N_H), (n, 3, N_H); by k_n at a constant gap.

        Local.  docs/theory.md, eq. (3.15).
        """
        if name == "gap":
            return -self.k_n[:, None, None] * self.rate_at_preload("N0", U, n_samples, harmonics)
        rate, of_gaps = self.rate_at_preload(name, U, n_samples, harmonics), self._preload_of_gaps
        if name == "k_n" and of_gaps.any():
            rate += of_gaps[:, None, None] * self.rate_at_preload("N0", U, n_samples, harmonics)
        return rate

    def rate_at_preload(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return the same, by k_n at a constant N0.  Local."""
        raise NotImplementedError
