"""What other rooms ask of a method beside its reduction; each file in ``methods`` says it of its own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Facts:
    makes_basis: bool = False  # of vectors of the whole structure, all of them in memory at once
    knows_range: bool = False  # the reduction depends on the frequencies and harmonics that are asked for
