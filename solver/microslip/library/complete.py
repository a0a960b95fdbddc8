"""A scene completed by its model file: materials, bodies, supports and more that the file states and the scene does not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..formats.model import FileModel, Finding
from ..formats.read import read_model
from ..messages.errors import CaseError, Faults
from ..messages.words import counted, hint, listed, verb
from ..parallel.agree import on_root
from ..scene.checks.structure import remarks
from ..scene.read import completed
from ..scene.schema import Scene
from ..tables.joint import Joint
from ..tables.structure import Material, Tie
from ..tables.units import UNITS, Units, times

if TYPE_CHECKING:
    from mpi4py import MPI

Tables = dict[str, Any]  # of a scene, as its file would state them
_PARTS = ("materials", "bodies", "supports", "ties", "joints", "points", "masses", "springs", "statics")


def read_completed(scene: Scene, comm: MPI.Comm) -> tuple[FileModel | None, Scene, tuple[str, ...]]:
    """Return the model file of a scene, on rank 0 alone, the scene completed by it, and notes for the log.

    Collective on ``comm``.

    Raises
    ------
    CaseError, MeshError : as ``read_model`` and :func:`complete`, on every rank
    """
    assert scene.model.mesh is not None, "a scene with a mesh"
    model = on_root(comm, read_model, scene.folder / scene.model.mesh, scene.model.step, share=False)
    completed, notes = on_root(comm, complete, scene, model)
    return None if model is None else held_by(scene, model), completed, (*notes, *remarks(completed))


def completed_scene(scene: Scene, comm: MPI.Comm) -> Scene:
    """Return the scene completed by its model file, which is read only where it may add to the scene.

    Collective.  Raises as :func:`read_completed`.
    """
    return read_completed(scene, comm)[1] if scene.awaits_file else scene


def held_by(scene: Scene, model: FileModel) -> FileModel:
    """Return the model without its supports in rotated axes (which are equations), if the scene states supports itself.

    Local, rank 0.
    """
    if model.equations is None or "supports" in taken_parts(scene, model):
        return model
    return replace(model, equations=model.equations.without_supports())


def complete(scene: Scene, model: FileModel) -> tuple[Scene, tuple[str, ...]]:
    """Return the scene completed by the model file and validated again, and notes for the log.  Local, rank 0.

    The scene takes precedence: its bodies and supports replace those of the file, and its material replaces one of the same
    name; everything else is added. ``[model] take`` states which parts of the file are used; parts stated there are added
    to those of the scene in any case.

    Raises
    ------
    CaseError : the file has keywords that would change the results and are not used, or the completed scene is invalid
    """
    if scene.is_complete:
        return scene, ()
    file_parts = taken_parts(scene, model)
    notes = _refuse_findings(scene, model, file_parts)
    if not scene.awaits_file:
        return scene, tuple(notes)
    tables = {name: value for name, value in scene.model_dump(exclude_unset=True).items() if value}
    for part in _PARTS:
        entries = _tables_of(scene, model, part) if part in file_parts else ()
        if entries:
            _refuse_unknown_units(scene, part)
            tables[part] = _joined(entries, tables.get(part))
            summary = (
                _summary_of_statics(model)
                if part == "statics"
                else counted(len(entries), "body" if part == "bodies" else part[:-1])
            )
            notes.append(f"{summary} taken over from {scene.model.mesh}" + (f": {_named(entries)}" if part != "statics" else ""))
    if "statics" in file_parts:
        tables["model"] = {**_axis(model, _units(scene)), **tables["model"]}
    notes += _equations(model, scene, "supports" in file_parts)
    tables["orientations"] = _joined(_tables_of(scene, model, "orientations"), tables.get("orientations"))
    for part in ("materials", "orientations"):
        used = {body.get(part[:-1]) for body in tables.get("bodies", {}).values()}
        tables[part] = {name: entry for name, entry in tables.get(part, {}).items() if name in used}
    _refuse_incomplete(scene, {name: material for name, material in model.materials.items() if name in tables["materials"]})
    return completed(scene, tables), tuple(notes)


def _equations(model: FileModel, scene: Scene, takes_supports: bool) -> list[str]:
    """Return notes on the equations of the file, including those of supports in rotated axes.

    Raises
    ------
    CaseError : supports of the file are used, but not those that are equations
    """
    n = 0 if model.equations is None else len(model.equations.where)
    n_held = 0 if model.equations is None else model.equations.n_supports
    if "equations" not in scene.model.take:
        if n_held and takes_supports:
            raise CaseError(
                f"{scene.path}: [model] take: {counted(n_held, 'support')} of {scene.model.mesh} {verb(n_held, 'are')} "
                "in turned axes, which takes "
                'equations; add "equations", or leave out "supports" and state [[supports]]'
            )
        return []
    n_left = 0 if takes_supports else n_held
    notes = [f"{counted(n - n_left, 'equation')} taken over from {scene.model.mesh}"] if n > n_left else []
    if n_left:
        notes.append(
            f"{counted(n_left, 'support')} in turned axes of {scene.model.mesh} {verb(n_left, 'are')} left out, as its others are"
        )
    return notes


def _joined(of_file: Any, of_scene: Any) -> Any:
    """Return the entries of both; the scene takes precedence for a name in both, and lists are concatenated."""
    if not isinstance(of_file, dict):
        return (*of_file, *(of_scene or ()))
    lists = {key: (*of_file[key], *values) for key, values in (of_scene or {}).items() if isinstance(of_file.get(key), tuple)}
    return {**of_file, **(of_scene or {}), **lists}


def _named(entries: Any) -> str:
    """Return the names of some entries, or of the groups on which they act."""
    names = list(entries) if isinstance(entries, dict) else [_name(entry) for entry in entries]
    return ", ".join(names[:10]) + (f", ... ({len(names)} in all)" if len(names) > 10 else "")


def _name(entry: Tables) -> str:
    return (
        entry.get("name")
        or entry.get("group")
        or entry.get("point")
        or " to ".join(entry.get("surfaces") or entry.get("groups") or ())
    )


def taken_parts(scene: Scene, model: FileModel) -> set[str]:
    """Return the parts of the file's model that are taken over.  Local."""
    is_stated = "take" in scene.model.model_fields_set
    stated = {"bodies": scene.bodies, "supports": scene.supports, "statics": scene.statics}
    parts: set[str] = {part for part in scene.model.take if is_stated or not stated.get(part)}
    return parts - {"statics"} if _ignores_statics(scene, model) else parts


def _ignores_statics(scene: Scene, model: FileModel) -> bool:
    """Return whether the scene ignores the static loads of the file explicitly."""
    return model.statics is not None and _bare(model.statics.word) in map(_bare, scene.model.ignore)


def _refuse_findings(scene: Scene, model: FileModel, file_parts: set[str]) -> list[str]:
    """Return notes on the keywords that are left out.

    Raises
    ------
    CaseError : a keyword changes the results and the scene does not list it in ``ignore``; an entry of ``ignore`` without effect
    """
    findings, ignored = model.findings, {_bare(word): word for word in scene.model.ignore}
    held = {_bare(finding.word) for finding in findings}
    for bare, word in ignored.items():
        if bare not in held:
            near = hint(word, [finding.word for finding in findings])
            raise CaseError(f'{scene.path}: [model] ignore: {scene.model.mesh} holds no "{word}" that is left out{near}')
    answered = {model.statics.word, model.statics.large} if model.statics is not None and "statics" in file_parts else set()
    needed = {"statics"} if scene.statics is None and not _ignores_statics(scene, model) else set()
    needed |= {"cyclic"} if scene.cyclic is None else set()
    of_file = [frozenset(joint.surfaces or ()) for joint in _joints(scene, model)]
    between = _joined_surfaces(scene) + of_file
    wrong = [
        finding
        for finding in findings
        if finding.changes
        and _bare(finding.word) not in ignored
        and finding.word not in answered
        and finding.part in {"", *file_parts, *needed}
        and not (finding.surfaces and frozenset(finding.surfaces) in between)
    ]
    if wrong:
        lines = [f"{each.where}: {each.word}: {each.effect}" for each in wrong[:20]]
        more = [f"... and {len(wrong) - 20} more"] if len(wrong) > 20 else []
        words = listed([f'"{word}"' for word in dict.fromkeys(each.word for each in wrong)], "and")
        raise CaseError(
            "\n  ".join(
                [
                    f"{scene.folder / (scene.model.mesh or '')}: {counted(len(wrong), 'entry')} {verb(len(wrong), 'are')} not "
                    "modelled and would change the answer; state in the scene what is meant, or leave it out on purpose: "
                    f"[model] ignore takes {words}",
                    *lines,
                    *more,
                ]
            )
        )
    answered -= set(ignored.values())
    left_out = [each for each in findings if each.word not in answered and frozenset(each.surfaces) not in of_file]
    return [f"{each.where}: {each.word}{_fate(each, between)}" for each in left_out]


def _fate(finding: Finding, between: list[frozenset[str]]) -> str:
    """Return whether the scene replaces an entry of the file, or its effect in the file's program, as text."""
    if finding.surfaces and frozenset(finding.surfaces) in between:
        return f" is replaced by a joint or tie of the scene between {' and '.join(finding.surfaces)}"
    return f"{'' if finding.is_taken else ' is left out'}: {finding.effect}"


def _bare(word: str) -> str:
    return "".join(word.upper().lstrip("*").split())


def _refuse_unknown_units(scene: Scene, part: str) -> None:
    """Raise CaseError if quantities with units are used from a file for which only the length unit is stated."""
    if part not in ("ties", "supports", "bodies", "equations") and scene.model.units is None and scene.model.scale != 1.0:
        raise CaseError(
            f"{scene.path}: [model] scale states the length unit of {scene.model.mesh} alone, and its {part} have units, too; "
            f"state units = {listed([repr(name) for name in UNITS], 'or')} in place of scale, or state {part} in the scene and "
            "leave them out of [model] take"
        )


def _refuse_incomplete(scene: Scene, materials: Mapping[str, Material]) -> None:
    """Raise CaseError for incomplete materials of the file that the scene does not state."""
    faults = Faults()
    for name, material in materials.items():
        if material.lacking and name not in scene.materials:
            text = f"{scene.path}: material {name!r} of {scene.model.mesh} has no {listed(material.lacking)}; "
            faults.add([CaseError(f"{text}state [materials.{name}] in the scene")])
    faults.refuse()


def _joined_surfaces(scene: Scene) -> list[frozenset[str]]:
    """Return the surfaces that the scene joins or ties."""
    surfaces = [joint.surfaces for joint in scene.joints] + [tie.surfaces for tie in scene.ties]
    return [frozenset(names) for names in surfaces if names is not None]


def _units(scene: Scene) -> Units:
    """Return the units of the model file; [model] scale states the length unit only."""
    return Units(scene.model.scale, 1.0) if scene.model.units is None else UNITS[scene.model.units]


def _ties(scene: Scene, model: FileModel) -> list[Tie]:
    """Return the ties of the file between surfaces that the scene does not join."""
    between = _joined_surfaces(scene)
    return [tie for tie in model.ties if frozenset(tie.surfaces) not in between]


def _joints(scene: Scene, model: FileModel) -> list[Joint]:
    """Return the joints of the file that are used: the completely defined ones, if there are loads at rest."""
    file_parts, between = taken_parts(scene, model), _joined_surfaces(scene)
    has_loads = scene.statics is not None or ("statics" in file_parts and model.statics is not None and model.statics.acts)
    if "joints" not in file_parts or not has_loads:
        return []
    ignored = set(map(_bare, scene.model.ignore))
    left_out = [frozenset(joint.surfaces) for joint in model.findings if joint.surfaces and _bare(joint.word) in ignored]
    return [joint for joint in model.joints if not joint.lacking and frozenset(joint.surfaces or ()) not in [*between, *left_out]]


def _statics(scene: Scene, model: FileModel) -> Tables:
    """Return the constant loads that act before and during the vibration."""
    statics = model.statics
    if statics is None or not statics.acts:
        return {}
    is_large = statics.large and _bare(statics.large) not in map(_bare, scene.model.ignore)
    about = "large_displacements" if is_large else "deformed_shape"
    return {**{key: value for key, value in statics.table.in_si(_units(scene)).items() if value}, about: True}


def _axis(model: FileModel, units: Units) -> Tables:
    """Return the axis of rotation of the file, as keys of [model]."""
    statics = model.statics
    if statics is None or not statics.table.rotation_speed:
        return {}
    return {"axis": statics.axis, "axis_point": times(statics.axis_point, units.length)}


def _summary_of_statics(model: FileModel) -> str:
    """Return a summary of the loads that became [statics]."""
    statics = model.statics
    assert statics is not None, "a file with loads"
    return f"[statics] with {listed(statics.kinds, 'and')} of step {statics.step}"


def _tables_of(scene: Scene, model: FileModel, part: str) -> Any:
    """Return a part of the model file as the scene's table of that name."""
    if part == "statics":
        return _statics(scene, model)
    units = _units(scene)
    entries: Any = {
        "materials": model.materials,
        "orientations": model.orientations,
        "bodies": model.bodies,
        "supports": model.supports,
        "ties": _ties(scene, model),
        "joints": _joints(scene, model),
        "points": model.connected,
        "masses": model.masses,
        "springs": model.springs,
    }[part]
    if isinstance(entries, Mapping):
        return {name: entry.in_si(units) for name, entry in entries.items()}
    return tuple(entry.in_si(units) for entry in entries)
