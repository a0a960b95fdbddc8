"""What a reduction needs to know, as plain values in SI units."""

from __future__ import annotations

from dataclasses import dataclass

from ..mesh.settings import Load
from ..modes.band import Band


@dataclass(frozen=True, kw_only=True)
class ModalDamping:
    """Of every mode of the stuck structure the same ratio, or Rayleigh's alpha M + beta K_L."""

    ratio: float | None = None
    rayleigh: tuple[float, float] | None = None  # 1/s, s


@dataclass(frozen=True, kw_only=True)
class ReductionSettings:
    """A method, its modes and the loads it has to bear."""

    method: str = "receptance"
    modes: int | None = None  # as many as stated; None: as few as meet the accuracy
    accuracy: float = 1e-3  # of the response over its linear peak
    insists: bool = False  # on the accuracy: it was stated
    verify_modes: bool = True  # prove by a count that none is missed
    harmonics: int = 3  # the highest
    loads: tuple[Load, ...] = ()  # their harmonics and phases
    damping: ModalDamping | None = None  # None: the structure has a damping matrix
    band: Band = Band()
    level: float = 1.0  # the highest [N]
    interface_modes: int = 40  # shapes of the joint
    condensed: bool = False  # rubin with relative interface DOFs only
    in_point_check: bool = False  # adaptive methods check all pairs inside the point
    energy_tolerance: float = 1e-10  # J per cycle and pair
    where: str = ""  # the scene file, for messages
