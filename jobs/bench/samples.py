"""Error of the response against the number of samples: with the path between samples, and with the return map at the samples alone.

    python jobs/bench/samples.py [SCENE.toml] [--samples 32 64 128 256 512] [--reference 4096]

Errors are those of the complex amplitude at the same frequencies, the largest over levels and outputs, relative to the largest
amplitude of the level; the reference follows the path with many samples.  Times are those of the response without set-up.
"""

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import time

import numpy as np
from machine import facts

N_POINTS = 24  # frequencies, over the range of the scene


def amplitudes(structure, samples, law, at):
    """Return the complex amplitudes (n_levels, n_outputs, n), and the seconds they took."""
    start = time.perf_counter()
    response = microslip.respond(structure, samples=samples, between_samples=law, at=at, error_bars=False)
    seconds = time.perf_counter() - start
    curves = [response[name] for name in response.outputs]
    values = [[c.amplitude[i] * np.exp(1j * c.phase[i]) for c in curves] for i in range(len(response.levels))]
    requested = [np.flatnonzero(np.isin(np.round(curves[0].frequency[i], 6), at)) for i in range(len(response.levels))]
    return [np.array(v)[:, n] for v, n in zip(values, requested)], seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="jobs/spatial.toml")
    parser.add_argument("--samples", type=int, nargs="+", default=[32, 64, 128, 256, 512])
    parser.add_argument("--reference", type=int, default=4096)
    given = parser.parse_args()
    structure = microslip.build(microslip.read(given.scene))
    whole = microslip.respond(structure, error_bars=False, points=20)
    frequency = whole[whole.outputs[0]].frequency
    at = np.round(np.linspace(np.nanmin(frequency), np.nanmax(frequency), N_POINTS + 2)[1:-1], 6).tolist()
    reference, _ = amplitudes(structure, given.reference, "path", at)
    print(f"{facts()['processor']}; {given.scene}, reference: path, {given.reference} samples")
    print("| samples | path between samples | s | return map at samples alone | s |\n| ---: | ---: | ---: | ---: | ---: |")
    for n in given.samples:
        cells = []
        for law in ("path", "return-map"):
            values, seconds = amplitudes(structure, n, law, at)
            error = max(
                np.abs(a - b).max() / np.abs(b).max() if a.shape == b.shape else np.nan for a, b in zip(values, reference)
            )
            cells.append(f"{100 * error:.2g} % | {seconds:.2f}")
        print(f"| {n} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
