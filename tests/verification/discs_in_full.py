"""Discs computed from one sector, checked by the equations of the full ring: every sector, every joint.

    PYTHONPATH=solver:tests:meshes python tests/verification/discs_in_full.py [--docs DIR] [--name TEXT]

Each point of a disc is expanded to all sectors by its wave and tested in the ring's equations: sparse matrices of the whole ring, a
direct solve at every harmonic, and the contact law of tests/oracles/path.py.  Writes the tables of discs_in_full.md into DIR.  The
exit status is 1 if a point is wrong.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import sys
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from discs import of_ring, write_ring, write_sector
from mpi4py import MPI
from oracles.point_check import Judge, relative
from oracles.scenes import cycle_work
from scene_text import table

from microslip.continuation.point_record import HELD
from microslip.library.build import assembled, build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.observe.log import RunLog
from microslip.scene.read import read_scene

sys.path.insert(0, str(Path(__file__).parents[2] / "jobs" / "bench"))
from page_tables import put
from page_tables import table as page_table

HERE, SAMPLES = MPI.COMM_SELF, 60
STICK, SLIP, OPEN = 0, 1, 2
BOUNDS = {"motion": 1e-7, "response": 1e-7, "force": 1e-6, "law": 1e-7, "energy": 1e-5}  # of the ring's equations
CREEP = 100.0
FREQUENCIES = 1e-9  # of all nodal diameters against the ring
DENSE, LOWEST = 1_500, 60  # DOF up to which the ring's frequencies are computed, and how many
RAYLEIGH = 150.0  # 1/s, of C = alpha M: a ratio of 0.8 % at 1400 Hz


@dataclass(frozen=True)
class Case:
    """A disc under one level of a wave, and the states of pairs that must occur: 0 stuck, 1 slip, 2 open."""

    name: str
    N: int
    h: int
    level: float  # N
    band: tuple[float, float]  # Hz
    states: set[int]
    harmonics: Any = 3
    points: int = 6
    body: dict = field(default_factory=dict)  # keys of discs.body_text
    modes: int = 54  # all of a sector
    creeps: bool = False  # at a fold sliders creep: rounding decides where the curve ends, and the bounds are CREEP times as wide


SHROUDS, BLADE, SHROUDED = {"how": {"shroud": True}}, (1395.0, 1455.0), (940.0, 1010.0)
FINE = {"friction": 0.05, "how": {"divisions": (1, 3, 1)}}  # angles of 120 degrees and more are no hex8
GAP = SHROUDS | {"of_shrouds": {"preload": 0.0, "gap": 2e-6}}


def comparison(N: int = 12) -> list[Case]:
    """Return discs under engine orders 1, 2, N/2 and N + 1, from stuck to gross slip and lift-off."""
    cases, slides = [], {"friction": 0.1}
    for h in (1, 2, N // 2, N + 1):
        of_N = (N, h % N)
        in_shrouds = {STICK} if h == N // 2 or of_N == (8, 2) else {STICK, SLIP}  # no resonance in the range
        level = 35.0 if of_N == (8, 1) else 20.0  # N; the resonance is beside the range
        cases += [
            Case(f"N = {N}, order {h}, all stuck", N, h, 0.01, BLADE, {STICK}),
            Case(f"N = {N}, order {h}, slip", N, h, level, BLADE, {STICK, SLIP}, body=slides),
            Case(f"N = {N}, order {h}, shrouds", N, h, 30.0, SHROUDED, in_shrouds, body=SHROUDS | slides, modes=90),
        ]
        cases[-1] = replace(cases[-1], creeps=of_N == (12, 2))
    return [
        *cases,
        Case(f"N = {N}, order 1, gross slip", N, 1, 120.0, BLADE, {SLIP}, body=slides),
        Case(f"N = {N}, order 1, lift-off", N, 1, 250.0, BLADE, {OPEN}, body={"friction": 0.5}),
        Case(f"N = {N}, order 2, harmonics 1 and 3", N, 2, 20.0, BLADE, {SLIP}, [1, 3], body=slides),
    ]


def extremes() -> list[Case]:
    """Return discs at the limits of the values that [cyclic] accepts."""
    slides = {"friction": 0.05}
    return [
        Case("two sectors, order 1 = N/2", 2, 1, 20.0, (1300.0, 1500.0), {SLIP}, body=FINE, modes=126),
        Case("two sectors, order 0", 2, 0, 20.0, (1300.0, 1500.0), {SLIP}, body=FINE, modes=126),
        Case("three sectors, order 1: harmonic 3 is even", 3, 1, 20.0, (1300.0, 1500.0), {SLIP}, body=FINE, modes=126),
        Case("100 sectors, order 0", 100, 0, 1.0, (600.0, 900.0), {STICK}, points=3, body=slides),
        Case("100 sectors, order 7", 100, 7, 1.0, (600.0, 900.0), {STICK}, points=3, body=slides),
        Case("100 sectors, order 50 = N/2", 100, 50, 1.0, (600.0, 900.0), {STICK}, points=3, body=slides),
        Case("order 0, shrouds", 5, 0, 30.0, (900.0, 1100.0), {SLIP}, body=SHROUDS | slides, modes=90),
        Case("shrouds open at rest that never close", 5, 1, 0.01, BLADE, {STICK, OPEN}, body=GAP, modes=90),
        Case("shrouds open at rest that close", 5, 1, 60.0, (925.0, 935.0), {OPEN}, points=3, body=GAP, modes=90),
        Case("all slip", 5, 2, 60.0, BLADE, {SLIP}, body={"friction": 1e-3, "preload": 2e7}),
        Case("no friction", 5, 2, 1.0, (500.0, 900.0), {SLIP}, body={"friction": 0.0, "preload": 2e7}),
        Case("one harmonic", 6, 2, 20.0, BLADE, {SLIP}, 1, body=slides),
    ]


@dataclass
class Judged:
    """The largest errors of a case over its points, each relative."""

    case: Case
    errors: dict[str, float]
    states: set[int]
    n_points: int
    n_dof: int  # of the ring
    frequencies: float  # error of those of all nodal diameters; NaN for a large ring
    failure: str = ""

    @property
    def faults(self) -> list[str]:
        """Return the faults, an empty list if there are none."""
        computed, wider = [self.failure] if self.failure and not self.case.creeps else [], CREEP if self.case.creeps else 1.0
        computed += [f"frequencies {self.frequencies:.1e}"] if self.frequencies > FREQUENCIES else []
        computed += [
            f"{name} {self.errors[name]:.1e}" for name, bound in BOUNDS.items() if not self.errors[name] <= wider * bound
        ]
        return computed + ([] if self.case.states <= self.states else [f"no pair is in one of the states {self.case.states}"])


class Ring:
    """The full ring of a sector: its matrices, and the motion of all sectors under given forces."""

    def __init__(self, path: Path, sector_pairs, case: Case):
        scene = read_scene(path)
        rest = assembled(scene, HERE, RunLog(HERE, screen=False)).rest
        system, self.pairs, self.sector_pairs, self.case = rest.system, rest.pairs, sector_pairs, case
        K, self.M = (sp.csr_matrix(matrix.getValuesCSR()[::-1], matrix.getSize()) for matrix in (system.K, system.M))
        self.R, self.O, self.k = system.R, system.outputs, self.pairs.law.stiffness
        self.K_L = (K + self.R.T @ sp.diags(self.k.ravel()) @ self.R).tocsr()
        phases = np.array([load.phase for load in scene.loads])
        vectors = system.loads.toarray()
        self.cos, self.sin = vectors @ np.cos(phases), -(vectors @ np.sin(phases))

    def expanded(self, x: np.ndarray) -> np.ndarray:
        """Return coefficients of the pairs of sector 0, (n, 3, N_H), on the pairs of all sectors."""
        return of_ring(self.sector_pairs, self.pairs, self.case.N, self.case.h, x)

    def frequencies(self, of_sector: np.ndarray) -> float:
        """Return the largest relative difference of the lowest frequencies from those of all nodal diameters; NaN if large."""
        if self.M.shape[0] > DENSE:
            return float("nan")
        K, M = self.K_L.toarray(), self.M.toarray()
        squares = scipy.linalg.eigh(K, M, eigvals_only=True, subset_by_index=(0, min(LOWEST, len(K)) - 1))
        return float(np.abs(np.sort(of_sector)[: len(squares)] / np.sqrt(squares) - 1.0).max())

    def motion(self, omega: float, forces: np.ndarray) -> np.ndarray:
        """Return u (n, N_H) under forces (n, N_H) with all joint springs in place."""
        u = np.empty_like(forces)
        u[:, 0] = scipy.sparse.linalg.spsolve(self.K_L.tocsc(), forces[:, 0])
        for n in range(1, forces.shape[1] // 2 + 1):
            Z = (self.K_L + (1j * n * omega * RAYLEIGH - (n * omega) ** 2) * self.M).tocsc()
            x = scipy.sparse.linalg.spsolve(Z, forces[:, 2 * n - 1] - 1j * forces[:, 2 * n])
            u[:, 2 * n - 1], u[:, 2 * n] = x.real, -x.imag
        return u

    def errors(self, point, march, level: float) -> dict[str, float]:
        """Return the relative errors of a point of the disc whose wave is substituted in the ring's equations."""
        N_H, N = point.U.shape[-1], self.case.N
        is_solved = np.isin((np.arange(N_H) + 1) // 2, np.atleast_1d(self.case.harmonics)) | isinstance(self.case.harmonics, int)
        if any(HELD in note for note in point.notes):  # the mean of p_t is not that of the law: docs/theory.md, eq. (5.6)
            march.p[:, :2, 0] = point.p[:, :2, 0]
        law = march.p * is_solved
        U, p, by_law = (self.expanded(x) for x in (point.U, point.p, law))
        f = np.zeros((len(self.cos), N_H))
        f[:, 1], f[:, 2] = level * self.cos, level * self.sin
        u = self.motion(point.omega, f - self.R.T @ p.reshape(-1, N_H))
        du = (self.R @ u).reshape(U.shape)
        stiff = self.k[:, :, None]
        unbalanced = self.R.T @ (p - by_law + stiff * (du - U)).reshape(-1, N_H)
        size = np.linalg.norm(f) + np.linalg.norm(self.R.T @ (by_law + stiff * U).reshape(-1, N_H))
        n = (np.arange(N_H) + 1) // 2
        loss = np.pi * point.omega * RAYLEIGH * float(np.sum(n**2 * np.einsum("ih,ih->h", u, self.M @ u)))
        energies = np.array([cycle_work(f, u).sum(), loss, cycle_work(by_law, U).sum()])
        stated = N * np.array([point.input, point.damping, point.friction])
        response = self.O @ u
        return {
            "motion": relative(du - U, U),
            "response": relative(np.asarray(point.response)[:1] - response, response),
            "force": float(np.linalg.norm(unbalanced) / size),
            "law": float((np.abs(point.p - law).max(axis=(1, 2)) / march.size).max()),
            "energy": float(np.abs(energies - stated).max() / np.abs(energies).max()),
        }


def end(case: Case) -> str:
    """Return the tables of damping, response and solver."""
    low, high = case.band
    keys = {"harmonics": case.harmonics, "samples": SAMPLES, "error_bars": False, "tolerance": 1e-10}
    return (
        table("damping", rayleigh=[RAYLEIGH, 0.0])
        + table("response", levels=[case.level], frequencies=[low, high], points=case.points)
        + table("solver", modes=case.modes, **keys)
    )


def judged(case: Case, folder: Path, h_of_ring: int | None = None) -> Judged:
    """Return the errors of a case.  Local.  ``h_of_ring`` excites the ring by another wave, to test the check."""
    sector = build(read_scene(write_sector(folder, case.N, end(case), wave={"engine_order": case.h}, **case.body)), HERE)
    ring = Ring(
        write_ring(folder, case.N, end(case), h=case.h if h_of_ring is None else h_of_ring, **case.body), sector.pairs, case
    )
    (branch,) = follow(prepare(sector, has_bars=False).response)
    pairs = sector.pairs
    law = {"mu": pairs.mu, "N0": pairs.N0, "k_t": pairs.k_t, "k_n": pairs.k_n, "separate": pairs.separate}
    judge = Judge.__new__(Judge)
    judge.system, judge.k, judge.n_samples = law, pairs.law.stiffness, SAMPLES
    errors, states = dict.fromkeys(BOUNDS, 0.0), set()
    for point in branch.points:
        judge.H = point.U.shape[-1] // 2
        march = judge.march(point.U)
        of_point = ring.errors(point, march, case.level)
        errors = {name: max(errors[name], of_point[name]) for name in errors}
        states |= {int(state) for state in march.state}
    frequencies = ring.frequencies(np.concatenate([sector.per_group.of_group(d).omega_n for d in range(case.N)]))
    sector.close()
    failure = branch.failure or ""
    return Judged(case, errors, states, len(branch.points), ring.M.shape[0], frequencies, failure)


def write_page(folder: Path, computed: list[Judged]) -> None:
    """Write the tables of discs_in_full.md."""
    names = {STICK: "stick", SLIP: "slip", OPEN: "open"}

    def rows(cases: list[Case]) -> list[str]:
        of = [each for each in computed if each.case.name in {case.name for case in cases}]
        words = [
            [
                each.case.name,
                f"{each.n_dof:,}",
                ", ".join(names[state] for state in sorted(each.states)),
                str(each.n_points),
                "–" if np.isnan(each.frequencies) else f"{each.frequencies:.0e}",
                *(f"{each.errors[name]:.0e}" for name in BOUNDS),
            ]
            for each in of
        ]
        heads = ["disc", "DOF of the ring", "states seen", "points", "frequencies", *BOUNDS]
        bounds = ["bound", "", "", "", *(f"{bound:.0e}" for bound in (FREQUENCIES, *BOUNDS.values()))]
        return page_table(heads, [bounds, *words], words=3)

    tables = {"comparison": rows(comparison()), "comparison_8": rows(comparison(8)), "extremes": rows(extremes())}
    put(folder / "discs_in_full.md", tables)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", help="folder of the page")
    parser.add_argument("--name", default="", help="only cases whose name holds this text")
    options = parser.parse_args()
    values = []
    for case in [case for case in comparison() + comparison(8) + extremes() if options.name in case.name]:
        with tempfile.TemporaryDirectory() as folder:
            values.append(judged(case, Path(folder)))
        errors = "  ".join(f"{name} {error:.0e}" for name, error in values[-1].errors.items())
        print(
            f"{case.name:45s} {values[-1].n_points:3d} points  {sorted(values[-1].states)}  frequencies "
            f"{values[-1].frequencies:.0e}  {errors}  {values[-1].faults}",
            flush=True,
        )
    if options.docs:
        write_page(Path(options.docs), values)
    sys.exit(any(each.faults for each in values))


if __name__ == "__main__":
    main()
