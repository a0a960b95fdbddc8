"""Are peaks missed where few points are requested, and does ``peaks = true`` locate them?  Random structures with sharp modes.

    PYTHONPATH=solver:tests python tests/verification/sharp_peaks.py --systems 9 --points 10 30 [--first 0] [--reference 800]
    PYTHONPATH=solver:tests python tests/verification/sharp_peaks.py --systems 200 --small --points 10 --reference 300
    PYTHONPATH=solver:tests python tests/verification/sharp_peaks.py --small --reference 300 --store 1 2 76 91 103 108 114 129 145 155 174

Structures of 6 to 20 degrees of freedom, 1 to 4 pairs and 3 outputs, damping ratios of 0.001 to 0.003, several modes in the range,
are solved stuck, at the first slip and further on (``--small``: 3 to 5, 1 to 2 and 2, at one of the last two levels); with few points and
``peaks = true``, and with many for reference.  A peak is a local maximum of an output's amplitude above 5 % of the largest of the
curve.  The points of a curve miss it if none lies at half power or more, and show its height if one lies at 99 % of it.
``peaks = true`` locates it if a maximum lies in its half-power range and is at least as high, to 1e-3; those lower by more than
1e-4 are counted as well: maxima of the sampled law near the highest one are as close to it.  ``--store`` writes the peaks of the
reference of some systems to tests/data/sharp_peaks.csv, for the tests.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
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

from microslip.continuation.levels import ResponseProblem
from microslip.library.build import build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.scene.read import read_scene

STORED = Path(__file__).parent.parent / "data" / "sharp_peaks.csv"
LEVELS = (0.5, 1.5, 4.0)  # relative to first slip at resonance
FAINT, HALF_POWER, HEIGHT = 0.05, 0.7, 0.99
LOWER, EQUAL = 1e-3, 1e-4  # relative to a peak of the reference: by which a maximum may be lower; up to which it is equal
BEYOND = 2e-3  # relative to the frequency: how far it may lie beyond the points of the reference, where the curve turns back
COUNTS = ("peaks", "missed by points", "below 99 % by points", "not located", "lower", "points", "notes")


def draw(seed: int, number: int, is_small: bool = False) -> tuple[dict, list[int]]:
    """Return a system of scenes.py with its levels, band and outputs, which depends only on the numbers."""
    rng, (sizes, pairs) = np.random.default_rng([seed, number]), ((3, 6), (1, 3)) if is_small else ((6, 21), (1, 5))
    n, m = int(rng.integers(*sizes)), int(rng.integers(*pairs))
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
    levels = {
        str(i): level * (onset if np.isfinite(onset) else 1.0) / unit
        for i, level in enumerate(LEVELS)
        if not is_small or i == 1 + number % 2
    }
    outputs = sorted(set(rng.choice(n, 2 if is_small else 3, replace=False).tolist()))
    return {**system, "N0": N0 / unit, "omega": (low, high), "levels": levels}, outputs


@contextmanager
def response_of(seed: int, number: int, is_small: bool = False, samples: int = 128) -> Iterator[ResponseProblem]:
    """Build a system with 3 harmonics, and yield its response."""
    system, outputs = draw(seed, number, is_small)
    with tempfile.TemporaryDirectory() as folder:
        levels = list(system["levels"].values())
        path = write_matrix_scene(
            Path(folder), system, levels, system["omega"], outputs=outputs, points=60, harmonics=3, samples=samples
        )
        with build(read_scene(path), MPI.COMM_SELF) as structure:
            yield prepare(structure, has_bars=False).response


def curves(
    seed: int, number: int, points: list[int], reference: int | None, is_small: bool = False, samples: int = 128
) -> list[list]:
    """Return the branches of a system for each number of points, with peaks, and the optional reference without."""
    with response_of(seed, number, is_small, samples) as response:
        settings = [replace(response.settings, points=n, peaks=True) for n in points]
        settings += [] if reference is None else [replace(response.settings, points=reference)]
        return [follow(replace(response, settings=each)) for each in settings]


def sampled(branch) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (n,) [rad/s] and the outputs' amplitudes (n, n_outputs) [m] of a branch."""
    return np.array([p.omega for p in branch.points]), np.array([np.hypot(*p.response[:, 1:3].T) for p in branch.points])


def peaks(omega: np.ndarray, amplitude: np.ndarray) -> list[tuple[int, float, float]]:
    """Return point and half-power range of the peaks of a curve, whose sides fall that far on one side at least."""
    inner, values = amplitude[1:-1], []
    for i in 1 + np.flatnonzero((inner > amplitude[:-2]) & (inner >= amplitude[2:]) & (inner > FAINT * amplitude.max())):
        below = np.flatnonzero(amplitude < HALF_POWER * amplitude[i])
        if len(below):
            low, high = below[below < i].max(initial=0), below[below > i].min(initial=len(omega) - 1)
            values.append((int(i), omega[low : high + 1].min(), omega[low : high + 1].max()))
    return values


def peaks_of_outputs(branch) -> list[list[tuple[float, float, float]]]:
    """Return the peaks of the curve of each output of a branch."""
    omega, amplitude = sampled(branch)
    return [[(float(curve[i]), low, high) for i, low, high in peaks(omega, curve)] for curve in amplitude.T]


def missing(branch, reference: list[list[tuple[float, float, float]]]) -> np.ndarray:
    """Return counts of a reference's peaks of all outputs: all, missed, and lower in a branch; not located, and located lower."""
    omega, amplitude = sampled(branch)
    counts = np.zeros(5, dtype=int)
    for output, (curve, true) in enumerate(zip(amplitude.T, reference, strict=True)):
        maxima = [peak for peak in branch.peaks if peak.output == output]
        for height, low, high in true:
            most = curve[(low <= omega) & (omega <= high)].max(initial=0.0)
            low, high = low * (1.0 - BEYOND), high * (1.0 + BEYOND)
            top = max((abs(peak.amplitude) for peak in maxima if low <= peak.omega <= high), default=0.0)
            short = 1.0 - top / height
            counts += 1, most < HALF_POWER * height, most < HEIGHT * height, short > LOWER, short > EQUAL
            if short > LOWER:
                print(
                    f"  level {branch.level:.4g}, output {output}: {height:.4g} m in {low:.5g}..{high:.5g} rad/s, located {top:.4g}"
                )
    return counts


def store(seed: int, numbers: list[int], reference: int, is_small: bool) -> None:
    """Write the reference peaks of some systems of one level to the file for the tests."""
    rows = []
    for number in numbers:
        ((dense,),) = curves(seed, number, [], reference, is_small)
        assert dense.failure is None
        rows += [(number, k, *peak) for k, of in enumerate(peaks_of_outputs(dense)) for peak in of]
    np.savetxt(STORED, rows, fmt=("%d", "%d", *["%.9g"] * 3), delimiter=",", header="system,output,height_m,low_rad_s,high_rad_s")


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for key, default in (("seed", 7), ("systems", 9), ("first", 0), ("reference", 800)):
        options.add_argument(f"--{key}", type=int, default=default)
    options.add_argument("--points", type=int, nargs="+", default=[10, 30])
    options.add_argument("--small", action="store_true", help="3 to 5 degrees of freedom, 1 to 2 pairs, 2 outputs")
    options.add_argument(
        "--store", type=int, nargs="+", help="numbers of systems whose peaks of the reference are stored for the tests"
    )
    args, start = options.parse_args(), time.process_time()
    if args.store:
        return store(args.seed, args.store, args.reference, args.small)
    total, incomplete = {n: np.zeros(len(COUNTS), dtype=int) for n in args.points}, dict.fromkeys(args.points, 0)
    for number in range(args.first, args.first + args.systems):
        *few, dense = curves(args.seed, number, args.points, args.reference, args.small)
        for n, branches in zip(args.points, few):
            for branch, reference in zip(branches, dense):
                if branch.failure or reference.failure:
                    incomplete[n] += 1
                    continue
                notes = sum("resonance" in note for point in branch.points for note in point.notes)
                total[n] += *missing(branch, peaks_of_outputs(reference)), len(branch.points), notes
        counts = {n: dict(zip(COUNTS, map(int, each))) for n, each in total.items()}
        print(f"system {number}: {time.process_time() - start:.0f} s, {counts}", flush=True)
    print(f"\n| points requested | {' | '.join(COUNTS)} | curves that end early |\n|{' --- |' * (len(COUNTS) + 2)}")
    for n, counts in total.items():
        print(f"| {n} | " + " | ".join(map(str, [*counts, incomplete[n]])) + " |")


if __name__ == "__main__":
    main()
