"""Branches of many harmonics compared with direct time integration, around resonance.

    PYTHONPATH=solver:tests:tests/continuation python tests/verification/time_domain.py

One mass on a Jenkins element, and one mass with three coupled directions on a 3-D pair that slides along ellipses under a varying
normal force and lifts off (``oracles.scenes``).  Time integration (``oracles.time_integration``) uses neither Fourier
coefficients nor the two periods of the march of harmonic balance: it starts from rest and ends when a period repeats.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from dense_model import amplitude, branch
from mpi4py import MPI
from oracles import exact, scenes, time_integration


@dataclass(frozen=True)
class Case:
    """A system at a level, and the frequencies [rad/s] of comparison."""

    scene: str
    level: float
    omegas: tuple[float, ...]


CASES = {
    "Jenkins mass": Case("jenkins", 0.8, (1.12, 1.16, 1.2, 1.25, 1.3, 1.4)),
    "3-D pair, sliding part of the cycle": Case("spatial", 0.4, (1.1, 1.3, 1.45, 1.6, 1.8)),
    "3-D pair, sliding": Case("spatial", 0.6, (1.0, 1.1, 1.2, 1.4, 1.7)),
    "3-D pair, lift-off": Case("spatial", 1.2, (1.0, 1.1, 1.2, 1.4, 1.7)),
}


def balanced(case: Case, omegas, H: int, n_samples: int, points: int = 60) -> list:
    """Return the points of the branch at ``omegas``, ascending."""
    curve = branch(
        scenes.SCENES[case.scene](),
        MPI.COMM_SELF,
        case.level,
        low=0.97 * min(omegas),
        high=1.03 * max(omegas),
        H=H,
        n_samples=n_samples,
        at=tuple(omegas),
        points=points,
    )
    assert curve.failure is None, curve.failure
    return sorted((point for point in curve.points if point.requested), key=lambda point: point.omega)


def marched(case: Case, omega: float, n_steps: int, start=None, tolerance=1e-7):
    """Return the steady state by time integration."""
    return time_integration.steady_state(
        scenes.SCENES[case.scene](),
        omega,
        case.level,
        n_steps=n_steps,
        harmonics=31,
        scheme="exponential",
        start=start,
        tolerance=tolerance,
    )


def state_at_start(case: Case, point) -> tuple:
    """Return u, v and T at t = 0 of a point of a branch of one mass (R is the identity on its DOFs)."""
    system, n = scenes.SCENES[case.scene](), np.arange(1, point.U.shape[-1] // 2 + 1)
    u = point.U[0, :, 0] + point.U[0, :, 1::2].sum(axis=1)
    v = point.omega * point.U[0, :, 2::2] @ n
    T = system["k_t"][0] * u[:2] + point.p[0, :2, 0] + point.p[0, :2, 1::2].sum(axis=1)
    n_dof = len(system["M"])
    return u[:n_dof], v[:n_dof], T[None]


def difference(case: Case, point, steady) -> tuple[float, float]:
    """Return the largest difference of the output over the period, and of its harmonic 1 (amplitude and phase) [m]."""
    output = scenes.SCENES[case.scene]()["output"]
    N_H = point.response.shape[-1]
    wave = point.response[0] @ scenes.harmonic_basis(N_H // 2, len(steady.u)) - steady.u @ output
    return float(np.abs(wave).max()), float(np.hypot(*(point.response[0] - (output @ steady.u_hat)[:N_H])[1:3]))


def main():
    for name, case in CASES.items():
        output = scenes.SCENES[case.scene]()["output"]
        steady, coarse = ({omega: marched(case, omega, n_steps) for omega in case.omegas} for n_steps in (1024, 512))
        change = max(np.abs(steady[omega].u[::2] @ output - coarse[omega].u @ output).max() for omega in case.omegas)
        peak = max(np.hypot(*(output @ steady[omega].u_hat)[1:3]) for omega in case.omegas)
        print(
            f"\n{name}: level {case.level:g}, largest amplitude {peak:.4f} m, states "
            f"{sorted({int(state) for each in steady.values() for state in each.state})}; "
            f"512 to 1024 steps a period change the march by {change / peak:.1e} of it"
        )
        print("\n| harmonics | samples | largest difference of u(t) | of harmonic 1 |\n| --- | --- | --- | --- |")
        for H, n_samples in ((3, 4096), (7, 4096), (15, 4096), (31, 4096), (15, 1024), (15, 256), (15, 128)):
            points = balanced(case, case.omegas, H, n_samples)
            errors = np.array([difference(case, point, steady[point.omega]) for point in points]) / peak
            print(f"| {H} | {n_samples} | {errors[:, 0].max():.1e} | {errors[:, 1].max():.1e} |", flush=True)
        if case.scene == "jenkins":
            exactly(case, balanced(case, case.omegas, 31, 4096))


def exactly(case: Case, points) -> None:
    """Compare with the piecewise solution of the Jenkins mass, exact in all harmonics."""
    peak = max(map(amplitude, points))
    for point in points:
        known = exact.jenkins_steady_state(point.omega, case.level, m=1.0, c=0.02, k=1.0, k_t=1.0, muN=1.0)
        error = np.abs(point.response[0] - known.harmonics(31)).max()
        print(f"omega = {point.omega:g}: amplitude {amplitude(point):.6f}, harmonics within {error / peak:.1e} of the exact ones")


if __name__ == "__main__":
    main()
