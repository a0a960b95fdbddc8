"""Random structures with contact, of 2 to 12 degrees of freedom and 1 to 4 pairs, drawn from a seed.

They have the typical mechanisms of a joint: sliding in one or two directions under a constant or a varying normal force, lift-off,
gaps, constant loads, two harmonics of load, light and heavy damping, from the first slip to gross slip.
"""

from __future__ import annotations

import numpy as np
from oracles import scenes
from scipy.linalg import eigh

LEVELS = (0.8, 1.5, 3.0, 8.0)  # relative to first slip at resonance, each times 0.8 to 1.25


def draw(seed: int, number: int, lift_off: bool = False) -> dict:
    """Return a system of scenes.py with its levels and band, which depends only on the two numbers.

    With ``lift_off`` the levels are relative to the level at which the first pair slips and the first opens.
    """
    rng = np.random.default_rng([seed, number])
    n, m = int(rng.integers(2, 13)), int(rng.integers(1, 5))
    M, K = np.diag(_between(rng, 0.5, 2.0, n)), _stiffness(rng, n)
    pair_dofs = np.array([_dofs(rng, n) for _ in range(m)])
    soft = np.median(np.diag(K))
    k_t, k_n = soft * _between(rng, 0.1, 3.0, m), soft * _between(rng, 0.3, 3.0, m)
    mu, damping = _between(rng, 0.1, 0.8, m), {"zeta": float(_between(rng, 0.002, 0.05))}
    system = scenes.make_system(
        f"random {seed}-{number}",
        M,
        K,
        pair_dofs,
        mu=mu,
        N0=1.0,
        k_t=k_t,
        k_n=k_n,
        separate=bool(rng.random() < 0.25),
        loads=_loads(rng, n),
        output=np.eye(n)[rng.integers(n)],
        omega=(0.0, 1.0),
        levels={},
        **damping,
    )
    mode = int(rng.integers(min(n, 3)))
    open_, stuck = (np.sqrt(eigh(A, M, eigvals_only=True)[mode]) for A in (K, scenes.stuck_stiffness(system)))
    low, high = 0.93 * open_, 1.05 * stuck
    shear, press = stuck_forces(system, low, high)
    N0 = _between(rng, 0.3, 3.0, m) * np.maximum(shear / mu, 0.3 * press)
    onset = np.min(np.where(shear > 0.0, mu * N0 / np.where(shear > 0.0, shear, 1.0), np.inf))
    onset = onset if np.isfinite(onset) else 1.0
    if lift_off and (press > 0.0).any():
        onset = max(onset, np.min(N0[press > 0.0] / press[press > 0.0]))
    gaps = (rng.random(m) < 0.15) & (press > 0.0)  # which close at the third level at the latest
    N0 = np.where(gaps, -_between(rng, 0.1, 1.0, m) * press * LEVELS[1] * onset, N0)
    unit = np.abs(N0).max()  # forces of order 1
    levels = np.array(LEVELS) * _between(rng, 0.8, 1.25, len(LEVELS)) * onset / unit
    return {**system, "N0": N0 / unit, "omega": (low, high), "levels": {str(i): level for i, level in enumerate(levels)}}


def _between(rng, low, high, size=None):
    """Return numbers with uniformly distributed logarithms."""
    return np.exp(rng.uniform(np.log(low), np.log(high), size))


def _stiffness(rng, n):
    """Return springs to the ground and between neighbours, or a full matrix; without rigid motion."""
    if rng.random() < 0.5:
        Q, _ = np.linalg.qr(rng.standard_normal((n, n)))
        return Q @ np.diag(_between(rng, 0.5, 10.0, n)) @ Q.T
    D = np.eye(n) - np.eye(n, k=1)
    return D.T @ np.diag(_between(rng, 0.5, 3.0, n)) @ D + np.diag(_between(rng, 0.1, 1.0, n))


def _dofs(rng, n):
    """Return the degrees of freedom of a pair, with or without the second tangential and the normal direction."""
    dofs, free = np.full(6, -1), rng.permutation(n)
    wanted = [0] + [1] * (rng.random() < 0.7) + [2] * (rng.random() < 0.7)
    wanted = wanted[: len(free)]
    dofs[wanted] = free[: len(wanted)]
    rest = free[len(wanted) :]
    if rng.random() < 0.5:  # against another body, in the directions for which it has degrees of freedom
        others = wanted[: len(rest)]
        dofs[3 + np.array(others, dtype=int)] = rest[: len(others)]
    return dofs


def _loads(rng, n):
    """Return a load of harmonic 1, and optionally a constant load and a load of harmonic 2."""
    wanted = [(1, 1.0)] + [(0, 0.5)] * (rng.random() < 0.3) + [(2, 0.3)] * (rng.random() < 0.3)
    return [
        {
            "vector": size * rng.standard_normal(n) * (rng.random(n) < 0.7) + size * 0.3 * np.eye(n)[rng.integers(n)],
            "harmonic": harmonic,
            "phase": float(rng.uniform(0.0, 2.0 * np.pi)) if harmonic else 0.0,
        }
        for harmonic, size in wanted
    ]


def stuck_forces(system, low, high):
    """Return the largest shear and normal force of every pair at unit level in the band, all pairs stuck, (m,) each."""
    M, K, C, R = np.asarray(system["M"]), scenes.stuck_stiffness(system), scenes.damping_matrix(system), system["R"]
    f = scenes.force_coefficients(system, 1.0, 2)
    forces = []
    for omega in np.linspace(low, high, 200):
        u = np.linalg.solve(K - omega**2 * M + 1j * omega * C, f[:, 1] - 1j * f[:, 2])
        du = np.abs(R @ u).reshape(-1, 3)
        forces.append([system["k_t"] * np.hypot(du[:, 0], du[:, 1]), system["k_n"] * du[:, 2]])
    return np.max(forces, axis=0)


def kinds(system) -> list[str]:
    """Return the features of a system, by the words of the table."""
    dofs, harmonics = system["pair_dofs"], {load["harmonic"] for load in system["loads"]}
    moves = [(dofs[:, i] >= 0) | (dofs[:, 3 + i] >= 0) for i in range(3)]
    computed = ["separate" if system["separate"].any() else "circle" if (moves[0] & moves[1]).any() else "line"]
    computed += ["varying normal force"] * bool(moves[2].any()) + ["gap"] * bool((system["N0"] < 0.0).any())
    return computed + ["constant load"] * (0 in harmonics) + ["two harmonics"] * (2 in harmonics)
