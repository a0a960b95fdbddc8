"""Two surfaces that may be a joint, with what there is to say of them."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ...mesh.skin import Skin
from ...tables.structure import Surface

APART = 0.01  # of the size of the faces: surfaces farther apart than that do not touch yet


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """Two surfaces that may be a joint, the first of which lies on the second."""

    name: str
    surfaces: tuple[str, str]
    made: tuple[Surface, ...] = ()  # that make groups of these names; none: the file has them
    n_faces: tuple[int, int]
    area: float  # m2, of the first that lies on the second
    gap: float  # m, its mean
    size: float  # m, of the larger faces
    matches: bool  # node to node
    nodes: tuple[np.ndarray, np.ndarray]  # index into Mesh.points, of the faces of either side that lie on the other
    faces: tuple[np.ndarray, np.ndarray]  # of the skin, either side whole
    is_of_bolt: bool = False  # one side is a bolt's, a nut's or a washer's
    is_asked: bool = False  # the file itself has them in contact, with room between them
    refused: str = ""  # why a run would not take it
    is_likely: bool = True  # nothing else joins the two bodies, or the file names the surfaces

    @property
    def is_apart(self) -> bool:
        """Whether there is room between the surfaces."""
        return abs(self.gap) > APART * self.size

    @property
    def text(self) -> str:
        """What there is to say of it, on one line."""
        nodes = "node to node" if self.matches else "their meshes differ"
        apart = f"{self.gap:.2g} m apart" if abs(self.gap) > 1e-6 * self.size else "touching"
        text = f"{' on '.join(self.surfaces)}: {self.n_faces[0]} faces on {self.n_faces[1]}, {self.area:.4g} m2, {apart}, {nodes}"
        return f"{text}; refused: {self.refused}" if self.refused else text


def bodies_of(skin: Skin, first: np.ndarray, second: np.ndarray) -> list[list[int]]:
    """Return which bodies two sets of faces connect, each two numbers rising.  Local."""
    pairs = {tuple(sorted((a, b))) for a in np.unique(skin.body[first]).tolist() for b in np.unique(skin.body[second]).tolist()}
    return [list(pair) for pair in pairs]


def plain(name: str) -> str:
    """Return a name without what names of scenes may not have.  Local."""
    return re.sub(r'[\s,"/\\\x00-\x1f]+', "_", name).strip("_") or "joint"
