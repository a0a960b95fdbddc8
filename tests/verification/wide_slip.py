"""The demo from all stuck to gross slip and lift-off, and the effect of the springs that hold the mean slip.

    PYTHONPATH=solver:tests python tests/verification/wide_slip.py

Needs meshes/fan_small.msh (make setup, and meshes/fan_sector.py --size small --out meshes/fan_small.msh).
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from mpi4py import MPI
from verification import chain

from microslip.continuation.point_record import HELD
from microslip.harmonic import mean_slip
from microslip.scene.read import read_scene

DEMO = Path(__file__).parents[2] / "jobs" / "fan_small.toml"
LEVELS = (1.0, 5.0, 10.0, 15.0, 30.0, 40.0, 60.0, 100.0, 200.0, 300.0, 1000.0)  # N


def demo(levels, comm) -> chain.Chain:
    """Return the demo at other levels, by `receptance`.  Collective."""
    scene = read_scene(DEMO)
    response, solver = (
        scene.response.model_copy(update={"levels": tuple(levels)}),
        scene.solver.model_copy(update={"method": "receptance"}),
    )
    return chain.solve_scene(scene.model_copy(update={"response": response, "solver": solver}), comm)


def main():
    print("level N, springs: points, held; peak m/N at Hz, slipping and open pairs of 46; largest energy closure; s")
    for hold in (1e-3, 1e-2):
        mean_slip.HOLD = hold
        for level in LEVELS if hold == 1e-3 else [level for level in LEVELS if level >= 40.0]:
            start = time.perf_counter()
            done = demo([level], MPI.COMM_SELF)
            points = done.branches[0].points
            top = points[int(np.argmax(chain.amplitudes(done.branches[0])))]
            print(
                f"{level:6g}, {hold:g}: {len(points)}, {sum(HELD in point.notes for point in points)}; "
                f"{np.hypot(*top.response[0, 1:3]) / level:.4e} at {top.omega / 2 / np.pi:.3f}, {(top.state == 1).sum()} {(top.state == 2).sum()}; "
                f"{done.worst_closure:.1e}; {time.perf_counter() - start:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
