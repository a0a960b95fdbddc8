"""The best friction and mass of an under-platform damper for a range of excitation, by SciPy's optimiser with exact gradients.

    python meshes/damper.py --out meshes/damper.msh
    python jobs/examples/damper_design.py [--levels 0.5 1 2 4] [--evaluations 15]

A damper with too small a contact force slides freely and dissipates no energy; one with too large a force sticks.  Its pressure
on the platforms is due to centrifugal force and grows with its mass.  Friction and mass are varied to minimise the largest peak
per newton over the levels; each evaluation solves the response at the levels, and its derivatives with one adjoint solution per
peak. The structure, with its factor and modes, is built once, with the inertia of the scene's damper; the last line gives the
peak for a structure built with the optimal mass.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import OptimizeResult, minimize

ROOT = Path(__file__).parents[2]
POWER = 8.0  # of the mean that stands for the largest peak, so that it is smooth
FRICTION, MASS = (0.05, 0.8), (0.05, 4.0)  # bounds; the mass over that of the scene
TOLERANCE = 1e-4  # of the logarithm of the mean


def mean_of_peaks(structure, levels: Sequence[float], friction: float, mass: float) -> tuple[float, np.ndarray]:
    """Return ln of the mean peak per newton over levels, and its derivatives by ln friction and ln mass, (2,).  Collective."""
    preload = {name: mass * stated for name, stated in preloads(structure).items()}
    response = microslip.respond(
        structure, levels=levels, friction=friction, preload=preload, peaks=True, sensitivities=True, error_bars=False
    )
    per_level, slopes = [], []
    for level in levels:
        peak, rates = max(response.sensitivity.of_peaks(level), key=lambda each: abs(each[0].amplitude))
        size = abs(peak.amplitude)
        relative = {key: (response.sensitivity.varied[key].value or level) * rates[key].amplitude / size for key in rates}
        slopes.append([sum(relative[key] for key in relative if key.endswith(name)) for name in ("friction", "preload")])
        per_level.append(size / level)
    powers = np.array(per_level) ** POWER
    return float(np.log(powers.mean()) / POWER), (powers / powers.sum()) @ np.array(slopes)


def preloads(structure) -> dict[str, float | np.ndarray]:
    """Return the preload of each joint [Pa], or the normal forces of its pairs [N] where a file states them.  Local."""
    names = np.array(structure.pairs.joint)
    return {
        joint.name: joint.preload if isinstance(joint.preload, float) else structure.pairs.N0[names == joint.name]
        for joint in structure.scene.joints
    }


def best_damper(structure, levels: Sequence[float], start: Sequence[float] = (0.3, 1.0), evaluations: int = 15) -> OptimizeResult:
    """Return SciPy's result, whose ``x`` are ln friction and ln mass, from a ``start`` of friction and mass.  Collective."""

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = mean_of_peaks(structure, levels, *np.exp(x))
        if structure.comm.rank == 0:
            print(
                f"friction {np.exp(x[0]):.4f}, mass {np.exp(x[1]):.4f}: {1e6 * np.exp(value):.5g} um/N, slopes {slope.round(5)}"
            )
        return value, slope

    bounds = np.log([FRICTION, MASS])
    limits = {"maxfun": evaluations, "ftol": TOLERANCE}
    return minimize(objective, np.log(start), jac=True, bounds=bounds, method="L-BFGS-B", options=limits)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", type=Path, default=Path(__file__).with_suffix(".toml"))
    parser.add_argument("--levels", nargs="+", type=float, default=[0.5, 1.0, 2.0, 4.0])
    parser.add_argument("--evaluations", type=int, default=15)
    arguments = parser.parse_args()
    with microslip.build(microslip.read(arguments.scene)) as structure:
        best = best_damper(structure, arguments.levels, evaluations=arguments.evaluations)
        is_first = structure.comm.rank == 0
    friction, mass = np.exp(best.x)
    heavier = microslip.read(arguments.scene, [f"materials.damper.density={7850.0 * mass}"])
    with microslip.build(heavier) as structure:
        value, _ = mean_of_peaks(structure, arguments.levels, friction, mass)
    if is_first:
        print(f"best: friction {friction:.3f}, {mass:.3f} of the mass of the scene: {1e6 * np.exp(best.fun):.5g} um/N")
        print(f"with the inertia of that mass: {1e6 * np.exp(value):.5g} um/N")


if __name__ == "__main__":
    main()
