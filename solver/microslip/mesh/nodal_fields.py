"""Scalar nodal fields of the mesh file.  Local, rank 0."""

from __future__ import annotations

import numpy as np

from ..messages.errors import MeshError
from ..messages.words import hint
from .data import Mesh


def field_at_nodes(mesh: Mesh, field: str, nodes: np.ndarray, where: str, what: str) -> np.ndarray:
    """Return a field of the mesh, (n_nodes,), with values at all ``nodes`` (n,) of ``what``.

    Raises
    ------
    MeshError : the field does not exist, or has no value at one of these nodes
    """
    if field not in mesh.fields:
        fields_text = f"it has: {', '.join(mesh.fields)}" if mesh.fields else "it has no field of one number a node at all"
        raise MeshError(f"{where} = {field!r}: there is no such field in the mesh{hint(field, mesh.fields, repr)}; {fields_text}")
    missing = nodes[np.isnan(mesh.fields[field][nodes])]
    if len(missing):
        raise MeshError(
            f"{where} = {field!r} has no value at {len(missing)} nodes of {what}, the first is {mesh.numbers[missing[0]]}"
        )
    return mesh.fields[field]
