"""The reduction methods, one file each, and their registry by the names of ``method``.

A method takes the stuck structure and the settings and returns a :class:`Reduction` by its ``reduce``; or, if it uses the
structure's modes with their exact static response, it has a ``selection`` of the set B.  Harmonic balance and continuation do
not depend on methods.  A file may have ``check`` (of the size, before any solve) and ``check_modes``.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from ...assembly.system import System
from ...points.selection import Selection
from .. import whole_disc
from ..expand import displacements
from ..facts import Facts
from ..modal_structure import reduce_structure
from ..reduction import Expansion, Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure
from ..whole_disc import WholeDisc
from . import adaptive, adaptive_energy, craig_bampton, full, joint_interface_modes, receptance, rubin, trial_vectors


class Method(Protocol):
    """Interface of each file."""

    FACTS: Facts


METHODS: dict[str, Method] = {
    "receptance": receptance,
    "adaptive": adaptive,
    "adaptive-energy": adaptive_energy,
    "full": full,
    "rubin": rubin,
    "craig-bampton": craig_bampton,
    "joint-interface-modes": joint_interface_modes,
    "trial-vectors": trial_vectors,
}


def _with(function: str) -> dict[str, Callable[..., Any]]:
    """Return a ``function`` of all methods whose file has it, by name."""
    return {name: getattr(method, function) for name, method in METHODS.items() if hasattr(method, function)}


CHECKS, MODE_CHECKS = _with("check"), _with("check_modes")
REDUCTIONS: dict[str, Callable[[StuckStructure, ReductionSettings], Reduction]] = _with("reduce")
SELECTIONS: dict[str, Callable[[ReductionSettings], Selection]] = _with("selection")


def check_size(settings: ReductionSettings, system: System) -> None:
    """Refuse a structure that is too large for the method, before any solve.  Collective on ``system.comm``."""
    if settings.method in CHECKS:
        CHECKS[settings.method](settings, system)


def check_modes(stuck: StuckStructure, settings: ReductionSettings) -> None:
    """Refuse too few modes for the method, before the reduction.  Collective.

    Raises
    ------
    CaseError : on every rank
    """
    if settings.method in MODE_CHECKS:
        MODE_CHECKS[settings.method](stuck, settings)


def keeps_to_K_L(settings: ReductionSettings) -> bool:
    """Return whether K without the springs of the joints is not needed once K_L exists.  Local."""
    return settings.method in SELECTIONS


def reduce_by_method(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction by the requested method, or in the internal-variable form (docs/theory.md, section 4).

    Collective; the internal-variable form includes static solves when a pair first slips or opens.
    """
    if not keeps_to_K_L(settings):
        check_size(settings, stuck.system)
        stuck.linearised.bring_K_back()
    if settings.method in REDUCTIONS:
        return REDUCTIONS[settings.method](stuck, settings)
    expand: Expansion = partial(displacements, stuck)
    structure = reduce_structure(stuck, settings.damping)
    if isinstance(stuck, WholeDisc):
        expand = partial(whole_disc.displacements, stuck)
        structure = whole_disc.of_sectors(stuck, structure, settings.damping)
    selection = SELECTIONS[settings.method](settings)
    return Reduction(structure, selection, expand, leaves_out="modes")
