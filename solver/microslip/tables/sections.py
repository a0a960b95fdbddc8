"""The data of a body that its elements use: material with axes in the model, density, quadrature."""

from ..elements import Anisotropic, Cylindrical, Directions, Isotropic, SolidSection
from .elasticity import elasticity_of
from .structure import Body, Material, Orientation


def section_of(body: Body, material: Material, orientation: Orientation | None) -> SolidSection:
    """Return the section of a body's elements; without an orientation its material axes are those of the model.  Local."""
    return SolidSection(
        material=_anisotropic(material, orientation) if material.has_axes else _isotropic(material),
        density=material.density,
        integration=body.integration,
        incompatible_modes=body.incompatible_modes,
    )


def _isotropic(material: Material) -> Isotropic:
    young, poisson, expansion = material.young, material.poisson, material.expansion
    if not isinstance(young, float) or not isinstance(poisson, float) or isinstance(expansion, tuple):
        raise TypeError("an isotropic material has one number of each constant")
    return Isotropic(young, poisson, expansion or 0.0)


def _anisotropic(material: Material, orientation: Orientation | None) -> Anisotropic:
    axes: Directions | Cylindrical = Directions()
    if orientation is not None and orientation.axis is not None:
        axes = Cylindrical(orientation.axis, orientation.axis_point)
    elif orientation is not None:
        axes = Directions(*(orientation.directions or ()))
    alpha = material.expansion or 0.0
    D = elasticity_of(material.elasticity, material.young, material.poisson, material.shear)
    return Anisotropic(tuple(map(tuple, D.tolist())), alpha if isinstance(alpha, tuple) else (alpha,) * 3, axes)
