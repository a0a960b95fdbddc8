"""The model that Nastran writes into its output, .op2: the tables of its geometry, read by pyNastran."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ..model import FileModel
from .plain import Plain
from .read import follow_references, model_of, read_by_pynastran, streams_kept

_WRITE_IT = "Nastran writes it with PARAM,POST,-1 and without PARAM,OGEOM,NO; the bulk data, .bdf, hold it, too"


def read_op2_model(path: str) -> FileModel:
    """Return the structure of an .op2 file, as :func:`read_bdf` does of bulk data.  Local.

    Raises
    ------
    MeshError without the file's name: damaged, or without geometry
    """
    cards = _geometry(path)
    for material in cards.materials.values():
        _shorten(material)
    if not cards.nodes or not cards.elements:
        raise MeshError(f"the file holds no grid points and elements; {_WRITE_IT}")
    return model_of(Plain(""), cards)


def _shorten(material: Any) -> None:
    """Give a material the decimals that were meant where the file has single precision: 0.33 for 0.33000001311302185."""
    for name in ("e", "g", "nu", "rho", "a"):
        value = getattr(material, name, None)
        if isinstance(value, float) and np.isfinite(value) and float(np.float32(value)) == value:
            setattr(material, name, float(str(np.float32(value))))


def _geometry(path: str) -> Any:
    """Return pyNastran's reading of the geometry, its results passed over."""
    try:
        with streams_kept():
            from pyNastran.op2.op2_geom import OP2Geom
    except ImportError:
        raise MeshError("Nastran's .op2 is read by pyNastran; install it: pip install pyNastran") from None
    cards = OP2Geom(debug=None)
    with read_by_pynastran("Nastran's output", f"; {_WRITE_IT}"):
        cards.set_results([])
        cards.read_op2(path, combine=True)
        follow_references(cards)
    return cards
