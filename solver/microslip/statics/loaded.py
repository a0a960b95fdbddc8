"""A structure under its constant loads, for checks of its rest."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..assembly.system import System
from ..mesh.data import ContactPairs, Mesh
from ..tables.cyclic import Cyclic


@dataclass(frozen=True, eq=False)
class Loaded:
    """A structure, the constant forces on it, and the pairs in the reference state."""

    system: System
    mesh: Mesh | None  # rank 0 only
    pairs: ContactPairs
    forces_owned: np.ndarray  # (n_dof_owned,) N, this rank's rows
    body_of: Mapping[str, str]  # the body of each group of elements
    where: str = ""  # the scene file, for messages
    cyclic: Cyclic | None = None  # of one sector of a disc
