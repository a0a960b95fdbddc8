"""All independent faults of a scene and its files in one message, collected after the first one has ended a check."""

from collections.abc import Callable
from typing import TypeVar

from mpi4py import MPI

from ...assembly.check import check_elements
from ...assembly.constraints import check_supports
from ...assembly.fixed_pairs import notes_on_pairs
from ...assembly.nodal_forces import nodal_forces
from ...assembly.output_rows import output_row
from ...formats.model import FileModel
from ...formats.read import read_model
from ...library.complete import complete, held_by
from ...mesh.connected import check_fixed, connected_parts
from ...mesh.cut import cuts_through
from ...mesh.data import ContactPairs, Mesh
from ...mesh.links import Links, find_links, fixed_places
from ...mesh.pairing import pair_contacts
from ...mesh.partition import distribute
from ...mesh.read import read_mesh
from ...mesh.sector_factors import notes_on_sectors
from ...messages.errors import CaseError, Faults
from ...scene.schema import Scene

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
