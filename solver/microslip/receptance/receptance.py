"""The receptance of one harmonic group: modes and static response between pairs, loads and outputs.

Between any two of these with modal participations x, y, in harmonic n (docs/theory.md, eq. (4.1)),

    A_n(omega) = A_static + x c_n(omega) y^H.

Participations and A_static are real for a plain structure, complex for a sector whose neighbours have another phase.  Motions and
forces are real coefficients [mean, cos, sin, ...] of the group's harmonics; the complex amplitude is cos - i sin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..fourier.amplitudes import adjoint_times, loaded_times, matrix_times, to_complex
from .damping import DynamicFlexibility, Flexibility, StatedDamping
from .modes import DampedModes
from .rigid_motion import RigidMotion
from .sector_products import SectorProducts
from .static_response import StaticResponse


@dataclass(frozen=True, eq=False)
class Receptance:
    """Data of one harmonic group, docs/theory.md, eq. (4.1).  All methods are local; N_H counts coefficients of the group."""

    modes: DampedModes  # elastic modes
    static: StaticResponse  # by inertia relief for a structure without supports
    rigid: RigidMotion | None = None  # of a structure without supports
    sectors: SectorProducts | None = None  # the same between all pairs of a disc, without changed springs

    @property
    def is_complex(self) -> bool:
        """Whether modes or static columns are complex."""
        return np.iscomplexobj(self.modes.R_phi) or self.static.G_static.is_complex

    def with_damping(self, sigma: float, factor: float = 1.0, stated: StatedDamping | None = None) -> Receptance:
        """Return the receptance with the stated damping, or the matrix C, times a factor, plus sigma M [1/s]."""
        rigid = self.rigid and self.rigid.with_damping(sigma, factor, stated)
        return replace(self, modes=self.modes.with_damping(sigma, factor, stated), rigid=rigid)

    def conjugated(self) -> Receptance:
        """Return the receptance of conj(K_L), conj(M) and conj(C) under conjugate load vectors: of nodal diameter N - d from d.

        The static columns, which need by far the most memory, are a view.  A real receptance is returned itself.
        """
        return replace(self, modes=self.modes.conjugated(), static=self.static.conjugated()) if self.is_complex else self

    def modal_forces(self, f: np.ndarray, p: np.ndarray | None = None) -> np.ndarray:
        """Return phi^H (f - R^H p), (m, N_H), for loads (n_loads, N_H) and forces of the pairs (3 n_pairs, N_H)."""
        q = matrix_times(self.modes.b, f)
        if p is None or not p.any():  # all pairs stick, as at all frequencies of a linear curve
            return q
        return q - adjoint_times(self.modes.R_phi, p)

    def linear_motion(self, f: np.ndarray, c: Flexibility, rows: slice) -> np.ndarray:
        """Return the motion of some rows of the pairs under loads f alone, all pairs stuck, (n_rows, N_H) [m]."""
        if not f.any():  # of a disc most groups have no load
            return np.zeros((len(self.static.du_static[rows]), f.shape[-1]))
        return matrix_times(self.static.du_static[rows], f) + self._of_modes(c.apply(self.modal_forces(f)), rows)

    def linear_motion_rate(self, f: np.ndarray, rate: Flexibility, rows: slice) -> np.ndarray:
        """Return the rate of :meth:`linear_motion`, (n_rows, N_H), for the ``rate`` of c_n."""
        return self._of_modes(rate.apply(self.modal_forces(f)), rows)

    def _of_modes(self, eta: np.ndarray, rows: slice) -> np.ndarray:
        """Return R phi eta of some rows, (n_rows, N_H) [m]; few harmonics have loads."""
        if self.sectors is None:
            return loaded_times(self.modes.R_phi[rows], eta)
        motion, loaded = np.zeros((len(self.modes.R_phi), eta.shape[1])), eta.any(axis=0)
        if loaded.any():
            motion[:, loaded] = self.sectors.of_modes(eta[:, loaded])
        return motion[rows]

    def output_motion(self, f: np.ndarray, p: np.ndarray, c: DynamicFlexibility) -> np.ndarray:
        """Return o u, (n_outputs, N_H) [m]."""
        if not (f.any() or p.any()):
            return np.zeros((len(self.modes.o), f.shape[-1]))
        dynamic = matrix_times(self.modes.o, c.apply(self.modal_forces(f, p)))
        elastic: np.ndarray = matrix_times(self.static.out_static, f) - matrix_times(self.static.out_R, p) + dynamic
        return elastic if self.rigid is None else elastic + self.rigid.o @ self.rigid.coordinates(f, c.n_omega)

    def load_motion(self, f: np.ndarray, p: np.ndarray, c: DynamicFlexibility) -> np.ndarray:
        """Return f^H u, the motion along each load, (n_loads, N_H) [m]."""
        dynamic = adjoint_times(self.modes.b, c.apply(self.modal_forces(f, p)))
        elastic: np.ndarray = matrix_times(self.static.load_static, f) - adjoint_times(self.static.du_static, p) + dynamic
        return elastic if self.rigid is None else elastic + self.rigid.b.T @ self.rigid.coordinates(f, c.n_omega)

    def modal_motion(self, f: np.ndarray, p: np.ndarray, c: Flexibility) -> np.ndarray:
        """Return the complex modal amplitudes D_n^-1 phi^H (f - R^H p), (m, n_harmonics)."""
        q = self.modal_forces(f, p)
        return to_complex(c.apply(q)) + to_complex(q) / self.modes.omega_n[:, None] ** 2

    def of_outputs(self, c: DynamicFlexibility, i: int) -> np.ndarray:
        """Return A_n between outputs and pairs, (n_outputs, 3 n_pairs) complex [m/N], of the i-th of the group's harmonics."""
        return self.static.out_R + c.between(self.modes.o, i, self.modes.R_phi)
