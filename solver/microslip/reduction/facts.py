"""Properties of a method that other packages need; each file in ``methods`` states its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .settings import ReductionSettings


@dataclass(frozen=True)
class Counts:
    """How many there are."""

    modes: int
    dof: int
    pairs: int
    loads: int


@dataclass(frozen=True)
class Facts:
    coordinates: Callable[[ReductionSettings, Counts], int]  # unknowns that a harmonic coefficient has at most
    makes_basis: bool = False  # of vectors of the whole structure, all of them in memory at once
    knows_range: bool = False  # the reduction depends on the requested frequencies and harmonics
