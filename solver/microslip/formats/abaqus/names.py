"""Numbers and names of one scope, and positions of numbers."""

from dataclasses import dataclass, field

import numpy as np

from ..model import NO_NODES
from .nodes import Elements
from .scopes import Scope


class Places:
    """Lookup of the positions of numbers."""

    def __init__(self, numbers: np.ndarray):
        self.first = int(numbers[0]) if len(numbers) else 0
        self.n = len(numbers)
        is_rising = bool((np.diff(numbers) > 0).all())
        self.is_range = is_rising and (self.n == 0 or int(numbers[-1]) - self.first == self.n - 1)
        self.order = None if is_rising else np.argsort(numbers, kind="stable")
        self.sorted = numbers if self.order is None else numbers[self.order]

    def present(self, wanted: np.ndarray | range) -> tuple[np.ndarray, int, int]:
        """Return the positions of existing numbers, the count of missing numbers, and the first missing one."""
        if isinstance(wanted, range):  # may be far longer than the list of numbers
            low, high = np.searchsorted(self.sorted, [wanted.start, wanted.stop])
            inside = self.sorted[low:high]
            inside = inside[(inside - wanted.start) % wanted.step == 0]
            n_alike = int(np.cumprod(inside == wanted.start + wanted.step * np.arange(len(inside))).sum())
            return self.find(inside)[0], len(wanted) - len(inside), wanted.start + wanted.step * n_alike
        index, missing = self.find(wanted)
        if not len(missing):
            return index, 0, 0
        return self.find(wanted[~np.isin(wanted, missing)])[0], len(missing), int(missing[0])

    def find(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of numbers, and the missing numbers."""
        if self.n == 0:
            return np.zeros(np.shape(wanted), dtype=np.int64), np.unique(wanted)
        if self.is_range:
            place = wanted - self.first
            is_missing = (place < 0) | (place >= self.n)
        else:
            place = np.minimum(np.searchsorted(self.sorted, wanted), self.n - 1)
            is_missing = self.sorted[place] != wanted
            place = place if self.order is None else self.order[place]
        return place, np.unique(wanted[is_missing]) if is_missing.any() else NO_NODES


@dataclass(eq=False)
class Names:
    """Numbers and names of one scope."""

    scope: Scope
    first_node: int = 0  # position of its first node among the nodes of all scopes
    first_element: int = 0
    node_numbers: np.ndarray = field(default_factory=lambda: NO_NODES)
    element_numbers: np.ndarray = field(default_factory=lambda: NO_NODES)
    node_places: Places = field(default_factory=lambda: Places(NO_NODES))
    element_places: Places = field(default_factory=lambda: Places(NO_NODES))
    given_nodes: list[tuple[np.ndarray, np.ndarray, str]] = field(default_factory=list)  # numbers, points, where
    blocks: list[Elements] = field(default_factory=list)
    sets: dict[str, dict[str, list[tuple[str, object, str]]]] = field(default_factory=lambda: {"NSET": {}, "ELSET": {}})
    internal: set[str] = field(default_factory=set)  # internal sets of a pre-processor
    unsorted: set[str] = field(default_factory=set)  # sets whose members remain in the stated order
    surfaces: dict[str, list[tuple[str, str, str]]] = field(default_factory=dict)  # element or set, face or "NODE", where
    system: tuple[np.ndarray, np.ndarray] = field(default_factory=lambda: (np.eye(3), np.zeros(3)))

    def places(self, kind: str) -> tuple[Places, int]:
        """Return the lookup of numbers for a kind of set, and the position of the first number."""
        return (self.node_places, self.first_node) if kind == "NSET" else (self.element_places, self.first_element)
