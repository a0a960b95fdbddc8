"""Time of one contact evaluation with full tangents: python jobs/bench/aft.py [--samples 128] [--seconds 0.3].

Prints milliseconds of processor time per call (best of the repetitions) over pairs, harmonics and the share of pairs
that slip.  ``stuck`` pairs stay far inside their friction limit; ``edge`` pairs stick too, but so close to it that only
their samples tell.
"""

import argparse
import time
from functools import partial

import numpy as np

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.law import STICK
from microslip.fourier.coefficients import synthesise

PAIRS, HARMONICS, SHARES = (208, 2000), (1, 3, 7, 15), ("stuck", "edge", "30 %", "100 %")


def joint(n_pairs):
    """Return pairs of the paper's order of stiffness and preload, every one able to hold 30 N."""
    ones = np.ones(n_pairs)
    return ElasticCoulomb(0.3 * ones, 100.0 * ones, 2e7 * ones, 3e7 * ones, np.zeros(n_pairs, dtype=bool))


def motion(n_pairs, H, share, rng):
    """Return harmonics (n_pairs, 3, N_H) [m] in every direction, falling off with order, in random phases."""
    U = rng.standard_normal((n_pairs, 3, 2 * H + 1))
    order = np.r_[1.0, np.repeat(np.arange(1, H + 1), 2)]
    U *= 0.3 ** (order - 1.0)
    U[:, :, 0] *= 0.1
    U[:, 2] *= 0.02
    peak = np.abs(U).sum(axis=(1, 2))[:, None, None]
    reach = 30.0 / 2e7  # m, slip distance at the preload
    if share == "edge":
        U[:, 2] = 0.0
        du_t = np.linalg.norm(synthesise(U[:, :2], 1024), axis=1)
        return 0.999 * reach * U / du_t.max(axis=1)[:, None, None]
    slipping = np.zeros(n_pairs) if share == "stuck" else np.arange(n_pairs) % 10 < int(share[:-2]) // 10
    return reach * np.where(np.asarray(slipping, dtype=bool)[:, None, None], 8.0, 0.3) * U / peak


def milliseconds(call, seconds):
    """Return the least processor time of ``call`` over repetitions that fill ``seconds``, five at least."""
    times: list[float] = []
    end = time.perf_counter() + seconds
    while len(times) < 5 or time.perf_counter() < end:
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=128)
    parser.add_argument("--seconds", type=float, default=0.3)
    options = parser.parse_args()
    rng = np.random.default_rng(1)
    print(f"{options.samples} samples; ms per call, with tangents (without)")
    print(f"{'pairs':>6} {'H':>3}" + "".join(f"{share:>20}" for share in SHARES) + "   pairs not stuck")
    for n_pairs in PAIRS:
        for H in HARMONICS:
            law, cells, slipping = joint(n_pairs), [], []
            for share in SHARES:
                U = motion(n_pairs, H, share, rng)
                calls = (partial(law.cycle, U, options.samples, wish) for wish in (True, False))
                times = [milliseconds(call, options.seconds) for call in calls]
                slipping.append(int(np.sum(law.cycle(U, options.samples).state != STICK)))
                cells.append(f"{times[0]:10.3f} ({times[1]:.3f})")
            print(f"{n_pairs:6d} {H:3d}" + "".join(f"{cell:>20}" for cell in cells), "  ", slipping, flush=True)


if __name__ == "__main__":
    main()
