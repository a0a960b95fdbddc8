"""Free decay by time integration compared with the nonlinear mode: frequency shift and damping over the amplitude.

    PYTHONPATH=solver:tests python tests/verification/free_decay.py [SCENE] [STARTS] [PERIODS] [HARMONICS]

Starts on the mode at each of STARTS (1.5,2,3,4) times the amplitude of first slip, and fits a decaying harmonic to every two periods
of the mode's coordinate.  Four periods are followed by default: later periods retain tractions of the earlier, larger cycles.
"""

from __future__ import annotations

import sys

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

import microslip
from microslip.continuation.nonlinear_mode import NonlinearMode, follow_mode
from microslip.fourier.amplitudes import to_real
from microslip.harmonic.balance import HarmonicBalance
from microslip.library.mode_at_rest import first_slip
from microslip.library.respond import prepared_with
from microslip.points.sweep import Sweep
from microslip.receptance.motions import modal_motion
from microslip.transient.march import March
from microslip.transient.steady import from_harmonics
from microslip.transient.transient_model import transient_model

STEPS, WINDOW = 256, 2  # steps per period; periods per fit


def decay(scene: str, largest: float, periods: int, **keys):
    """Return (amplitude, omega, ratio) of the mode (n, 3) and of the decay (m, 3), and omega while all pairs stick."""
    structure = microslip.build(microslip.read(scene))
    prepared, _ = prepared_with(structure, {}, {"error_bars": False} | keys, has_bars=False)
    model, law = prepared.model, prepared.response.law
    problem = NonlinearMode.of(HarmonicBalance.of_all(model, law, prepared.response.settings.samples), 0)
    first = float(np.log(first_slip(prepared, problem).amplitude))
    branch = follow_mode(problem, Sweep(first, first + float(np.log(largest))), 1e-8)
    assert branch.failure is None, branch.failure
    mode = np.array([(np.exp(a), omega, -sigma / (2.0 * omega)) for a, omega, sigma in (p.parameters for p in branch.points)])
    point, H = branch.points[-1], (branch.points[-1].U.shape[-1] - 1) // 2
    at = problem.at(point.parameters)
    (eta,) = modal_motion(problem.equation.model_at(at), at.level, at.omega, point.p.reshape(-1, 2 * H + 1))
    start = from_harmonics(transient_model(model, law), np.array([at.omega]), to_real(eta, 2 * H + 1)[None], point.U[None], STEPS)
    march = March(transient_model(model, law), np.array([at.omega]), np.zeros(1), STEPS)
    z, contact, q = start.z, start.p, list[np.ndarray]()
    for _ in range(periods):
        z, contact, cycle = march.period(z, contact)
        q.append(cycle.eta[:, 0, 0])
    structure.close()
    return mode, fits(np.concatenate(q), at.omega), problem.omega


def fits(q: np.ndarray, omega: float) -> np.ndarray:
    """Return amplitude, undamped frequency and damping ratio of windows of a signal whose steps are 2 pi / (STEPS omega)."""
    results = []
    theta = 2.0 * np.pi / STEPS * (np.arange(WINDOW * STEPS) - 0.5 * WINDOW * STEPS)
    for begin in range(0, len(q) - WINDOW * STEPS + 1, WINDOW * STEPS):
        part = q[begin : begin + WINDOW * STEPS]

        def basis(x):
            waves = [np.exp(-n * x[1] * theta) * wave(n * x[0] * theta) for n in (1, 2, 3) for wave in (np.cos, np.sin)]
            return np.stack([*waves, np.ones_like(theta)], axis=1)

        def misfit(x, part=part):
            A = basis(x)
            return (A @ np.linalg.lstsq(A, part, rcond=None)[0] - part) / np.abs(part).max()

        x = least_squares(misfit, [1.0, 1e-3], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
        a = np.linalg.lstsq(basis(x), part, rcond=None)[0]
        undamped = float(np.hypot(*x))
        results.append((float(np.hypot(a[0], a[1])), undamped * omega, x[1] / undamped))
    return np.array(results)


def main(scene: str = "jobs/fan_small.toml", starts: str = "1.5,2,3,4", periods: str = "4", harmonics: str = "9") -> None:
    print("start | amplitude over the first | frequency shift: mode, decay, ratio | damping %: mode, decay, ratio")
    for start in starts.split(","):
        mode, free, stuck = decay(scene, float(start), int(periods), harmonics=int(harmonics), samples=256)
        of_mode = CubicSpline(np.log(mode[:, 0]), mode[:, 1:])
        for a, omega, zeta in free:
            omega_mode, zeta_mode = of_mode(np.log(a))
            shift = (omega_mode - stuck) / stuck, (omega - stuck) / stuck
            print(
                f"{start} | {a / mode[0, 0]:6.3f} | {shift[0]:.4e} {shift[1]:.4e} {shift[1] / shift[0]:.4f} | "
                f"{100.0 * zeta_mode:.4f} {100.0 * zeta:.4f} {zeta / zeta_mode:.4f}",
                flush=True,
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
