"""Nonlinear modes of a structure built once: frequency, damping and shape against amplitude (docs/theory.md, section 15)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..contact.law import OPEN, STICK
from ..continuation.checkpointer import NO_CHECKPOINTS, Checkpointer
from ..continuation.nonlinear_mode import NonlinearMode, QuasiStaticMode, follow_mode, follow_pushes, resolved_again
from ..fourier.amplitudes import to_complex
from ..fourier.harmonics import Harmonics
from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import OperatingPoint
from ..messages.errors import CaseError
from ..messages.words import counted
from ..parallel.agree import on_root
from ..points.branch import Branch, Point
from ..points.sweep import Sweep
from ..receptance.motions import modal_motion
from ..receptance.reduced_model import ReducedModel
from .arguments import number_above, refuse_no_structure, whole_number
from .build import Structure, WholeStructure
from .mode_at_rest import FARTHEST, Begin, first_slip, moved_by, pairs_without_springs
from .prepare import Prepared
from .respond import prepared_with
from .settings import output_names, refuse_statics, units_of

if TYPE_CHECKING:
    from .respond import OfJoints

NONE = 1e-12  # damping ratio by friction below which nothing slips: rounding, of either sign
NO_FORCE = 1e-8  # modal force of loads over that of the mode that they excite most, below which they do not act: rounding
EQUAL = 1e-6  # relative difference of frequencies up to which modes are multiple
PAST = 0.5  # of the largest damping ratio by friction, to which it has fallen where a mode is followed no further
AT_BEGIN = 1e-3  # of the static load of the first point: largest share of the pairs where a mode begins
CHECKED = 6  # points that are solved again for their error
BETWEEN, LOWEST = 20, 1e-3  # of synthesised responses: amplitudes from point to point, and the lowest over that of first slip
BEYOND = 10.0  # times the amplitude at which the last pair left sticking, the same


@dataclass(frozen=True, eq=False)
class ModePoint:
    """A point of a nonlinear mode; the same on every rank."""

    amplitude: float  # kg^1/2 m, q
    omega: float  # rad/s
    sigma: float  # 1/s
    response: np.ndarray  # (n_outputs, N_H)
    energy: np.ndarray  # (n_pairs,) J
    state: np.ndarray  # (n_pairs,)
    friction: float  # J a cycle
    supplied: float  # J a cycle, by the self-excitation
    per_level: complex  # modal force of the loads at unit level in the shape of the mode, phi^H f / q [N per kg^1/2 m]

    @property
    def damping_by_friction(self) -> float:
        """The part of the damping ratio due to friction [-]."""
        ratio = self.friction / self.supplied * -self.sigma / (2.0 * self.omega) if self.supplied > 0.0 else 0.0
        return ratio if ratio > NONE else 0.0


@dataclass(frozen=True, eq=False)
class QuasiStatic:
    """The same mode by statics and Masing's rules, eq. (15.5)."""

    amplitude: np.ndarray  # (n,) kg^1/2 m
    frequency: np.ndarray  # (n,) Hz
    damping: np.ndarray  # (n,) -
    seconds: float
    opens: float  # kg^1/2 m, amplitude of the first point at which a pair opens or touches, unknown to the rules; inf: none
    failure: str | None  # why it ends below the largest amplitude of the mode

    def at(self, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return frequency [Hz] and damping ratio at amplitudes; NaN outside.  Local."""
        x = np.log(self.amplitude)
        frequency, damping = (np.interp(np.log(amplitude), x, y, np.nan, np.nan) for y in (self.frequency, self.damping))
        return frequency, damping


@dataclass(frozen=True, eq=False)
class Synthesis:
    """The forced response to the loads at a level, by the nonlinear mode alone, eq. (15.6)."""

    level: float  # N
    frequency: np.ndarray  # (n,) Hz, up one side of the peak and down the other
    coefficients: np.ndarray  # (n, n_outputs) complex amplitude of harmonic 1
    peak: np.ndarray  # (n_outputs,) amplitude at phase resonance; NaN beyond the amplitudes of the mode
    resonance: float  # Hz


@dataclass(frozen=True, eq=False)
class Backbone:
    """A nonlinear mode, point by point of rising arc; the same on every rank."""

    mode: int  # from 1
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    level_unit: str
    linear_frequency: float  # Hz, all pairs stuck
    linear_damping: float  # -
    first_slip: float  # kg^1/2 m, q at which the first pair slips, opens or touches; infinite if the mode moves no pair
    points: tuple[ModePoint, ...] = ()
    quasi_static: QuasiStatic | None = None
    meetings: tuple[Meeting, ...] = ()
    checks: tuple[Check, ...] = ()
    seconds: float = 0.0
    failure: str | None = None
    notes: tuple[str, ...] = ()
    joints: tuple[str, ...] = field(default=(), repr=False)  # of each pair
    slips_at_rest: bool = False  # whether some pairs slip from the first motion on; the mode then begins at a small amplitude
    open_at_rest: int = 0  # number of pairs
    counts_open: bool = False  # whether modes are counted with pairs open that [response] mode counts as closed

    def _of(self, name: str) -> np.ndarray:
        return np.array([getattr(point, name) for point in self.points])

    @property
    def amplitude(self) -> np.ndarray:
        """Modal amplitude q, (n,) [kg^1/2 m]."""
        return self._of("amplitude")

    @property
    def frequency(self) -> np.ndarray:
        """(n,) [Hz]."""
        return self._of("omega") / (2.0 * np.pi)

    @property
    def damping(self) -> np.ndarray:
        """Damping ratio of all damping, (n,) [-]."""
        return -self._of("sigma") / (2.0 * self._of("omega"))

    @property
    def damping_by_friction(self) -> np.ndarray:
        """The part of it due to friction, (n,) [-]."""
        return self._of("damping_by_friction")

    @property
    def response(self) -> np.ndarray:
        """Motion of the outputs, (n, n_outputs, N_H) in their units."""
        return self._of("response")

    @property
    def shape(self) -> np.ndarray:
        """Complex amplitudes of harmonic 1 of the outputs per modal amplitude, (n, n_outputs)."""
        response = self.response
        return (response[..., 1] - 1j * response[..., 2]) / self.amplitude[:, None]

    @property
    def energy(self) -> np.ndarray:
        """Friction loss of each pair, (n, n_pairs) [J per cycle]."""
        return self._of("energy")

    @property
    def state(self) -> np.ndarray:
        """State of each pair, 0 sticks, 1 slips, 2 opens, (n, n_pairs)."""
        return self._of("state")

    @property
    def slipping(self) -> np.ndarray:
        """Number of pairs that slip or open, (n,)."""
        return np.count_nonzero(self.state != STICK, axis=1)

    @property
    def level(self) -> np.ndarray:
        """Level of the scene's loads whose phase resonance has this amplitude, (n,); infinite if they do not act on the mode."""
        with np.errstate(divide="ignore"):
            return -self._of("sigma") * self._of("omega") * self.amplitude / np.abs(self._of("per_level"))

    def forced(self, level: float) -> Synthesis:
        """Return the forced response at a level, synthesised from the mode.  Local.

        Each amplitude is met at two frequencies, on both sides of the phase resonance, at which the amplitude is largest.

        Raises
        ------
        CaseError : the level is not a number above 0
        """
        level = number_above(level, 0.0, "forced: level")
        q, omega, sigma, per_level, shape = self._dense()
        zeta, force = -sigma / (2.0 * omega), level * per_level
        with np.errstate(invalid="ignore"):
            half = np.sqrt((np.abs(force) / q) ** 2 - (sigma * omega) ** 2 * (1.0 - zeta**2))
        sides = []
        for way in (-1.0, 1.0):
            with np.errstate(invalid="ignore"):
                at = np.sqrt(omega**2 * (1.0 - 2.0 * zeta**2) + way * half)
                eta = force / (omega**2 - at**2 - 1j * sigma * at)
            sides.append((at[np.isfinite(at)] / (2.0 * np.pi), (eta[:, None] * shape)[np.isfinite(at)]))
        (low, a_low), (high, a_high) = sides
        peak, resonance = self._resonance(level)
        amplitudes = np.concatenate([a_low, a_high[::-1]])
        return Synthesis(level, np.concatenate([low, high[::-1]]), amplitudes, peak, resonance)

    def _dense(self) -> list[np.ndarray]:
        """Return q, omega, sigma, the force per level and the shape, close together along the branch and below first slip."""
        n = len(self.points)
        of_points = np.log(self.amplitude), self._of("omega"), self._of("sigma"), self._of("per_level"), self.shape
        along = np.linspace(0.0, n - 1.0, BETWEEN * (n - 1) + 1)
        log_q, *others = (_between(y, along) if n > 1 else y for y in of_points)
        below = log_q[0] + np.linspace(np.log(LOWEST), 0.0, 10 * BETWEEN, endpoint=False)
        stuck = (np.repeat(y[:1], len(below), axis=0) for y in others)
        return [np.exp(np.concatenate([below, log_q])), *(np.concatenate(each) for each in zip(stuck, others))]

    def _resonance(self, level: float) -> tuple[np.ndarray, float]:
        """Return the amplitudes of the outputs and the frequency [Hz] at phase resonance; NaN where no point brackets it."""
        levels, sizes = self.level, np.abs(self.shape) * self.amplitude[:, None]
        ahead = np.flatnonzero((levels[:-1] <= level) & (level < levels[1:]))
        if level < levels[0]:
            return sizes[0] * level / levels[0], float(self.frequency[0])
        if len(ahead) == 0:
            return np.full(sizes.shape[1], np.nan), float("nan")
        i = int(ahead[0])
        share = np.log(level / levels[i]) / np.log(levels[i + 1] / levels[i])
        peak = sizes[i] * (sizes[i + 1] / sizes[i]) ** share
        return peak, float(self.frequency[i] + share * (self.frequency[i + 1] - self.frequency[i]))


@dataclass(frozen=True)
class Check:
    """A point solved again with twice the harmonics and samples; its changes estimate their error, NaN without a solution."""

    point: int  # number of it, from 0
    frequency: float  # Hz, change
    damping: float  # -, change of the damping ratio

    @property
    def is_solved(self) -> bool:
        """Whether Newton's method converged with twice the harmonics and samples."""
        return bool(np.isfinite(self.frequency))


@dataclass(frozen=True)
class Meeting:
    """A superharmonic resonance: harmonic n of the mode meets another mode of the stuck structure."""

    harmonic: int
    mode: int  # from 1, of the modes of that harmonic
    amplitude: float  # kg^1/2 m, q
    frequency: float  # Hz, of the nonlinear mode
    place: float  # among the points: 2.5 is midway between points 2 and 3, from 0


def backbone(
    structure: Structure,
    mode: int = 1,
    *,
    farthest: float | None = None,
    quasi_static: bool = True,
    error_bars: bool = True,
    friction: OfJoints | None = None,
    preload: OfJoints | None = None,
    on_point: Callable[[Point], None] = lambda point: None,
    checkpointer: Checkpointer = NO_CHECKPOINTS,
    **keys: Any,
) -> Backbone:
    """Return a nonlinear mode of a structure, from the amplitude of first slip to gross slip.

    Collective on ``structure.comm``; the same on every rank.

    The loads of the scene do not act; they determine the level at which a forced response has its phase resonance there.

    Parameters
    ----------
    mode : its number from 1, of the modes with all pairs stuck; of a disc those of the nodal diameter of harmonic 1
    farthest : the last amplitude over that of first slip; None: gross slip, where the damping by friction has passed its largest
        value and fallen to half of it, or ten times the amplitude at which the last pair leaves sticking; at most 1e4
    quasi_static : whether the mode is computed by statics, too; not of a disc
    error_bars : whether some points are solved again with twice the harmonics and samples
    friction, preload, keys : as for :func:`respond`
    on_point : is called with each point, on every rank
    checkpointer : of the branch

    Raises
    ------
    CaseError : no such mode, nothing that vibrates, no joint or no friction, a constant load; on every rank
    ConvergenceError, ResourceError : on every rank; ``failure`` has the reason of a branch that ends early
    """
    refuse_no_structure(structure, "backbone")
    mode = whole_number(mode, 1, "backbone: mode")
    farthest = None if farthest is None else number_above(farthest, 1.0, "backbone: farthest")
    prepared, notes = prepared_with(structure, {"friction": friction, "preload": preload}, keys, has_bars=False, has_curve=False)
    refuse_what_has_none(prepared, mode)
    prepared, n_released = pairs_without_springs(prepared)
    refuse_multiple(prepared, mode, has_gaps=n_released > 0)
    start = time.perf_counter()
    equation = HarmonicBalance.of_all(prepared.model, prepared.response.law, prepared.response.settings.samples)
    problem = NonlinearMode.of(equation, mode - 1)
    order = np.argsort(-prepared.response.law.utilisation(moved_by(prepared, mode - 1)), kind="stable")
    prepared.model.expect_to_slip(equation.comm.bcast(order))  # the same columns on all ranks, also where a tie falls otherwise
    begin = first_slip(prepared, problem)
    if not np.isfinite(begin.amplitude):
        if moved_by(prepared, mode - 1).any():
            raise CaseError(
                f"{structure.scene.path}: backbone: all pairs that mode {mode} moves are closed without a preload: nothing "
                "sticks at small amplitudes, so that there is no mode to begin from; state a preload or a gap"
            )
        why = f"mode {mode} moves no pair of a joint: its frequency and damping are the same at any amplitude"
        return replace(_linear(prepared, problem, mode, Begin(np.inf)), notes=(*notes, why))
    points = list[ModePoint]()

    def at(point: Point) -> ModePoint:  # the motion of points from checkpoints is on rank 0
        return on_root(prepared.model.comm, mode_point, problem, prepared.model, point)

    def record(point: Point) -> None:
        points.append(at(point))
        on_point(point)

    def is_gross(point: Point) -> bool:
        return farthest is None and comes_to_gross_slip([*points, at(point)])

    low = float(np.log(begin.amplitude))
    sweep, tolerance = Sweep(low, low + float(np.log(farthest or FARTHEST))), prepared.response.settings.tolerance
    branch = follow_mode(problem, sweep, tolerance, record, is_gross, checkpointer=checkpointer)
    seconds = time.perf_counter() - start
    checks = checked(problem, branch, points, tolerance) if error_bars else ()
    quasi, left_out = _by_statics(prepared, equation, problem, branch, points) if quasi_static else (None, ())
    return replace(
        _linear(prepared, problem, mode, begin),
        points=tuple(points),
        quasi_static=quasi,
        meetings=meetings_of(prepared.model, problem.j, tuple(points)),
        checks=checks,
        seconds=seconds,
        failure=branch.failure,
        notes=(*notes, *left_out, *_note_on_gaps(n_released)),
        counts_open=n_released > 0,
    )


def _by_statics(
    prepared: Prepared, equation: HarmonicBalance, problem: NonlinearMode, branch: Branch, points: list[ModePoint]
) -> tuple[QuasiStatic | None, tuple[str, ...]]:
    """Return the mode by statics, None for a disc or a single point, and a note where it is left out.  Collective."""
    if prepared.scene.cyclic is not None or len(points) < 2:
        return None, ()
    opens = on_root(equation.comm, opens_from, branch, prepared.pairs.open_at_rest)
    quasi = by_statics(equation, problem, points, opens)
    return (
        (None, (f"mode {problem.j + 1} by statics and Masing's rules: left out, {quasi}",))
        if isinstance(quasi, str)
        else (quasi, ())
    )


def _note_on_gaps(n: int) -> list[str]:
    """Return the note on n pairs with a gap, whose springs are left out.  Local."""
    which = f"{counted(n, 'pair')} have a gap and are" if n > 1 else "1 pair has a gap and is"
    return [f"{which} open at rest: modes are counted without springs there"] * (n > 0)


def comes_to_gross_slip(points: list[ModePoint]) -> bool:
    """Return whether damping by friction is past its maximum, or all pairs have slipped for long, at the last point.  Local."""
    by_friction = [point.damping_by_friction for point in points]
    sticking = [point.amplitude for point in points if (point.state == STICK).any()]
    return by_friction[-1] < PAST * max(by_friction) or points[-1].amplitude > BEYOND * max(sticking, default=np.inf)


def refuse_multiple(prepared: Prepared, mode: int, has_gaps: bool) -> None:
    """Raise CaseError where another mode at rest has the frequency of this one.  Collective; the same on every rank.

    The mode after the last one in use is computed for it, unless pairs that have gaps lost their springs.
    """
    scene, structure, (k, _) = prepared.scene, prepared.structure, prepared.model.index_of(1)
    omega_n = prepared.model.groups[k].receptance.modes.omega_n
    if mode == len(omega_n) < structure.n_elastic and not has_gaps and not isinstance(structure, WholeStructure):
        is_known = structure.n_computed > mode
        next_ones = structure.projected if is_known else structure.lowest_modes(mode + 1, verify=False, allows_fewer=True)
        omega_n = np.append(omega_n, next_ones.omega_n[mode : mode + 1])
    others = np.flatnonzero(np.abs(omega_n - omega_n[mode - 1]) <= EQUAL * omega_n[mode - 1]) + 1
    if len(others) > 1:
        cure = (
            "leave [cyclic] whole out, for the wave of a nodal diameter"
            if isinstance(structure, WholeStructure)
            else "let a mass or a stiffness make them differ"
        )
        raise CaseError(
            f"{scene.path}: backbone: modes {', '.join(map(str, others))} have the same frequency, "
            f"{omega_n[mode - 1] / (2.0 * np.pi):.6g} Hz: any combination of them is a mode, and none of these begins a single "
            f"nonlinear one; {cure}, or state another --mode"
        )


def refuse_what_has_none(prepared: Prepared, mode: int) -> None:
    """Raise CaseError where a scene has no nonlinear mode of this number.  Local; the same on every rank."""
    scene, model, pairs = prepared.scene, prepared.model, prepared.pairs
    where = f"{scene.path}: backbone"
    refuse_statics(scene, "backbone")
    k, _ = model.index_of(1)
    n = len(model.groups[k].receptance.modes.omega_n)
    if not 1 <= mode <= n:
        all_modes = prepared.structure.n_elastic
        has, choice = f"{n} mode{'s' * (n > 1)}", "only --mode 1" if n == 1 else f"--mode 1 to {n}"
        if n >= all_modes:
            raise CaseError(f"{where}: there is no mode {mode}: the structure has {has}, and {choice} can be followed")
        raise CaseError(
            f"{where}: there is no mode {mode}: {has} {'were' if n > 1 else 'was'} computed; state {choice}, or raise "
            "[solver] modes"
        )
    if pairs.n_pairs == 0:
        raise CaseError(f"{where}: the scene has no [[joints]]: frequency and damping do not depend on the amplitude")
    if any(load.harmonic == 0 for load in scene.loads):
        raise CaseError(
            f"{where}: [[loads]] with harmonic = 0 changes the rest about which a mode vibrates; state it in [statics], or leave "
            "it out (loads that vibrate do no harm: they do not act)"
        )
    if not (np.isfinite(prepared.response.law.utilisation(np.ones((pairs.n_pairs, 3)))) | (pairs.N0 < 0.0)).any():
        raise CaseError(f"{where}: no pair has friction and a preload, and none a gap: no amplitude is the first to slip")


def supply(problem: NonlinearMode, point: Point) -> float:
    """Return the work of the self-excitation on the modes, pi omega (-sigma) sum n^2 |eta_n|^2 [J per cycle].  Local."""
    at = problem.at(point.parameters)
    model = problem.equation.model_at(at)
    p = _forces(model, point)
    squares = [
        np.sum(group.harmonics.numbers**2 * np.abs(eta) ** 2)
        for group, eta in zip(model.groups, modal_motion(model, at.level, at.omega, p))
    ]
    return -np.pi * at.omega * at.sigma * float(sum(squares))


def _forces(model: ReducedModel, point: Point) -> np.ndarray:
    """Return the forces of all pairs at a point in the harmonics of a model, (3 n_pairs, N_H) [N]."""
    return Harmonics.full(point.p.shape[-1]).carry(point.p, model.harmonics).reshape(-1, model.N_H)


def mode_point(problem: NonlinearMode, loaded: ReducedModel, point: Point) -> ModePoint:
    """Return the record of a point; ``loaded`` is the model with the loads of the scene.  Local."""
    at = problem.at(point.parameters)
    return ModePoint(
        at.level,
        at.omega,
        at.sigma,
        point.response,
        point.energy,
        point.state,
        point.friction,
        supply(problem, point),
        modal_force(problem, at, loaded, point),
    )


def modal_force(problem: NonlinearMode, at: OperatingPoint, loaded: ReducedModel, point: Point) -> complex:
    """Return phi^H f of the loads of harmonic 1 at unit level in the shape of the mode at a point [N per kg^1/2 m].  Local."""
    model = problem.equation.model_at(at)
    p, (k, i) = _forces(model, point), model.index_of(1)
    receptance, group = loaded.groups[k].receptance, model.groups[k]
    eta = modal_motion(model, at.level, at.omega, p)[k][:, i]
    p_1, f_1 = (to_complex(each[:, group.columns])[:, i] for each in (p, loaded.f))
    modes, static = receptance.modes, receptance.static
    flexible = eta + (modes.R_phi.conj().T @ p_1) / modes.omega_n**2
    y = modes.b.conj().T @ flexible - static.du_static.conj().T @ p_1
    force, most = complex(np.vdot(y, f_1)), np.linalg.norm(flexible) * float(np.abs(modes.b).max(axis=0) @ np.abs(f_1))
    return force / at.level if abs(force) > NO_FORCE * most else 0.0


def checked(problem: NonlinearMode, branch: Branch, points: list[ModePoint], tolerance: float) -> tuple[Check, ...]:
    """Return some points with slip, solved again with twice the harmonics and samples.  Collective."""
    slipping = [i for i, point in enumerate(points) if point.damping_by_friction > 0.0]
    chosen = [slipping[k] for k in np.unique(np.linspace(0, len(slipping) - 1, CHECKED).round().astype(int))] if slipping else []
    equation = problem.equation
    finer = Harmonics.up_to(2 * equation.harmonics.highest)
    values = resolved_again(problem, [branch.points[i] for i in chosen], finer, 2 * equation.n_samples, tolerance)
    return tuple(
        Check(
            i,
            (float(omega) - points[i].omega) / (2.0 * np.pi),
            float(-sigma / (2.0 * omega) + points[i].sigma / (2.0 * points[i].omega)),
        )
        for i, (omega, sigma) in zip(chosen, values)
    )


def by_statics(equation: HarmonicBalance, problem: NonlinearMode, points: list[ModePoint], opens: float) -> QuasiStatic | str:
    """Return the mode by statics and Masing's rules, eq. (15.5), over the amplitudes of the points, or why there is none.

    Collective.
    """
    start, j = time.perf_counter(), problem.j
    modes = equation.model.groups[equation.model.index_of(1)[0]].receptance.modes
    R_j, omega_j = modes.R_phi[:, j], float(modes.omega_n[j])
    stop = max(point.amplitude * (point.omega / omega_j) ** 2 for point in points)
    sweep = Sweep(float(np.log(points[0].amplitude)), float(np.log(max(stop, 1.01 * points[0].amplitude))))
    statics = QuasiStaticMode.of(equation, j)
    branch = follow_pushes(statics, sweep, 1e-8)
    pushed = (
        [(np.exp(point.parameters[0]), R_j @ point.p[:, :, 0].ravel(), (point.state == STICK).any()) for point in branch.points]
        if equation.comm.rank == 0
        else []
    )
    load, lost, sticks = np.array(equation.comm.bcast(pushed)).reshape(-1, 3).T  # q', minus the force that slip takes away
    q = load - lost / omega_j**2
    n = 1 + int(np.argmin(np.diff(q, append=-np.inf) > 0.0))  # up to the largest amplitude
    failure = None
    if n < len(q):
        failure = "beyond, the amplitude falls while the static load grows"
    elif branch.failure is not None:
        why = branch.failure.split("; the step was", 1)[0]
        failure = f"no static equilibrium was found beyond ({'no pair sticks any more' if not sticks[-1] else why})"
    elif q[-1] < 0.99 * max(point.amplitude for point in points):
        failure = "the mode has its larger amplitudes at smaller static loads"
    if len(q) < 2 or n < 2:
        return f"under the first static loads {failure}"
    load, lost, q = load[:n], lost[:n], q[:n]
    if abs(lost[0]) > AT_BEGIN * omega_j**2 * load[0]:
        return (
            "the smallest static load already moves pairs that are at their friction limit, or closed without a preload, at rest"
        )
    less = -lost  # omega_j^2 q - alpha
    omega = np.sqrt(omega_j**2 * load / q)
    loss = 8.0 * (0.5 * less * q - np.concatenate([[0.0], np.cumsum(_areas(q, less))]))
    loss[loss < 0.0] = np.nan  # no loop that Masing's rules know: the normal forces vary too much
    damping = loss / (2.0 * np.pi * (omega * q) ** 2) - problem.sigma / (2.0 * omega)
    return QuasiStatic(q, omega / (2.0 * np.pi), damping, time.perf_counter() - start, opens, failure)


def opens_from(branch: Branch, open_at_rest: np.ndarray) -> float:
    """Return the amplitude of the first point at which a closed pair opens or an open one touches; infinite if none does.

    Local, on rank 0.
    """
    for point in branch.points:
        touches = point.p.reshape(len(open_at_rest), -1).any(axis=1)
        if np.where(open_at_rest, touches, point.state == OPEN).any():
            return float(np.exp(point.parameters[0]))
    return float("inf")


def _between(y: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return values y (n, ...) between their places 0 to n - 1, by monotone cubics."""
    from scipy.interpolate import PchipInterpolator  # slow import, seldom needed

    parts = [PchipInterpolator(np.arange(len(y)), part)(along) for part in (y.real, y.imag)]
    return parts[0] + 1j * parts[1] if np.iscomplexobj(y) else parts[0]


def _areas(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the integrals of y between neighbouring x, by a monotone cubic."""
    from scipy.interpolate import PchipInterpolator  # slow import, seldom needed

    total = PchipInterpolator(x, y).antiderivative()
    return np.diff(total(x))


def meetings_of(model: ReducedModel, j: int, points: tuple[ModePoint, ...]) -> tuple[Meeting, ...]:
    """Return where a harmonic of mode j (from 0) meets another mode of the stuck structure, by rising amplitude.  Local."""
    meetings, first = [], model.index_of(1)[0]
    for n in (int(n) for n in model.harmonics.above_mean if n > 1):
        k, _ = model.index_of(n)
        for number, omega_k in enumerate(model.groups[k].receptance.modes.omega_n, 1):
            if k == first and number == j + 1:
                continue
            for i, (a, b) in enumerate(zip(points, points[1:])):
                before, after = n * a.omega - omega_k, n * b.omega - omega_k
                if before * after < 0.0 or (after == 0.0 and before != 0.0):
                    share = before / (before - after)
                    q = a.amplitude * (b.amplitude / a.amplitude) ** share
                    meetings.append(Meeting(n, number, float(q), float(omega_k / n / (2.0 * np.pi)), i + float(share)))
    return tuple(sorted(meetings, key=lambda meeting: meeting.amplitude))


def _linear(prepared: Prepared, problem: NonlinearMode, mode: int, begin: Begin) -> Backbone:
    """Return the backbone of a mode without points, from the linear structure alone.  Local."""
    units = units_of(prepared.scene)
    return Backbone(
        mode=mode,
        outputs=output_names(prepared.scene),
        units=units.outputs,
        level_unit=units.level,
        linear_frequency=problem.omega / (2.0 * np.pi),
        linear_damping=-problem.sigma / (2.0 * problem.omega),
        first_slip=begin.amplitude,
        joints=tuple(prepared.pairs.joint),
        slips_at_rest=not begin.is_first_slip,
        open_at_rest=int(np.count_nonzero(prepared.pairs.open_at_rest)),
    )
