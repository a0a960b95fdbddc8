"""The structure assembled from bulk data, and the axes of its grid points."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..draft import Draft


@dataclass(eq=False)
class Content(Draft):
    """The structure so far, and the cards that state it."""

    node: str = "grid point"
    cards: Any = None  # pyNastran's BDF

    def left_out(self, card: str, number: int, effect: str, part: str = "", changes: bool = True) -> None:
        """Add a finding on a card that is not taken over.  Local."""
        self.findings.add(card, f"{card} {number}", effect, changes, part)

    def taken_over(self, card: str, number: int, effect: str, part: str) -> None:
        """Add a finding on a card that is taken over.  Local."""
        self.findings.add(card, f"{card} {number}", effect, False, part, is_taken=True)

    @property
    def mass_factor(self) -> float:
        """PARAM,WTMASS, by which Nastran multiplies all masses."""
        stated = self.cards.params.get("WTMASS")
        return float(stated.values[0]) if stated is not None else 1.0

    def axes(self, node: int) -> np.ndarray | None:
        """Return the axes of a grid point's displacements (field CD), (3, 3) rows; None for the axes of the model."""
        card = self.cards.nodes.get(int(self.numbers[node]))
        if card is None:  # a plain grid point
            return None
        coord = card.cd_ref if getattr(card, "cd_ref", None) is not None else self.cards.coords.get(card.cd)
        if coord is None or coord.cid == 0:
            return None
        axes = np.asarray(coord.beta(), dtype=float)
        if coord.type in ("CORD2C", "CORD1C", "CORD2S", "CORD1S"):
            local = axes @ (self.points[node] - np.asarray(coord.origin))
            axes = _local_axes(local, is_sphere=coord.type.endswith("S")) @ axes
        return None if np.allclose(axes, np.eye(3), atol=1e-12) else axes


def _local_axes(at: np.ndarray, is_sphere: bool) -> np.ndarray:
    """Return e_r, e_theta, e_z of a cylindrical system at a point, or e_r, e_theta, e_phi of a spherical system, as rows."""
    phi = np.arctan2(at[1], at[0])
    around = np.array([-np.sin(phi), np.cos(phi), 0.0])
    outward = np.array([np.cos(phi), np.sin(phi), 0.0])
    along = np.array([0.0, 0.0, 1.0])
    if not is_sphere:
        return np.stack([outward, around, along])
    theta = np.arctan2(np.hypot(at[0], at[1]), at[2])
    return np.stack([np.sin(theta) * outward + np.cos(theta) * along, np.cos(theta) * outward - np.sin(theta) * along, around])
