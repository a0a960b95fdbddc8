"""Structures of the battery of extremes (extremes.py): small, with all parameters free, and one with thousands of pairs.

The default stiffness, mass and preload are 1, so that stiffness ratios are the parameters themselves.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from oracles import scenes


def oscillator(*, k_t=1.0, k_n=1.0, mu=0.5, N0=2.0, harmonic=1, **damping):
    """Return one mass on a Jenkins element: the pair slides along x, its normal force is the preload."""
    return _system(
        "oscillator",
        [[1.0]],
        [[1.0]],
        [[0, -1, -1, -1, -1, -1]],
        [1.0],
        k_t=k_t,
        k_n=k_n,
        mu=mu,
        N0=N0,
        harmonic=harmonic,
        damping=damping,
    )


def two_masses(*, k_t=1.0, k_n=1.0, mu=0.5, N0=2.0, harmonic=1, **damping):
    """Return two masses, each on a spring, with friction between them."""
    return _system(
        "two masses",
        np.diag([1.0, 0.7]),
        np.diag([1.0, 1.6]),
        [[0, -1, -1, 1, -1, -1]],
        [1.0, -0.4],
        k_t=k_t,
        k_n=k_n,
        mu=mu,
        N0=N0,
        harmonic=harmonic,
        damping=damping,
    )


def spatial(*, k_t=1.0, k_n=1.0, mu=0.5, N0=1.0, harmonic=1, separate=False, **damping):
    """Return one mass with three coupled DOFs on one 3-D pair: ellipses, varying normal force, lift-off."""
    K = [[1.0, 0.15, 0.10], [0.15, 1.3, -0.12], [0.10, -0.12, 1.5]]
    return _system(
        "3-D pair",
        np.diag([1.0, 1.2, 0.9]),
        K,
        [[0, 1, 2, -1, -1, -1]],
        [1.0, 0.5, 0.3],
        k_t=k_t,
        k_n=k_n,
        mu=mu,
        N0=N0,
        harmonic=harmonic,
        separate=separate,
        damping=damping,
    )


def chain(*, k_t=1.0, k_n=1.0, mu=0.3, N0=1.0, harmonic=1, separate=False, **damping):
    """Return three masses of three DOFs; pair 1 between the first two, pair 2 between the last and the ground."""
    stiff, soft = np.diag([1.0, 0.75, 1.5]), np.diag([0.25, 0.4, 0.5])
    link, zero = stiff + 0.1 * (np.ones((3, 3)) - np.eye(3)), np.zeros((3, 3))
    K = np.block([[soft + link, -link, zero], [-link, 2.0 * link, -link], [zero, -link, link + soft]])
    return _system(
        "chain",
        np.diag(np.repeat([1.0, 0.8, 0.6], 3)),
        K,
        [[0, 1, 2, 3, 4, 5], [6, 7, 8, -1, -1, -1]],
        [1.0, 0.4, 0.2, 0.0, 0.3, 0.0, 0.2, 0.0, 0.0],
        k_t=k_t,
        k_n=k_n,
        mu=mu,
        N0=N0,
        harmonic=harmonic,
        separate=separate,
        damping=damping,
    )


def frame(*, k_t=1.0, k_n=1.0, mu=0.3, N0=1.0, harmonic=1, n_elements=6, overlap=4, **damping):
    """Return two overlapping cantilever beams: a lap joint of ``overlap`` pairs, axial slip and transverse lift-off.

    Euler-Bernoulli beams with three DOFs a node; the tip of one beam has the bending stiffness 3 EI / L^3 = 1.
    """
    length, n = 1.0 / n_elements, 3 * n_elements
    element_K, element_M = _beam(length, EI=1.0 / 3.0, EA=100.0, rhoA=1.0)
    K, M = np.zeros((n + 3, n + 3)), np.zeros((n + 3, n + 3))
    for i in range(n_elements):
        K[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += element_K
        M[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += element_M
    K, M = K[3:, 3:], M[3:, 3:]
    K, M = scipy.linalg.block_diag(K, 1.3 * K), scipy.linalg.block_diag(M, 0.9 * M)
    nodes = np.arange(n_elements - overlap, n_elements)
    mirrored = nodes[::-1]  # the second beam comes from the other side
    none = np.full(overlap, -1)
    pairs = np.stack([3 * nodes, none, 3 * nodes + 1, n + 3 * mirrored, none, n + 3 * mirrored + 1], axis=1)
    load = np.zeros(2 * n)
    load[[3 * n_elements - 3, 3 * n_elements - 2, 2 * n - 2]] = 1.0, 0.3, -0.2
    return _system("frame", M, K, pairs, load, k_t=k_t, k_n=k_n, mu=mu, N0=N0, harmonic=harmonic, damping=damping)


def free_body(*, k_t=1.0, k_n=1.0, mu=0.5, N0=1.0, harmonic=1, n_pairs=2, separate=False, **damping):
    """Return a body of two masses supported only by its joint with another, supported body."""
    held = np.array([[2.0, 0.2, 0.1], [0.2, 1.5, 0.0], [0.1, 0.0, 1.8]])
    link = np.diag([1.0, 1.2, 0.9])
    K = scipy.linalg.block_diag(held, np.block([[link, -link], [-link, link]]))
    pairs = [[3, 4, 5, 0, 1, 2], [6, 7, 8, -1, -1, -1]][:n_pairs]
    return _system(
        "free body",
        np.diag(np.repeat([1.0, 0.6, 0.5], 3)),
        K,
        pairs,
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.3, 0.02],
        k_t=k_t,
        k_n=k_n,
        mu=mu,
        N0=N0,
        harmonic=harmonic,
        separate=separate,
        damping=damping,
    )


def identical_pairs(n_pairs, *, k_t=1.0, k_n=1.0, mu=0.5, N0=1.0, harmonic=1, **damping):
    """Return the 3-D pair many times on the same DOFs, each with its share of stiffness and preload."""
    single = spatial(k_t=k_t / n_pairs, k_n=k_n / n_pairs, mu=mu, N0=N0 / n_pairs, harmonic=harmonic, **damping)
    return _system(
        "identical pairs",
        single["M"],
        single["K"],
        np.tile(single["pair_dofs"], (n_pairs, 1)),
        [1.0, 0.5, 0.3],
        k_t=k_t / n_pairs,
        k_n=k_n / n_pairs,
        mu=mu,
        N0=N0 / n_pairs,
        harmonic=harmonic,
        damping=damping,
    )


def coincident(n_copies=3, **numbers):
    """Return uncoupled copies of one oscillator: every frequency is multiple."""
    pairs = [[i, -1, -1, -1, -1, -1] for i in range(n_copies)]
    parameters = {"k_t": 1.0, "k_n": 1.0, "mu": 0.5, "N0": 2.0, **numbers}
    damping = {key: parameters.pop(key) for key in ("zeta", "C", "rayleigh") if key in parameters}
    return _system(
        "coincident modes",
        np.eye(n_copies),
        np.eye(n_copies),
        pairs,
        np.linspace(1.0, 0.5, n_copies),
        harmonic=1,
        damping=damping,
        **parameters,
    )


def patch(n_x=100, n_y=50, *, slipping=0.02, seed=4):
    """Return a lattice of n_x n_y nodes on the ground, one pair per node; every tenth node in a row of ten has mass.

    All modes are computed, because the other DOFs have no mass.  ``slipping`` is the share of pairs with a low
    friction limit, spread evenly.
    """
    n = n_x * n_y
    node = np.arange(n).reshape(n_x, n_y)
    ends = np.concatenate(
        [np.stack([node[:-1].ravel(), node[1:].ravel()], 1), np.stack([node[:, :-1].ravel(), node[:, 1:].ravel()], 1)]
    )
    B = sp.csr_matrix((np.tile([1.0, -1.0], len(ends)), (np.repeat(np.arange(len(ends)), 2), ends.ravel())), (len(ends), n))
    K = sp.kron(B.T @ B, np.diag([1.0, 0.8, 0.5])).tocsr() + 1e-3 * sp.identity(3 * n)
    mass = np.zeros((n_x, n_y))
    mass[5::20, 5::20] = 40.0
    dofs = 3 * np.arange(n)[:, None] + np.arange(3)
    vector = np.zeros(3 * n)
    heavy = np.flatnonzero(mass.ravel())
    vector[3 * heavy[:3]] = 1.0
    mu = np.where(np.arange(n) * 7919 % n < slipping * n, 0.01, 1e3)
    return scenes.make_system(
        "patch",
        np.zeros((1, 1)),
        np.zeros((1, 1)),
        np.column_stack([dofs, np.full((n, 3), -1)])[:0].reshape(0, 6),
        mu=0.0,
        N0=1.0,
        k_t=1.0,
        k_n=1.0,
        loads=[],
        output=[1.0],
        omega=(0.0, 1.0),
        levels={},
        rayleigh=(0.02, 0.0),
    ) | {
        "K": K.tocsc(),
        "M": sp.diags(np.repeat(mass.ravel(), 3)).tocsc(),
        "pair_dofs": np.column_stack([dofs, np.full((n, 3), -1)]),
        "R": sp.identity(3 * n, format="csr"),
        "mu": mu,
        "N0": np.ones(n),
        "k_t": np.full(n, 0.02),
        "k_n": np.full(n, 0.03),
        "separate": np.zeros(n, dtype=bool),
        "loads": [{"vector": vector, "harmonic": 1, "phase": 0.0}],
    }


def with_loads(system, *loads):
    """Return the system under other loads: vector, harmonic and phase of each."""
    return {
        **system,
        "loads": [{"vector": np.asarray(vector, dtype=float), "harmonic": n, "phase": phase} for vector, n, phase in loads],
    }


def scaled(system, *, length=1.0, mass=1.0, time=1.0):
    """Return the same structure in other units, or with scaled stiffness and density: values are multiplied by the factors."""
    force, stiffness = mass * length / time**2, mass / time**2
    computed = {
        **system,
        "M": system["M"] * mass,
        "K": system["K"] * stiffness,
        "k_t": system["k_t"] * stiffness,
        "k_n": system["k_n"] * stiffness,
        "N0": system["N0"] * force,
    }
    if "C" in system:
        computed["C"] = system["C"] * mass / time
    if "rayleigh" in system:
        computed["rayleigh"] = (system["rayleigh"][0] / time, system["rayleigh"][1] * time)
    return computed


def _beam(length, EI, EA, rhoA):
    """Return stiffness and consistent mass of a beam element, DOFs u, w, theta of both nodes."""
    a, b, L = EA / length, EI / length**3, length
    K, M = np.zeros((6, 6)), np.zeros((6, 6))
    axial, bending = np.ix_([0, 3], [0, 3]), np.ix_([1, 2, 4, 5], [1, 2, 4, 5])
    K[axial] = [[a, -a], [-a, a]]
    M[axial] = rhoA * L / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    K[bending] = b * np.array(
        [
            [12, 6 * L, -12, 6 * L],
            [6 * L, 4 * L * L, -6 * L, 2 * L * L],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, 2 * L * L, -6 * L, 4 * L * L],
        ]
    )
    M[bending] = (
        rhoA
        * L
        / 420.0
        * np.array(
            [
                [156, 22 * L, 54, -13 * L],
                [22 * L, 4 * L * L, 13 * L, -3 * L * L],
                [54, 13 * L, 156, -22 * L],
                [-13 * L, -3 * L * L, -22 * L, 4 * L * L],
            ]
        )
    )
    return K, M


def _system(name, M, K, pairs, load, *, k_t, k_n, mu, N0, harmonic, damping, separate=False):
    return scenes.make_system(
        name,
        M,
        K,
        pairs,
        mu=mu,
        N0=N0,
        k_t=k_t,
        k_n=k_n,
        separate=separate,
        loads=[{"vector": np.asarray(load, dtype=float), "harmonic": harmonic, "phase": 0.0}],
        output=np.eye(len(M))[0],
        omega=(0.0, 1.0),
        levels={},
        **(damping or {"zeta": 0.02}),
    )
