"""The door: the settings of every stage from a scene.  Beyond it no stage knows of scenes, nor of what was stated in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..assembly.settings import MatrixSettings, PairFile
from ..continuation.settings import ResponseSettings
from ..elements import Anisotropic, Cylindrical, Directions, Isotropic, checked, orthotropic
from ..fourier.harmonics import Harmonics
from ..mesh.settings import (
    GEOMETRY,
    Body,
    Bolt,
    Force,
    GroundPlane,
    Joint,
    Load,
    Mass,
    MeshSettings,
    Output,
    Point,
    Spring,
    Statics,
    Support,
    Tie,
    TouchingFaces,
    Warm,
)
from ..messages.errors import CaseError
from ..points.band import Band
from ..receptance.excitation import Excitation
from ..reduction.settings import ModalDamping, ReductionSettings
from ..scene import schema
from ..scene.read import changed
from ..scene.schema import DEFAULT_ACCURACY, Scene
from ..tables.joint_laws import OWN
from ..tables.matrix_names import KEYS as KEYS_OF_MATRICES
from ..tables.matrix_names import split_name
from ..tables.units import UNITS

KEYS = {"harmonics": "harmonics", "samples": "samples", "solver": "tolerance"}  # of [solver], for each part of the accuracy


def mesh_settings(scene: Scene) -> MeshSettings:
    """Return the structure of a scene with a mesh.  Local."""
    assert scene.model.mesh is not None, "a scene given as matrices has no mesh"
    return MeshSettings(
        file=scene.folder / scene.model.mesh,
        stated=scene.model.mesh,
        scale=scene.model.scale if scene.model.units is None else UNITS[scene.model.units].length,
        bodies={name: _body(body, scene) for name, body in scene.bodies.items()},
        supports=tuple(Support(group=support.group, point=support.point, fix=support.fix) for support in scene.supports),
        surfaces=tuple(TouchingFaces(**dict(surface)) for surface in scene.surfaces),
        joints=tuple(_joint(joint, scene) for joint in scene.joints),
        ties=tuple(_tie(tie) for tie in scene.ties),
        points=tuple(_point(point) for point in scene.points),
        masses=tuple(Mass(**dict(mass)) for mass in scene.masses),
        springs=tuple(Spring(**dict(spring)) for spring in scene.springs),
        has_equations="equations" in scene.model.take,
        loads=loads(scene),
        outputs=outputs(scene),
        statics=_statics(scene),
    )


def matrix_settings(scene: Scene) -> MatrixSettings:
    """Return the structure of a scene given as matrices.  Local."""
    stated = {key: file for key in KEYS_OF_MATRICES if (file := getattr(scene.model, key)) is not None}
    split = {key: split_name(file, scene.folder) for key, file in stated.items()}
    beside = {key: getattr(scene.model, key) for key in ("dofs", "nodes", "recovery_dofs")}
    return MatrixSettings(
        files={key: scene.folder / file for key, (file, _) in split.items()},
        names={key: name for key, (_, name) in split.items() if name is not None},
        joints=tuple(_joint(joint, scene) if joint.pairs is None else _pair_file(joint, scene) for joint in scene.joints),
        **{key: None if file is None else scene.folder / file for key, file in beside.items()},
        loads=loads(scene),
        outputs=outputs(scene),
        where=str(scene.path),
    )


def reduction_settings(scene: Scene) -> ReductionSettings:
    """Return the method of a scene, its modes and loads.  Local."""
    solver, damping = scene.solver, scene.damping
    keys = ("method", "modes", "verify_modes", "interface_modes", "condensed", "in_point_check", "energy_tolerance")
    return ReductionSettings(
        accuracy=solver.accuracy or DEFAULT_ACCURACY,
        insists=solver.accuracy is not None,
        excitation=excitation(scene),
        damping=None if damping is None else _damping(damping, scene),
        band=band(scene),
        level=max(scene.response.levels),
        where=str(scene.path),
        **{key: getattr(solver, key) for key in keys},
    )


def excitation(scene: Scene) -> Excitation:
    """Return how the loads of a scene vary in time, and its harmonics.  Local."""
    shapes = ((load.harmonic, phase) for load in loads(scene) for phase in load.phases)
    return Excitation(tuple(shapes), Harmonics.up_to(scene.harmonics))


def response_settings(scene: Scene) -> ResponseSettings:
    """Return what a scene asks of its response, with what was stated and what the program chooses.  Local."""
    solver, response, steps = scene.solver, scene.response, scene.continuation
    return ResponseSettings(
        levels=response.levels,
        band=band(scene),
        at=response.at,
        direction=response.direction,
        points=response.points,
        **{key: getattr(steps, key, None) for key in ("ds", "ds_min", "ds_max")},
        samples=solver.samples,
        follows_path=solver.between_samples == "path",
        tolerance=solver.tolerance,
        accuracy=solver.accuracy,
        is_corrected=solver.accuracy_of == "corrected",
        keeps=frozenset(part for part, key in KEYS.items() if not scene.chooses(key)),
        chooses_steps="points" not in response.model_fields_set,
        loaded=max((load.harmonic for load in scene.loads), default=1) or 1,
    )


def has_error_bars(scene: Scene) -> bool:
    """Return whether the error of every point is estimated: that of harmonic 1, where there is one.  Local."""
    return asks_for_bars(scene) and not scene.is_static


def refuse_statics(scene: Scene, command: str) -> None:
    """Raise CaseError where nothing vibrates.  Local."""
    if scene.is_static:
        raise CaseError(
            f"{scene.path}: [solver] harmonics = 0 is a static balance; {command} needs a vibration: state at least 1, and a "
            "load in harmonic 1"
        )


def asks_for_bars(scene: Scene) -> bool:
    """Return whether a scene asks for error bars, possible or not.  Local."""
    return scene.solver.error_bars


def asks_for_fields(scene: Scene) -> bool:
    """Return whether modes and peaks are to be written on the mesh, if there is one.  Local."""
    return scene.response.fields


def loads(scene: Scene) -> tuple[Load, ...]:
    """Return the loads of a scene.  Local."""
    return tuple(map(partial(_load, scene), scene.loads))


def outputs(scene: Scene) -> tuple[Output, ...]:
    """Return the outputs of a scene.  Local."""
    return tuple(Output(**dict(output)) for output in scene.outputs)


@dataclass(frozen=True)
class Units:
    """What the numbers of a scene's results count."""

    outputs: tuple[str, ...]
    level: str  # "1" where loads of several kinds share it

    @property
    def works(self) -> list[int]:
        """The outputs whose amplitude times the level is a work."""
        return [k for k, unit in enumerate(self.outputs) if unit == "m" and self.level == "N"]


def units_of(scene: Scene) -> Units:
    """Return the units of a scene's results.  Local."""
    of_loads = {load.unit for load in loads(scene)}
    return Units(tuple(output.unit for output in outputs(scene)), of_loads.pop() if len(of_loads) == 1 else "1")


def band(scene: Scene) -> Band:
    """Return the range of frequencies of a scene.  Local."""
    response = scene.response
    return Band(frequencies=response.frequencies, mode=response.mode, span=response.span)


def _statics(scene: Scene) -> Statics | None:
    """Return what acts before the structure vibrates; None where nothing does."""
    statics = scene.statics
    if statics is None:
        return None
    body_of = {body.group: name for name, body in scene.bodies.items()}
    return Statics(
        speed=statics.rotation_speed,
        axis=scene.model.axis or (0.0, 0.0, 1.0),
        axis_point=scene.model.axis_point,
        forces=tuple(Force(**dict(force)) for force in statics.forces),
        pressures=tuple((one.group, one.pressure) for one in statics.pressures),
        temperatures={body_of[warm.group]: _warm(warm, scene) for warm in statics.temperatures},
        bolts=tuple(
            Bolt(name=bolt.name or f"bolt {i}", group=bolt.group, force=bolt.force, shortening=bolt.shortening)
            for i, bolt in enumerate(statics.bolts, 1)
        ),
        displacements=tuple((one.group, one.displacement) for one in statics.displacements),
        steps=statics.steps,
        stiffens=statics.stress_stiffening,
        deforms=statics.deformed_shape,
        is_large=statics.large_displacements,
    )


def _warm(warm: schema.Temperature, scene: Scene) -> float | Warm:
    """Return the temperature of a body, or where those of its nodes are."""
    if warm.temperature is not None:
        return warm.temperature
    return Warm(field=warm.field, file=None if warm.file is None else scene.folder / warm.file)


def _damping(damping: schema.Damping, scene: Scene) -> ModalDamping:
    return ModalDamping(
        ratio=damping.ratio,
        rayleigh=damping.rayleigh,
        ratios=damping.ratios or (),
        of_modes=damping.modes or (),
        structural=damping.structural or 0.0,
        is_alone=not any(spring.damping for spring in scene.springs),
    )


def _load(scene: Scene, load: schema.Load) -> Load:
    """Return a load, with the axis that an engine order turns about and the file of its forces."""
    kept: dict[str, Any] = {**dict(load), "forces": None if load.forces is None else scene.folder / load.forces}
    if load.engine_order is not None:
        kept |= {"axis": scene.model.axis, "axis_point": scene.model.axis_point}
    return Load(**kept)


def _body(body: schema.Body, scene: Scene) -> Body:
    material = scene.materials[body.material]
    return Body(
        group=body.group,
        material=_anisotropic(material, body, scene) if material.has_axes else _isotropic(material),
        density=material.density,
        integration=body.integration,
        incompatible_modes=body.incompatible_modes,
    )


def _isotropic(material: schema.Material) -> Isotropic:
    assert isinstance(material.young, float) and isinstance(material.poisson, float), "a material without axes"
    assert not isinstance(material.expansion, tuple), "a material without axes"
    return Isotropic(material.young, material.poisson, material.expansion or 0.0)


def _anisotropic(material: schema.Material, body: schema.Body, scene: Scene) -> Anisotropic:
    """Return a material with axes: those of the body's orientation, or the model's.

    Raises
    ------
    CaseError : there is no material of these constants
    """
    try:
        elasticity = _elasticity(material)
    except ValueError as problem:
        raise CaseError(f"{scene.path}: [materials.{body.material}]: there is no such material; {problem}") from None
    axes: Directions | Cylindrical = Directions()
    if body.orientation is not None:
        stated = scene.orientations[body.orientation]
        axes = Cylindrical(stated.axis, stated.axis_point) if stated.axis is not None else Directions(*(stated.directions or ()))
    alpha = material.expansion or 0.0
    return Anisotropic(tuple(map(tuple, elasticity.tolist())), alpha if isinstance(alpha, tuple) else (alpha,) * 3, axes)


def _elasticity(material: schema.Material) -> np.ndarray:
    """Return stress of strain (6, 6) [Pa] of a material with axes; ValueError where there is none."""
    if material.elasticity is not None:
        return checked(np.array(material.elasticity))
    young, poisson, shear = material.young, material.poisson, material.shear
    assert isinstance(young, tuple) and isinstance(poisson, tuple) and shear is not None, "three constants along the axes"
    return orthotropic(young, poisson, shear)


def _tie(tie: schema.Tie) -> Tie:
    return Tie(name=tie.name or " to ".join(tie.surfaces), surfaces=tie.surfaces, tolerance=tie.tolerance)


def _point(point: schema.Point) -> Point:
    return Point(
        name=point.name,
        position=point.position,
        group=point.group,
        rigid=point.connection == "rigid",
        by_area=point.weights == "area",
        mass=point.mass,
        inertia=(*(point.inertia or ()), *(0.0,) * 6)[:6],
        stiffness=point.stiffness or (0.0, 0.0, 0.0),
        rotational_stiffness=point.rotational_stiffness or (0.0, 0.0, 0.0),
    )


def _pair_file(joint: schema.Joint, scene: Scene) -> PairFile:
    return PairFile(
        name=joint.name,
        file=scene.folder / (joint.pairs or ""),
        separate=joint.friction_limit == "separate",
        law=joint.law,
        keys=_keys_of_law(joint),
    )


def _joint(joint: schema.Joint, scene: Scene) -> Joint:
    """Return a joint of surfaces or of node pairs; the scene has been checked to state all of it."""
    assert joint.pairs is None, "pairs of DOFs are a PairFile"
    kept = ("name", "tolerance", "pairing", "tangent", "law", "fields")
    plane = None
    if joint.plane_point is not None and joint.plane_normal is not None:
        plane = GroundPlane(point=joint.plane_point, normal=joint.plane_normal)
    return Joint(
        plane=plane,
        surfaces=joint.surfaces or (joint.node_pairs or "",),
        node_pairs=None if joint.node_pairs is None else scene.folder / joint.node_pairs,
        gap=joint.gap if plane is None else GEOMETRY,
        preload=0.0 if isinstance(joint.preload, str) else joint.preload or 0.0,
        separate=joint.friction_limit == "separate",
        parameters=None if joint.parameters is None else scene.folder / joint.parameters,
        keys=_keys_of_law(joint),
        friction=_along_x(joint.friction),
        tangential_stiffness=_along_x(joint.tangential_stiffness),
        normal_stiffness=_along_x(joint.normal_stiffness),
        **{key: getattr(joint, key) for key in kept},
    )


def _along_x(value: float | tuple[float, float] | None) -> float:
    """Return a number of a joint, of two that along x; 0 where its law has none."""
    return value[0] if isinstance(value, tuple) else value or 0.0


def _keys_of_law(joint: schema.Joint) -> dict[str, float | None]:
    """Return what a law takes from its joint beside what every joint has."""
    along_y = {
        f"{key}_y": value[1] for key in ("friction", "tangential_stiffness") if isinstance(value := getattr(joint, key), tuple)
    }
    return {**{key: getattr(joint, key) for key in OWN}, **along_y}


def by_method(scene: Scene, method: str) -> Scene:
    """Return the scene with another method.  Local.

    Raises
    ------
    CaseError : the method cannot answer it
    """
    return changed(scene, {"solver": {"method": method}})
