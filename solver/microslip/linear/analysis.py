"""MUMPS' estimates of a factorisation after its analysis: memory on each rank."""

from dataclasses import dataclass
from typing import Protocol

_MB = 1e6  # bytes of MUMPS' megabyte
_BYTES_AN_ENTRY = 12.0  # of a matrix: its value and its place


class Reports(Protocol):
    """MUMPS' reports by their numbers in its guide: INFO of this rank, INFOG and RINFOG of all."""

    def info(self, number: int) -> int:
        """Return INFO(number) of MUMPS, of this rank."""

    def infog(self, number: int) -> int:
        """Return INFOG(number) of MUMPS."""

    def rinfog(self, number: int) -> float:
        """Return RINFOG(number) of MUMPS."""


@dataclass(frozen=True)
class FactorMemory:
    """MUMPS' estimates of a factorisation on this rank; the entries are of all ranks."""

    in_core: float  # bytes
    out_of_core: float  # bytes in memory, the factor on disk
    on_disk: float  # bytes of the factor, out of core
    entries: int  # of the factor


def factor_memory(mumps: Reports) -> FactorMemory:
    """Return the memory that an analysed factor will need on this rank.  Local."""
    return FactorMemory(
        in_core=_MB * mumps.info(15),
        out_of_core=_MB * mumps.info(17),
        on_disk=8.0 * count(mumps.info(3)),
        entries=count(mumps.infog(20)),
    )


def saved_size(mumps: Reports) -> float:
    """Return the size of this rank's part of a factor in a file [bytes], a tenth of it for indices.  Local."""
    return 1.1 * 8.0 * count(mumps.info(9))


def scaled_memory(mumps: Reports, n_dof_each: int, entries_owned: int) -> FactorMemory:
    """Return the memory of a factor on this rank from the analysed graph of its nodes, of ``n_dof_each`` unknowns each.  Local.

    Fronts have ``n_dof_each`` times the rows and the square of that the entries.  The entries of the matrix are added, half of
    ``entries_owned`` with their indices.
    """
    size = 8.0 * n_dof_each**2
    of_matrix = _BYTES_AN_ENTRY * entries_owned / 2.0
    return FactorMemory(
        in_core=size * count(mumps.info(8)) + of_matrix,
        out_of_core=_MB * n_dof_each * mumps.info(17) + of_matrix,
        on_disk=size * count(mumps.info(3)),
        entries=n_dof_each**2 * count(mumps.infog(20)),
    )


def count(value: int) -> int:
    """Return a count that MUMPS gives in millions, as a negative number, where it exceeds 32 bits.  Local."""
    return value if value >= 0 else -value * 1_000_000
