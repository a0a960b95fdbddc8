"""The 8-node hexahedron with incompatible modes in this program and in CalculiX (C3D8I): differences and limits.

    PYTHONPATH=solver:tests python tests/verification/incompatible_modes.py [path of ccx] [refinements, 1,2,4 by default]

CalculiX' element is rebuilt: gradients of the modes without the factor det J_centre / det J, and a mass that includes the modes. At
the 2 x 2 x 2 points of the mass 1 - xi^2 is 2/3 in all three directions, so that three modes move the inside of the element
together: three additional unknowns per element with its whole mass, and six that follow without mass. With ``ccx`` (Debian:
calculix-ccx) that is compared with its frequencies. Then over refined meshes of the curved, twisted and tapered bar, whose elements
become parallelepipeds, and of a straight bar of trapezia whose shape does not change: six frequencies compared with hex20, and the
energy of a constant strain (the least of six) compared with the exact energy, in which an element that passes the patch test has no
error.
"""

from __future__ import annotations

import shutil
import sys

import numpy as np
import scipy.sparse.linalg as sla
from box_meshes import box
from small_fe import _sum, assemble, bent, dofs, frequencies
from verification.calculix import STEEL, calculix

from microslip import elements
from microslip.elements import Isotropic, solid
from microslip.elements.kinds import KINDS
from microslip.elements.quadrature import rules

HEX8 = KINDS["hex8"]
SIZE = (1.0, 1.5, 4.0)
AS_ONE = np.array([[0.5, 1.0, 0.0], [0.5, -1.0, 1.0], [0.5, 0.0, -1.0]])  # modes by: their common motion, two without mass


def as_calculix(points, nodes):
    """Return K and M of CalculiX' C3D8I, with three rows per element after those of the nodes."""
    young, poisson, density = STEEL
    corners, rule = points[nodes], rules("hex8")[0]
    dN, volumes = solid._gradients(HEX8, corners, rule)
    centre = solid._jacobians(HEX8, corners, np.zeros((1, 3)))[1]
    modes = solid._incompatible_gradients(HEX8, corners, rule, centre * rule.weights)  # with weights that make the factor 1
    whole = Isotropic(young, poisson).stiffness(np.concatenate([dN, modes @ AS_ONE], axis=-1), volumes)
    K = solid.condensed(whole, 27)
    N = np.column_stack([HEX8.values(rule.points), np.ones(8)])
    M = density * np.einsum("eq,qa,qb->eab", volumes, N, N)
    dofs = np.column_stack([nodes, len(points) + np.arange(len(nodes))])
    rows = (3 * dofs[:, :, None] + np.arange(3)).reshape(len(dofs), -1)
    return _sum(K, rows), _sum(np.einsum("eab,ij->eaibj", M, np.eye(3)).reshape(len(M), 27, 27), rows)


def curved(kind, times):
    points, nodes = box(kind, (2 * times, 2 * times, 4 * times), SIZE)
    return bent(points), nodes


def trapezia(kind, times):
    """Return the straight bar, with every second layer of nodes moved up and down along the bar by a third of an element."""
    points, nodes = box(kind, (2 * times, 2 * times, 4 * times), SIZE)
    i, k = points[:, 0] * 2 * times / SIZE[0], points[:, 2] * 4 * times / SIZE[2]
    wave = np.cos(np.pi * i) * np.sin(0.5 * np.pi * k) ** 2 * np.isclose(k % 2.0, 1.0)
    return points + np.outer(wave / 3.0 * SIZE[2] / (4 * times), [0.0, 0.0, 1.0]), nodes


def lowest(K, M, points, n=6):
    return frequencies(K, M, dofs(points[:, 2] == 0.0), n)


def least_energy(K, points, nodes):
    """Return the least energy of six constant strains divided by the exact energy, less 1; rows after the nodes' have no force."""
    lam, mu = (steel := Isotropic(*STEEL[:2])).lam, steel.mu
    n, volume, values = points.size, elements.volumes("hex8", points[nodes]).sum(), []
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)):
        H = np.zeros((3, 3))
        H[i, j] += 0.5
        H[j, i] += 0.5
        u = (points @ H).ravel()
        if K.shape[0] > n:
            u = np.concatenate([u, -sla.spsolve(K[n:, n:].tocsc(), K[n:, :n] @ u)])
        values.append(u @ (K @ u) / volume / (lam * np.trace(H) ** 2 + 2.0 * mu * np.sum(H**2)) - 1.0)
    return min(values)


def rebuilt(ccx):
    """Print how CalculiX' frequencies agree with those of its rebuilt element, on both meshes."""
    for mesh in (curved, trapezia):
        points, nodes = mesh("hex8", 1)
        tip = int(np.argmax(points[:, 2]))
        theirs = calculix(ccx, "C3D8I", made=(points, nodes, tip))
        computed = lowest(*as_calculix(points, nodes), points)
        print(f"{mesh.__name__:9s} C3D8I of CalculiX against it rebuilt: {abs(computed / theirs - 1.0).max():.1e}")


def main():
    ccx = sys.argv[1] if len(sys.argv) > 1 else shutil.which("ccx")
    if ccx:
        rebuilt(ccx)
    print("| bar | element | cells | constant strain | six frequencies |\n| --- | --- | --- | --- | --- |")
    for mesh in (curved, trapezia):
        points, nodes = curved("hex20", 4) if mesh is curved else box("hex20", (8, 8, 16), SIZE)
        exact = lowest(*assemble("hex20", points, nodes, *STEEL), points)
        for times in map(int, sys.argv[2].split(",") if len(sys.argv) > 2 else "124"):
            points, nodes = mesh("hex8", times)
            for title, (K, M) in (("here", assemble("hex8", points, nodes, *STEEL)), ("CalculiX", as_calculix(points, nodes))):
                errors = ", ".join(f"{error:+.2%}" for error in lowest(K, M, points) / exact - 1.0)
                cells = f"{2 * times} x {2 * times} x {4 * times}"
                print(f"| {mesh.__name__} | {title} | {cells} | {least_energy(K, points, nodes):.1e} | {errors} |", flush=True)


if __name__ == "__main__":
    main()
