"""Shape functions, quadrature, element stiffness and mass of solids, linear elastic materials, element faces.  NumPy only."""

from .faces import (
    CELLS,
    FINER_SAMPLES,
    RINGS,
    SAMPLES,
    face_nodal_areas,
    face_normals,
    face_points,
    part_integrals,
    point_functions,
    pressure_forces,
)
from .kinds import FACE_KINDS, KINDS
from .large_displacements import large_displacements
from .materials import Anisotropic, Cylindrical, Directions, Isotropic, checked, orthotropic
from .nearest import nearest_on_faces
from .quadrature import INTEGRATIONS
from .recovery import nodal_strain, nodal_stress
from .solid import Solids, SolidSection, jacobian_minimum, mass, stiffness, volumes
from .stress import deformed_stiffness, stress, stress_stiffness, thermal_forces

__all__ = [
    "CELLS",
    "Anisotropic",
    "Cylindrical",
    "Directions",
    "Isotropic",
    "FACE_KINDS",
    "INTEGRATIONS",
    "KINDS",
    "RINGS",
    "FINER_SAMPLES",
    "SAMPLES",
    "SolidSection",
    "Solids",
    "point_functions",
    "checked",
    "deformed_stiffness",
    "face_nodal_areas",
    "face_normals",
    "face_points",
    "jacobian_minimum",
    "large_displacements",
    "mass",
    "nearest_on_faces",
    "nodal_strain",
    "nodal_stress",
    "orthotropic",
    "part_integrals",
    "pressure_forces",
    "stiffness",
    "stress",
    "stress_stiffness",
    "thermal_forces",
    "volumes",
]
