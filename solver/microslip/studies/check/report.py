"""The report of `check`: content of a scene and resources of a run, as lines."""

from collections.abc import Container

import numpy as np

from ...assembly.assemble import read_off
from ...assembly.matrices import GivenStructure
from ...contact.laws import ELASTIC_COULOMB
from ...continuation.accuracy import MOST_HARMONICS
from ...formats.model import FileModel
from ...library.complete import taken_parts
from ...library.mode_at_rest import has_springs_across_gap
from ...library.settings import reduction_settings, response_settings
from ...mesh.cut import cuts_through
from ...mesh.data import ContactPairs, Mesh
from ...mesh.sector_factors import notes_on_sectors
from ...messages.words import counted, place
from ...modes.limits import FEW, refuse_too_many
from ...reduction.facts import Counts
from ...reduction.methods import METHODS
from ...scene.schema import Scene
from ...scene.solution import ACCURACY_OF_MODES
from ...tables.structure import Mass, Spring
from ...tables.units import UNITS
from ...tables.vibration import Load, Output
from . import model_content as content
from .plausible import SI, suspicion


def description(
    scene: Scene, file: FileModel, mesh: Mesh, pairs: ContactPairs, of_file: tuple[str, ...], stated: Scene
) -> list[str]:
    """Return lines on the content of the scene and the resources of a run.  Local, on rank 0.

    ``of_file``: notes on data taken over from the model file; ``stated``: the scene before its completion by the file.

    Raises
    ------
    MeshError, CaseError : faults of mesh and scene together: free parts, loads or outputs without a node, too many modes
    """
    whole = read_off(mesh, pairs, scene)
    is_fixed, links = whole.is_fixed, whole.links
    volume = content.volumes(mesh, scene.bodies)
    density = {name: scene.materials[body.material].density for name, body in scene.bodies.items()}
    n_dependent = int((~is_fixed.ravel()[links.dependent]).sum())
    n_dof = int((~is_fixed).sum()) - n_dependent
    following = f", {n_dependent} that follow ties or points" if n_dependent else ""
    kinds = ", ".join(f"{len(block.nodes)} {block.kind} in {block.group}" for block in mesh.elements)
    parts = counted(len(whole.part_names), "connected part")
    lines = [
        f"scene      {scene.source}: no fault found",
        f"mesh       {mesh.path}: {counted(len(mesh.points), 'node')}, {kinds}; {parts}",
        f"           from {place(mesh.points.min(axis=0))} to {place(mesh.points.max(axis=0))} m",
        *_suspected(scene, file, mesh, stated.materials, content.mass(volume, density)),
        *(f"           {note}" for note in (*of_file, *mesh.notes)),
        *content.facts(file),
        *content.steps(file, taken_parts(stated, file)),
        *content.bodies(mesh, scene.bodies, volume, density),
        *_materials(scene),
        *content.axes(scene.orientations, scene.bodies),
        *content.groups(mesh, scene.bodies),
        *_supports(mesh, scene),
        *content.table("masses", [_mass(mass) for mass in scene.masses]),
        *content.table("springs", [content.spring(_ends(spring), spring.stiffness, spring.damping) for spring in scene.springs]),
        *content.table("equations", [] if mesh.equations is None else [f"{len(mesh.equations.where)} of the file"]),
        f"unknowns   {n_dof} DOF free, {int(is_fixed.sum())} fixed{following}",
        *(f"           {note}" for note in links.notes),
        *_joints(scene, pairs),
        *(f"           {note}" for note in (*pairs.notes, *notes_on_sectors(scene.cyclic, scene.path), *whole.notes)),
        *_bolts(mesh, scene),
        *(
            f"load {i}     {_load_at(mesh, load, applied.nodes)}"
            for i, (load, applied) in enumerate(zip(scene.loads, whole.loads), 1)
        ),
        *(f"output     {out.name}: {_output_at(mesh, out, row.at)}" for out, row in zip(scene.outputs, whole.outputs)),
        *_solution(scene, n_dof, pairs.n_pairs),
        *_mode_across_gaps(scene, pairs),
    ]
    return lines


def _mass(mass: Mass) -> str:
    return f"{mass.group}: {mass.mass:.6g} kg a node" if mass.point is None else f"point {mass.point}: {mass.mass:.6g} kg"


def _ends(spring: Spring) -> tuple[str, ...]:
    return (*spring.groups, *(f"point {name}" for name in spring.points))


def _suspected(scene: Scene, file: FileModel, mesh: Mesh, stated: Container[str], mass: float) -> list[str]:
    """Return a text on suspected units of the file, or of materials that the scene states."""
    units, used = UNITS[scene.model.units or SI], {body.material for body in scene.bodies.values()}
    of_file = {name: material for name, material in file.materials.items() if name in used and name not in stated}
    of_scene = {name: material for name, material in scene.materials.items() if name in used and name in stated}
    text = suspicion(mesh.diagonal / units.length, of_file, units, mass)
    text = text or suspicion(mesh.diagonal, of_scene, UNITS[SI], mass, by_scene=True)
    return [f"           {text}"] if text else []


def _materials(scene: Scene) -> list[str]:
    """Return a line for each material in use."""
    used = dict.fromkeys(body.material for body in scene.bodies.values())
    return content.materials({name: material for name, material in scene.materials.items() if name in used})


def _supports(mesh: Mesh, scene: Scene) -> list[str]:
    """Return a line for each support."""
    held = [
        f"{support.point or support.group}: {', '.join(support.fix)}"
        + (f", {counted(len(mesh.node_groups[support.group]), 'node')}" if support.group in mesh.node_groups else "")
        for support in scene.supports
    ]
    return content.table("supports", held)


def _bolts(mesh: Mesh, scene: Scene) -> list[str]:
    """Return a line for each bolt.  Local, rank 0."""
    bolts = () if scene.statics is None else scene.statics.bolts
    lines = []
    for bolt, cut in zip(bolts, cuts_through(mesh, bolts)):
        across = place(np.round(cut.normal, 4) + 0.0)
        lines.append(
            f"bolt       {bolt.label}: a cut of {cut.area:.4g} m2 with {counted(len(cut.nodes), 'node')}, across {across}"
        )
    return lines


def description_of_matrices(scene: Scene, given: GivenStructure) -> list[str]:
    """Return the lines of ``description`` for a scene given as matrices.  Local, on rank 0.  Raises CaseError: too many modes."""
    massless = f"; {given.n_massless} DOF without mass" if given.n_massless else ""
    damping = "" if given.C is None else f", damping {given.C.nnz}"
    return [
        f"scene      {scene.source}: no fault found",
        f"matrices   {given.n_dof} DOF{massless}; entries: stiffness {given.K.nnz}, mass {given.M.nnz}{damping}",
        *(f"           {note}" for note in given.notes),
        *_joints(scene, given.pairs),
        *(f"load {i}     {_load_on_dofs(load)}, harmonic {load.harmonic}" for i, load in enumerate(scene.loads, 1)),
        *(f"output     {output.name}: {_output_on(output, _place_of(output))}" for output in scene.outputs),
        *_solution(scene, given.n_dof, given.pairs.n_pairs),
        *_mode_across_gaps(scene, given.pairs),
    ]


def highest_harmonic(scene: Scene) -> int:
    """Return the largest possible number of harmonics of a point."""
    return MOST_HARMONICS if scene.chooses("harmonics") else scene.harmonics


def _listed(scene: Scene) -> str:
    return ", ".join(map(str, scene.chosen_harmonics)) if scene.leaves_harmonics_out else f"0 to {scene.harmonics}"


def resolution(scene: Scene) -> str:
    """Return the harmonics and samples of the points as text."""
    chosen = f"chosen at each point for accuracy {scene.accuracy}"
    stated = "harmonic 0 only: statics" if scene.is_static else f"harmonics {_listed(scene)}"
    harmonics = f"harmonics up to {MOST_HARMONICS}, {chosen}" if scene.chooses("harmonics") else stated
    return f"{harmonics}, {f'samples {chosen}' if scene.chooses('samples') else f'{scene.solver.samples} samples'}"


def _solution(scene: Scene, n_dof: int, n_pairs: int) -> list[str]:
    """Return lines on the method and its size."""
    solver = scene.solver
    refuse_too_many(solver.modes, n_dof, scene.path, scene.response.mode)
    modes = f"number chosen at run time for [solver] accuracy = {scene.accuracy or ACCURACY_OF_MODES:g}"
    if solver.modes or n_dof <= FEW:
        modes = f"{solver.modes}, stated by [solver] modes" if solver.modes else "all"
    n_modes = solver.modes or (n_dof if n_dof <= FEW else 0)
    settings = reduction_settings(scene)
    n_loads = len(settings.excitation.shapes)
    coordinates, with_another_mode = (
        METHODS[solver.method].FACTS.coordinates(settings, Counts(n_modes + more, n_dof, n_pairs, n_loads)) for more in (0, 1)
    )
    unknowns = (2 * highest_harmonic(scene) + 1) * coordinates
    points = "one point, for all frequencies" if scene.is_static else f"about {scene.response.points} points"
    if not scene.is_static and scene.accuracy is not None and response_settings(scene).chooses_steps:
        points = f"as many points as accuracy {scene.accuracy:g} requires"
    has_more = n_modes == 0 and with_another_mode > coordinates
    return [
        f"method     {solver.method}: {resolution(scene)}; at most {unknowns} unknowns "
        f"with all pairs slipping{', in addition to the modes' if has_more else ''}",
        f"modes      {modes}",
        f"response   {counted(len(scene.response.levels), 'level')} of {points}",
    ]


def _mode_across_gaps(scene: Scene, pairs: ContactPairs) -> list[str]:
    """Return a warning if the range lies about a mode that counts with pairs of a gap closed."""
    n, mode = np.count_nonzero(has_springs_across_gap(pairs)), scene.response.mode
    if mode is None or scene.statics is not None or n == 0:
        return []
    closed = f"{counted(n, 'pair')} of a gap closed"
    return [f"           WARNING: mode = {mode} counts with {closed}; a run states its frequency with them open"]


def _joints(scene: Scene, pairs: ContactPairs) -> list[str]:
    by_statics, lines = {joint.name for joint in scene.joints if joint.preload == "static"}, []
    for name, of_joint in pairs.by_joint().items():
        N0, area = pairs.N0[of_joint], pairs.area[of_joint].sum()
        where = f" on {area:.6g} m2" if np.isfinite(area) else ""  # matrices come without areas
        law = "" if pairs.laws[of_joint][0] == ELASTIC_COULOMB else f', law "{pairs.laws[of_joint][0]}"'
        preload = "computed by [statics]" if name in by_statics else f"{N0[N0 > 0].sum():.4g} N in all"
        gaps = f"{np.count_nonzero(N0 < 0)} with a gap"
        lines.append(f"joint      {name}: {counted(len(of_joint), 'pair')}{where}{law}, normal preload {preload}, {gaps}")
    return lines


def _load_on_dofs(load: Load) -> str:
    """Return the place of a load on matrices as text."""
    if load.forces is not None:
        return f"forces of {load.forces}"
    return f"DOF {load.dof}, scale {load.scale:g}" if load.dof is not None else _place_of(load)


def _place_of(entry: Load | Output) -> str:
    """Return the stated place of a load or an output on matrices as text."""
    if entry.dof is not None:
        return f"DOF {entry.dof}"
    group = getattr(entry, "group", None)
    at = f"the nodes of {group}" if group else f"node {entry.node}" if entry.node is not None else f"{entry.position} m"
    return f"{at} along {entry.direction}"


def _load_at(mesh: Mesh, load: Load, nodes: np.ndarray) -> str:
    """Return the place of a load on a mesh as text."""
    if load.base_acceleration is not None:
        return f"acceleration of the supports along {place(load.base_acceleration)}"
    if load.forces is not None:
        return f"forces on {counted(len(np.unique(nodes)), 'node')}, from {load.forces}"
    if load.pressure is not None:
        return f"pressure of {load.pressure:g} Pa a unit of level on {load.group}, {counted(len(np.unique(nodes)), 'node')}"
    return _at(mesh, load, nodes)


def _output_at(mesh: Mesh, output: Output, node: int) -> str:
    """Return kind and place of an output on a mesh as text."""
    return _output_on(output, "" if node < 0 else _at(mesh, output, np.array([node])))


def _output_on(output: Output, where: str) -> str:
    """Return kind and place of an output as text; only the place for a displacement."""
    if output.joint is not None:
        along = "normal" if output.direction is None else f"along {place(output.direction)}"
        return f"contact force of {output.joint}, {along}"
    if output.quantity == "displacement":
        return where
    return f"{output.quantity}{f' {output.component}' if output.component else ''}, {where}"


def _at(mesh: Mesh, entry, nodes: np.ndarray) -> str:
    """Return the place of a load or an output as text."""
    if entry.point is not None:
        return f"point {entry.point}"
    if len(nodes) > 1:
        return f"shared by {counted(len(nodes), 'node')} of {entry.group}"
    text = f"node {mesh.numbers[nodes[0]]} at {place(mesh.points[nodes[0]])} m"
    if entry.position is not None:
        text += f", {np.linalg.norm(mesh.points[nodes[0]] - np.array(entry.position)):.3g} m from the requested position"
    return text
