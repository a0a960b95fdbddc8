"""What a run did not compute because the scene did not require it, for the end of the response in the log."""

from __future__ import annotations

import numpy as np

from .continuation.branch import Branch


def not_computed(scene, *, omega_n: np.ndarray | None, n_dof: int, known: np.ndarray | None, branches: list[Branch],
                 has_mesh: bool, has_bars: bool) -> list[str]:
    """Return a line for everything left out, with the fact behind it.  Local.

    Parameters
    ----------
    omega_n : (n_modes,) rad/s, where all modes beyond them are left out of the response; None where the method leaves none out
    known : (n_pairs,) bool, the pairs whose static columns were solved for; None where those of all pairs had to be
    has_bars : whether points have error bars
    """
    solved = [branch for branch in branches if branch.points]
    highest = max((point.harmonics for branch in solved for point in branch.points), default=0)
    lines = [f"solution in harmonics above {highest}"] if solved else []
    if omega_n is not None and 0 < len(omega_n) < n_dof:
        lines.append(f"response of modes above {omega_n.max() / (2.0 * np.pi):.6g} Hz, all but {len(omega_n)} of {n_dof} DOF, "
                     "beyond their static part")
    if known is not None and len(known) == 0:
        lines.append("contact forces and static columns: the scene has no pair, the response is linear")
    elif known is not None and not known.all():
        lines.append(f"static columns of {np.count_nonzero(~known)} of {len(known)} pairs: none of these was let slip or open")
    scaled, odd = ([branch.level for branch in branches if getattr(branch, name)] for name in ("scaled", "odd"))
    if scaled:
        lines.append(f"Newton iterations at {_newtons(scaled)}: no pair leaves sticking, the linear response is scaled")
    if odd:
        lines.append(f"even harmonics at {_newtons(odd)}: by the symmetry of the scene they vanish")
    if scene.damping is not None:
        lines.append("damping matrix: [damping] gives that of each mode")
    if not has_bars:
        lines.append("error bars: [solver] asks for none")
    if not has_mesh:
        lines.append("fields for ParaView: the scene has no mesh")
    return lines


def _newtons(levels: list[float]) -> str:
    return ", ".join(f"{level:g}" for level in levels) + " N"
