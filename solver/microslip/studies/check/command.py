"""The command `check`: read and check a scene, list its content and optionally draw it."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from ...assembly.check import check_elements
from ...assembly.constraints import check_supports
from ...assembly.fixed_pairs import notes_on_pairs
from ...assembly.maps import output_row
from ...assembly.matrices import read_structure
from ...assembly.nodal_forces import nodal_forces
from ...formats.model import FileModel
from ...formats.read import read_model
from ...library.complete import complete, held_by, read_completed
from ...mesh.connected import check_fixed, connected_parts
from ...mesh.cut import cuts_through
from ...mesh.data import ContactPairs, Mesh
from ...mesh.links import Links, find_links, fixed_places
from ...mesh.pairing import pair_contacts
from ...mesh.partition import distribute
from ...mesh.read import read_mesh
from ...mesh.sector_factors import notes_on_sectors
from ...messages.errors import CaseError, Faults
from ...parallel.agree import on_root
from ...scene.schema import Scene
from ...system.memory import peak_memory
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


T = TypeVar("T")


def refuse_all(scene: Scene, first: CaseError) -> None:
    """Raise ``first``, which ended a check of a scene with a mesh, together with all faults independent of it.

    Local, rank 0.

    Raises
    ------
    CaseError, MeshError : always
    """
    faults = Faults()
    whole, file = _completed(scene, faults)
    if file is not None and whole is not None:
        mesh = _value(faults, lambda: read_mesh(whole, held_by(scene, file)))
        if mesh is not None:
            _of_mesh(whole, mesh, faults)
    with faults.collected():
        raise first
    faults.refuse()


def _value(faults: Faults, function: Callable[[], T]) -> T | None:
    """Return the value of a function; None if it raised a fault, which is collected."""
    with faults.collected():
        return function()
    return None


def _completed(scene: Scene, faults: Faults) -> tuple[Scene | None, FileModel | None]:
    """Return the scene completed by its file, with unresolved findings waived, and the file."""
    file = _value(faults, lambda: read_model(scene.folder / (scene.model.mesh or ""), scene.model.step))
    if file is None:
        return None, None
    whole = _value(faults, lambda: complete(scene, file))
    if whole is None:
        words = tuple(dict.fromkeys(finding.word for finding in file.findings if finding.changes))
        waived = scene.with_keys(model=scene.model.with_keys(ignore=words))
        whole = _value(faults, lambda: complete(waived, file))
    return (None if whole is None else whole[0]), file


def _of_mesh(scene: Scene, mesh: Mesh, faults: Faults) -> None:
    """Collect the faults of a scene on its mesh."""
    pairs = _value(faults, lambda: pair_contacts(mesh, scene.joints, scene.cyclic))
    links = _value(faults, lambda: find_links(mesh, scene))
    _value(faults, lambda: notes_on_sectors(scene.cyclic, scene.path))
    with faults.collected():
        check_elements(distribute(mesh, scene, MPI.COMM_SELF), scene)
    if links is not None:
        _of_links(scene, mesh, pairs, links, faults)
    for i, load in enumerate(scene.loads, 1):
        if links is not None or load.point is None:
            with faults.collected():
                nodal_forces(mesh, load, scene.model, f"[[loads]] {i}", links)
    for output in scene.outputs:
        if links is not None or output.point is None:
            with faults.collected():
                output_row(mesh, output, scene, links)
    if scene.statics is not None:
        with faults.collected():
            cuts_through(mesh, scene.statics.bolts)


def _of_links(scene: Scene, mesh: Mesh, pairs: ContactPairs | None, links: Links, faults: Faults) -> None:
    """Collect the faults of supports and of links between nodes."""
    with faults.collected():
        is_fixed = fixed_places(mesh, scene, links)
        check_supports(mesh, links, is_fixed)
        if pairs is not None:
            notes_on_pairs(pairs, links, is_fixed, str(scene.path))
    if pairs is not None and links.cyclic is None:
        with faults.collected():
            check_fixed(*connected_parts(mesh, scene.body_of), mesh, scene.supports, pairs, links)
