"""Linear elastic materials: stress of strain, and stiffness of the gradients of shape functions (docs/theory.md, section 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

Vector = tuple[float, float, float]
COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # the order of six stresses and strains, as in Abaqus
_ROUNDED = 1e-9  # of the largest entry of an elasticity: rounding to the digits of a file
_ON_AXIS = 1e-12  # of the distance from the point of a cylinder: nearer to its axis the radial direction is arbitrary


class Elastic(Protocol):
    """The law of a material at some points, in model axes."""

    def stress(self, strain: np.ndarray, temperature_rise: float | np.ndarray = 0.0) -> np.ndarray:
        """Return the stress (..., 3, 3) [Pa] of a strain (..., 3, 3) at a ``temperature_rise`` (...) [K]."""
        ...

    def stiffness(self, dN: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """Return K (n_elements, 3 m, 3 m) [N/m] of m functions from their gradients (n_elements, n_q, 3, m) and w det J."""
        ...

    def stiffness_about(self, dN: np.ndarray, F: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """Return K_F of m functions about the deformation gradient F (n_elements, n_q, 3, 3): docs/theory.md, eq. (12.11)."""
        ...


@dataclass(frozen=True)
class Isotropic:
    """Hooke's law of two constants."""

    young: float  # Pa
    poisson: float  # -
    expansion: float = 0.0  # 1/K

    @property
    def lam(self) -> float:
        """Lame's first constant [Pa]."""
        return self.young * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))

    @property
    def mu(self) -> float:
        """The shear modulus [Pa]."""
        return self.young / (2.0 * (1.0 + self.poisson))

    @property
    def expands(self) -> bool:
        """Whether the material has a thermal expansion."""
        return self.expansion != 0.0

    @property
    def elastic(self) -> tuple:
        """Elastic constants and axes: materials with equal ones have the same stiffness."""
        return self.young, self.poisson

    def at(self, places: np.ndarray) -> Isotropic:
        """Return the material itself: it is the same at all places and in all axes."""
        return self

    def stress(self, strain: np.ndarray, temperature_rise: float | np.ndarray = 0.0) -> np.ndarray:
        """sigma = lam tr(eps) 1 + 2 mu eps - (3 lam + 2 mu) alpha dT 1; see :class:`Elastic`."""
        lam, mu = self.lam, self.mu
        mean = lam * np.trace(strain, axis1=-2, axis2=-1) - (3.0 * lam + 2.0 * mu) * self.expansion * temperature_rise
        return 2.0 * mu * strain + mean[..., None, None] * np.eye(3)

    def stiffness(self, dN: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """Return K of docs/theory.md, eq. (2.1), one matrix product an element; see :class:`Elastic`."""
        n_elements, n_q, _, m = dN.shape
        lam, mu = self.lam, self.mu
        D = dN.reshape(n_elements, n_q, 3 * m)
        weighted = D * volumes[:, :, None]
        G = (D.transpose(0, 2, 1) @ weighted).reshape(n_elements, 3, m, 3, m)
        trace = mu * (G[:, 0, :, 0] + G[:, 1, :, 1] + G[:, 2, :, 2])
        K = np.empty((n_elements, m, 3, m, 3))
        for i in range(3):
            K[:, :, i, :, i] = (lam + mu) * G[:, i, :, i] + trace
            for j in range(i):
                block = lam * G[:, i, :, j] + mu * G[:, j, :, i]
                K[:, :, i, :, j] = block
                K[:, :, j, :, i] = block.transpose(0, 2, 1)
        return K.reshape(n_elements, 3 * m, 3 * m)

    def stiffness_about(self, dN: np.ndarray, F: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """With g = F dN, lam g_ai g_bj + mu g_aj g_bi + mu (F F^T)_ij dN_a . dN_b; see :class:`Elastic`."""
        n_elements, n_q, _, m = dN.shape
        g = (F @ dN).reshape(n_elements, n_q, 3 * m)
        G = (g.swapaxes(-1, -2) @ (g * volumes[..., None])).reshape(n_elements, 3, m, 3, m)
        left = self.mu * volumes[..., None, None] * (F @ F.swapaxes(-1, -2))
        K = np.empty((n_elements, m, 3, m, 3))
        for i in range(3):
            for j in range(3):
                trace = (dN.swapaxes(-1, -2) @ (left[:, :, i, j, None, None] * dN)).sum(axis=1)
                K[:, :, i, :, j] = self.lam * G[:, i, :, j] + self.mu * G[:, j, :, i] + trace
        return K.reshape(n_elements, 3 * m, 3 * m)


@dataclass(frozen=True)
class Directions:
    """Axes of a material that are the same everywhere: the first, and another direction in the plane of the first two."""

    first: Vector = (1.0, 0.0, 0.0)
    second: Vector = (0.0, 1.0, 0.0)

    def at(self, places: np.ndarray) -> np.ndarray:
        """Return the axes, one a row, (3, 3)."""
        first = _unit(np.array(self.first))
        third = _unit(np.cross(first, _unit(np.array(self.second))))
        return np.stack([first, np.cross(third, first), third])


@dataclass(frozen=True)
class Cylindrical:
    """Axes of a material around an axis: the first is radial, the second tangential, the third along it."""

    axis: Vector
    point: Vector = (0.0, 0.0, 0.0)  # m

    def at(self, places: np.ndarray) -> np.ndarray:
        """Return the axes at places (..., 3) [m], one a row, (..., 3, 3); on the axis itself any direction is radial."""
        along = _unit(np.array(self.axis))
        arm = places - np.array(self.point)
        radial = arm - (arm @ along)[..., None] * along
        is_on_axis = np.linalg.norm(radial, axis=-1) <= _ON_AXIS * np.linalg.norm(arm, axis=-1)
        radial[is_on_axis] = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        tangential = np.cross(along, radial)
        return _unit(np.stack([radial, tangential, np.broadcast_to(along, radial.shape)], axis=-2))


@dataclass(frozen=True)
class Anisotropic:
    """A linear elastic material with material axes."""

    elasticity: tuple[tuple[float, ...], ...]  # (6, 6) Pa in its axes, stresses and strains in the order of COMPONENTS
    expansion: Vector = (0.0, 0.0, 0.0)  # 1/K, along its axes
    axes: Directions | Cylindrical = Directions()

    @property
    def expands(self) -> bool:
        """Whether the material has a thermal expansion in any direction."""
        return any(self.expansion)

    @property
    def elastic(self) -> tuple:
        """Elastic constants and axes: materials with equal ones have the same stiffness."""
        return self.elasticity, self.axes

    def at(self, places: np.ndarray) -> Turned:
        """Return the material at places (n_elements, n_q, 3) [m] in model axes: docs/theory.md, eq. (2.12)."""
        axes = self.axes.at(places)
        T = strain_transformation(axes)
        elasticity = T.swapaxes(-1, -2) @ np.array(self.elasticity) @ T
        return Turned(elasticity, (axes.swapaxes(-1, -2) * np.array(self.expansion)) @ axes)


@dataclass(frozen=True, eq=False)
class Turned:
    """An anisotropic material in model axes, uniform or by quadrature point of some elements; see :class:`Elastic`."""

    elasticity: np.ndarray  # (6, 6) or (n_elements, n_q, 6, 6) Pa
    expansion: np.ndarray  # (3, 3) or (n_elements, n_q, 3, 3) 1/K

    def stress(self, strain: np.ndarray, temperature_rise: float | np.ndarray = 0.0) -> np.ndarray:
        """Return the stress, elasticity : (eps - alpha dT); see :class:`Elastic`."""
        elastic = strain - np.asarray(temperature_rise)[..., None, None] * self.expansion
        six = np.stack([elastic[..., i, j] * (1.0 if i == j else 2.0) for i, j in COMPONENTS], axis=-1)
        values = (self.elasticity @ six[..., None])[..., 0]
        sigma = np.empty((*values.shape[:-1], 3, 3))
        for k, (i, j) in enumerate(COMPONENTS):
            sigma[..., i, j] = sigma[..., j, i] = values[..., k]
        return sigma

    def stiffness(self, dN: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """docs/theory.md, eq. (2.12); see :class:`Elastic`."""
        return self.stiffness_about(dN, np.eye(3), volumes)

    def stiffness_about(self, dN: np.ndarray, F: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """Six strains sym(F^T dv/dx) of each function, and their stresses; see :class:`Elastic`."""
        n_elements, n_q, _, m = dN.shape
        strains = _strain_rows(dN, F)
        stresses = (self.elasticity @ strains) * volumes[..., None, None]
        return strains.reshape(n_elements, n_q * 6, 3 * m).swapaxes(-1, -2) @ stresses.reshape(n_elements, n_q * 6, 3 * m)


Material = Isotropic | Anisotropic


def orthotropic(young: Vector, poisson: Vector, shear: Vector) -> np.ndarray:
    """Return the elasticity (6, 6) [Pa] of three planes of symmetry.

    Local.

    Parameters
    ----------
    young : E_1, E_2, E_3 [Pa]
    poisson : nu_12, nu_13, nu_23 [-]: contraction along j divided by the extension along i, under tension along i
    shear : G_12, G_13, G_23 [Pa]

    Raises
    ------
    ValueError : the compliance is not positive definite

    Notes
    -----
    docs/theory.md, eq. (2.13), inverted.
    """
    compliance = np.diag(1.0 / np.array([*young, *shear]))
    for (i, j), nu in zip(((0, 1), (0, 2), (1, 2)), poisson, strict=True):
        compliance[i, j] = compliance[j, i] = -nu / young[i]
    size = np.sqrt(np.diag(compliance))
    least = np.linalg.eigvalsh(compliance / np.outer(size, size))[0]
    if least <= _ROUNDED:
        raise ValueError(
            f"its compliance matrix must be positive definite, but scaled to a unit diagonal it has the eigenvalue {least:.3g}; "
            "check nu_ij: the contraction along j divided by the extension along i, under tension along i"
        )
    elasticity = np.linalg.inv(compliance)
    return 0.5 * (elasticity + elasticity.T)


def checked(elasticity: np.ndarray) -> np.ndarray:
    """Return a symmetric, positive semidefinite elasticity (6, 6) [Pa], without the asymmetry of rounding.  Local.

    Strains without energy are allowed: an inviscid fluid resists only changes of volume.

    Raises
    ------
    ValueError : it is not symmetric, has a negative eigenvalue, or is zero
    """
    if (np.abs(elasticity - elasticity.T) > _ROUNDED * np.abs(elasticity).max()).any():
        raise ValueError("its elasticity is not symmetric")
    least, *_, most = np.linalg.eigvalsh(elasticity)
    if not (least >= -_ROUNDED * most and most > 0.0):
        raise ValueError(f"its elasticity must be positive semidefinite and not zero, but has the eigenvalue {least:.3g} Pa")
    return 0.5 * (elasticity + elasticity.T)


def strain_transformation(axes: np.ndarray) -> np.ndarray:
    """Return T (..., 6, 6), which takes strains in model axes to those in ``axes`` (..., 3, 3), one a row.  Local.

    Six strains with shear angles gamma_ij = 2 eps_ij, of eps'_rs = a_ri a_sj eps_ij.
    """
    T = np.empty((*axes.shape[:-2], 6, 6))
    for row, (r, s) in enumerate(COMPONENTS):
        for column, (i, j) in enumerate(COMPONENTS):
            both = axes[..., r, i] * axes[..., s, j] + axes[..., r, j] * axes[..., s, i]
            T[..., row, column] = 0.5 * both if r == s else both
    return T


def _strain_rows(dN: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return the six strains sym(F^T dv/dx) of each function v, (n_elements, n_q, 6, 3 m)."""
    *shape, _, m = dN.shape
    rows = np.empty((*shape, 6, m, 3))
    for i, (r, s) in enumerate(COMPONENTS):
        rows[..., i, :, :] = dN[..., s, :, None] * F[..., None, :, r]
        if r != s:
            rows[..., i, :, :] += dN[..., r, :, None] * F[..., None, :, s]
    return rows.reshape(*shape, 6, 3 * m)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
