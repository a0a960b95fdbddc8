"""The command `modes`: assemble, factor, lowest modes with proof, effective masses, table and pictures."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...assembly.system import System
from ...library.build import Assembled, factor_of
from ...library.settings import reduction_settings
from ...linear.dense import gram, multiply
from ...linear.joint_springs import Linearised
from ...messages.errors import CaseError
from ...modes.coriolis import Waves
from ...modes.eigen import Modes, first_of, lowest_modes
from ...observe.log import RunLog
from ...parallel.agree import on_root
from ...reduction.expand import node_fields
from ...reduction.modal_structure import damped_modes
from ...reduction.stuck import project_modes
from ...scene.read import changed
from ...scene.schema import Scene
from ...system.files import remove_files
from ..log import log_of
from .campbell import ORDERS, Families, write_campbell
from .coriolis import basis_size, of_modes, takes_coriolis, waves_of, with_matrix
from .disc import Excited, diameters_of, show_disc
from .disc_at_speed import show_at_speeds
from .report import ModeTable, joint_shares, write_modes_of

COUNT = 12  # default number of modes


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    count: int | None = None  # number of modes; None: [solver] modes, or 12
    speeds: tuple[float, ...] = ()  # rad/s, override [statics] rotation_speed
    diameters: tuple[int, ...] = ()  # nodal diameters of a disc; empty: all of them
    orders: tuple[int, ...] = ()  # engine orders; empty: 1 to 6, for a disc 1 to the number of sectors


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Compute the lowest modes of a scene with all pairs stuck, about its state of rest; write table, picture and shapes.

    Collective on ``comm``.  For several speeds of rotation also the Campbell diagram, with shapes at the highest speed; for a
    disc of sectors the interference diagram, with [statics] and speeds the Campbell diagram of all nodal diameters.

    Raises
    ------
    CaseError, MeshError, ResourceError, ConvergenceError : on every rank
    """
    if request.orders and not request.speeds:
        raise CaseError("--orders: engine orders meet modes at speeds of rotation; state --speeds A,B, too")
    with log_of(comm, folder / "modes.log", scene, options) as log:
        scene = changed(scene, {"solver": {"method": "receptance"} | ({} if request.count is None else {"modes": request.count})})
        on_root(comm, remove_files, folder, "campbell.*", "crossings.csv", "interference.png", "modes_diameter_*.vtkhdf")
        at_rest = scene.statics is None and (scene.cyclic is not None or not request.speeds)
        turns = not at_rest and (request.speeds or (scene.statics is not None and scene.statics.rotation_speed > 0.0))
        if turns and not takes_coriolis(scene):
            log.note("Coriolis forces of the rotation are left out; [statics] coriolis = true takes them in")
        if scene.cyclic is not None:
            _of_disc(scene, comm, folder, request, log)
        elif request.diameters:
            raise CaseError(f"--diameters: {scene.path} has no table [cyclic], and so no nodal diameters")
        else:
            _of_structure(scene, comm, folder, request, log)
        log.note(f"results in {folder}")


def _of_disc(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, log: RunLog) -> None:
    """Compute the modes of nodal diameters, with [statics] at each speed.  Collective."""
    diameters = diameters_of(scene, request.diameters)
    excited, count = Excited(scene.cyclic.sectors, request.speeds, request.orders), scene.solver.modes or COUNT
    if request.speeds and scene.statics is not None:
        at_speeds = ((speed, *with_matrix(at_speed(scene, speed), comm, log)) for speed in sorted(request.speeds))
        show_at_speeds(at_speeds, count, diameters, excited, folder, log)
    else:
        parts, matrix = with_matrix(scene, comm, log)
        show_disc(parts, matrix, count, diameters, excited, folder, log)


def _of_structure(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, log: RunLog) -> None:
    """Compute the modes of a structure that is no disc, with several speeds the Campbell diagram.  Collective."""
    families = Families(1 if takes_coriolis(scene) else 2)
    speeds: list[float | None] = [*sorted(request.speeds)] or [None]
    for speed in speeds:
        if speed is not None:
            log.note(f"speed of rotation {speed:g} rad/s")
        with stuck_modes(scene if speed is None else at_speed(scene, speed), comm, log) as (parts, linearised, computed, turning):
            shown = of_modes(linearised, computed) if turning is None else turning
            families.add(comm, shown.frequency, shown.phi_owned, shown.M_phi_owned)
            if speed is None or speed == max(request.speeds):
                _show(parts, linearised, computed, turning, folder, log)
    if request.speeds:
        campbell = families.campbell(sorted(request.speeds))
        with log.stage("Campbell diagram"):
            log.note(on_root(comm, write_campbell, campbell, request.orders or tuple(range(1, ORDERS + 1)), scene, folder))


def at_speed(scene: Scene, speed: float) -> Scene:
    """Return the scene with a speed of rotation [rad/s].  Local.  Raises CaseError: the scene has no axis."""
    return changed(scene, {"statics": {"rotation_speed": speed}})


@contextmanager
def stuck_modes(scene: Scene, comm: MPI.Comm, log: RunLog) -> Iterator[tuple[Assembled, Linearised, Modes, Waves | None]]:
    """Yield mesh and matrices, the factor, the lowest modes of a scene and those with Coriolis forces, and free them.

    Collective.

    Raises
    ------
    CaseError, MeshError, ResourceError, ConvergenceError : on every rank
    """
    parts, matrix = with_matrix(scene, comm, log)
    linearised, solver = factor_of(parts, log), scene.solver
    count = solver.modes or min(COUNT, linearised.system.n_dof)
    n_modes = count if matrix is None else min(basis_size(scene, count), linearised.system.n_dof)
    turning = None
    with log.stage("modes"):
        computed = lowest_modes(linearised, n_modes, solver.verify_modes, allows_fewer=solver.modes is None or matrix is not None)
        if matrix is not None:
            turning = waves_of(linearised, computed, matrix, count, log)[0]
            matrix.destroy()
    yield parts, linearised, first_of(computed, count), turning
    linearised.destroy()
    linearised.system.destroy()


def _show(parts: Assembled, linearised: Linearised, computed: Modes, turning: Waves | None, folder: Path, log: RunLog) -> None:
    """Write table, picture and shapes.  Collective."""
    table = mode_table(parts, linearised, computed)
    if turning is not None:
        table = replace(table, coriolis=turning.frequency)
    shapes = None if linearised.system.dof is None else node_fields(linearised.system, computed.phi_owned)
    with log.stage("table and pictures"):
        text = on_root(linearised.system.comm, write_modes_of, table, parts.mesh, shapes, parts.scene, folder)
    log.note(text)
    log.note(computed.completeness)


def mode_table(parts: Assembled, linearised: Linearised, computed: Modes) -> ModeTable:
    """Return the table of the modes.  Collective: one or two sums.

    The effective mass of a mode along an axis is (phi^T M r)^2, with r a unit translation of all free DOFs; the sum over all
    modes is the movable mass r^T M r.  The fraction of a joint is the strain energy of its springs, the sum of
    k (R phi)^2 / omega_n^2 over its pairs: the relative change of omega_n^2 with the stiffness of the joint.
    """
    system, pairs = linearised.system, parts.rest.pairs
    projected = project_modes(system, computed.omega_n, computed.phi_owned)
    K_J = pairs.law.stiffness.ravel()
    joints = joint_shares(pairs, projected)
    settings = reduction_settings(parts.scene)
    damping = damped_modes(projected, K_J, settings.damping).zeta
    mass, total = None, None
    if system.dof is not None:
        r_owned = _translations(system)[slice(*system.M.getOwnershipRange())]
        Mr_owned = multiply(system.M, r_owned)
        mass, total = gram(system.comm, computed.phi_owned, Mr_owned) ** 2, np.diag(gram(system.comm, r_owned, Mr_owned))
    return ModeTable(computed.frequency, damping, joints, mass, total)


def _translations(system: System) -> np.ndarray:
    """Return a unit translation along x, y and z of all free DOFs of nodes and points, (n_dof, 3).  Local."""
    places = system.dof
    if system.constraints is not None:
        free, n_points = system.constraints.free, len(system.constraints.points)
        n_nodes = len(free) - 2 * n_points
        places = np.concatenate([free[:n_nodes], free[n_nodes::2]])
    r = np.zeros((system.n_dof, 3))
    for axis, rows in enumerate(places.T):
        r[rows[rows >= 0], axis] = 1.0
    return r
