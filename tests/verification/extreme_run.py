"""Run one case of the battery of extremes and check the result: every point separately, and the expectation of the case."""

from __future__ import annotations

import re
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import exact, point_check, scenes
from oracles.point_check import BOUNDS
from verification.extreme_cases import Case, onset
from verification.extreme_structures import scaled

from microslip.continuation.point_record import HELD
from microslip.library.build import build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.messages.errors import MicroslipError
from microslip.scene.read import read_scene

HERE = MPI.COMM_SELF
SOLVED, REFUSED, FAILED, WRONG, DEFECT = "solved", "refused", "failed", "wrong", "defect"


@dataclass
class Outcome:
    """The outcome of a case."""

    name: str
    family: str
    status: str = SOLVED
    words: str = ""  # message of the program for a refusal or a failure; otherwise the fault
    expected: bool = False  # True for a refusal that the case expects
    has_answer: bool = True  # of the case
    n_points: int = 0
    states: tuple[int, ...] = ()  # states of pairs at any point
    errors: dict[str, float] = field(default_factory=dict)  # the largest of each kind over the points
    expectation: float = 0.0  # error relative to the expectation of the case
    held: int = 0  # points with the mean slip held
    in_segments: bool = False  # a level was completed by a second or third segment
    seconds: float = 0.0
    cpu: float = 0.0  # processor time [s]


def run_case(case: Case) -> Outcome:
    """Return the outcome of a case; nothing is raised.  Local: the program runs in this process."""
    outcome, start, cpu = Outcome(case.name, case.family, has_answer=case.has_answer), time.perf_counter(), time.process_time()
    try:
        with tempfile.TemporaryDirectory() as folder:
            _solve_and_judge(case, outcome, Path(folder))
    except MicroslipError as refusal:
        outcome.words = re.sub(r"\S*/(?=\w+\.mtx)", "", str(refusal))  # without the temporary folder
        outcome.expected = case.expect == "refused" and case.reason in outcome.words
        outcome.status = REFUSED if outcome.words else DEFECT
    except Exception as defect:  # a traceback of the program, which the battery searches for
        outcome.status, outcome.words = DEFECT, f"{type(defect).__name__}: {defect}"
    outcome.seconds, outcome.cpu = time.perf_counter() - start, time.process_time() - cpu
    return outcome


def _solve_and_judge(case: Case, outcome: Outcome, folder: Path) -> None:
    system = case.build()
    H, samples = case.solver.get("harmonics", 3), case.solver.get("samples", 128)
    if H == 0:
        H, samples = 1, 3  # statics are recorded with a harmonic 1, which is zero
    levels, band, at = requested_of(case, system)
    branches = solved(folder, system, levels, band, at, case)
    outputs = _outputs(system)
    if case.expect == "refused":
        outcome.status, outcome.words = WRONG, "expected a refusal"
    sparse = sp.issparse(system["K"])
    judge = None if sparse else point_check.Judge(system, H, samples)
    for branch in branches:
        outcome.in_segments |= branch.broken is not None
        if branch.failure:
            outcome.status, outcome.words = FAILED, branch.failure
    points = [point for branch in branches for point in branch.points]
    at_levels = [branch.level for branch in branches for _ in branch.points]
    verdicts = (
        [_sparse_verdict(system, point, level, H, samples) for point, level in zip(points, at_levels)]
        if judge is None
        else judge.verdicts(points, at_levels, outputs)
    )
    faults = []
    for point, level, verdict in zip(points, at_levels, verdicts):
        _count(outcome, point, verdict)
        faults += [f"{level:.3g} N, {point.omega:.6g} rad/s: {fault}" for fault in verdict.faults()]
    if not faults and outcome.status == SOLVED:
        faults = _against_expectation(case, system, branches, H, outcome, (levels, band, at), folder)
    if faults:
        outcome.status, outcome.words = WRONG, f"{len(faults)} faults; {faults[0]}"


def requested_of(case: Case, system: dict) -> tuple[list[float], tuple[float, float], list[float]]:
    """Return levels [N], band and further frequencies [rad/s] of a case."""
    unit = 2.0 * np.pi if case.hertz else stuck_frequencies(system)[0]
    low, high = case.band[0] * unit, case.band[1] * unit
    if case.wide:  # from below the resonance of the open structure, for any shift by the joint
        open_ = np.sqrt(max(scipy.linalg.eigh(system["K"], system["M"], eigvals_only=True)[0], 0.0))
        low = min(low, case.band[0] * open_) if open_ > 1e-3 * unit else low
        high = min(high, max(3.0 * open_, 1.5 * low))
    lightly = system.get("zeta", 1.0) < 1e-3 or ("C" in system and not np.any(system["C"]))
    newton = 1.0 if case.newtons else onset(system, 0.98 * unit if lightly else unit)
    return [level * newton for level in case.levels], (low, high), [share * unit for share in case.at]


def stuck_frequencies(system: dict) -> np.ndarray:
    """Return the natural frequencies of the stuck structure [rad/s], ascending, without motions without mass."""
    theta = scipy.linalg.eigh(system["M"], scenes.stuck_stiffness(system), eigvals_only=True)[::-1]
    return 1.0 / np.sqrt(theta[theta > 1e-15 * theta[0]])


def solved(folder: Path, system: dict, levels, band, at, case: Case) -> list:
    """Return the branches of a case by the stages of ``microslip run``, without result files."""
    n_dof = system["K"].shape[0]
    solver = dict(case.solver)
    if 20 < n_dof <= 400 and "modes" not in solver and not (np.diag(system["M"]) == 0.0).any():
        solver["modes"] = n_dof
    path = write_matrix_scene(folder, system, levels, band, at=at, points=case.points, outputs=_outputs(system), **solver)
    scene = read_scene(path)
    with build(scene, HERE) as structure:
        response = prepare(structure, has_bars=False).response
        solved_for = replace(response.curve, sticks_up_to=np.zeros(len(response.curve.omega)))  # linear levels are solved as well
        return follow(replace(response, curve=solved_for))


def _outputs(system: dict) -> list[int]:
    n_dof = system["K"].shape[0]
    return list(range(n_dof)) if n_dof <= 400 else [0, n_dof // 2]


def _count(outcome: Outcome, point, verdict) -> None:
    outcome.n_points += 1
    outcome.held += HELD in point.notes
    outcome.states = tuple(sorted({*outcome.states, *map(int, np.unique(point.state))}))
    for name in BOUNDS:
        outcome.errors[name] = float(np.fmax(outcome.errors.get(name, 0.0), getattr(verdict, name)))


# -- the expectation of a case -------------------------------------------------------------------------------------


def _against_expectation(case: Case, system: dict, branches, H: int, outcome: Outcome, what, folder: Path) -> list[str]:
    """Return the differences from the exact, limiting or scaled solution; stores the largest error."""
    if case.expect in ("stuck", "frictionless", "open"):
        worst = max(
            (_linear_error(case.expect, system, point, branch.level, H) for branch in branches for point in branch.points),
            default=0.0,
        )
    elif case.expect == "jenkins":
        worst = max(_jenkins_error(point, branch.level, H) for branch in branches for point in branch.points if point.requested)
    elif case.expect == "twin":
        worst = _twin_error(case, system, branches, what, folder)
    else:
        return []
    outcome.expectation = worst
    bound = {"twin": 1e-9}.get(case.expect, case.tolerance)
    return [] if worst <= bound else [f"differs from {case.expect} by {worst:.1e} (bound {bound:.0e})"]


def _linear_error(expect: str, system: dict, point, level: float, H: int) -> float:
    """Return the relative error of the response compared with a linear structure; infinity where a pair is in another state."""
    wanted = {
        "stuck": lambda: system,
        "frictionless": lambda: {**system, "k_t": 0.0 * system["k_t"]},
        "open": lambda: {**system, "k_t": 0.0 * system["k_t"], "k_n": 0.0 * system["k_n"]},
    }[expect]()
    if expect == "stuck" and (point.state != 0).any():
        return np.inf
    C = point_check.damping(system, scenes.stuck_stiffness(system))
    judge = point_check.Judge({**wanted, "C": C}, H, 2 * H + 1)
    u, _ = judge.motion(point.omega, point_check.loads(system, level, H))
    return point_check.relative(point.response - u, u)


def _jenkins_error(point, level: float, H: int) -> float:
    C = point_check.damping(_oscillator(), scenes.stuck_stiffness(_oscillator()))[0, 0]
    known = exact.jenkins_steady_state(point.omega, level, m=1.0, c=C, k=1.0, k_t=1.0, muN=1.0)
    return point_check.relative(point.response[0] - known.harmonics(H), known.harmonics(H))


def _oscillator() -> dict:
    from verification.extreme_structures import oscillator

    return oscillator()


def _twin_error(case: Case, system: dict, branches, what, folder: Path) -> float:
    """Return the largest relative difference of the requested points from those of the same structure in other units."""
    levels, band, at = what
    unit = {"length": 1.0, "mass": 1.0, "time": 1.0, **case.twin}
    length, time_ = unit["length"], unit["time"]
    force = unit["mass"] * length / time_**2
    (folder / "twin").mkdir()
    others = solved(
        folder / "twin",
        scaled(system, **case.twin),
        [level * force for level in levels],
        [w / time_ for w in band],
        [w / time_ for w in at],
        case,
    )
    worst = 0.0
    for branch, other in zip(branches, others):
        if other.failure:
            raise chain_failure(other.failure)
        mine, its = ([point for point in each.points if point.requested] for each in (branch, other))
        if len(mine) != len(its):
            return np.inf
        for a, b in zip(mine, its):
            worst = max(
                worst,
                point_check.relative(b.response / length - a.response, a.response),
                float(np.abs(b.energy / (force * length) - a.energy).max() / max(abs(a.input), 1e-300)),
            )
    return worst


def chain_failure(words: str) -> Exception:
    from microslip.messages.errors import ConvergenceError

    return ConvergenceError(f"the twin: {words}")


# -- thousands of pairs ---------------------------------------------------------------------------------------------


def _sparse_verdict(system: dict, point, level: float, H: int, samples: int):
    """Return the verdict on a large structure: sparse factors in double precision, Rayleigh damping alpha M."""
    R, k = system["R"], np.stack([system["k_t"], system["k_t"], system["k_n"]], axis=1)
    small = point_check.Judge.__new__(point_check.Judge)
    small.system, small.H, small.n_samples, small.k = system, H, samples, k
    K_L = (system["K"] + R.T @ sp.diags(k.ravel()) @ R).tocsc()
    f = np.zeros((system["K"].shape[0], 2 * H + 1))
    f[:, 1] = level * system["loads"][0]["vector"]
    N_H = 2 * H + 1
    small.R = R
    small.M, small.K_L, small.C = system["M"], K_L, system["rayleigh"][0] * system["M"]

    def motion(omega, forces):
        u = np.empty_like(forces)
        u[:, 0] = scipy.sparse.linalg.spsolve(K_L, forces[:, 0])
        for n in range(1, H + 1):
            Z = (K_L - (n * omega) ** 2 * small.M + 1j * n * omega * small.C).tocsc()
            x = scipy.sparse.linalg.spsolve(Z, forces[:, 2 * n - 1] - 1j * forces[:, 2 * n])
            u[:, 2 * n - 1], u[:, 2 * n] = x.real, -x.imag
        return u.reshape(-1, N_H), 0.0

    small.motion = motion
    return small.verdict(point, level, _outputs(system), forces=f)
