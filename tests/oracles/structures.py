"""Natural frequencies of beams and free plates from theory, for the tests of elements and modes."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh, expm
from scipy.optimize import brentq

# state of a beam: deflection, rotation, moment, shear force; which of them vanish at each kind of end
ENDS = {"clamped": (0, 1), "pinned": (0, 2), "free": (2, 3)}


def beam_frequencies(n, *, length, EI, rhoA, ends=("clamped", "free"), shear_stiffness=np.inf, rhoI=0.0):
    """Return the n lowest bending frequencies [rad/s] of a uniform beam.

    Euler and Bernoulli by default; Timoshenko with ``shear_stiffness`` = kappa G A and ``rhoI``.  The exact transfer
    matrix of the beam's four first-order equations is searched for zeros of its frequency determinant, in steps of a
    twentieth of the spacing of the Euler-Bernoulli roots; rigid-body motions are not counted.
    """
    time = np.sqrt(rhoA * length**4 / EI)
    slender, compliance = rhoI / (rhoA * length**2), EI / (shear_stiffness * length**2)
    unknowns = [i for i in range(4) if i not in ENDS[ends[0]]]

    def determinant(a):  # a^2 is the dimensionless frequency
        w2 = a**4
        # w' = theta + compliance Q,  theta' = m,  m' = -Q - slender w2 theta,  Q' = -w2 w   (all dimensionless)
        A = np.zeros((4, 4))
        A[0, 1], A[0, 3], A[1, 2], A[2, 1], A[2, 3], A[3, 0] = 1.0, compliance, 1.0, -slender * w2, -1.0, -w2
        transfer = expm(A)[np.ix_(ENDS[ends[1]], unknowns)]
        return np.linalg.det(transfer) / np.cosh(a)

    roots, a, before, step = [], 1.0, determinant(1.0), np.pi / 20.0
    while len(roots) < n:
        after = determinant(a + step)
        if before * after < 0.0:
            roots.append(brentq(determinant, a, a + step, xtol=1e-13))
        a, before = a + step, after
    return np.array(roots) ** 2 / time


def timoshenko_rectangle(n, *, length, width, height, young, poisson, density, ends=("clamped", "free")):
    """Return the n lowest frequencies [rad/s] of bending over ``height``; shear factor 10 (1 + nu) / (12 + 11 nu)."""
    A, inertia = width * height, width * height**3 / 12.0
    kappa = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)
    return beam_frequencies(
        n,
        length=length,
        EI=young * inertia,
        rhoA=density * A,
        ends=ends,
        rhoI=density * inertia,
        shear_stiffness=kappa * young / (2.0 * (1.0 + poisson)) * A,
    )


def bar_frequencies(n, *, length, young, density, ends=("clamped", "free")):
    """Return the n lowest non-zero axial frequencies [rad/s] of a uniform bar."""
    shift = 0.5 if ends[0] != ends[1] else 0.0
    return np.pi * (np.arange(1, n + 1) - shift) / length * np.sqrt(young / density)


def _plate_tables(degree):
    """Return the matrices of the integrals of P_i^(r) P_j^(s) over -1 .. 1 for derivatives r, s = 0, 1, 2."""
    points, weights = legendre.leggauss(degree + 1)
    values = [
        np.array(
            [
                legendre.legval(points, legendre.legder(row, r)) if r else legendre.legval(points, row)
                for row in np.eye(degree + 1)
            ]
        )
        for r in range(3)
    ]
    return [[(values[r] * weights) @ values[s].T for s in range(3)] for r in range(3)]


def free_plate(n, *, ratio=1.0, poisson=0.3, thickness=0.0, degree=14, shear_factor=5.0 / 6.0):
    """Return the n lowest parameters omega a^2 sqrt(rho h / D) of a plate a x b free on all sides, ratio = a / b.

    Kirchhoff's theory for ``thickness`` = 0, else Mindlin's with h / a = thickness (rotary inertia included).  Ritz
    with products of Legendre polynomials up to ``degree`` in each direction; rigid-body motions are not counted.
    """
    table = _plate_tables(degree)

    def product(rx, sx, ry, sy):  # integral of d^rx_x d^ry_y times d^sx_x d^sy_y over the plate, a = 1
        return np.kron(2.0 ** (rx + sx - 1) * table[rx][sx], (2.0 * ratio) ** (ry + sy) / (2.0 * ratio) * table[ry][sy])

    mass = product(0, 0, 0, 0)
    if thickness == 0.0:
        K = (
            product(2, 2, 0, 0)
            + product(0, 0, 2, 2)
            + poisson * (product(2, 0, 0, 2) + product(0, 2, 2, 0))
            + 2.0 * (1.0 - poisson) * product(1, 1, 1, 1)
        )
        M = mass
    else:
        S = shear_factor * 6.0 * (1.0 - poisson) / thickness**2  # kappa G h over D / a^2
        twist, zero = 0.5 * (1.0 - poisson), np.zeros_like(mass)
        K_xx = product(1, 1, 0, 0) + twist * product(0, 0, 1, 1) + S * mass
        K_yy = product(0, 0, 1, 1) + twist * product(1, 1, 0, 0) + S * mass
        K_xy = poisson * product(1, 0, 0, 1) + twist * product(0, 1, 1, 0)
        K_wx, K_wy = S * product(1, 0, 0, 0), S * product(0, 0, 1, 0)  # shear strain w_x + theta_x
        K_ww = S * (product(1, 1, 0, 0) + product(0, 0, 1, 1))
        K = np.block([[K_ww, K_wx, K_wy], [K_wx.T, K_xx, K_xy], [K_wy.T, K_xy.T, K_yy]])
        rotary = thickness**2 / 12.0 * mass
        M = np.block([[mass, zero, zero], [zero, rotary, zero], [zero, zero, rotary]])
    squares = eigh(K, M, eigvals_only=True, subset_by_index=[3, n + 2])  # 0 .. 2: the rigid-body motions
    return np.sqrt(squares)
