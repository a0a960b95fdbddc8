"""The model in Nastran's output .op2: its geometry tables, read by pyNastran."""

from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ..model import FileModel
from .plain import Plain
from .read import follow_references, model_of, read_by_pynastran, restored_streams

_WRITE_IT = "Nastran writes it with PARAM,POST,-1 and without PARAM,OGEOM,NO; the bulk data, .bdf, also hold it"


def read_op2_model(path: str) -> FileModel:
    """Return the structure of an .op2 file in the form of :func:`read_bdf`.  Local.

    Raises
    ------
    MeshError without the file's name: the file is damaged or has no geometry
    """
    cards = _geometry(path)
    for material in cards.materials.values():
        _shorten(material)
    if not cards.nodes or not cards.elements:
        raise MeshError(f"the file holds no grid points and elements; {_WRITE_IT}")
    return model_of(Plain(""), cards)


def _shorten(material: Any) -> None:
    """Round the constants of a material from single precision: 0.33 for 0.33000001311302185."""
    for name in ("e", "g", "nu", "rho", "a"):
        value = getattr(material, name, None)
        if isinstance(value, float) and np.isfinite(value) and float(np.float32(value)) == value:
            setattr(material, name, float(str(np.float32(value))))


def _geometry(path: str) -> Any:
    """Return the geometry as read by pyNastran, without results."""
    try:
        with restored_streams():
            from pyNastran.op2.op2_geom import OP2Geom
    except ImportError:
        raise MeshError("Nastran's .op2 is read by pyNastran; install it: pip install pyNastran") from None
    cards = OP2Geom(debug=None)
    with read_by_pynastran("Nastran's output", f"; {_WRITE_IT}"):
        cards.set_results([])
        cards.read_op2(path, combine=True)
        follow_references(cards)
    return cards
