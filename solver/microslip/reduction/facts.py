"""Properties of a method that other packages need; each file in ``methods`` states its own."""

from collections.abc import Callable
from dataclasses import dataclass

from .settings import ReductionSettings


@dataclass(frozen=True)
class Counts:
    """Numbers of modes, DOFs, pairs and loads."""

    modes: int
    dof: int
    pairs: int
    loads: int


@dataclass(frozen=True)
class Facts:
    """Properties of a method, known before it reduces a structure."""

    coordinates: Callable[[ReductionSettings, Counts], int]  # largest number of unknowns per harmonic coefficient
    makes_basis: bool = False  # of vectors of the whole structure, all in memory at the same time
    knows_range: bool = False  # the reduction depends on the requested frequencies and harmonics
