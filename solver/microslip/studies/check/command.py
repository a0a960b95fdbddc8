"""The command `check`: read and check a scene, list its content and optionally draw it."""

from pathlib import Path

from mpi4py import MPI

from ...assembly.check import check_elements
from ...assembly.matrices import read_structure
from ...library.complete import read_completed
from ...mesh.pairing import pair_contacts
from ...mesh.partition import distribute
from ...mesh.read import read_mesh
from ...messages.errors import CaseError
from ...parallel.agree import on_root
from ...scene.schema import Scene
from ...system.memory import peak_memory
from .faults import refuse_all
from .marks import marks_of_scene
from .memory_report import memory_of_matrices, memory_of_mesh
from .picture import draw
from .report import description, description_of_matrices


def check(scene: Scene, comm: MPI.Comm, out: Path | None = None) -> None:
    """Read and check mesh and pairs, or matrices; print their content and the resources of a run.  Nothing is solved.

    Collective on ``comm``.  With a folder ``out`` the mesh is drawn there.

    Raises
    ------
    CaseError, MeshError : on every rank; for a scene with a mesh with all independent faults
    """
    try:
        lines = _lines(scene, comm, out)
    except CaseError as fault:
        if scene.model.mesh is None:
            raise
        on_root(comm, refuse_all, scene, fault)
    if comm.rank == 0:
        print("\n".join(lines))


def _lines(scene: Scene, comm: MPI.Comm, out: Path | None) -> list[str]:
    """Return the report, on rank 0.  Collective on ``comm``."""
    if scene.model.mesh is None:
        given = on_root(comm, read_structure, scene, share=False)
        lines = on_root(comm, description_of_matrices, scene, given)
        lines += memory_of_matrices(scene, given, comm)
    else:
        stated = scene
        file, scene, notes = read_completed(scene, comm)
        mesh = on_root(comm, read_mesh, scene, file, share=False)
        pairs = on_root(comm, pair_contacts, mesh, scene.joints, scene.cyclic)
        dmesh, so_far = distribute(mesh, scene, comm), peak_memory()
        check_elements(dmesh, scene)
        lines = on_root(comm, description, scene, file, mesh, pairs, notes, stated)
        lines += memory_of_mesh(scene, dmesh, mesh, pairs, so_far)
        if out is not None:
            lines += on_root(comm, lambda: draw(out, mesh, marks_of_scene(mesh, scene), scene.title or scene.name))
    return lines
