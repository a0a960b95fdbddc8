"""All stages in memory: from a scene file to its branches, without result files.  For the studies of this folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc; without effect if already done

from microslip.library.build import Structure, build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.receptance.reduced_model import ReducedModel
from microslip.results.audit import energy_closure
from microslip.scene.read import read_scene


@dataclass(frozen=True)
class Chain:
    """The results of a scene; its matrices are freed."""

    structure: Structure
    model: ReducedModel
    branches: list
    n_rows: int  # matrix rows of this rank

    @property
    def worst_closure(self) -> float:
        """The largest error of the energy balance over all points, relative to the input.  On rank 0."""
        return max(energy_closure(branch).max() for branch in self.branches)


def solve(path: Path, comm) -> Chain:
    """Return the branches of every level of a scene file.  Collective on ``comm``.

    The stages are those of ``microslip.run``; a branch that ends early is an error here.
    """
    return solve_scene(read_scene(path), comm)


def solve_scene(scene, comm) -> Chain:
    """Return the branches of every level of a scene.  Collective on ``comm``."""
    structure = build(scene, comm)
    prepared = prepare(structure, has_bars=False)
    branches = follow(prepared.response)
    first, last = structure.linearised.M.getOwnershipRange()
    structure.close()
    failures = [branch.failure for branch in branches if branch.failure]
    assert not failures, failures
    return Chain(structure, prepared.model, branches, last - first)


def requested(branch) -> list:
    """Return the points of a branch at the frequencies of [response] ``at``."""
    return [point for point in branch.points if point.requested]


def amplitudes(branch, output=0) -> np.ndarray:
    """Return the amplitudes of harmonic 1 along a branch, (n_points,) [m]."""
    return np.array([np.hypot(*point.response[output, 1:3]) for point in branch.points])
