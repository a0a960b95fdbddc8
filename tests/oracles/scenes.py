"""Small canonical systems with contact pairs, as dictionaries of NumPy arrays, and functions of them for all oracles.

A system holds
    M, K : (n, n) mass [kg] and stiffness WITHOUT the joint springs [N/m]
    C : (n, n) viscous damping [N s/m], or zeta : damping ratio of every mode of (K_L, M), K_L with all pairs stuck, or
        rayleigh : (alpha, beta) of C = alpha M + beta K_L [1/s, s]
    pair_dofs : (n_pairs, 6) DOF x1, y1, z1, x2, y2, z2 of each pair, -1 = ground; R (3 n_pairs, n) follows from it
    mu, N0, k_t, k_n : (n_pairs,) friction coefficient, preload (negative: gap -N0 / k_n), stiffness
    separate : (n_pairs,) bool, True where the two tangential directions slip on their own
    loads : dictionaries with vector (n,) [N per unit level], harmonic and phase, by default 0;
        force = level vector cos(harmonic omega t + phase), harmonic 0: level vector
    output : (n,) row of the observed displacement
    omega : (low, high) band of interest [rad/s]
    levels : regime name -> (level, omega, state of each pair in the steady state: 0 stuck, 1 slips, 2 open at times)
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh


def incidence(pair_dofs, n_dof):
    """Return R (3 n_pairs, n_dof), body 1 minus body 2; rows of directions grounded on both sides are zero."""
    R = np.zeros((3 * len(pair_dofs), n_dof))
    for i, (first, second) in enumerate(np.reshape(pair_dofs, (-1, 2, 3))):
        for direction in range(3):
            if first[direction] >= 0:
                R[3 * i + direction, first[direction]] += 1.0
            if second[direction] >= 0:
                R[3 * i + direction, second[direction]] -= 1.0
    return R


def make_system(name, M, K, pair_dofs, *, mu, N0, k_t, k_n, loads, output, omega, levels, separate=False, **damping):
    """Return a checked system; ``damping`` is C=(n, n) or zeta=float."""
    pair_dofs = np.atleast_2d(np.asarray(pair_dofs, dtype=int))
    n_pairs = len(pair_dofs)
    M, K = np.asarray(M, dtype=float), np.asarray(K, dtype=float)
    system = {
        "name": name,
        "M": M,
        "K": K,
        "pair_dofs": pair_dofs,
        "R": incidence(pair_dofs, len(M)),
        "loads": [{"phase": 0.0} | load for load in loads],
        "output": np.asarray(output, dtype=float),
        "omega": omega,
        "levels": levels,
    }
    for key, value in {"mu": mu, "N0": N0, "k_t": k_t, "k_n": k_n}.items():
        system[key] = np.broadcast_to(np.asarray(value, dtype=float), (n_pairs,)).copy()
    system["separate"] = np.broadcast_to(np.asarray(separate, dtype=bool), (n_pairs,)).copy()
    if set(damping) not in ({"C"}, {"zeta"}, {"rayleigh"}):
        raise ValueError(f"{name}: give C, zeta or rayleigh, got {sorted(damping)}")
    system.update(damping)
    return system


def joint_stiffness(system):
    """Return the diagonal of K_J, (3 n_pairs,) [N/m]."""
    return np.stack([system["k_t"], system["k_t"], system["k_n"]], axis=1).ravel()


def stuck_stiffness(system):
    """Return K_L = K + R^T K_J R, (n, n) [N/m]."""
    R = system["R"]
    return system["K"] + R.T @ (joint_stiffness(system)[:, None] * R)


def stuck_frequencies(system):
    """Return the natural frequencies of (K_L, M), (n,) [rad/s]."""
    return np.sqrt(eigh(stuck_stiffness(system), system["M"], eigvals_only=True))


def damping_matrix(system):
    """Return C, (n, n) [N s/m]; from the ratio of every mode of (K_L, M) where no matrix is given."""
    if "C" in system:
        return np.asarray(system["C"], dtype=float)
    if "rayleigh" in system:
        return system["rayleigh"][0] * np.asarray(system["M"]) + system["rayleigh"][1] * stuck_stiffness(system)
    omega_squared, phi = eigh(stuck_stiffness(system), system["M"])
    M_phi = system["M"] @ phi
    return M_phi @ np.diag(2.0 * system["zeta"] * np.sqrt(omega_squared)) @ M_phi.T


def force_coefficients(system, level, H):
    """Return the load's harmonics mean, cos 1, sin 1, ..., (n, 2 H + 1) [N]; harmonics above H are an error."""
    F = np.zeros((len(system["M"]), 2 * H + 1))
    for load in system["loads"]:
        vector, n, phase = level * np.asarray(load["vector"], dtype=float), load["harmonic"], load.get("phase", 0.0)
        if n > H:
            raise ValueError(f"{system['name']}: load of harmonic {n}, only {H} harmonics")
        if n == 0:
            F[:, 0] += vector
        else:
            F[:, 2 * n - 1] += vector * np.cos(phase)
            F[:, 2 * n] -= vector * np.sin(phase)
    return F


def harmonic_basis(H, n_samples):
    """Return 1, cos th, sin th, ..., cos H th, sin H th over one period, (2 H + 1, n_samples)."""
    theta = 2.0 * np.pi * np.arange(n_samples) / n_samples
    rows = [np.ones(n_samples)]
    for n in range(1, H + 1):
        rows += [np.cos(n * theta), np.sin(n * theta)]
    return np.array(rows)


def harmonic_coefficients(samples, H):
    """Return the coefficients of samples (..., n_samples) over one period, (..., 2 H + 1)."""
    n_samples = samples.shape[-1]
    weights = np.full(2 * H + 1, 2.0 / n_samples)
    weights[0] = 1.0 / n_samples
    return (samples @ harmonic_basis(H, n_samples).T) * weights


def cycle_work(F, X):
    """Return the closed integral of f dx over a cycle from coefficients (..., 2 H + 1) of both [J]."""
    n = np.arange(1, F.shape[-1] // 2 + 1)
    return np.pi * np.sum(n * (F[..., 1::2] * X[..., 2::2] - F[..., 2::2] * X[..., 1::2]), axis=-1)


def jenkins_mass():
    """Return one mass on a Jenkins element, as in docs/validation.md: m = k = k_t = mu N = 1, c = 0.02."""
    return make_system(
        "jenkins mass",
        [[1.0]],
        [[1.0]],
        [[0, -1, -1, -1, -1, -1]],
        mu=0.5,
        N0=2.0,
        k_t=1.0,
        k_n=1.0,
        C=np.array([[0.02]]),
        loads=[{"vector": [1.0], "harmonic": 1}],
        output=[1.0],
        omega=(0.5, 2.0),
        levels={"stuck": (0.02, 1.3, (0,)), "onset": (0.8, 1.13, (1,)), "slip": (0.8, 1.2, (1,))},
    )


def spatial_mass():
    """Return one mass with three coupled DOFs on one 3-D pair: elliptic sliding, varying normal force, lift-off."""
    return make_system(
        "spatial mass",
        np.diag([1.0, 1.2, 0.9]),
        [[1.0, 0.15, 0.10], [0.15, 1.3, -0.12], [0.10, -0.12, 1.5]],
        [[0, 1, 2, -1, -1, -1]],
        mu=0.4,
        N0=1.0,
        k_t=1.5,
        k_n=2.5,
        zeta=0.03,
        loads=[
            {"vector": [1.0, 0.0, 0.3], "harmonic": 1},
            {"vector": [0.0, 0.7, 0.0], "harmonic": 1, "phase": np.pi / 3},
            {"vector": [0.0, 0.1, 0.2], "harmonic": 2, "phase": 0.4},
            {"vector": [0.05, 0.0, -0.1], "harmonic": 0},
        ],
        output=[1.0, 0.0, 0.0],
        omega=(0.8, 2.4),
        levels={"stuck": (0.02, 1.5, (0,)), "slip": (0.4, 1.3, (1,)), "lift-off": (4.0, 1.1, (2,))},
    )


def chain():
    """Return three masses of three DOFs with SI magnitudes; pair 1 between mass 1 and 2, pair 2 between mass 3 and ground."""
    stiff, soft = np.diag([4.0e5, 3.0e5, 6.0e5]), np.diag([1.0e5, 1.5e5, 2.0e5])
    tilt = 4.0e4 * (np.ones((3, 3)) - np.eye(3))
    link, zero = stiff + tilt, np.zeros((3, 3))
    K = np.block([[soft + link, -link, zero], [-link, 2.0 * link, -link], [zero, -link, link + soft]])
    M = np.diag(np.repeat([0.5, 0.4, 0.3], 3))
    return make_system(
        "chain",
        M,
        K,
        [[0, 1, 2, 3, 4, 5], [6, 7, 8, -1, -1, -1]],
        mu=[0.3, 0.25],
        N0=[60.0, 40.0],
        k_t=[5.0e5, 4.0e5],
        k_n=[8.0e5, 6.0e5],
        zeta=0.02,
        loads=[
            {"vector": [1.0, 0.4, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "harmonic": 1},
            {"vector": [0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.2, 0.0, 0.0], "harmonic": 1, "phase": 1.0},
        ],
        output=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        omega=(400.0, 800.0),
        levels={
            "stuck": (0.3, 560.0, (0, 0)),
            "micro": (10.0, 560.0, (0, 1)),
            "gross": (100.0, 560.0, (1, 1)),
            "lift-off": (400.0, 650.0, (2, 2)),
        },
    )


def gap_mass():
    """Return one mass that strikes a frictional stop after a gap: hardening, two stable states between the turning points.

    At "two states" z has the amplitude 0.352 (never touches; reached from rest) or 2.322 (from below in omega); two
    stable states exist between about omega = 1.19 and 1.29.
    """
    return make_system(
        "gap mass",
        np.eye(3),
        np.diag([1.5, 1.4, 1.0]),
        [[0, 1, 2, -1, -1, -1]],
        mu=0.3,
        N0=-1.5,
        k_t=0.5,
        k_n=3.0,
        C=0.06 * np.eye(3),
        loads=[{"vector": [0.4, 0.2, 1.0], "harmonic": 1}],
        output=[0.0, 0.0, 1.0],
        omega=(0.6, 1.6),
        levels={"open": (0.02, 0.9, (2,)), "struck": (0.2, 1.15, (2,)), "two states": (0.2, 1.25, (2,))},
    )


def den_hartog_mass(beta=0.75, friction_ratio=0.2, k_t=2000.0):
    """Return one undamped mass with nearly rigid Coulomb friction; level 1 is P = 1, omega = beta, mu N = friction_ratio.

    The element turns within sqrt(8 mu N / (k_t |u''|)) seconds: time integration needs several steps in that, some 1024
    per period for the default; with too few it settles on a motion of three periods that is no solution of the equation.
    """
    return make_system(
        "Den Hartog mass",
        [[1.0]],
        [[1.0]],
        [[0, -1, -1, -1, -1, -1]],
        mu=1.0,
        N0=friction_ratio,
        k_t=k_t,
        k_n=1.0,
        C=np.zeros((1, 1)),
        loads=[{"vector": [1.0], "harmonic": 1}],
        output=[1.0],
        omega=(0.5, 1.6),
        levels={"slip": (1.0, beta, (1,))},
    )


SCENES = {"jenkins": jenkins_mass, "spatial": spatial_mass, "chain": chain, "gap": gap_mass, "den-hartog": den_hartog_mass}
