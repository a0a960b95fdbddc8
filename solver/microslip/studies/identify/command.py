"""The command `identify`: build, fit, table, picture, and the scene with the fitted values."""

from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from ...formats.measured import read_measured
from ...library.build import build
from ...library.fitted_numbers import refuse_bounds
from ...library.identify import identify
from ...library.settings import output_names, refuse_discs, refuse_statics, units_of
from ...messages.errors import CaseError, ConvergenceError
from ...parallel.agree import on_root
from ...scene.schema import Scene
from ..log import log_of
from .report import write_identified


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    other: str  # file of the measurement
    fit: tuple[str, ...] = ()  # KEY=LOW:HIGH, numbers to identify


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Fit numbers of a scene to a measurement.  Collective on ``comm``.

    Raises
    ------
    CaseError, MeshError, ConvergenceError, ResourceError : on every rank
    """
    numbers = list(map(bounds_of, request.fit))
    twice = next((key for i, (key, _) in enumerate(numbers) if key in dict(numbers[:i])), None)
    if twice is not None:
        raise CaseError(f"--fit {twice} is stated twice; each number has one pair of bounds")
    bounds = dict(numbers)
    refuse_statics(scene, "identify")
    refuse_discs(scene, "identify", "is for structures that are modelled in full")
    on_root(comm, refuse_bounds, scene, bounds)
    of, response = (output_names(scene), units_of(scene).outputs), scene.response
    rows = on_root(comm, read_measured, Path(request.other), *of, response.levels, response.frequencies)
    with log_of(comm, folder / "identify.log", scene, options, measurement=request.other) as log:
        structure = build(scene, comm, log)
        with log.stage("least squares"):
            identified = identify(structure, rows, bounds)
        log.note(on_root(comm, write_identified, identified, scene, folder))
        log.note(f"results in {folder}")
        structure.close()
    if not identified.is_converged:
        raise ConvergenceError(f"identify: least squares has not converged; what was computed is in {folder}")


def bounds_of(text: str) -> tuple[str, tuple[float, float]]:
    """Return the number and its bounds of KEY=LOW:HIGH.  Local.  Raises CaseError: another text."""
    key, _, ends = text.partition("=")
    low, _, high = ends.partition(":")
    try:
        return key.strip(), (float(low), float(high))
    except ValueError:
        raise CaseError(f"--fit {text}: expected KEY=LOW:HIGH, as --fit joints.dovetail.friction=0.1:0.6") from None
