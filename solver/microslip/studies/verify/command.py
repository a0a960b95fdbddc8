"""The command `verify`: the curve by harmonic balance, and time integration of the same model at some of its points."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...continuation.levels import ResponseProblem, follow_levels
from ...fourier.amplitudes import to_real
from ...fourier.coefficients import amplitude, cycle_work, synthesise
from ...fourier.harmonics import Harmonics
from ...library.build import Structure, build
from ...library.prepare import prepare
from ...library.settings import refuse_statics, units_of
from ...messages.errors import CaseError, ConvergenceError
from ...parallel.agree import on_each, on_root
from ...points.branch import Branch
from ...receptance.motions import modal_motion
from ...receptance.reduced_model import ReducedModel
from ...scene.read import changed
from ...scene.schema import Scene
from ...transient.growth import growth
from ...transient.march import Cycle, March
from ...transient.steady import Start, SteadyState, coefficients, energies, from_harmonics, from_rest, samples, steady_state
from ...transient.transient_model import TransientModel, transient_model
from ..check.report import resolution
from ..log import log_of
from .report import Check, Loop, write_verification

SHARES = (0.85, 0.75)  # fractions of the peak at the verified points on both sides; 0.71 bounds the half-power band
TOLERANCE = 1e-5  # distance from the steady state, relative to the motion
CLOSER = 1e-3  # of the tolerance, where a small disturbance is watched: else the state departs by more than that
ACCEPTED = 1e-3  # the same, above which a point is not compared
MOST_PERIODS, MOST_FROM_REST = 60, 3000
STEPS = 256  # steps per period; half as many first


@dataclass(frozen=True)
class Request:
    """Options of the command line; None or 0: as in the scene."""

    at: tuple[float, ...] = ()  # Hz
    levels: tuple[float, ...] = ()  # N
    harmonics: int | None = None
    samples: int | None = None
    steps: int = STEPS
    from_rest: bool = False
    disturbed: bool = False  # whether each steady state is disturbed, and the disturbance watched


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Integrate the reduced model in time at points of its response curves; print, write and draw the comparison.

    Collective on ``comm``: the curves as in a run; then each rank integrates its part of the points.

    Raises
    ------
    CaseError : options that contradict the scene; on every rank
    ConvergenceError : a curve ended early, or a point reached no steady state, after all files were written; on every rank
    """
    stated, scene = scene, with_requested_range(scene, request)
    settings = f"{scene.solver.method}, {resolution(scene)}"
    facts = {"harmonic balance": settings, "time integration": f"generalised-alpha, {request.steps} steps a period"}
    with log_of(comm, folder / "verify.log", stated, options, **facts) as log:
        structure = build(scene, comm, log)
        with log.stage("reduction"):
            response = ready(structure, request.at)
        with log.stage("curves by harmonic balance"):
            branches = follow_levels(response)
        with log.stage("static columns of every pair"):
            transient = transient_model(response.model, response.law)
        with log.stage("time integration"):
            chosen = on_root(comm, chosen_points, branches, request.at)
            checks = integrate(transient, response.model, chosen, request, comm)
        log.note(on_root(comm, write_verification, checks, branches, scene, str(folder), settings, units_of(scene).outputs[0]))
        log.note(f"results in {folder}")
        structure.close()
    failed = [f"level {branch.why_ended}" for branch in branches if branch.failure]
    failed += [f"{check.where}: {check.failure}" for check in checks if check.failure]
    if failed:
        raise ConvergenceError("\n".join(failed) + f"\nwhat was computed is in {folder}")


def with_requested_range(scene: Scene, request: Request) -> Scene:
    """Return the scene with the requested levels, harmonics, samples and frequencies.  Local.

    Raises
    ------
    CaseError : values that a scene may not have
    """
    if scene.damping is not None and scene.damping.structural:
        raise CaseError(
            f"{scene.path}: [damping] structural: a loss factor is defined for steady vibration alone, and has no equivalent in "
            "time; verify the scene with ratio in its place, of about half the loss factor"
        )
    scene = _as_ring(scene)
    solver = {key: value for key in ("harmonics", "samples") if (value := getattr(request, key)) is not None}
    response = {key: value for key in ("levels", "at") if (value := getattr(request, key))}
    stability = {"stability": True} if request.disturbed else {}
    try:
        scene = changed(scene, {"solver": solver, "response": response | stability})
    except CaseError as problem:
        options = (*solver, *response, *(["disturbed"] if request.disturbed else []))
        raise CaseError(f"{' '.join(f'--{key}' for key in options)}: {problem}") from None
    refuse_statics(scene, "verify")
    return scene


def _as_ring(scene: Scene) -> Scene:
    """Return a disc with the pairs of all sectors, the only form with one real structure in time; other scenes unchanged.

    Local.

    Raises
    ------
    CaseError : keys that a whole disc cannot have
    """
    if scene.cyclic is None or scene.cyclic.whole:
        return scene
    try:
        return changed(scene, {"cyclic": {"whole": True}})
    except CaseError as problem:
        raise CaseError(f"verify integrates all sectors of a disc in time, as with whole = true: {problem}") from None


def ready(structure: Structure, at: tuple[float, ...]) -> ResponseProblem:
    """Return the problem of the curves, with error bars if an accuracy needs them.  Collective.

    Raises
    ------
    CaseError : a frequency of --at outside the range, on every rank
    """
    try:
        return prepare(structure, has_bars=structure.scene.accuracy is not None).response
    except CaseError as problem:
        text = str(problem).replace("[response] at", "--at") if at else str(problem)
        raise CaseError(f"{structure.scene.path}: verify: {text}") from None


@dataclass(frozen=True, eq=False)
class Chosen:
    """A point of a curve to verify: harmonic coefficients of the first output, of du and of p, and the loss of each pair."""

    level: float  # N
    omega: float  # rad/s
    peak: float  # amplitude at the peak of the curve [m]
    is_peak: bool
    has_loop: bool  # the point of its curve whose friction loop is drawn
    response: np.ndarray  # (N_H,) m
    U: np.ndarray  # (n_pairs, 3, N_H) m
    p: np.ndarray  # (n_pairs, 3, N_H) N
    energy: np.ndarray  # (n_pairs,) J
    multiplier: float  # largest modulus; NaN without stability


def chosen_points(branches: list[Branch], at: tuple[float, ...]) -> list[Chosen]:
    """Return the points to verify: at the frequencies ``at``, or by ``around_peak`` at every level.  Local, on rank 0."""
    chosen, most = [], Harmonics.full(max((point.p.shape[-1] for branch in branches for point in branch.points), default=3))
    for branch in branches:
        sizes = np.array([amplitude(point.response[0]) for point in branch.points])
        if len(sizes) == 0:
            continue
        top = int(np.argmax(sizes))
        of_top = np.flatnonzero([point.segment == branch.points[top].segment for point in branch.points])
        indices = (
            [i for i, point in enumerate(branch.points) if point.requested]
            if at
            else [int(of_top[i]) for i in around_peak(sizes[of_top])]
        )
        nearest = min(indices, key=lambda i: abs(i - top), default=top)
        for i in indices:
            point = branch.points[i]
            response, U, p = (
                Harmonics.full(values.shape[-1]).carry(values, most) for values in (point.response[0], point.U, point.p)
            )
            largest = np.nan if point.multipliers is None else float(np.hypot(*point.multipliers.T).max(initial=0.0))
            chosen.append(
                Chosen(
                    branch.level, point.omega, float(sizes[top]), i == top, i == nearest, response, U, p, point.energy, largest
                )
            )
    return chosen


def around_peak(sizes: np.ndarray) -> list[int]:
    """Return the indices of the peak and of the points on its flanks nearest to ``SHARES`` of it, in order.  Local."""
    top = int(np.argmax(sizes))
    indices = {top}
    for step, end in ((-1, -1), (1, len(sizes))):
        flank = np.arange(top + step, end, step)
        falling = flank[: int(np.argmax(sizes[flank] < 0.5 * sizes[top])) or None] if len(flank) else flank
        for share in SHARES:
            others = [i for i in falling if i not in indices]
            if others:
                indices.add(int(min(others, key=lambda i: abs(sizes[i] - share * sizes[top]))))
    return sorted(indices)


def integrate(
    transient: TransientModel, model: ReducedModel, chosen: list[Chosen], request: Request, comm: MPI.Comm
) -> list[Check]:
    """Return the checks of the chosen points, in order, on every rank.  Collective: a rank integrates every size-th point."""
    shares = comm.allgather(on_each(comm, checks_of, transient, model, chosen[comm.rank :: comm.size], request))
    return [shares[i % comm.size][i // comm.size] for i in range(len(chosen))]


def checks_of(transient: TransientModel, model: ReducedModel, chosen: list[Chosen], request: Request) -> list[Check]:
    """Integrate points with half the steps, then from the result with all steps, and compare.  Local."""
    if not chosen:
        return []
    clock = time.perf_counter()
    omega, level = (np.array([getattr(point, name) for point in chosen]) for name in ("omega", "level"))
    start, most = from_rest(transient, len(chosen)), MOST_FROM_REST
    if not request.from_rest:
        start, most = start_of(transient, model, chosen, request.steps), MOST_PERIODS
    tolerance = TOLERANCE * (CLOSER if request.disturbed else 1.0)
    steady: list[SteadyState] = []
    responses: list[np.ndarray] = []
    try:
        for n_steps in (request.steps // 2, request.steps):
            steady.append(steady_state(March(transient, omega, level, n_steps), start, tolerance, most, not request.from_rest))
            start = steady[-1].start
            responses.append(responses_of(transient, model, omega, level, steady[-1].cycle)[:, 0])
        factors = np.full(len(chosen), np.nan)
        if request.disturbed:
            factors = growth(March(transient, omega, level, request.steps // 2), steady[0].start)
    except ConvergenceError as problem:
        if len(chosen) == 1:
            return [failed_check(chosen[0], str(problem))]
        return [check for point in chosen for check in checks_of(transient, model, [point], request)]  # the other points succeed
    seconds = (time.perf_counter() - clock) / len(chosen)
    work, damping, friction = energies(transient, omega, level, steady[-1].cycle)
    closure = (work - damping - friction) / np.where(work != 0.0, work, 1.0)
    du = samples(transient, omega, level, steady[-1].cycle)[0]
    periods = steady[0].periods + steady[1].periods
    return [
        replace(
            compared(point, responses[1][i], responses[0][i]),
            closure=float(closure[i]),
            periods=int(periods[i]),
            change=float(steady[-1].change[i]),
            distance=float(steady[-1].distance[i]),
            seconds=seconds,
            growth=float(factors[i]),
            failure=unsteady(steady[-1].distance[i], int(periods[i])),
            loop=loop_of(transient, point, du[:, i], steady[-1].cycle.p[:, i]) if point.has_loop else None,
        )
        for i, point in enumerate(chosen)
    ]


def responses_of(
    transient: TransientModel, model: ReducedModel, omega: np.ndarray, level: np.ndarray, cycle: Cycle
) -> np.ndarray:
    """Return the coefficients of the outputs of some points, (B, n_outputs, N_H), for all harmonics resolved by the steps."""
    harmonics = Harmonics.up_to((len(cycle.eta) - 1) // 2)
    rows = coefficients(samples(transient, omega, level, cycle)[1], harmonics.highest)
    if model.observed is None:
        return rows
    p, f = coefficients(cycle.p, harmonics.highest), model.harmonics.carry(model.f, harmonics)
    return np.array([model.observed.motion(rows[i], p[i], level[i] * f, harmonics, omega[i]) for i in range(len(level))])


def start_of(transient: TransientModel, model: ReducedModel, chosen: list[Chosen], n_steps: int) -> Start:
    """Return the states of harmonic balance at t = 0, which select one of the steady states with different residual tractions."""
    N_H = chosen[0].p.shape[-1]
    model = model.with_harmonics(Harmonics.full(N_H))
    motions = [modal_motion(model, point.level, point.omega, point.p.reshape(-1, N_H)) for point in chosen]
    eta = [to_real(of_family, N_H) for (of_family,) in motions]
    return from_harmonics(
        transient, np.array([point.omega for point in chosen]), np.array(eta), np.array([point.U for point in chosen]), n_steps
    )


def compared(point: Chosen, fine: np.ndarray, coarse: np.ndarray) -> Check:
    """Return the comparison of harmonic balance with the coefficients (N_H,) for all and for half of the steps.  Local."""
    scale = point.peak or 1.0
    marched, balanced = float(amplitude(fine)), float(amplitude(point.response))
    return Check(
        level=point.level,
        frequency=point.omega / (2.0 * np.pi),
        is_peak=point.is_peak,
        balanced=balanced,
        marched=marched,
        difference=(balanced - marched) / scale,
        with_phase=float(np.hypot(*(point.response[1:3] - fine[1:3]))) / scale,
        integration_error=float(np.hypot(*(fine[1:3] - coarse[1:3]))) / scale,
        higher=float(np.linalg.norm(fine[3:])) / (marched or 1.0),
        closure=np.nan,
        periods=0,
        change=np.nan,
        distance=np.nan,
        seconds=np.nan,
        multiplier=point.multiplier,
    )


def failed_check(point: Chosen, why: str) -> Check:
    """Return the row of a point whose march in time failed, and ``why``.  Local."""
    nothing = np.full(3, np.nan)
    return replace(compared(point, nothing, nothing), failure=why)


def unsteady(distance: float, periods: int) -> str:
    """Return the message for a point without a steady state, or an empty text.  Local."""
    if distance <= ACCEPTED:
        return ""
    return f"no steady state after {periods} periods: {distance:.1e} of the motion away"


def loop_of(transient: TransientModel, point: Chosen, du: np.ndarray, p: np.ndarray) -> Loop | None:
    """Return the loop of the pair with the largest loss, from du and p (n_steps, 3 n_pairs); None without losses.  Local."""
    if not np.any(point.energy > 0.0):
        return None
    pair = int(np.argmax(point.energy))
    direction = int(np.argmax(cycle_work(point.p[pair, :2], point.U[pair, :2])))
    k_t, row = transient.law.stiffness[pair, direction], 3 * pair + direction
    balanced = [synthesise(x[pair, direction], len(du)) for x in (point.U, point.p)]
    return Loop(
        pair,
        "xy"[direction],
        np.array([balanced[0], balanced[1] + k_t * balanced[0]]),
        np.array([du[:, row], p[:, row] + k_t * du[:, row]]),
    )
