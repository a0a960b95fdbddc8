"""The sets marked in the picture of a mesh: those used by a scene, or named by a model file."""

import numpy as np

from ...formats.model import FileModel
from ...mesh.cut import cuts_through
from ...mesh.data import Mesh
from ...mesh.locate import find_node
from ...mesh.skin import faces_of_group, skin_of_mesh
from ...mesh.surface import outward_faces
from ...tables.structure_tables import StructureTables
from ...tables.vibration import Load, Output
from .picture import Mark


def marks_of_scene(mesh: Mesh, settings: StructureTables) -> list[Mark]:
    """Return joints, ties, faces of a sector, bolts, supports, points, loads and outputs of a scene.  Local, rank 0."""
    marks = [Mark(label=f"joint {joint.name}", faces=_faces(mesh, joint.groups)) for joint in settings.joints]
    if settings.ties:
        named = settings.ties[0].label if len(settings.ties) == 1 else f"{len(settings.ties)} of them"
        marks.append(
            Mark(label=f"ties: {named}", faces=[faces for tie in settings.ties for faces in _faces(mesh, tie.surfaces[:1])])
        )
    if settings.cyclic is not None and settings.cyclic.faces is not None:
        turns = (f"low face: {settings.cyclic.faces[0]}", f"high face: {settings.cyclic.faces[1]}")
        marks += [Mark(label=label, faces=_faces(mesh, (face,))) for label, face in zip(turns, settings.cyclic.faces)]
    bolts = () if settings.statics is None else settings.statics.bolts
    for bolt, cut in zip(bolts, cuts_through(mesh, bolts)):
        marks.append(Mark(label=f"cut of {bolt.label}", points=mesh.points[cut.nodes], marker="s"))
    held = [mesh.node_groups[support.group] for support in settings.supports if support.group in mesh.node_groups]
    if held:
        names = ", ".join(dict.fromkeys(str(support.group) for support in settings.supports if support.group is not None))
        marks.append(Mark(label=f"held: {names}", points=mesh.points[np.unique(np.concatenate(held))], marker="^"))
    places = {point.name: point.position for point in settings.points}
    marks += [Mark(label=f"point {name}", points=np.array([at]), marker="D") for name, at in places.items()]
    loads = [(f"load {i}", table) for i, table in enumerate(settings.loads, 1)]
    outputs = [(f"output {output.name}", output) for output in settings.outputs]
    return marks + [mark for label, table in loads + outputs if (mark := _mark_at(mesh, label, table, places)) is not None]


def _faces(mesh: Mesh, groups: tuple[str, ...]) -> list[np.ndarray]:
    return [faces for group in groups for faces in outward_faces(mesh, group).values()]


def _mark_at(mesh: Mesh, label: str, entry: Load | Output, places: dict) -> Mark | None:
    """Return the mark of a load or an output; None if it acts everywhere or on a joint."""
    group = getattr(entry, "group", None)
    if entry.point is not None:
        points = np.array([places[entry.point]])
    elif entry.position is None and entry.node is None and group is None:
        return None
    else:
        points = mesh.points[find_node(mesh, position=entry.position, node=entry.node, group=group)]
    is_load = isinstance(entry, Load)
    return Mark(label=label, points=points, marker="*" if is_load else "o", direction=entry.direction if is_load else None)


def marks_of_file(mesh: Mesh, file: FileModel, settings: StructureTables) -> list[Mark]:
    """Return the groups of faces, the supports and the points of a model file.  Local, rank 0."""
    skin, of_bodies, held = skin_of_mesh(mesh), set(settings.body_of), {support.group for support in file.supports}
    marks = []
    for name, nodes in mesh.node_groups.items():
        outer = faces_of_group(mesh, skin, name) if name not in of_bodies and len(nodes) else np.zeros(0, dtype=np.int64)
        if name in held:
            marks.append(Mark(label=f"held: {name}", points=mesh.points[nodes], marker="^"))
        elif len(outer) and skin.area[outer].sum() < 0.5 * skin.area.sum():
            marks.append(Mark(label=name, faces=list(skin.by_kind(outer).values())))
    metres = settings.model.metres
    return marks + [
        Mark(label=f"point {point.name}", points=np.array([point.position]) * metres, marker="D") for point in file.connected
    ]
