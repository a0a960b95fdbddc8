"""Contact forces of joints as outputs: rows over displacements and over p (docs/theory.md, section 13)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..assembly.system import System
from ..mesh.data import ContactPairs
from ..tables.vibration import Output
from .joint_springs import joint_stiffness


def with_contact_forces(system: System, pairs: ContactPairs, outputs: Sequence[Output]) -> System:
    """Return the system with the outputs that are contact forces of the pairs as they vibrate, docs/theory.md, eq. (13.7).

    Local; collective nowhere.  The force on body 1 is -R^T f_nl with f_nl = K_J R u + p: its springs are a row over the
    displacements, statics included, and the contribution of p is separate.
    """
    if all(output.joint is None for output in outputs):
        return system
    c = np.array([_on_pairs(pairs, output) for output in outputs]).reshape(len(outputs), 3 * pairs.n_pairs)
    of_springs = sp.csr_matrix(c * joint_stiffness(pairs)) @ system.R
    return replace(system, outputs=sp.csr_matrix(system.outputs + of_springs), output_pairs=c)


def _on_pairs(pairs: ContactPairs, output: Output) -> np.ndarray:
    """Return c of one output, (3 n_pairs,): minus the direction in each pair's frame, or minus its normal; 0 elsewhere."""
    of_joint = np.array([name == output.joint for name in pairs.joint], dtype=bool)
    if output.component == "normal":
        along = np.broadcast_to([0.0, 0.0, 1.0], (pairs.n_pairs, 3))
    else:
        along = pairs.frame @ np.array(output.direction or (0.0, 0.0, 0.0), dtype=float)
    return -(along * of_joint[:, None]).ravel()
