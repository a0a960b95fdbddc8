"""Two surfaces that may be a joint, with their properties."""

import re
from dataclasses import dataclass

import numpy as np

from ...mesh.skin import Skin
from ...messages.words import counted
from ...tables.structure import Surface

DISTANT = 0.01  # of the size of the faces: distance above which surfaces do not touch


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """Two surfaces that may be a joint; the first lies on the second."""

    name: str
    surfaces: tuple[str, str]
    made: tuple[Surface, ...] = ()  # tables that define groups of these names; empty: groups of the file
    n_faces: tuple[int, int]
    area: float  # m2, area of the first surface on the second
    gap: float  # m, mean gap
    size: float  # m, size of the larger faces
    matches: bool  # matching nodes
    nodes: tuple[np.ndarray, np.ndarray]  # index into Mesh.points, of the touching faces of each side
    faces: tuple[np.ndarray, np.ndarray]  # faces of the skin, each side complete
    is_of_bolt: bool = False  # one side belongs to a bolt, nut or washer
    in_contact_in_file: bool = False  # the file has them in contact, with a gap
    refused: str = ""  # reason why a run would refuse it
    is_likely: bool = True  # no other connection of the two bodies, or surfaces named by the file

    @property
    def is_distant(self) -> bool:
        """Whether there is a gap between the surfaces."""
        return abs(self.gap) > DISTANT * self.size

    @property
    def text(self) -> str:
        """Return a description on one line."""
        nodes = "node to node" if self.matches else "their meshes differ"
        gap_text = f"{self.gap:.2g} m apart" if abs(self.gap) > 1e-6 * self.size else "touching"
        faces = f"{counted(self.n_faces[0], 'face')} on {self.n_faces[1]}"
        text = f"{' on '.join(self.surfaces)}: {faces}, {self.area:.4g} m2, {gap_text}, {nodes}"
        return f"{text}; refused: {self.refused}" if self.refused else text


def bodies_of(skin: Skin, first: np.ndarray, second: np.ndarray) -> list[list[int]]:
    """Return the pairs of bodies that two sets of faces connect, each in ascending order.  Local."""
    pairs = {tuple(sorted((a, b))) for a in np.unique(skin.body[first]).tolist() for b in np.unique(skin.body[second]).tolist()}
    return [list(pair) for pair in pairs]


def plain(name: str) -> str:
    """Return a name without characters that scenes do not allow.  Local."""
    return re.sub(r'[\s,"/\\\x00-\x1f]+', "_", name).strip("_") or "joint"
