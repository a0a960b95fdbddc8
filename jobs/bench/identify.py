"""How often the confidence intervals of an identification contain the true values: a mass on a Jenkins element, with noise.

    python jobs/bench/identify.py [--seeds 100]
    python jobs/bench/identify.py --example DIR        the files of one case

One mass (m = k = k_t = 1, c = 0.02, limit mu N0 = 1) under two levels at 8 frequencies each; amplitudes have noise of 1 % of the
largest, phases of 0.02 rad.  Friction, tangential stiffness and damping are fitted from a different start, for each noise seed.
"""

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import tempfile
from pathlib import Path

import numpy as np
from mpi4py import MPI

SCENE = """
title = "One mass on a friction element"
[model]
stiffness = "K.mtx"
mass = "M.mtx"
[damping]
ratio = {ratio}
[[joints]]
name = "joint"
pairs = "pairs.csv"
[[loads]]
dof = 0
[[outputs]]
name = "mass"
dof = 0
[response]
levels = [0.6, 1.0]
frequencies = [0.12, 0.3]
[solver]
harmonics = 1
samples = 256
error_bars = false
"""
TRUE = {"joints.joint.friction": 1.0 / 1.25, "joints.joint.tangential_stiffness": 1.0 / 0.8, "damping.ratio": 0.02}
BOUNDS = {key: (0.2 * value, 5.0 * value) for key, value in TRUE.items()}
ONE = "%%MatrixMarket matrix coordinate real symmetric\n1 1 1\n1 1 1.0\n"
FREQUENCY, LEVELS = np.linspace(0.15, 0.24, 8), (0.6, 1.0)


def build(folder: Path, friction: float, k_t: float, ratio: float):
    """Return the structure of a scene with these values."""
    for name in ("K", "M"):
        (folder / f"{name}.mtx").write_text(ONE)
    (folder / "pairs.csv").write_text(f"x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n0,-1,-1,-1,-1,-1,{friction},1.0,0.0,{k_t},0.0\n")
    (folder / "scene.toml").write_text(SCENE.format(ratio=ratio))
    return microslip.build(microslip.read(folder / "scene.toml"), MPI.COMM_WORLD)


def measurement(structure):
    """Return exact columns of a structure."""
    columns = {"frequency_Hz": np.tile(FREQUENCY, 2), "level_N": np.repeat(LEVELS, len(FREQUENCY))}
    amplitudes = []
    for level in LEVELS:
        response = microslip.respond(structure, levels=level, at=tuple(FREQUENCY))
        is_requested = response.level(level).requested.astype(bool)
        amplitudes.append(response["mass"].harmonic(1)[0, : len(is_requested)][is_requested])
    a = np.concatenate(amplitudes)
    return columns | {"amplitude_m": np.abs(a), "phase_rad": np.angle(a)}


def main() -> None:
    """Print for each parameter how many intervals contain its true value, and their mean width."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--example", type=Path, metavar="DIR")
    seeds, example = vars(parser.parse_args()).values()
    with tempfile.TemporaryDirectory() as folder:
        for name in ("true", "start"):
            Path(folder, name).mkdir()
        with build(Path(folder, "true"), 1.0, 1.0, 0.02) as structure:
            exact = measurement(structure)
        with build(Path(folder, "start"), 1.25, 0.8, 0.03) as structure:
            if example is not None:
                from microslip.studies.identify.report import write_identified  # after PETSc's start

                result = microslip.identify(structure, noisy(exact, 0), BOUNDS)
                print(write_identified(result, structure.scene, example))
                return
            estimates = [microslip.identify(structure, noisy(exact, seed), BOUNDS) for seed in range(seeds)]
    print("| number | true | intervals that hold it | mean | deviation | mean half width of the interval |")
    for i, (key, value) in enumerate(TRUE.items()):
        low, high, values = (np.array([getattr(each, name)[i] for each in estimates]) for name in ("low", "high", "values"))
        held = np.count_nonzero((low <= value) & (value <= high))
        row = (
            key,
            f"{value:g}",
            f"{held} of {seeds}",
            *(f"{x:.4g}" for x in (values.mean(), values.std(), ((high - low) / 2).mean())),
        )
        print("| " + " | ".join(row) + " |")
    print(f"evaluations of the response: {np.mean([each.evaluations for each in estimates]):.1f} a fit")


def noisy(exact, seed):
    """Return columns with the noise of a seed."""
    rng, size = np.random.default_rng(seed), exact["amplitude_m"]
    noise, deviation = rng.standard_normal((2, len(size))), 0.01 * size.max()
    amplitude = np.maximum(size + deviation * noise[0], 1e-6)
    stated = {"sigma_m": np.full(len(size), deviation), "sigma_phase_rad": np.full(len(size), 0.02)}
    return exact | {"amplitude_m": amplitude, "phase_rad": exact["phase_rad"] + 0.02 * noise[1]} | stated


if __name__ == "__main__":
    main()
