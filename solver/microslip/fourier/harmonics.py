"""Sets of harmonics and the order of their real coefficients.  NumPy only; every function is local.

Coefficients run [mean if 0 is in the set, then cos n, sin n for each n > 0, rising] along the last axis: a set has a mean exactly
if the number of its coefficients is odd.  The complex amplitude of harmonic n is cos - i sin.  docs/theory.md, section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np


@dataclass(frozen=True)
class Harmonics:
    """A set of harmonics, equal to and hashed like its tuple; ValueError unless that rises strictly, from 0 or above."""

    chosen: tuple[int, ...]

    def __post_init__(self) -> None:
        chosen = tuple(int(n) for n in self.chosen)
        if not chosen or chosen[0] < 0 or any(b <= a for a, b in zip(chosen, chosen[1:])):
            raise ValueError(f"harmonics {self.chosen}: at least one is needed, none below 0, each above the one before")
        object.__setattr__(self, "chosen", chosen)

    @staticmethod
    @lru_cache(maxsize=256)
    def up_to(H: int) -> Harmonics:
        """Return the full set 0, 1, ..., H."""
        return Harmonics(tuple(range(H + 1)))

    @staticmethod
    @lru_cache(maxsize=256)
    def odd_up_to(H: int) -> Harmonics:
        """Return 1, 3, ..., up to H, which is at least 1."""
        return Harmonics(tuple(range(1, H + 1, 2)))

    @staticmethod
    def full(n_coefficients: int) -> Harmonics:
        """Return the full set of an odd number 2 H + 1 of coefficients; ValueError for an even number."""
        if n_coefficients % 2 == 0:
            raise ValueError(f"{n_coefficients} coefficients are not those of the harmonics 0 to H: name the set")
        return Harmonics.up_to(n_coefficients // 2)

    def __contains__(self, n: int) -> bool:
        return n in self.chosen

    def __len__(self) -> int:
        return len(self.chosen)

    def __str__(self) -> str:
        return ", ".join(map(str, self.chosen))

    @property
    def has_mean(self) -> bool:
        """Whether the mean is one of the harmonics."""
        return self.chosen[0] == 0

    @property
    def highest(self) -> int:
        """The highest harmonic."""
        return self.chosen[-1]

    @property
    def is_constant(self) -> bool:
        """Whether there are no harmonics above the mean: nothing vibrates."""
        return self.highest == 0

    @property
    def vibrate_about_a_mean(self) -> bool:
        """Whether there is a mean, and others above it."""
        return self.has_mean and not self.is_constant

    def samples(self, n: int) -> int:
        """Return the number of samples of a period: ``n``, or one for a constant motion."""
        return 1 if self.is_constant else n

    @cached_property
    def numbers(self) -> np.ndarray:
        """The harmonics, those of the complex amplitudes, (n_harmonics,).  Read-only."""
        return _read_only(np.array(self.chosen))

    @cached_property
    def above_mean(self) -> np.ndarray:
        """The harmonics n > 0, those of the columns ``cos`` and ``sin``.  Read-only."""
        return _read_only(np.array([n for n in self.chosen if n > 0], dtype=int))

    @cached_property
    def n_coefficients(self) -> int:
        """N_H, 2 H + 1 of the full set."""
        return 2 * len(self.chosen) - int(self.has_mean)

    @cached_property
    def mean(self) -> slice:
        """The column of the mean; an empty slice without one."""
        return slice(0, int(self.has_mean))

    @cached_property
    def vibration(self) -> slice:
        """The columns of the harmonics above the mean."""
        return slice(int(self.has_mean), None)

    @cached_property
    def cos(self) -> slice:
        """The columns of the cosines."""
        return slice(int(self.has_mean), None, 2)

    @cached_property
    def sin(self) -> slice:
        """The columns of the sines."""
        return slice(int(self.has_mean) + 1, None, 2)

    def columns(self, n: int) -> slice:
        """Return the columns of harmonic n: its mean, or its cosine and sine; ValueError if it is not in the set."""
        first = 2 * self.chosen.index(n) - int(self.has_mean and n > 0)
        return slice(first, first + (1 if n == 0 else 2))

    def carry(self, U: np.ndarray, to: Harmonics) -> np.ndarray:
        """Return coefficients (..., N_H) of this set as those of another: missing ones zero, surplus ones dropped.

        ``U`` itself where the sets are equal.
        """
        if U.shape[-1] != self.n_coefficients:
            raise ValueError(f"{U.shape[-1]} coefficients for the harmonics {self}, which have {self.n_coefficients}")
        if to == self:
            return U
        carried = np.zeros((*U.shape[:-1], to.n_coefficients), dtype=U.dtype)
        here, there = _shared_columns(self, to)
        carried[..., there] = U[..., here]
        return carried


@lru_cache(maxsize=256)
def _shared_columns(a: Harmonics, b: Harmonics) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns of the harmonics that two sets share, in each of them."""
    shared = [n for n in a.chosen if n in b]

    def columns(of: Harmonics) -> np.ndarray:
        return np.concatenate([np.r_[of.columns(n)] for n in shared] or [np.zeros(0, dtype=int)])

    return columns(a), columns(b)


def _read_only(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values
