"""Provenance of results: with the scene, options and versions all that is needed to recompute them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class InputFile:
    """A file that a run reads, as it was then."""

    key: str  # where it is named: "[model] mesh", "included by plates.inp"
    path: str  # absolute
    size: int  # bytes
    sha256: str  # "" of a file that could not be read


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Provenance of a run: command, machine, user, and input files."""

    command: str
    started: str  # date and time with the zone
    scene_path: str
    settings: tuple[str, ...] = ()  # KEY=VALUE of the command line, already applied to the scene's text
    hosts: tuple[str, ...]  # of each rank
    n_groups: int = 1  # groups of ranks that followed levels in parallel
    environment: dict[str, str]  # variables that change a run: threads, PETSc's options
    inputs: tuple[InputFile, ...] = ()

    @property
    def n_ranks(self) -> int:
        """The number of ranks."""
        return len(self.hosts)
