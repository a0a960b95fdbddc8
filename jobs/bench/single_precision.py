"""A factor of K_L in single precision with refinement in double, and its mode count, compared with MUMPS in double precision.

    python meshes/fan_sector.py --size paper --out meshes/fan_paper.msh
    python jobs/bench/single_precision.py jobs/fan_paper.toml [--columns 1 16 64]

One rank.  A copy of the bridge to MUMPS is built for smumps, in a temporary folder (needs Cython, gcc and MUMPS' headers).
Solutions are refined by conjugate gradients preconditioned with the factor, all columns at once, to a residual of 1e-10.
"""

import argparse
import ctypes.util
import importlib.util
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from types import ModuleType
from typing import Any

from microslip.parallel.petsc import initialise

initialise()

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc

from microslip.library.build import assembled, factor_of
from microslip.linear import _mumps
from microslip.linear.mumps import ANALYSE, DEFINITE, FACTOR, INDEFINITE, RHS_BLOCK, SOLVE
from microslip.linear.ordering import elimination_order
from microslip.modes.eigen import lowest_modes
from microslip.observe.log import RunLog
from microslip.scene.read import read_scene

BRIDGE = Path(__file__).parents[2] / "solver" / "microslip" / "linear" / "_mumps.pyx"
CONTROLS = ((3, 0), (4, 0), (7, 1), (15, 1), (27, RHS_BLOCK))  # ICNTL, as linear/mumps.py sets them
FOR_INERTIA = ((8, 0), (13, 1), (24, 1), (31, 1))
RESIDUAL, MOST = 1e-10, 100


def single_bridge(folder: str) -> ModuleType:
    """Return the bridge to MUMPS in single precision, built from that in double precision."""
    source = BRIDGE.read_text()
    source = re.sub(r"double (?=\*|cntl|rinfo)|double(?=\[)", lambda match: match[0].replace("double", "float"), source)
    Path(folder, "_smumps.pyx").write_text(source.replace("dmumps", "smumps").replace("DMUMPS", "SMUMPS"))
    Path(folder, "setup.py").write_text(
        "from Cython.Build import cythonize\nfrom setuptools import setup\nsetup(ext_modules=cythonize('_smumps.pyx'))\n"
    )
    subprocess.run([sys.executable, "setup.py", "-q", "build_ext", "--inplace"], cwd=folder, check=True, capture_output=True)
    (library,) = Path(folder).glob("_smumps.*.so")
    spec = importlib.util.spec_from_file_location("_smumps", library)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Scaled:
    """A symmetric matrix in MUMPS, scaled to a diagonal of about 1, in single or double precision."""

    def __init__(self, bridge: ModuleType, library: str, A: sp.csr_matrix, order, sym: int, precision: type):
        self.scale = np.exp2(-np.round(0.5 * np.log2(np.abs(A.diagonal()))))
        self.precision = precision
        upper = sp.triu(sp.diags(self.scale) @ A @ sp.diags(self.scale)).tocoo()
        self.mumps = bridge.Instance(library, MPI.COMM_WORLD.py2f(), sym)
        for number, value in (*CONTROLS, *(FOR_INERTIA if sym == INDEFINITE else ())):
            self.mumps.set_icntl(number, value)
        self.mumps.set_order(order.places, order.starts)
        rows, columns = (index.astype(np.int32) + 1 for index in (upper.row, upper.col))
        self.mumps.set_matrix(A.shape[0], rows, columns, upper.data.astype(precision), False)
        self.mumps.run(ANALYSE)
        began = process_time()
        self.code = self.mumps.run(FACTOR)
        self.seconds = process_time() - began
        self.memory = self.mumps.infog(22)

    def solve(self, B: np.ndarray) -> np.ndarray:
        """Return A^-1 B without refinement, in double precision."""
        X = self.scale[:, None] * B
        sizes = np.abs(X).max(axis=0)
        X = np.asfortranarray((X / sizes).astype(self.precision))
        self.mumps.set_dense(X)
        self.mumps.run(SOLVE)
        return self.scale[:, None] * (X.astype(float) * sizes)


def refined(A: sp.csr_matrix, factor: Scaled, B: np.ndarray) -> tuple[np.ndarray, int]:
    """Return A^-1 B by preconditioned conjugate gradients, and the number of iterations."""
    X, norms = factor.solve(B), np.linalg.norm(B, axis=0)
    R = B - A @ X
    Z = factor.solve(R)
    P, rho = Z.copy(), np.sum(R * Z, axis=0)
    for iteration in range(MOST):
        if np.max(np.linalg.norm(R, axis=0) / norms) < RESIDUAL:
            return X, iteration
        Q = A @ P
        step = rho / np.sum(P * Q, axis=0)
        X += step * P
        R -= step * Q
        Z = factor.solve(R)
        rho, before = np.sum(R * Z, axis=0), rho
        P = Z + rho / before * P
    return X, MOST


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return processor time, and the result of the work."""
    began = process_time()
    result = work()
    return process_time() - began, result


def csr(A: PETSc.Mat) -> sp.csr_matrix:
    starts, columns, values = A.getValuesCSR()
    return sp.csr_matrix((values, columns, starts), shape=A.getSize())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--columns", type=int, nargs="+", default=[1, 16, 64])
    parser.add_argument("--modes", type=int, default=20)
    arguments = parser.parse_args()
    comm, log = MPI.COMM_WORLD, RunLog(MPI.COMM_WORLD, screen=False)
    linearised = factor_of(assembled(read_scene(arguments.scene), comm, log), log)
    modes = lowest_modes(linearised, arguments.modes)
    omega_n = modes.omega_n
    K, M = csr(linearised.K_L), csr(linearised.M)
    order = elimination_order(linearised.K_L, np.empty(0, dtype=int), True)
    with tempfile.TemporaryDirectory() as folder:
        libraries: dict[str, tuple[Any, str, type]] = {
            "double": (_mumps, PETSc.__file__, np.float64),
            "single": (single_bridge(folder), ctypes.util.find_library("smumps-5.5") or "libsmumps.so", np.float32),
        }
        factors = {name: Scaled(bridge, library, K, order, DEFINITE, kind) for name, (bridge, library, kind) in libraries.items()}
        print(f"{K.shape[0]} unknowns")
        rounding = np.finfo(np.float32).eps * (K.diagonal() @ modes.phi_owned**2) / omega_n**2
        print(
            f"rounding of K_L in single precision, over the eigenvalue: at most {rounding[0]:.1g} in mode 1, {rounding[-1]:.1g} in the last"
        )
        for name, factor in factors.items():
            print(f"{name}: factor {factor.seconds:.2f} s, {factor.memory} MB, code {factor.code}")
        for m in arguments.columns:
            B = np.random.default_rng(m).standard_normal((K.shape[0], m))
            in_double, X = timed(partial(factors["double"].solve, B))
            in_single, (Y, n) = timed(partial(refined, K, factors["single"], B))
            error = np.max(np.linalg.norm(Y - X, axis=0) / np.linalg.norm(X, axis=0))
            print(f"{m} columns: double {in_double:.2f} s, single {in_single:.2f} s in {n} iterations, differ by {error:.0e}")
        gaps = [k for k in range(1, len(omega_n)) if omega_n[k] > 1.02 * omega_n[k - 1]]
        for k in (gaps[0], gaps[-1]):
            sigma = (0.5 * (omega_n[k - 1] + omega_n[k])) ** 2
            for name, (bridge, library, kind) in libraries.items():
                shifted = Scaled(bridge, library, sp.csr_matrix(K - sigma * M), order, INDEFINITE, kind)
                print(
                    f"modes below {np.sqrt(sigma) / 2 / np.pi:.0f} Hz, of {k}: {shifted.mumps.infog(12)} in {name}, {shifted.seconds:.2f} s"
                )
    linearised.destroy()


if __name__ == "__main__":
    main()
