"""Checks across the tables of a scene: references between tables, contradictions, and missing files."""

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, get_args

from ..contact.keys import ELASTIC_COULOMB, ROUGH
from ..messages.words import hint, listed
from ..system.files import NO_FILE
from ..tables.constant_loads import Statics
from ..tables.cyclic import Cyclic
from ..tables.joint import Joint, OfPoints
from ..tables.table import any_of
from .inputs import may_know_nodes, named_files
from .schema import Scene
from .wear import ARCHARD, ENERGY, Wear

OF_DISCS = ("receptance", "adaptive", "adaptive-energy")  # methods with the basis of the stuck structure


def contradictions(scene: Scene) -> list[str]:
    """Return the contradictions between the tables of a scene, one text each.  Local."""
    of_kind = _of_matrices if scene.model.mesh is None else _of_a_mesh
    checks: tuple[Callable[[Scene], Iterable[str]], ...] = (
        *(_materials, _same_groups, _same_names, _harmonics, _constant_loads, _base, _outputs, _surfaces, _statics),
        *(_volumes_as_faces, _points, _bars, _peaks, _stability, _sensitivities, _over, _mode, _wear, _disc, of_kind, _damping),
    )
    return [text for check in checks for text in check(scene)]


def _of_a_mesh(scene: Scene) -> list[str]:
    """Return mistakes: tables missing with a mesh, and keys that belong to matrices."""
    mistakes = (
        [] if scene.bodies or scene.awaits_file else [f"[bodies] is missing: expected {Scene.model_fields['bodies'].description}"]
    )
    for where, joint in _numbered(scene, "joints"):
        if joint.pairs is not None:
            mistakes.append(f"{where} pairs: belongs to a model given as matrices; with a mesh, name two surfaces")
        if joint.node_pairs is not None:
            mistakes.append(f"{where} node_pairs: belongs to a model given as matrices; with a mesh, name two surfaces")
    for where, entry in _numbered(scene, "loads", "outputs"):
        if entry.dof is not None:
            mistakes.append(f"{where} dof: belongs to a model given as matrices; with a mesh, name a position or a node")
    return mistakes


def _of_matrices(scene: Scene) -> list[str]:
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
    for where, joint in _numbered(scene, "joints"):
        if joint.surfaces is not None and not (knows_nodes and has_mesh):
            mistakes.append(f"{where} surfaces: belongs to a mesh; with matrices, give pairs, the path of a CSV file")
        if joint.node_pairs is not None and not knows_nodes:
            mistakes.append(f"{where} node_pairs: the matrices have no nodes; state [model] dofs, node and direction of each row")
    for where, entry in _numbered(scene, "loads", "outputs"):
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


def _numbered(scene: Scene, *tables: str) -> list[tuple[str, Any]]:
    """Return the entries of some lists of tables, each with its header for messages."""
    return [
        (f"[[{table}]] {number}" + (f' ("{name}")' if (name := getattr(entry, "name", None)) else ""), entry)
        for table in tables
        for number, entry in enumerate(getattr(scene, table), 1)
    ]


def _damping(scene: Scene) -> list[str]:
    """Return mistakes: damping that is missing or stated twice."""
    if scene.damping is None and scene.model.damping is None:
        return [f"[damping] is missing: expected {Scene.model_fields['damping'].description}"]
    if scene.damping is not None and scene.model.damping is not None:
        return ["[damping]: the model also has a damping matrix, [model] damping; state only one of them"]
    return []


def _materials(scene: Scene) -> list[str]:
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


def _same_groups(scene: Scene) -> list[str]:
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


def _same_names(scene: Scene) -> list[str]:
    """Return mistakes: joints and outputs that share a name."""
    mistakes = []
    for table in ("joints", "outputs", "surfaces", "ties", "points"):
        counts = Counter(entry.name for entry in getattr(scene, table) if entry.name is not None)
        mistakes += [f'[[{table}]] name = "{name}" is used {n} times; each needs its own' for name, n in counts.items() if n > 1]
    return mistakes


def _harmonics(scene: Scene) -> list[str]:
    """Return mistakes: loads in a harmonic outside the solution, and error bars with a list of harmonics."""
    stated = scene.solver.harmonics
    text, remedy = (f"{list(stated)}", "add it") if isinstance(stated, tuple) else (f"{stated}", "raise that")
    change = "change" if isinstance(stated, tuple) else "lower"
    mistakes = [
        f"[[loads]] {number} harmonic = {load.harmonic}: [solver] harmonics = 0 is a static balance, in which nothing vibrates; "
        f"state at least {load.harmonic}, or harmonic = 0 of a constant load"
        if scene.is_static
        else f"[[loads]] {number} harmonic = {load.harmonic}: [solver] harmonics = {text} leaves it out; {remedy}, or {change} "
        "the load's harmonic"
        for number, load in enumerate(scene.loads, 1)
        if load.harmonic not in scene.chosen_harmonics
    ]
    if scene.leaves_harmonics_out and scene.solver.error_bars:
        mistakes.append(
            f"[solver] harmonics = {text} leaves harmonics out, which error bars do not cover: state error_bars = false, or "
            f"harmonics = {scene.harmonics}"
        )
    return mistakes


def _statics(scene: Scene) -> list[str]:
    """Return mistakes: static preloads without statics, a speed without an axis, temperatures without expansion."""
    statics, mistakes = scene.statics, _axis(scene)
    for where, joint in _numbered(scene, "joints"):
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


def _volumes_as_faces(scene: Scene) -> list[str]:
    """Return mistakes: pressures, joints, ties and bolts that name the elements of a body where faces are meant."""
    bodies = {body.group for body in scene.bodies.values()}
    used = [(where, group, "a joint has faces") for where, joint in _numbered(scene, "joints") for group in joint.surfaces or ()]
    used += [
        (where, group, "a tie has faces or their nodes") for where, tie in _numbered(scene, "ties") for group in tie.surfaces
    ]
    used += [
        (where, load.group, "a pressure acts on faces") for where, load in _numbered(scene, "loads") if load.pressure is not None
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


def _base(scene: Scene) -> list[str]:
    """Return mistakes: an accelerated base without supports, or absolute outputs without a base motion."""
    moving = [(where, load) for where, load in _numbered(scene, "loads") if load.base_acceleration is not None]
    absolute = [(where, output) for where, output in _numbered(scene, "outputs") if output.absolute]
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


def _outputs(scene: Scene) -> list[str]:
    """Return mistakes: outputs of bodies and joints that do not exist."""
    mistakes = []
    joints = [joint.name for joint in scene.joints]
    for where, output in _numbered(scene, "outputs"):
        for key, name, known in (("body", output.body, list(scene.bodies)), ("joint", output.joint, joints)):
            if name is not None and name not in known and not scene.awaits_file:
                mistakes.append(f'{where} {key} = "{name}": there is no such {key}{hint(name, known)}')
    return mistakes


def _surfaces(scene: Scene) -> list[str]:
    """Return mistakes: surfaces of bodies that do not exist."""
    mistakes = []
    for where, surface in _numbered(scene, "surfaces"):
        for name in dict.fromkeys(surface.bodies):
            if name not in scene.bodies and not scene.awaits_file and scene.model.mesh is not None:
                mistakes.append(f'{where} bodies holds "{name}": there is no such body{hint(name, scene.bodies)}')
    return mistakes


def _axis(scene: Scene) -> list[str]:
    """Return mistakes: an axis without rotation, or a rotation without an axis."""
    turned = [where for where, load in _numbered(scene, "loads") if load.engine_order is not None]
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


def _points(scene: Scene) -> list[str]:
    """Return mistakes: points that do not exist, cannot be supported, or have an inertia in a rotating structure."""
    mistakes, points = [], {point.name: point for point in scene.points}
    used = [*_numbered(scene, "supports", "loads", "outputs", "masses")]
    if scene.statics is not None:
        used += [(f"[[statics.forces]] {i}", force) for i, force in enumerate(scene.statics.forces, 1)]
    named = [(where, entry.point) for where, entry in used if entry.point is not None]
    named += [(where, name) for where, spring in _numbered(scene, "springs") for name in spring.points]
    for where, name in named:
        if name not in points and scene.model.mesh is not None and not scene.awaits_file:
            known = f"; known: {', '.join(points)}" if points else "; there are no [[points]] at all"
            mistakes.append(f'{where} point = "{name}": there is no such point{hint(name, points) or known}')
    for where, support in _numbered(scene, "supports"):
        if support.point in points and points[support.point].connection == "distributing":
            mistakes.append(
                f'{where} point = "{support.point}": a distributing point follows its nodes and cannot be held; take '
                'connection = "rigid", or give the point a stiffness'
            )
    if scene.statics is not None and scene.statics.rotation_speed > 0.0:
        for where, point in _numbered(scene, "points"):
            if point.inertia is not None:
                mistakes.append(
                    f"{where} inertia: with [statics] rotation_speed the inertia of a point would turn, which is not modelled; "
                    "leave it out, or mesh the body"
                )
    return mistakes


def _constant_loads(scene: Scene) -> list[str]:
    """Return mistakes: statics with a method that selects pairs by dissipation, or that carries loads by modes only."""
    solver = scene.solver
    if not scene.is_static:
        return []
    if solver.method == "adaptive-energy" and not solver.in_point_check:
        return [
            '[solver] method = "adaptive-energy": with harmonics = 0 no pair dissipates, and pairs that slide would be dropped; '
            'take "receptance", or in_point_check = true'
        ]
    if solver.method in ("craig-bampton", "rubin") and solver.modes is None:
        return [
            f'[solver] modes is missing: with harmonics = 0 the modes of method = "{solver.method}" carry the load, and '
            'accuracy does not choose their number; state it, or take "receptance", which is exact with any number'
        ]
    return []


def _bars(scene: Scene) -> list[str]:
    """Return mistakes: error bars that are needed but off; accuracy_of without an accuracy."""
    if scene.solver.accuracy_of != "amplitude" and scene.accuracy is None:
        return ["[solver] accuracy_of has no effect without accuracy; state accuracy, or leave accuracy_of out"]
    if scene.solver.error_bars or not (scene.chooses("harmonics") or scene.chooses("samples")):
        return []
    return ["[solver] error_bars = false: accuracy chooses harmonics and samples by them; leave error_bars out, or state both"]


def _stability(scene: Scene) -> list[str]:
    """Return mistakes: stability without vibration, of one sector of a disc, or with structural damping."""
    if not scene.response.stability:
        return []
    begin = "[response] stability = true: "
    if scene.is_static:
        return [f"{begin}with harmonics = 0 nothing vibrates, so that there is no cycle; leave stability out"]
    if scene.cyclic is not None and not scene.cyclic.whole:
        return [
            f"{begin}a disturbance need not be a wave, and the model has one sector; state [cyclic] whole = true, or leave "
            "stability out"
        ]
    if scene.damping is not None and scene.damping.structural:
        return [
            f"{begin}a loss factor, [damping] structural, is only defined for steady vibration and has no equivalent in time; "
            "state ratio in its place, of about half the loss factor, or leave stability out"
        ]
    return []


def _sensitivities(scene: Scene) -> list[str]:
    """Return mistakes: derivatives of what does not vibrate."""
    if not (scene.response.sensitivities and scene.is_static):
        return []
    return ["[response] sensitivities = true: with harmonics = 0 nothing vibrates; leave sensitivities out"]


def _peaks(scene: Scene) -> list[str]:
    """Return mistakes: peaks without vibration, or of a method with pairs selected from the previous point."""
    stated = {"[response] peaks = true": scene.response.peaks, "[[response.over]]": scene.response.over}
    where = next((where for where, is_stated in stated.items() if is_stated), None)
    if where is None:
        return []
    if scene.is_static:
        return [f"{where}: with harmonics = 0 nothing vibrates, and there is no peak; leave peaks out"]
    if scene.solver.method in ("adaptive", "adaptive-energy"):
        return [f'{where}: method = "{scene.solver.method}" selects its pairs at the previous point; take "receptance"']
    return []


def _over(scene: Scene) -> list[str]:
    """Return mistakes: a key that the scene does not have, or that the state of rest depends on."""
    mistakes, names = [], {joint.name for joint in scene.joints}
    outputs = [output.name for output in scene.outputs]
    for i, over in enumerate(scene.response.over, 1):
        where = f"[[response.over]] {i}"
        if over.output is not None and over.output not in outputs:
            mistakes.append(f"{where} output: there is no output {over.output!r}{hint(over.output, outputs)}")
        if over.key == "level":
            continue
        known = ["level", "damping", "damping.ratio"]
        known += [f"joints.{name}.{key}" for name in sorted(names) for key in get_args(OfPoints)]
        if over.key not in known:
            mistakes.append(f"{where} key: there is no number {over.key!r}{hint(over.key, known)}")
        elif over.key in ("damping", "damping.ratio"):
            mistakes += [f"{where} key: {problem}" for problem in _of_damping(scene, over.key)]
        elif scene.statics is not None:
            mistakes.append(f"{where} key: with [statics] the state of rest depends on {over.key}; follow peaks over the level")
    return mistakes


def _of_damping(scene: Scene, key: str) -> list[str]:
    """Return mistakes: peaks over a damping that is not there, is not viscous, or is not the ratio alone."""
    stated = {} if scene.damping is None else {name: value for name, value in scene.damping if value}
    if stated.get("structural"):
        return ["peaks are followed over viscous damping alone; state [damping] ratio in the place of structural"]
    if key == "damping.ratio" and set(stated) != {"ratio"}:
        return ["[damping] ratio is not the only damping here; take damping, a factor of all viscous damping"]
    return []


def _mode(scene: Scene) -> list[str]:
    """Return mistakes: a range around a mode beyond the computed ones."""
    mode, modes = scene.response.mode, scene.solver.modes
    return [f"[response] mode = {mode}: only [solver] modes = {modes} are computed"] if mode and modes and mode > modes else []


def _wear(scene: Scene) -> list[str]:
    """Return mistakes of [wear]: joints and outputs that are not there, scenes that it does not support."""
    wear, mistakes = scene.wear, list[str]()
    if wear is None:
        return []
    names, outputs = [joint.name for joint in scene.joints], [output.name for output in scene.outputs]
    for key in ("coefficient", "area"):
        stated = getattr(wear, key)
        for name in stated if isinstance(stated, dict) and not scene.awaits_file else ():
            if name not in names:
                mistakes.append(f"[wear] {key}: there is no joint {name!r}{hint(name, names)}")
    mistakes += [mistake for joint in scene.joints for mistake in _worn_joint(scene, wear, joint)]
    if wear.output is not None and wear.output not in outputs:
        mistakes.append(f"[wear] output: there is no output {wear.output!r}{hint(wear.output, outputs)}")
    low, high = scene.response.frequencies or (0.0, math.inf)
    if wear.frequency is not None and not low <= wear.frequency <= high:
        mistakes.append(f"[wear] frequency = {wear.frequency:g} Hz: outside [response] frequencies = [{low:g}, {high:g}]")
    if scene.is_static:
        mistakes.append("[wear]: with harmonics = 0 nothing vibrates, and nothing slides; leave [wear] out")
    if scene.cyclic is not None:
        mistakes.append("[wear]: a disc is not supported: each sector would wear by its own response; leave [cyclic] out")
    if scene.solver.method in ("adaptive", "adaptive-energy"):
        mistakes.append(
            f'[wear]: method = "{scene.solver.method}" takes its pairs from the point before, and a jump of cycles has none; '
            'take "receptance"'
        )
    return mistakes


def _worn_joint(scene: Scene, wear: Wear, joint: Joint) -> list[str]:
    """Return mistakes: a joint without a coefficient, or that wear is not computed of."""
    where, coefficient = f"[wear] coefficient: joint {joint.name!r}", wear.coefficient_of(joint.name)
    if coefficient is None:
        return [f"{where} has none; state 0 if it does not wear"]
    if joint.law == ROUGH and scene.statics is None:
        return [
            f'[wear]: the springs of joint {joint.name!r}, law = "{ROUGH}", follow from a preload that wear changes; they are '
            "computed again with [statics] alone"
        ]
    if coefficient == 0.0:
        return []
    if joint.law != ELASTIC_COULOMB:
        return [
            f'{where} has law = "{joint.law}", whose limits do not follow from a worn shape; wear is computed with law = '
            f'"{ELASTIC_COULOMB}"; state 0 if it does not wear'
        ]
    if wear.law == ARCHARD and isinstance(joint.friction, tuple):
        return [
            f'[wear] law = "{ARCHARD}": joint {joint.name!r} has two friction coefficients, and its friction energy is no '
            f'multiple of normal force times slip distance; take law = "{ENERGY}"'
        ]
    if scene.statics is not None and isinstance(joint.preload, float) and joint.preload > 0.0:
        return [
            f"{where} states preload = {joint.preload:g} with [statics]: the cause of the pressure, and its change with "
            'wear, are unknown; state preload = "static" and the loads, or no [statics]'
        ]
    return []


def _disc(scene: Scene) -> list[str]:
    """Return mistakes: tables and keys that a disc computed from one sector cannot have."""
    cyclic, mistakes = scene.cyclic, []
    if cyclic is None:
        return [
            f"{where} next_sector: there is no table [cyclic], which states the position of the next sector"
            for where, joint in _numbered(scene, "joints")
            if joint.next_sector
        ]
    if scene.is_static:
        mistakes.append("[cyclic]: [solver] harmonics = 0 is a static equilibrium without waves; state at least 1")
    if scene.statics is not None and scene.statics.rotation_speed > 0.0 and scene.model.axis is not None:
        mistakes += _other_axis(cyclic, scene.model.axis, scene.model.axis_point)
    if scene.solver.method not in OF_DISCS:
        mistakes.append(
            f'[solver] method = "{scene.solver.method}": with [cyclic] each nodal diameter has its own complex matrices, '
            f"which this method does not support; take {any_of(OF_DISCS)}"
        )
    for where, load in _numbered(scene, "loads"):
        if load.base_acceleration is not None:
            mistakes.append(
                f"{where} base_acceleration: a moving base is not a wave of the sectors of [cyclic]; state forces or a pressure"
            )
    if cyclic.faces is None and not any(joint.next_sector for joint in scene.joints):
        mistakes.append(
            f"[cyclic] faces is missing: expected {type(cyclic).model_fields['faces'].description}, and no joint has next_sector"
        )
    mistakes += _whole_disc(scene) if cyclic.whole else []
    loaded = {min(d := cyclic.diameter(load.harmonic), cyclic.sectors - d) for load in scene.loads}
    if len(loaded) > 1 and scene.solver.modes is None:
        mistakes.append(
            f"[solver] modes is missing: the loads excite the nodal diameters {listed(map(str, sorted(loaded)))} of [cyclic], "
            "but accuracy chooses the modes of only one; state a number"
        )
    return mistakes


def _other_axis(cyclic: Cyclic, axis: Sequence[float], point: Sequence[float]) -> list[str]:
    """Return a mistake where an axis of rotation is another line than the axis of a disc."""
    x, y, z = (component / math.hypot(*cyclic.axis) for component in cyclic.axis)

    def across(v: Sequence[float]) -> float:
        return math.hypot(y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0])

    offset = [a - b for a, b in zip(point, cyclic.axis_point)]
    if across(axis) <= 1e-6 * math.hypot(*axis) and across(offset) <= 1e-6 * max(1.0, math.hypot(*cyclic.axis_point)):
        return []
    return ["[model] axis: a disc turns about the axis of [cyclic], and this is another line; leave axis and axis_point out"]


def _whole_disc(scene: Scene) -> list[str]:
    """Return mistakes: keys that a disc with the pairs of all sectors cannot have."""
    cyclic, damping, mistakes = scene.cyclic, scene.damping, []
    assert cyclic is not None, "a disc"
    unknown = [name for name in cyclic.blades or () if name not in scene.bodies]
    if unknown:
        mistakes.append(f"[cyclic] blades: there is no body {unknown[0]!r}{hint(unknown[0], scene.bodies)}")
    if scene.solver.method != "receptance":
        mistakes.append(f'[solver] method = "{scene.solver.method}": with [cyclic] whole = true take "receptance"')
    if damping is not None and (damping.ratios or damping.modes or damping.structural):
        key = next(key for key in ("ratios", "modes", "structural") if getattr(damping, key))
        mistakes.append(
            f"[damping] {key}: with [cyclic] whole = true the modes of all nodal diameters are those of one disc; state ratio, "
            "or rayleigh"
        )
    if scene.solver.modes is None and any(load.harmonic != 1 for load in scene.loads):
        mistakes.append(
            "[solver] modes is missing: with [cyclic] whole = true accuracy chooses modes only for loads in "
            "harmonic 1; state a number of modes per nodal diameter"
        )
    return mistakes


def missing_files(scene: Scene) -> list[str]:
    """Return the missing files of the scene, one text each.  Local."""
    return [mistake for where, file in named_files(scene) if (mistake := _missing(where, file, scene.folder))]


def _missing(where: str, file: str, folder: Path) -> str | None:
    path = folder / file
    try:
        if path.is_file():
            return None
        fault = "that is a folder; a file is expected" if path.is_dir() else NO_FILE if path.exists() else None
    except (OSError, ValueError) as problem:  # a name too long, or with a null character
        fault = str(problem)
    return f'{where} = "{file}": {fault or absent(path)}'


def absent(path: Path) -> str:
    """Return the message for a missing file, with a similar name in its folder.  Local."""
    folder = path.parent
    if path.is_symlink():
        return f"that is a symbolic link to {os.readlink(path)}, where there is no file"
    if not folder.is_dir():
        return f"there is no folder {folder}"
    try:
        near = hint(path.name, [entry.name for entry in folder.iterdir()])
    except OSError:
        near = ""
    return f"there is no such file in {folder}{near}"
