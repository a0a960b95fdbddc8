"""Coriolis forces in the command `modes`: the matrix of a scene, and its modes with them (docs/theory.md, section 12)."""

from mpi4py import MPI

from ...assembly.coriolis import Coriolis, coriolis
from ...library.build import Assembled, assembled, without_reference
from ...linear.dense import multiply
from ...linear.joint_springs import Linearised
from ...modes.coriolis import Waves, waves
from ...modes.eigen import Modes
from ...observe.log import RunLog
from ...scene.schema import Scene

BASIS = 2  # modes without Coriolis forces for each mode with them
_LARGE = 1e-3  # residual above which frequencies, with errors of its square, are in doubt


def with_matrix(scene: Scene, comm: MPI.Comm, log: RunLog) -> tuple[Assembled, Coriolis | None]:
    """Return mesh and matrices at rest, and the matrix of Coriolis forces where the scene states them.  Collective.

    Raises
    ------
    CaseError, MeshError, ResourceError, ConvergenceError : on every rank
    """
    parts, matrix = assembled(scene, comm, log, explicit=False), None
    if takes_coriolis(scene) and parts.reference is not None:
        matrix = coriolis(parts.reference.shares, parts.reference.settings, parts.reference.system)
    return without_reference(parts, False), matrix


def takes_coriolis(scene: Scene) -> bool:
    """Return whether a scene states Coriolis forces.  Local."""
    return scene.statics is not None and scene.statics.coriolis


def basis_size(scene: Scene, count: int) -> int:
    """Return the number of modes without Coriolis forces to compute for ``count`` modes.  Local."""
    return BASIS * count if takes_coriolis(scene) else count


def waves_of(linearised: Linearised, computed: Modes, matrix: Coriolis, count: int, log: RunLog) -> tuple[Waves, Waves]:
    """Return ``count`` solutions with positive and with negative omega, of a nodal diameter waves backward and forward.

    Collective.  A structure that turns is never free: its supports hold it.
    """
    G = matrix.of(linearised.maps)
    both = waves(linearised, computed, G, count)
    matrix.free_of(G)
    residual = max(wave.residual for wave in both)
    text = f"Coriolis forces: largest residual {residual:.1e} of the inertia forces"
    log.note(text if residual <= _LARGE else f"WARNING: {text}: frequencies may be wrong; state more modes")
    return both


def of_modes(linearised: Linearised, computed: Modes) -> Waves:
    """Return the modes without Coriolis forces in the form of those with them.  Collective."""
    return Waves(computed.omega_n, computed.phi_owned, multiply(linearised.M, computed.phi_owned), 0.0)
