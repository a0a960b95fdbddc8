"""One rank compared with several: the same scene on one rank and on all, inside one job.

    PYTHONPATH=solver:tests:meshes mpirun --oversubscribe -n 2 python tests/verification/ranks.py
    PYTHONPATH=solver:tests:meshes mpirun --oversubscribe -n 3 python tests/verification/ranks.py

Every rank solves the scene on COMM_SELF, and then all ranks solve it on COMM_WORLD. The mesh is partitioned, rows and contact
pairs are owned by different ranks, sums have another order: the differences are the errors of the solvers.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from blocks import stacked
from lap_joint import LapJoint, lap_joint
from mpi4py import MPI
from msh import write_msh
from scene_text import driven, joint, steel, support, table
from verification import chain


@dataclass(frozen=True)
class Case:
    """A scene, its mesh, and its differences from the other scenes."""

    bodies: dict
    clamp: str
    surfaces: tuple[str, str]
    k_t: float  # N/m3
    preload: float  # Pa
    loaded: list[float]  # m
    direction: list[float]
    response: dict
    modes: int


def lap(kind: str, low: float, high: float, **cells) -> Case:
    """Return the lap joint, coarse, all stuck and in micro-slip, between two frequencies [Hz]."""
    response = {"levels": [0.1, 2.0], "frequencies": [low, high], "points": 25}
    bodies, surfaces = lap_joint(LapJoint(kind=kind, **cells)), ("lap_1", "lap_2")
    return Case(bodies, "clamp", surfaces, 1e13, 1e7, [0.21, 0.01, 0.0], [0.0, 1.0, 0.0], response, 12)


def two_elements() -> Case:
    """Return a cube of one element on a held one, sheared across: with three ranks one owns no element and no row."""
    response = {"levels": [0.5, 6.0], "frequencies": [6700.0, 7040.0], "points": 20}
    bodies, surfaces = stacked("hex8", (0.02, 0.02, 0.02), (1, 1, 1), ground_height=0.02), ("bar_bottom", "ground_top")
    return Case(bodies, "ground_base", surfaces, 1e12, 1e6, [0.0, 0.0, 0.02], [1.0, 0.3, 0.0], response, 6)


CASES = {
    "two hex8": two_elements(),
    "lap joint of tet4": lap("tet4", 518.0, 546.0, n_free=8, n_overlap=3, n_thickness=1),
    "lap joint of tet10": lap("tet10", 354.0, 372.0),
}


def write_case(folder: Path, case: Case) -> Path:
    """Write mesh and scene; return the scene's path.  Local."""
    write_msh(str(folder / "case.msh"), case.bodies)
    text = table("model", mesh="case.msh") + steel(*case.bodies, young=210e9, density=7850.0) + support(case.clamp)
    text += joint(*case.surfaces, k_t=case.k_t, preload=case.preload) + driven([case.loaded], *2 * [case.direction], "loaded")
    at = np.linspace(*case.response["frequencies"], 10)[1:-1].tolist()
    text += table("damping", ratio=2e-3) + table("response", **case.response, at=at)
    text += table("solver", method="receptance", modes=case.modes, harmonics=3, samples=128)
    (folder / "case.toml").write_text(text)
    return folder / "case.toml"


@dataclass(frozen=True)
class Difference:
    """Differences between the results of one rank and of several."""

    frequencies: float  # largest relative difference
    response: float  # largest difference at the same frequencies, over the peak of their level
    closure: float  # energy balance, at the worst point
    states: list[int]  # of the pairs at these frequencies
    shares: list[tuple[int, int]]  # matrix rows and contact pairs of each rank


def difference(path: Path, comm) -> Difference:
    """Solve a scene on ``comm`` and on COMM_SELF.  Collective on ``comm``; the same result on every rank."""
    on_one, on_all = chain.solve(path, MPI.COMM_SELF), chain.solve(path, comm)
    response, states = 0.0, set()
    for a, b in zip(on_one.branches, on_all.branches, strict=True):
        peak = chain.amplitudes(a).max()
        for p, q in zip(chain.requested(a), chain.requested(b), strict=True):
            response = max(response, np.abs(p.response - q.response).max() / peak)
        states |= {int(state) for point in chain.requested(a) for state in point.state}
    computed = (np.abs(on_all.model.omega_n / on_one.model.omega_n - 1.0).max(), response, on_all.worst_closure)
    return Difference(
        *(float(comm.allreduce(value, op=MPI.MAX)) for value in computed),
        states=sorted(states),
        shares=comm.allgather((on_all.n_rows, on_all.model.owned.stop - on_all.model.owned.start)),
    )


def main():
    comm = MPI.COMM_WORLD
    for name, case in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            computed = difference(write_case(Path(folder), case), comm)
        if comm.rank == 0:
            print(
                f"| {comm.size} | {name} | {computed.frequencies:.1e} | {computed.response:.1e} | {computed.closure:.1e} | "
                f"{computed.states} | {'; '.join(map(str, computed.shares))} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
