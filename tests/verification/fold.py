"""Folded resonances followed in both directions: a preloaded contact that opens (softening), a gap that closes (hardening).

    PYTHONPATH=solver:tests python tests/verification/fold.py [DIR]

One mass on a spring, pressed against the ground or with a gap to it.  Draws fold.png into DIR.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from matrix_scenes import branches_of, write_matrix_scene
from mpi4py import MPI
from oracles import scenes

HZ = 2.0 * np.pi


@dataclass(frozen=True)
class Fold:
    """A mass of 1 kg on 1 N/m with a contact: the level, the band and the frequencies of comparison [rad/s]."""

    title: str
    k_n: float  # N/m
    N0: float  # N
    level: float  # N
    band: tuple[float, float]
    at: tuple[float, ...]


FOLDS = {
    "softening": Fold("preloaded contact opens", 1.0, 1.0, 0.18, (1.0, 1.6), (1.05, 1.2, 1.315, 1.33, 1.345, 1.38, 1.5)),
    "hardening": Fold("gap closes", 1.0, -1.0, 0.1, (0.7, 1.5), (0.8, 0.95, 1.0, 1.045, 1.05, 1.056, 1.2, 1.4)),
}


def mass(fold: Fold) -> dict:
    """Return the system."""
    return scenes.make_system(
        "bouncing mass",
        [[1.0]],
        [[1.0]],
        [[-1, -1, 0, -1, -1, -1]],
        mu=0.0,
        N0=fold.N0,
        k_t=1.0,
        k_n=fold.k_n,
        zeta=0.02,
        loads=[{"vector": [1.0], "harmonic": 1, "phase": 0.0}],
        output=[1.0],
        omega=fold.band,
        levels={},
    )


def followed(fold: Fold, direction: str, folder: Path, comm, points: int = 60):
    """Return the branch followed "up" or "down".  Collective on ``comm``; ``folder`` is the same on all ranks."""
    if comm.rank == 0:
        write_matrix_scene(
            folder,
            mass(fold),
            [fold.level],
            fold.band,
            at=fold.at,
            points=points,
            direction=direction,
            harmonics=7,
            samples=512,
            tolerance=1e-10,
        )
    comm.barrier()
    (branch,) = branches_of(folder / "scene.toml", comm)
    return branch


def amplitudes(branch) -> np.ndarray:
    return np.array([np.hypot(*point.response[0, 1:3]) for point in branch.points])


def turning_points(branch) -> list[int]:
    """Return the numbers of the points at which the branch turns back in frequency."""
    steps = np.diff([point.omega for point in branch.points])
    return [i + 1 for i in range(len(steps) - 1) if steps[i] * steps[i + 1] < 0.0]


def at_requested(fold: Fold, branch) -> list[np.ndarray]:
    """Return the sorted amplitudes of all solutions at each requested frequency."""
    omegas, sizes = np.array([point.omega for point in branch.points]), amplitudes(branch)
    return [np.sort(sizes[np.abs(omegas - omega) < 1e-9]) for omega in fold.at]


def difference(fold: Fold, up, down) -> float:
    """Return the largest relative difference of the amplitudes at requested frequencies, infinite where their numbers differ."""
    pairs = list(zip(at_requested(fold, up), at_requested(fold, down)))
    if any(len(a) != len(b) for a, b in pairs):
        return np.inf
    return max(float(np.abs(a / b - 1.0).max()) for a, b in pairs)


def draw(folder: Path) -> list[str]:
    """Draw fold.png into a folder; return a line of text for each fold."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.8), constrained_layout=True)
    lines = []
    for axis, (name, fold) in zip(axes, FOLDS.items()):
        with tempfile.TemporaryDirectory() as scratch:
            up, down = (followed(fold, way, Path(scratch), MPI.COMM_SELF) for way in ("up", "down"))
        styles = {"color": "tab:blue", "lw": 2.2}, {"color": "tab:orange", "lw": 1.0, "ls": "--"}
        for branch, style, words in zip((up, down), styles, ("forward", "backward")):
            hertz, sizes = np.array([point.omega for point in branch.points]) / HZ, amplitudes(branch)
            axis.plot(hertz, sizes, label=f"{words}, {len(sizes)} points", **style)
        turns = turning_points(up)
        axis.plot(
            [up.points[i].omega / HZ for i in turns],
            amplitudes(up)[turns],
            "o",
            ms=7,
            mfc="none",
            color="k",
            label="turning points",
        )
        axis.set(xlabel="frequency in Hz", ylabel="amplitude of harmonic 1 in m", title=f"{fold.title}: {name}, {fold.level:g} N")
        axis.legend(frameon=False, fontsize=8, loc="upper left" if name == "hardening" else "upper right")
        axis.spines[["top", "right"]].set_visible(False)
        lines.append(
            f"{fold.title} ({name}): {len(turning_points(up))} turning points forward, {len(turning_points(down))} backward; of "
            f"{len(fold.at)} common frequencies {sum(len(each) == 3 for each in at_requested(fold, up))} have three solutions, and both "
            f"directions give the same ones to {difference(fold, up, down):.1e}."
        )
    figure.savefig(folder / "fold.png", dpi=150)
    plt.close(figure)
    return lines


if __name__ == "__main__":
    print("\n".join(draw(Path(sys.argv[1] if len(sys.argv) > 1 else "."))))
