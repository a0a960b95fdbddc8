"""The command `export`: build, reduce, form matrices, write them with a README and a script for each other program."""

from dataclasses import dataclass, replace
from pathlib import Path

from mpi4py import MPI

from ...library.build import Structure, build
from ...library.prepare import reduced
from ...library.settings import reduction_settings, refuse_discs
from ...linear.joint_springs import joint_stiffness
from ...messages.errors import CaseError
from ...messages.words import counted, hint
from ...parallel.agree import on_root
from ...reduction.expand import node_fields
from ...reduction.methods import METHODS, SELECTIONS
from ...reduction.reduction import Reduction
from ...reduction.settings import ReductionSettings
from ...scene.schema import Scene
from ..log import log_of
from .contents import contents, recovery
from .interface_model import interface_model
from .report import write_export

FINITE = tuple(name for name in METHODS if name not in SELECTIONS)  # others: exact static response, no finite matrices
INSTEAD = "joint-interface-modes"  # default: same modes, and all static shapes of relative displacements


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    method: str | None = None  # None: the scene's method, if it has finite matrices
    recovery: bool = False


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Write the reduced model of a scene for other programs: model.npz, model.mat, README.txt and executable scripts.

    Collective on ``comm``.  Only the reduction is computed.

    Raises
    ------
    CaseError : a requested method without finite matrices, a structure without supports, or one that no script can solve; on
        every rank
    """
    known_method(request.method)
    refuse_discs(scene, "export", "writes real matrices, and those of a nodal diameter are complex; leave [cyclic] out")
    with log_of(comm, folder / "export.log", scene, options) as log:
        structure = build(scene, comm, log)
        if structure.rigid is not None:
            structure.close()
            raise CaseError(
                f"{scene.path}: export: the structure has no supports, and its rigid-body motion has no place in the exported "
                "matrices; add soft springs to ground or [[supports]]"
            )
        settings, note = settings_of(scene, structure, request.method)
        with log.stage(f"reduction: {settings.method}"):
            reduction = reduced(structure, settings)
        with log.stage("matrices"):
            K_J = joint_stiffness(structure.pairs)
            model = on_root(comm, lambda: interface_model(reduction.structure.receptance_of(1).modes, K_J))
            arrays = contents(scene, structure, reduction, model, K_J)
            fields = recovered(structure, reduction, model.T) if request.recovery else None
        log.note(note)
        log.note(on_root(comm, write_export, arrays, fields, settings.method, note, scene, str(folder)))
        log.note(f"results in {folder}")
        structure.close()


def known_method(name: str | None) -> None:
    """Raise CaseError unless a requested method has finite matrices.  Local."""
    if name is None or name in FINITE:
        return
    if name in SELECTIONS:
        why = f"{name!r} uses the exact static response, which no finite mass and stiffness have"
    else:
        why = f"unknown method {name!r}{hint(name, FINITE, str)}"
    raise CaseError(f"--method: {why}; methods that can be exported: {', '.join(FINITE)}")


def settings_of(scene: Scene, structure: Structure, method: str | None) -> tuple[ReductionSettings, str]:
    """Return the settings of a reduction with finite matrices, and a note that describes it.  Local."""
    settings = reduction_settings(scene)
    if method is not None or settings.method not in SELECTIONS:
        name = method or settings.method
        return replace(settings, method=name), f"exported: the reduction of method {name}"
    most = max(3 * structure.pairs.n_pairs, 1)
    note = (
        f"exported: the {counted(len(structure.modes.omega_n), 'mode')} of the scene and the static shapes of all "
        "relative displacements "
        f"and loads. Method {settings.method} has the same modes and statics, but no inertia in those shapes: no finite matrices"
    )
    return replace(settings, method=INSTEAD, interface_modes=most), note


def recovered(structure: Structure, reduction: Reduction, T) -> dict | None:
    """Return the arrays of full fields on rank 0, None elsewhere.  Collective: one gather."""
    system, owned = structure.system, reduction.phi_owned @ T
    if system.dof is None:
        gathered = system.comm.gather(owned, root=0)
        return None if gathered is None else recovery(gathered, None)
    u = node_fields(system, owned)
    return None if u is None else recovery([u], structure.mesh)
