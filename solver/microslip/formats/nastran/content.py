"""What is put together of bulk data: grid points, groups, findings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ..model import Finding, Group


@dataclass
class Content:
    """What is put together so far."""

    cards: Any  # pyNastran's BDF
    numbers: np.ndarray  # (n,) grid points, rising
    points: np.ndarray  # (n, 3) in the basic system
    groups: dict[str, Group] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    of_solids: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n,) a solid element has it

    def left_out(self, card: str, number: int, effect: str, part: str = "", changes: bool = True) -> None:
        where = f"{card} {number}"
        self.findings.append(Finding(word=card, where=where, effect=effect, changes=changes, part=part))

    def nodes_of(self, numbers: Iterable[int], where: str) -> np.ndarray:
        """Return the positions of grid points.

        Raises
        ------
        MeshError : one that is not there
        """
        wanted = np.array([number for number in numbers if number], dtype=np.int64)
        index = np.minimum(np.searchsorted(self.numbers, wanted), len(self.numbers) - 1)
        missing = wanted[self.numbers[index] != wanted]
        if len(missing):
            raise MeshError(f"{where} names grid point {missing.min()}, which the file does not hold")
        return index

    def group(self, name: str, nodes: np.ndarray) -> str:
        self.groups.setdefault(name, Group()).add_nodes(nodes)
        return name


def mass_factor(content: Content) -> float:
    """Return PARAM,WTMASS, by which Nastran multiplies all masses.  Local."""
    known = content.cards.params.get("WTMASS")
    return float(known.values[0]) if known is not None else 1.0
