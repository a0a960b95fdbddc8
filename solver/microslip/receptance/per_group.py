"""Harmonics in groups: harmonics of one group share stiffness, modes and static response (docs/theory.md, section 4).

A plain structure has one group; in a disc of identical sectors, the harmonics of one nodal diameter form a group.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")
S = TypeVar("S")


def only_group(n: int) -> Hashable:
    """Return the group of harmonic n if there is only one group."""
    return 0


class PerGroup(Generic[T]):
    """A value of each harmonic group, computed on demand.

    Parameters
    ----------
    make : collective; returns the value of a group
    group_of : returns the group of harmonic n
    groups : all groups
    """

    def __init__(
        self,
        make: Callable[[Hashable], T],
        group_of: Callable[[int], Hashable] = only_group,
        groups: tuple[Hashable, ...] = (only_group(0),),
    ):
        self._make, self.group_of, self.groups = make, group_of, groups
        self._computed: dict[Hashable, T] = {}

    @classmethod
    def single(cls, value: T) -> PerGroup[T]:
        """Return the same value for every harmonic."""
        return cls(lambda group: value)

    def of_group(self, group: Hashable) -> T:
        """Return the value of a group.  Collective if it is not computed yet."""
        if group not in self._computed:
            self._computed[group] = self._make(group)
        return self._computed[group]

    def knows(self, group: Hashable) -> bool:
        """Return whether the value of a group is computed.  Local."""
        return group in self._computed

    def of(self, n: int) -> T:
        """Return the value of the group of harmonic n.  Collective if it is not computed yet."""
        return self.of_group(self.group_of(n))

    def mapped(self, change: Callable[[T], S]) -> PerGroup[S]:
        """Return the values mapped by ``change``, on demand.  Local."""
        return PerGroup(lambda group: change(self.of_group(group)), self.group_of, self.groups)

    @property
    def computed(self) -> list[T]:
        """The values computed so far.  Local."""
        return list(self._computed.values())
