"""Omitted computations of a run for the log: each with the reason, or with its effect by the error bars."""

from dataclasses import dataclass

import numpy as np

from ..fourier.harmonics import Harmonics
from ..messages.words import counted
from ..points.branch import Branch, Point
from ..points.error_parts import PARTS, SAFETY

FAINT = 1e-3  # of the largest output: smaller outputs are compared with this value
TOO_LITTLE = 1e-6  # of the peak: smaller effects are not quantified
NO_BOUND = (
    "a bar above 100 % is no estimate: next to a fold or a resonance with little damping the amplitude at a fixed frequency "
    "changes without bound, or no solution with more harmonics is near; use more harmonics"
)


@dataclass(frozen=True)
class Extent:
    """The extent of a response."""

    method: str
    leaves_out: str  # omission of the method: Reduction.leaves_out
    omega_n: np.ndarray  # (n_modes,) rad/s
    n_dof: int
    harmonics: Harmonics  # as stated
    n_damped: int | None  # highest mode with stated damping; None: there is a damping matrix
    has_bars: bool  # with error bars
    has_mesh: bool
    rests: bool  # sensitivities are about a state of rest of [statics]
    is_whole_disc: bool = False  # omega_n also has the static shapes of blades that differ
    turns: bool = False  # with a speed of rotation in [statics]

    @property
    def moves(self) -> bool:
        """Whether loads oscillate."""
        return not self.harmonics.is_constant


def not_computed(of: Extent, branches: list[Branch], known: np.ndarray | None) -> list[str]:
    """Return a line for each omitted computation, with the reason or its effect on the response.  Local.

    ``known`` (n_pairs,) bool: pairs with computed static columns; None if the columns of all pairs were needed.
    """
    solved = [branch for branch in branches if branch.points]
    lines = _harmonics(solved, of.harmonics, known is None or len(known) > 0) if of.moves else _statics(solved)
    if of.leaves_out == "basis" and solved and of.moves:
        lines.append(f"response outside the basis of method {of.method}: {changes(solved, 'modes')}")
    if of.leaves_out == "modes" and solved and of.moves and 0 < len(of.omega_n) < of.n_dof:
        above = f"of modes above {of.omega_n.max() / (2.0 * np.pi):.6g} Hz, all but {len(of.omega_n)} of {of.n_dof} DOF"
        if of.is_whole_disc:
            above = f"outside {counted(len(of.omega_n), 'shape')} (modes; static shapes where blades differ) of {of.n_dof} DOF"
        lines.append(f"response {above}, beyond their static part: {changes(solved, 'modes')}")
    if _most(solved, "pairs")[0] > 0.0:
        lines.append(f"slip and opening of the pairs that method {of.method} holds stuck: {changes(solved, 'pairs')}")
    if _most(solved, "sliders")[0] > 0.0:
        lines.append(f"elements of rough and Iwan pairs beyond `sliders`: {changes(solved, 'sliders')}")
    if known is not None and len(known) == 0:
        lines.append("contact forces and static columns: the scene has no pair, the response is linear")
    elif known is not None and not known.all():
        lines.append(
            f"static columns of {np.count_nonzero(~known)} of {counted(len(known), 'pair')}: these pairs were always stuck"
        )
    linear, odd = ([branch.level for branch in branches if getattr(branch, name)] for name in ("is_linear", "odd"))
    if linear:
        lines.append(f"Newton iterations at {_newtons(linear)}: no pair leaves sticking, the linear response is scaled")
    if odd:
        lines.append(f"even harmonics at {_newtons(odd)}: by the symmetry of the scene they vanish")
    if of.n_damped is not None:
        lines.append("damping matrix: [damping] states the damping of each mode")
        if of.n_damped > len(of.omega_n):
            lines.append(
                f"damping of modes {len(of.omega_n) + 1} to {of.n_damped}: {counted(len(of.omega_n), 'mode')} are used, "
                "the others contribute statically"
            )
    if not of.has_bars:
        lines.append("error bars: off in [solver]")
    elif not of.moves:
        lines.append("error bars: they estimate harmonic 1, and harmonics = 0")
    if of.rests:
        lines.append(
            "change of the state of rest in the sensitivities: they leave preload and gaps of [statics] as they are; a sweep of "
            "friction, preload or contact stiffness solves for them again"
        )
    if of.turns and of.moves:
        lines.append(
            "Coriolis forces of the rotation: a response leaves them out, `microslip modes` takes them in ([statics] coriolis)"
        )
    if not of.has_mesh:
        lines.append("fields for ParaView: the scene has no mesh")
    return lines


def _statics(solved: list[Branch]) -> list[str]:
    """Return lines that state that one point represents all frequencies."""
    return (
        [
            "further points of [response]: harmonics = 0, constant loads have the same response at every frequency",
            "harmonics above 0: no load oscillates",
        ]
        if solved
        else []
    )


def _harmonics(solved: list[Branch], stated: Harmonics, has_pairs: bool) -> list[str]:
    """Return a line on the omitted harmonics of levels with slip, and of linear levels."""
    if not solved:
        return []
    slips = [branch for branch in solved if has_pairs and not branch.is_linear]
    numbers = {point.harmonics for branch in slips or solved for point in branch.points}
    low, high = min(numbers), max(numbers)
    if not slips:
        return [f"solution in harmonics above {high}: no load acts in them, and the response is linear"]
    above = f"{high}" if low == high else f"the highest that each point needed, {low} to {high}"
    omitted = ", ".join(str(n) for n in range(stated.highest) if n not in stated)
    return [f"solution in harmonics {omitted and f'{omitted} and '}above {above}: {changes(slips, 'harmonics')}"]


def changes(branches: list[Branch], part: str) -> str:
    """Return the largest effect of a part of the error bars on any output, relative to the peak of its level, as text.  Local."""
    if not any(point.error is not None for branch in branches for point in branch.points):
        return "the effect is unknown without error bars"
    share, where = _most(branches, part)
    if share < TOO_LITTLE:
        return f"effect by the error bars below {TOO_LITTLE:.0e} of the peak"
    text = f"effect by the error bars up to {100.0 * share:.3g} % of the peak, at {where:g} N"
    return text if share <= 1.0 else f"{text}: {NO_BOUND}"


def _most(branches: list[Branch], part: str) -> tuple[float, float]:
    """Return the largest ratio of a part of the bars to the peak of its output and level, and the level [N].  Local."""
    shares = [
        (_share([point for point in branch.points if point.error is not None], PARTS.index(part)), branch.level)
        for branch in branches
    ]
    return max(shares, default=(0.0, 0.0))


def _share(points: list[Point], i: int) -> float:
    """Return the largest ratio of part i to the peak of its output, over points with error bars.  Local."""
    if not points:
        return 0.0
    peaks = np.max([np.hypot(point.response[:, 1], point.response[:, 2]) for point in points], axis=0)
    peaks = np.maximum(peaks, FAINT * peaks.max(initial=0.0))
    bars = SAFETY * np.max([point.error[:, i] for point in points if point.error is not None], axis=0)
    return float(np.divide(bars, peaks, out=np.zeros_like(bars), where=peaks > 0.0).max(initial=0.0))


def _newtons(levels: list[float]) -> str:
    return ", ".join(f"{level:g}" for level in levels) + " N"
