"""Find inverted elements before anything is assembled from them."""

import numpy as np

from .. import elements
from ..mesh.data import DistributedMesh, LocalBlock
from ..messages.errors import MeshError
from ..messages.words import counted, verb
from ..tables.structure_tables import StructureTables

_CHUNK = 5000  # elements whose Jacobians are held at a time


def check_elements(dmesh: DistributedMesh, tables: StructureTables) -> None:
    """Raise MeshError on every rank if any element has a Jacobian determinant that is not positive.

    Collective on ``dmesh.comm``: one gather of the element numbers at fault.
    """
    bad_owned = [bad for block in dmesh.blocks for bad in _not_positive(block, tables.sections[block.body].integration)]
    bad = sorted({element for rank in dmesh.comm.allgather(bad_owned) for element in rank})  # ranks share some elements
    if bad:
        lowest, number, kind, body = min((det, number, kind, body) for body, kind, number, det in bad)
        first = ", ".join(str(number) for _, _, number, _ in bad[:10]) + (", ..." if len(bad) > 10 else "")
        raise MeshError(
            f"{tables.model.mesh}: {counted(len(bad), 'element')} {verb(len(bad), 'are')} inverted or collapsed "
            f"(elements {first}); the worst is "
            f"{kind} element {number} of body {body!r} with det J = {lowest:.3g} m3, it must be > 0; check the order of its "
            "nodes, and whether mid-side nodes lie far from the middle of their edges"
        )


def _not_positive(block: LocalBlock, integration: str) -> list[tuple[str, str, int, float]]:
    """Return (body, kind, number, det J) of a block's elements at fault."""
    bad = []
    for start in range(0, len(block.nodes), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        det = elements.jacobian_minimum(block.kind, block.points[chunk], integration)
        for i in np.flatnonzero(~(det > 0.0)):
            bad.append((block.body, block.kind, int(block.numbers[chunk][i]), float(det[i])))
    return bad
