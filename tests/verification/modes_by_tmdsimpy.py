"""Nonlinear modes of a chain with friction to ground, by this program and by TMDSimPy: the same law, samples and harmonics.

    PYTHONPATH=solver:tests python tests/verification/modes_by_tmdsimpy.py FOLDER [N_PAIRS]

FOLDER is a clone of github.com/tmd-lab/tmdsimpy.  Every mass has a Jenkins element with constant normal force; both
programs march from sample to sample by the return map.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import microslip  # isort: skip  selects the kernels of OpenBLAS before NumPy is loaded

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from matrix_scenes import write_matrix_scene
from oracles import scenes

H, SAMPLES = 3, 128


def chain(n: int) -> dict:
    """Return n masses between walls, friction elements of different limits and stiffness to the ground."""
    links = (n / 5.0) ** 2 * (np.diag(np.full(n, 2.0)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1))
    return scenes.make_system(
        "chain",
        np.eye(n),
        links,
        [[i, -1, -1, -1, -1, -1] for i in range(n)],
        mu=1.0,
        N0=np.linspace(0.5, 1.5, n),
        k_t=np.linspace(0.2, 0.1, n),
        k_n=0.0,
        C=0.01 * np.eye(n),
        loads=[{"vector": np.eye(n)[0], "harmonic": 1, "phase": 0.0}],
        output=np.eye(n)[0],
        omega=(0.1, 3.0),
        levels={},
    )


def by_this_program(system: dict):
    """Return the mode, with all masses as outputs, and the processor time of it [s]."""
    with tempfile.TemporaryDirectory() as folder:
        solver = {"harmonics": H, "samples": SAMPLES, "between_samples": "return-map", "tolerance": 1e-10, "error_bars": False}
        path = write_matrix_scene(Path(folder), system, [0.1], system["omega"], **solver)
        with microslip.build(microslip.read(path)) as structure:
            began = time.process_time()
            mode = microslip.backbone(structure, farthest=30.0, quasi_static=False, error_bars=False)
            return mode, time.process_time() - began


def by_tmdsimpy(system: dict, amplitudes, start):
    """Return omega and damping ratio at amplitudes of harmonic 1, (u_1^H M u_1)^1/2, and the processor time of it [s]."""
    from tmdsimpy.nlforces.vector_jenkins import VectorJenkins
    from tmdsimpy.vibration_system import VibrationSystem

    n, h = len(system["M"]), np.arange(H + 1)
    vibration = VibrationSystem(system["M"], system["K"], C=system["C"])
    for k_t, limit, row in zip(system["k_t"], system["N0"] * system["mu"], np.eye(n)):
        vibration.add_nl_force(VectorJenkins(row[None], row[:, None], k_t, limit))
    phase = np.zeros(n * (2 * H + 1))
    phase[2 * n : 3 * n] = start[n : 2 * n]  # the sine of the stuck mode is zero: samples are at the same instants
    x, results, began = start, [], time.process_time()
    for amplitude in amplitudes:
        for _ in range(60):
            residual, jacobian, _ = vibration.epmc_res(np.append(x, np.log10(amplitude)), phase, h, Nt=SAMPLES)
            step = np.linalg.solve(jacobian, residual)
            x = x - step
            if np.linalg.norm(step) < 1e-11 * np.linalg.norm(x):
                break
        else:
            raise RuntimeError(f"TMDSimPy: no solution at {amplitude:g}")
        results.append((x[-2], x[-1] / (2.0 * x[-2])))
    return np.array(results), time.process_time() - began


def main(folder: str, n_pairs: str = "10") -> None:
    sys.path.insert(0, folder)
    system = chain(int(n_pairs))
    mode, own = by_this_program(system)
    response, n = mode.response, int(n_pairs)
    amplitudes = np.sqrt((response[:, :, 1:3] ** 2).sum(axis=(1, 2)))
    first = response[0, :, 1] / amplitudes[0]
    start = np.concatenate([np.zeros(n), first, np.zeros(n * (2 * H - 1)), [mode.points[0].omega, 0.01]])
    theirs, seconds = by_tmdsimpy(system, amplitudes, start)
    ours = 2.0 * np.pi * mode.frequency, mode.damping
    shift = np.abs(theirs[:, 0] - ours[0]).max() / np.ptp(ours[0])
    damping = np.abs(theirs[:, 1] / ours[1] - 1.0).max()
    print(f"{n} pairs, {len(amplitudes)} points, damping {mode.damping.min():.4f} to {mode.damping.max():.4f}, ", end="")
    print(f"slipping {mode.slipping.min()} to {mode.slipping.max()}")
    print(f"largest difference: {shift:.1e} of the frequency shift, {damping:.1e} of the damping ratio")
    print(f"processor time: this program {own:.3g} s, TMDSimPy {seconds:.3g} s, ratio {seconds / own:.1f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
