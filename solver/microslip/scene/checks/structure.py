"""Checks of the structure of a scene: names, groups, places, loads at rest."""

from collections import Counter
from typing import Any

from ...messages.words import hint
from ...tables.constant_loads import Statics
from ..inputs import may_know_nodes
from ..schema import Scene


def of_a_mesh(scene: Scene) -> list[str]:
    """Return mistakes: tables missing with a mesh, and keys that belong to matrices."""
    mistakes = (
        [] if scene.bodies or scene.awaits_file else [f"[bodies] is missing: expected {Scene.model_fields['bodies'].description}"]
    )
    for where, joint in numbered(scene, "joints"):
        if joint.pairs is not None:
            mistakes.append(f"{where} pairs: belongs to a model given as matrices; with a mesh, name two surfaces")
        if joint.node_pairs is not None:
            mistakes.append(f"{where} node_pairs: belongs to a model given as matrices; with a mesh, name two surfaces")
    for where, entry in numbered(scene, "loads", "outputs"):
        if entry.dof is not None:
            mistakes.append(f"{where} dof: belongs to a model given as matrices; with a mesh, name a position or a node")
    return mistakes


def of_matrices(scene: Scene) -> list[str]:
    """Return mistakes: keys that belong to a mesh."""
    held = (
        ("[materials.NAME]", scene.materials),
        ("[orientations.NAME]", scene.orientations),
        ("[bodies.NAME]", scene.bodies),
        ("[[supports]]", scene.supports),
        ("[[surfaces]]", scene.surfaces),
        ("[[ties]]", scene.ties),
        ("[[points]]", scene.points),
        ("[[masses]]", scene.masses),
        ("[[springs]]", scene.springs),
        ("[cyclic]", scene.cyclic),
    )
    mistakes = [f"{table}: belongs to a mesh; the matrices must include it" for table, entries in held if entries]
    mistakes += ["[statics]: needs a mesh; pairs of matrices state their preload"] if scene.statics is not None else []
    knows_nodes = may_know_nodes(scene.model, scene.folder)
    has_mesh = scene.model.nodes is not None and not scene.model.nodes.lower().endswith(".csv")
    for where, joint in numbered(scene, "joints"):
        if joint.surfaces is not None and not (knows_nodes and has_mesh):
            mistakes.append(f"{where} surfaces: belongs to a mesh; with matrices, give pairs, the path of a CSV file")
        if joint.node_pairs is not None and not knows_nodes:
            mistakes.append(f"{where} node_pairs: the matrices have no nodes; state [model] dofs, node and direction of each row")
    for where, entry in numbered(scene, "loads", "outputs"):
        if getattr(entry, "pressure", None) is not None:
            mistakes.append(
                f"{where} pressure: a model given as matrices has no surfaces; state its forces on DOFs, forces = a CSV file"
            )
        elif getattr(entry, "base_acceleration", None) is not None:
            mistakes.append(
                f"{where} base_acceleration: a model given as matrices has no supports; state -M r as forces = a CSV file"
            )
        elif getattr(entry, "quantity", "") in ("stress", "strain"):
            mistakes.append(f'{where} quantity = "{entry.quantity}": a model given as matrices has no elements')
        elif getattr(entry, "absolute", False):
            mistakes.append(f"{where} absolute: a model given as matrices has no base")
        elif entry.point is not None or (not knows_nodes and _is_nowhere(entry)):
            mistakes.append(f"{where}: a model given as matrices has no nodes; name a dof, a row of the matrices counted from 0")
    return mistakes


def _is_nowhere(entry: Any) -> bool:
    """Return whether a load or an output has no DOF and is neither forces of a file nor the contact force of a joint."""
    return entry.dof is None and getattr(entry, "forces", None) is None and getattr(entry, "joint", None) is None


def numbered(scene: Scene, *tables: str) -> list[tuple[str, Any]]:
    """Return the entries of some lists of tables, each with its header for messages."""
    return [
        (f"[[{table}]] {number}" + (f' ("{name}")' if (name := getattr(entry, "name", None)) else ""), entry)
        for table in tables
        for number, entry in enumerate(getattr(scene, table), 1)
    ]


def materials(scene: Scene) -> list[str]:
    """Return mistakes: bodies with a material or orientation that does not exist."""
    if scene.awaits_file:
        return []
    mistakes = []
    for name, body in scene.bodies.items():
        for key, wanted, tables in (
            ("material", body.material, scene.materials),
            ("orientation", body.orientation, scene.orientations),
        ):
            if wanted is not None and wanted not in tables:
                known = f"known: {', '.join(tables)}" if tables else f"there is no table [{key}s.NAME] at all"
                mistakes.append(f'[bodies.{name}] {key} = "{wanted}": there is no such {key}{hint(wanted, tables)}; {known}')
    return mistakes


def same_groups(scene: Scene) -> list[str]:
    """Return mistakes: bodies that claim the same elements."""
    first: dict[str, str] = {}
    mistakes = []
    for name, body in scene.bodies.items():
        if body.group in first:
            mistakes.append(
                f'[bodies.{name}] group = "{body.group}": [bodies.{first[body.group]}] has it already; '
                "each element belongs to one body"
            )
        first.setdefault(body.group, name)
    return mistakes


def same_names(scene: Scene) -> list[str]:
    """Return mistakes: joints and outputs that share a name."""
    mistakes = []
    for table in ("joints", "outputs", "surfaces", "ties", "points"):
        counts = Counter(entry.name for entry in getattr(scene, table) if entry.name is not None)
        mistakes += [f'[[{table}]] name = "{name}" is used {n} times; each needs its own' for name, n in counts.items() if n > 1]
    return mistakes


def statics(scene: Scene) -> list[str]:
    """Return mistakes: static preloads without statics, a speed without an axis, temperatures without expansion."""
    statics, mistakes = scene.statics, _axis(scene)
    for where, joint in numbered(scene, "joints"):
        if joint.preload == "static" and statics is None and not scene.awaits_file:
            mistakes.append(
                f'{where} preload = "static": there is no table [statics] to compute it; add one, or state the preload in Pa'
            )
    if statics is None:
        return mistakes
    if statics.rotation_speed > 0.0 and scene.axis_of_rotation is None:
        mistakes.append("[statics] rotation_speed: [model] axis is missing, the direction of the axis of rotation [x, y, z]")
    acting = (any(load.pressure for load in statics.pressures), any(load.temperature != 0.0 for load in statics.temperatures))
    if not (statics.rotation_speed or statics.forces or statics.bolts or statics.displacements or any(acting)):
        mistakes.append(
            "[statics] loads nothing: state rotation_speed, forces, pressures, temperatures, bolts or displacements, or leave "
            "the table out"
        )
    mistakes += _same_bolts(statics)
    mistakes += [
        f'[[statics.temperatures]] group = "{group}" is used {n} times; a body has one temperature'
        for group, n in Counter(temperature.group for temperature in statics.temperatures).items()
        if n > 1
    ]
    body_of = {body.group: body for body in scene.bodies.values()}
    for i, temperature in enumerate(statics.temperatures, 1):
        where = f'[[statics.temperatures]] {i} group = "{temperature.group}"'
        if scene.awaits_file:
            continue
        if temperature.group not in body_of:
            mistakes.append(f"{where}: no body has this group{hint(temperature.group, body_of)}")
        elif (
            body_of[temperature.group].material in scene.materials
            and scene.materials[body_of[temperature.group].material].expansion is None
        ):
            mistakes.append(f"{where}: [materials.{body_of[temperature.group].material}] expansion is missing, in 1/K")
    return mistakes


def volumes_as_faces(scene: Scene) -> list[str]:
    """Return mistakes: pressures, joints, ties and bolts that name the elements of a body where faces are meant."""
    bodies = {body.group for body in scene.bodies.values()}
    used = [(where, group, "a joint has faces") for where, joint in numbered(scene, "joints") for group in joint.surfaces or ()]
    used += [(where, group, "a tie has faces or their nodes") for where, tie in numbered(scene, "ties") for group in tie.surfaces]
    used += [
        (where, load.group, "a pressure acts on faces") for where, load in numbered(scene, "loads") if load.pressure is not None
    ]
    if scene.statics is not None:
        pressures, bolts = enumerate(scene.statics.pressures, 1), enumerate(scene.statics.bolts, 1)
        used += [(f"[[statics.pressures]] {i}", entry.group, "a pressure acts on faces") for i, entry in pressures]
        used += [(f"[[statics.bolts]] {i}", entry.group, "a bolt is cut by faces across its shank") for i, entry in bolts]
    return [
        f"{where} group = {group!r}: these are the elements of a body, and {what}; name a group of them"
        for where, group, what in used
        if group in bodies
    ]


def _same_bolts(statics: Statics) -> list[str]:
    """Return mistakes: bolts that share a cut or a name."""
    mistakes = []
    for key in ("group", "name"):
        counts = Counter(value for bolt in statics.bolts if (value := getattr(bolt, key)) is not None)
        mistakes += [
            f'[[statics.bolts]] {key} = "{repeated}" is used {n} times; each bolt needs its own'
            for repeated, n in counts.items()
            if n > 1
        ]
    return mistakes


def base(scene: Scene) -> list[str]:
    """Return mistakes: an accelerated base without supports, or absolute outputs without a base motion."""
    moving = [(where, load) for where, load in numbered(scene, "loads") if load.base_acceleration is not None]
    absolute = [(where, output) for where, output in numbered(scene, "outputs") if output.absolute]
    mistakes = []
    has_base = scene.supports or scene.awaits_file
    if moving and scene.model.mesh is not None and not has_base and not any(joint.against for joint in scene.joints):
        mistakes.append(f"{moving[0][0]} base_acceleration: there are no [[supports]], which are the base that moves")
    for where, output in absolute if scene.model.mesh is not None else ():
        if not moving:
            mistakes.append(f"{where} absolute: no load has a base_acceleration, and the base is at rest; leave it out")
        elif output.quantity != "acceleration" and any(load.harmonic == 0 for _, load in moving):
            mistakes.append(
                f"{where} absolute: under a constant base_acceleration (harmonic = 0) {output.quantity} grows without end; "
                'state quantity = "acceleration", or use the motion relative to the base'
            )
    return mistakes


def outputs(scene: Scene) -> list[str]:
    """Return mistakes: outputs of bodies and joints that do not exist."""
    mistakes = []
    joints = [joint.name for joint in scene.joints]
    for where, output in numbered(scene, "outputs"):
        for key, name, known in (("body", output.body, list(scene.bodies)), ("joint", output.joint, joints)):
            if name is not None and name not in known and not scene.awaits_file:
                mistakes.append(f'{where} {key} = "{name}": there is no such {key}{hint(name, known)}')
    return mistakes


def surfaces(scene: Scene) -> list[str]:
    """Return mistakes: surfaces of bodies that do not exist."""
    mistakes = []
    for where, surface in numbered(scene, "surfaces"):
        for name in dict.fromkeys(surface.bodies):
            if name not in scene.bodies and not scene.awaits_file and scene.model.mesh is not None:
                mistakes.append(f'{where} bodies holds "{name}": there is no such body{hint(name, scene.bodies)}')
    return mistakes


def _axis(scene: Scene) -> list[str]:
    """Return mistakes: an axis without rotation, or a rotation without an axis."""
    turned = [where for where, load in numbered(scene, "loads") if load.engine_order is not None]
    if scene.model.axis is None:
        return [
            f"{where} engine_order: [model] axis is missing, the direction of the axis of rotation [x, y, z]" for where in turned
        ]
    if scene.statics is None and not turned and not scene.awaits_file:
        return ["[model] axis: nothing turns; state [statics] rotation_speed, or leave the axis out"]
    return []


def remarks(scene: Scene) -> list[str]:
    """Return notes on keys without effect in a consistent scene, one text each.  Local."""
    turns = scene.statics is not None and scene.statics.rotation_speed > 0.0
    turns = turns or any(load.engine_order is not None for load in scene.loads)
    if scene.model.axis is None or turns:
        return []
    return ["[model] axis: nothing turns about it; [statics] rotation_speed is not stated, or 0"]


def points(scene: Scene) -> list[str]:
    """Return mistakes: points that do not exist, cannot be supported, or have an inertia in a rotating structure."""
    mistakes, points = [], {point.name: point for point in scene.points}
    used = [*numbered(scene, "supports", "loads", "outputs", "masses")]
    if scene.statics is not None:
        used += [(f"[[statics.forces]] {i}", force) for i, force in enumerate(scene.statics.forces, 1)]
    named = [(where, entry.point) for where, entry in used if entry.point is not None]
    named += [(where, name) for where, spring in numbered(scene, "springs") for name in spring.points]
    for where, name in named:
        if name not in points and scene.model.mesh is not None and not scene.awaits_file:
            known = f"; known: {', '.join(points)}" if points else "; there are no [[points]] at all"
            mistakes.append(f'{where} point = "{name}": there is no such point{hint(name, points) or known}')
    for where, support in numbered(scene, "supports"):
        if support.point in points and points[support.point].connection == "distributing":
            mistakes.append(
                f'{where} point = "{support.point}": a distributing point follows its nodes and cannot be held; take '
                'connection = "rigid", or give the point a stiffness'
            )
    if scene.statics is not None and scene.statics.rotation_speed > 0.0:
        for where, point in numbered(scene, "points"):
            if point.inertia is not None:
                mistakes.append(
                    f"{where} inertia: with [statics] rotation_speed the inertia of a point would turn, which is not modelled; "
                    "leave it out, or mesh the body"
                )
    return mistakes
