"""Measured convergence of every element kind: a box with an exact mode, a free plate, a cantilever.

    PYTHONPATH=solver:tests python tests/verification/convergence.py

prints three Markdown tables, and one of the rates (about a minute). With elements of degree p a natural frequency of a smooth mode converges
as h^(2 p): rates 2 and 4. The references are independent theories:

- *box on rollers*: an isochoric standing wave, omega = c_s |k|, exact in three-dimensional elasticity; curved elements;
- *free plate*: 1 x 1 x 0.2 m, three-dimensional elasticity by the Ritz method with Legendre polynomials (Visscher and
  others 1991 use powers), which converges exponentially and whose thin limit is Kirchhoff's plate;
- *cantilever*: 10 x 1 x 1 m with nu = 0, where Timoshenko's beam holds at the clamped end too: the limit of the hex20
  meshes lies 1.2e-5 above it, and the table counts from that limit. One element wide, hex20 of reduced integration has
  a mechanism: an error of -1.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from box_meshes import box
from numpy.polynomial import legendre
from scipy.optimize import brentq
from small_fe import assemble, dofs, frequencies

YOUNG, POISSON, DENSITY = 2.1e11, 0.3, 7800.0
SERIES = {  # name: kind, integration, incompatible modes, degree
    "tet4": ("tet4", "full", True, 1),
    "wedge6": ("wedge6", "full", True, 1),
    "hex8": ("hex8", "full", True, 1),
    "hex8, no incompatible modes": ("hex8", "full", False, 1),
    "tet10": ("tet10", "full", True, 2),
    "wedge15": ("wedge15", "full", True, 2),
    "hex20": ("hex20", "full", True, 2),
    "hex20, reduced": ("hex20", "reduced", True, 2),
}


def frequency(series, points, nodes, fixed, n_rigid=0, poisson=POISSON):
    """Return the lowest natural frequency [Hz] of a mesh above its rigid motions."""
    kind, integration, incompatible_modes, _ = SERIES[series]
    K, M = assemble(kind, points, nodes, YOUNG, poisson, DENSITY, integration, incompatible_modes)
    return frequencies(K, M, fixed, 1, n_rigid)[0]


# ---- box on rollers

ROLLER_BOX = np.array([1.0, 0.8, 0.7])  # m


def roller_box_exact():
    """Return the frequency of u = curl of (0, 0, cos(pi x / a) cos(pi y / b)), the lowest mode [Hz]."""
    c_s = np.sqrt(YOUNG / 2.0 / (1.0 + POISSON) / DENSITY)
    return c_s * np.pi * np.linalg.norm(1.0 / ROLLER_BOX[:2]) / (2.0 * np.pi)


def roller_box(series, n):
    """Return the lowest frequency [Hz] of a box of n^3 cells that slides freely along each of its flat sides."""
    points, nodes = box(SERIES[series][0], (n, n, n), ROLLER_BOX)
    at_side = (points == 0.0) | (points == ROLLER_BOX)
    t = np.pi * points / ROLLER_BOX
    moved = points + 0.06 * np.sin(t) * np.cos(np.roll(t, 1, axis=1)) * np.cos(np.roll(t, 2, axis=1))
    moved[at_side] = points[at_side]
    fixed = np.concatenate([dofs(at_side[:, i], axis) for i, axis in enumerate("xyz")])
    return frequency(series, moved, nodes, fixed)


# ---- free plate

PLATE = (1.0, 1.0, 0.2)  # m


def ritz_frequencies(size, degrees, n):
    """Return the ``n`` lowest elastic frequencies [Hz] of a free box by Legendre polynomials up to ``degrees``."""
    masses, slopes, mixed = zip(*(_legendre_integrals(degree, length) for degree, length in zip(degrees, size)))

    def integral(i, j):
        """Return the integrals of df_a/dx_i df_b/dx_j over all products of polynomials."""
        factors = list(masses)
        if i == j:
            factors[i] = slopes[i]
        else:
            factors[i], factors[j] = mixed[i], mixed[j].T
        return np.kron(np.kron(factors[0], factors[1]), factors[2])

    lam, mu = YOUNG * POISSON / (1.0 + POISSON) / (1.0 - 2.0 * POISSON), YOUNG / 2.0 / (1.0 + POISSON)
    G = [[integral(i, j) for j in range(3)] for i in range(3)]
    trace = G[0][0] + G[1][1] + G[2][2]
    K = np.block([[lam * G[i][j] + mu * G[j][i] + (i == j) * mu * trace for j in range(3)] for i in range(3)])
    mass = DENSITY * np.diag(np.kron(np.kron(masses[0], masses[1]), masses[2]))
    scale = 1.0 / np.sqrt(np.tile(mass, 3))
    values = sla.eigh(scale[:, None] * K * scale, eigvals_only=True, subset_by_index=[6, 5 + n], overwrite_a=True)
    return np.sqrt(values) / (2.0 * np.pi)


def _legendre_integrals(degree, length):
    """Return the integrals of P_a P_b, P_a' P_b' and P_a' P_b over a side of this length."""
    x, w = legendre.leggauss(degree + 1)
    P = legendre.legvander(x, degree)
    dP = np.stack([legendre.legval(x, legendre.legder(unit)) for unit in np.eye(degree + 1)], axis=1)
    w = w[:, None]
    return P.T @ (w * P) * length / 2.0, dP.T @ (w * dP) * 2.0 / length, dP.T @ (w * P)


def kirchhoff_frequency(thickness):
    """Return the lowest frequency [Hz] of a free square thin plate of side 1 m; 13.468 is for nu = 0.3."""
    return 13.468 * np.sqrt(YOUNG * thickness**2 / (12.0 * (1.0 - POISSON**2) * DENSITY)) / (2.0 * np.pi)


def plate(series, n):
    """Return the lowest elastic frequency [Hz] of the plate, 5 n x 5 n x n cells."""
    points, nodes = box(SERIES[series][0], (5 * n, 5 * n, n), PLATE)
    return frequency(series, points, nodes, [], n_rigid=6)


# ---- cantilever

LENGTH, SIDE = 10.0, 1.0  # m


def timoshenko_frequency():
    """Return the lowest bending frequency [Hz] of the clamped-free beam of square section.

    With w and the rotation theta as sums of cosh, sinh (p x) and cos, sin (q x); clamped: w = theta = 0; free: no
    moment and no shear force; nu = 0, shear coefficient 5/6.
    """
    EI, area = YOUNG * SIDE**4 / 12.0, SIDE**2
    shear = 5.0 / 6.0 * area * YOUNG / 2.0
    rho_A, rho_I = DENSITY * area, DENSITY * SIDE**4 / 12.0

    def determinant(omega):
        b, c = rho_A / shear + rho_I / EI, rho_A / EI * (1.0 - rho_I * omega**2 / shear)
        root = np.sqrt((omega**2 * b) ** 2 / 4.0 + omega**2 * c)
        p, q = np.sqrt(root - omega**2 * b / 2.0), np.sqrt(root + omega**2 * b / 2.0)
        # theta' = -(w'' + rho_A omega^2 w / shear) gives theta = g sinh, g cosh, -k sin, k cos
        g, k = p + rho_A * omega**2 / shear / p, q - rho_A * omega**2 / shear / q
        ch, sh, cs, sn = np.cosh(p * LENGTH), np.sinh(p * LENGTH), np.cos(q * LENGTH), np.sin(q * LENGTH)
        return np.linalg.det(
            [
                [1.0, 0.0, 1.0, 0.0],  # w(0)
                [0.0, g, 0.0, k],  # theta(0)
                [g * p * ch, g * p * sh, -k * q * cs, -k * q * sn],  # theta'(L)
                [(p - g) * sh, (p - g) * ch, (k - q) * sn, (q - k) * cs],  # w'(L) - theta(L)
            ]
        )

    slender = (1.8751 / LENGTH) ** 2 * np.sqrt(EI / rho_A)
    return brentq(determinant, 0.8 * slender, 1.05 * slender, xtol=1e-10 * slender) / (2.0 * np.pi)


def cantilever(series, n):
    """Return the lowest frequency [Hz] of the clamped bar, 10 n x n x n cells.  (A double frequency, except with skew meshes.)"""
    points, nodes = box(SERIES[series][0], (10 * n, n, n), (LENGTH, SIDE, SIDE))
    return frequency(series, points, nodes, dofs(points[:, 0] == 0.0), poisson=0.0)


# ---- rates and tables


def rates(errors, sizes):
    """Return the rates between neighbouring meshes from errors against an exact value."""
    return np.log(errors[:-1] / errors[1:]) / np.log(sizes[1:] / sizes[:-1])


def extrapolate(values):
    """Return the limit of three meshes, each with half the cell size of the one before."""
    coarse, fine = values[0] - values[1], values[1] - values[2]
    return values[2] - fine**2 / (coarse - fine)


def study(title, solve, sizes, exact):
    """Print relative errors of every series against an exact value; return the rate between the last two meshes of each."""
    print(f"\n{title}: {exact:.6f} Hz\n\n| element | " + " | ".join(f"n = {n}" for n in sizes) + " | rate |")
    print("| --- " * (len(sizes) + 2) + "|")
    values = []
    for series in SERIES:
        errors = np.array([solve(series, n) for n in sizes]) / exact - 1.0
        cells = " | ".join(f"{error:+.2e}" for error in errors)
        values.append(rates(abs(errors), np.array(sizes))[-1])
        print(f"| {series} | {cells} | {values[-1]:.2f} |", flush=True)
    return values


def main():
    rollers = study("Box on rollers, exact", roller_box, (2, 4, 8), roller_box_exact())
    exact = ritz_frequencies(PLATE, (11, 11, 5), 1)[0]
    free = study("Free plate, three-dimensional theory", plate, (1, 2, 3), exact)
    theory, limit = timoshenko_frequency(), extrapolate([cantilever("hex20", n) for n in (1, 2, 4)])
    title = f"Cantilever, limit {limit / theory - 1.0:+.1e} from Timoshenko's {theory:.6f} Hz"
    clamped = study(title, cantilever, (1, 2, 4), limit)
    print("\nThe rates:\n\n| element | box on rollers | free plate | cantilever |\n| --- | --- | --- | --- |")
    for series, *three in zip(SERIES, rollers, free, clamped):
        print(f"| {series} | " + " | ".join(f"{rate:.2f}" for rate in three) + " |")


if __name__ == "__main__":
    main()
