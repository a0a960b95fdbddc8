"""Are peaks lost where few points are asked for?  Random structures with several sharp modes in the range.

    PYTHONPATH=solver:tests python tests/verification/sharp_peaks.py --systems 9 --points 10 30 [--first 0] [--reference 800]

Structures of 6 to 20 degrees of freedom and 1 to 4 pairs, damping ratios of 0.001 to 0.003, three to seven modes in the range, are
solved stuck, at the first slip and further on; with few points, and with many for reference.  A peak is a local maximum of an
output's amplitude above 5 % of the largest of the curve, and lost if no point lies on it, at half power or more.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes
from scipy.linalg import eigh
from verification.random_structures import _between, _dofs, _loads, _stiffness, stuck_forces

from microslip.library.build import build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.scene.read import read_scene

LEVELS = (0.5, 1.5, 4.0)  # over the one at which the first pair slips at resonance
FAINT, HALF_POWER = 0.05, 0.7


def draw(seed: int, number: int) -> tuple[dict, list[int]]:
    """Return a system of scenes.py with its levels and band, and its outputs; the same for the same two numbers."""
    rng = np.random.default_rng([seed, number])
    n, m = int(rng.integers(6, 21)), int(rng.integers(1, 5))
    M, K = np.diag(_between(rng, 0.5, 2.0, n)), _stiffness(rng, n)
    pair_dofs = np.array([_dofs(rng, n) for _ in range(m)])
    soft = np.median(np.diag(K))
    k_t, k_n = soft * _between(rng, 0.1, 3.0, m), soft * _between(rng, 0.3, 3.0, m)
    mu = _between(rng, 0.1, 0.8, m)
    bare = dict(mu=mu, N0=1.0, k_t=k_t, k_n=k_n, loads=_loads(rng, n)[:1], output=np.eye(n)[0], omega=(0.0, 1.0), levels={})
    system = scenes.make_system(f"sharp {seed}-{number}", M, K, pair_dofs, **bare, zeta=float(_between(rng, 0.001, 0.003)))
    free, stuck = (np.sqrt(eigh(A, M, eigvals_only=True)) for A in (K, scenes.stuck_stiffness(system)))
    first = int(rng.integers(2))
    low, high = 0.93 * free[first], 1.05 * stuck[min(first + int(rng.integers(2, 6)), n - 1)]
    shear, press = stuck_forces(system, low, high)
    N0 = _between(rng, 0.3, 3.0, m) * np.maximum(shear / mu, 0.3 * press)
    onset = np.min(np.where(shear > 0.0, mu * N0 / np.where(shear > 0.0, shear, 1.0), np.inf))
    unit = np.abs(N0).max()  # forces of order 1
    levels = {str(i): level * (onset if np.isfinite(onset) else 1.0) / unit for i, level in enumerate(LEVELS)}
    outputs = sorted(set(rng.choice(n, 3, replace=False).tolist()))
    return {**system, "N0": N0 / unit, "omega": (low, high), "levels": levels}, outputs


def curves(seed: int, number: int, points: list[int]) -> list[list]:
    """Return the branches of a system at each of some numbers of points."""
    system, outputs = draw(seed, number)
    with tempfile.TemporaryDirectory() as folder:
        levels = list(system["levels"].values())
        path = write_matrix_scene(
            Path(folder), system, levels, system["omega"], outputs=outputs, points=60, harmonics=3, samples=128
        )
        with build(read_scene(path), MPI.COMM_SELF) as structure:
            response = prepare(structure).response
            return [follow(replace(response, settings=replace(response.settings, points=n))) for n in points]


def sampled(branch) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (n,) [rad/s] and the outputs' amplitudes (n, n_outputs) [m] of a branch."""
    return np.array([p.omega for p in branch.points]), np.array([np.hypot(*p.response[:, 1:3].T) for p in branch.points])


def peaks(omega: np.ndarray, amplitude: np.ndarray) -> list[tuple[float, float, float]]:
    """Return height and half-power range of the peaks of a curve, which falls that far on one side of them at least."""
    inner, found = amplitude[1:-1], []
    for i in 1 + np.flatnonzero((inner > amplitude[:-2]) & (inner >= amplitude[2:]) & (inner > FAINT * amplitude.max())):
        below = np.flatnonzero(amplitude < HALF_POWER * amplitude[i])
        if len(below):
            low, high = below[below < i].max(initial=0), below[below > i].min(initial=len(omega) - 1)
            found.append((float(amplitude[i]), omega[low : high + 1].min(), omega[low : high + 1].max()))
    return found


def lost(branch, reference) -> tuple[int, int]:
    """Return how many peaks of a reference there are in all outputs, and how many a branch shows no point of."""
    (omega, amplitude), (dense_omega, dense) = sampled(branch), sampled(reference)
    n_peaks = n_lost = 0
    for own, true in zip(amplitude.T, dense.T):
        for height, low, high in peaks(dense_omega, true):
            n_peaks += 1
            n_lost += own[(low <= omega) & (omega <= high)].max(initial=0.0) < HALF_POWER * height
    return n_peaks, int(n_lost)


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for key, default in (("seed", 7), ("systems", 9), ("first", 0), ("reference", 800)):
        options.add_argument(f"--{key}", type=int, default=default)
    options.add_argument("--points", type=int, nargs="+", default=[10, 30])
    asked, start = options.parse_args(), time.perf_counter()
    total = dict.fromkeys(asked.points, (0, 0, 0, 0))  # peaks, lost, points, notes
    for number in range(asked.first, asked.first + asked.systems):
        *few, dense = curves(asked.seed, number, [*asked.points, asked.reference])
        for n, branches in zip(asked.points, few):
            complete = [pair for pair in zip(branches, dense) if not any(branch.failure for branch in pair)]
            of = [lost(*pair) for pair in complete]
            counts = [sum(p for p, _ in of), sum(missing for _, missing in of), sum(len(branch.points) for branch, _ in complete)]
            counts.append(sum("resonance" in note for branch, _ in complete for point in branch.points for note in point.notes))
            total[n] = tuple(a + b for a, b in zip(total[n], counts))
        print(f"system {number}: {time.perf_counter() - start:.0f} s, {total}", flush=True)
    print("\n| points asked for | peaks | lost | points found | notes |\n| --- | --- | --- | --- | --- |")
    for n, counts in total.items():
        print(f"| {n} | " + " | ".join(map(str, counts)) + " |")


if __name__ == "__main__":
    main()
