"""Samples needed for the percentiles of a peak: Sobol points, Latin hypercubes and independent samples, against many samples.

    python jobs/bench/percentiles.py [SCENE.toml] [--samples 1024] [--seeds 200]

Solves the peaks of `--samples` Sobol points of four parameters on one structure: friction 15 %, preload 10 %, damping 10 %
(lognormal), level 5 %.  The amplitude is interpolated between them (thin-plate splines in the logarithms of the parameters); the
interpolation error is measured at a quarter of the points, left out.  `--seeds` designs of each kind and size are evaluated on
the interpolant.  Printed: the root mean square of their errors in the percentiles 5, 50 and 95, in per cent of the distance from
5 to 95, against 2^16 Sobol points.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator

ROOT = Path(__file__).parents[2]
PERCENTILES = 5.0, 50.0, 95.0
SIZES = 8, 16, 32, 64, 128, 256
MANY = 2**16
SCATTER = {"joints.dovetail.friction": 15.0, "joints.dovetail.preload": 10.0, "damping.ratio": 10.0, "level": 5.0}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=ROOT / "jobs" / "fan_small.toml")
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--seeds", type=int, default=200)
    arguments = parser.parse_args()
    structure = microslip.build(microslip.read(arguments.scene, ["solver.error_bars=false", "response.levels=[10.0]"]))
    from microslip.library.design import Scatter, scattered
    from microslip.library.varied import Varied

    nominal = Varied.of(structure.scene, tuple(SCATTER)).nominal
    scatter = {key: Scatter(mean, percent) for (key, percent), mean in zip(SCATTER.items(), nominal)}
    design, start = scattered(scatter, arguments.samples), time.process_time()
    table = microslip.sweep(structure, {key: design.values[:, j] for j, key in enumerate(design.keys)}, paired=True)
    x, y = np.log(design.values[table.is_done]), np.log(table.amplitude[table.is_done])
    print(f"{len(y)} of {arguments.samples} peaks in {time.process_time() - start:.3g} s of the processor")
    rest = np.arange(len(y)) % 4 == 0
    off = RBFInterpolator(x[~rest], y[~rest], neighbors=80)(x[rest]) - y[rest]
    amplitude = RBFInterpolator(x, y, neighbors=80)
    exact = np.percentile(amplitude(np.log(scattered(scatter, MANY, seed=1).values)), PERCENTILES)
    spread = exact[2] - exact[0]
    print(
        f"from 5 to 95: {100.0 * np.expm1(spread):.3g} %; interpolated to {100.0 * np.sqrt((off**2).mean()) / spread:.2g} % of it"
    )
    kinds = {"sobol": "Sobol", "latin": "Latin hypercube", "random": "independent"}
    print("| samples | " + " | ".join(f"{name}: 5, 50, 95 %" for name in kinds.values()) + " |")
    for n in SIZES:
        cells = [errors(kind, n, arguments.seeds, scatter, amplitude, exact) / spread for kind in kinds]
        print(f"| {n} | " + " | ".join(", ".join(f"{100.0 * error:.1f}" for error in each) for each in cells) + " |", flush=True)
    structure.close()


def errors(kind: str, n: int, n_seeds: int, scatter: dict, amplitude: RBFInterpolator, exact: np.ndarray) -> np.ndarray:
    """Return the root mean square of the errors of the percentiles over designs of n samples, (3,)."""
    from microslip.library.design import scattered

    random = np.random.default_rng(0)
    values = []
    for seed in range(n_seeds):
        if kind == "random":
            values.append(np.column_stack([each.at(random.random(n)) for each in scatter.values()]))
        else:
            values.append(scattered(scatter, n, kind, seed + 2).values)
    of_designs = amplitude(np.log(np.concatenate(values))).reshape(n_seeds, n)
    return np.sqrt(((np.percentile(of_designs, PERCENTILES, axis=1).T - exact) ** 2).mean(axis=0))


if __name__ == "__main__":
    main()
