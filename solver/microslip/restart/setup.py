"""A set-up on disk: what the response needs of a structure, all but its matrices and factor, and the modes for its pictures.

The reduced model is small and whole on every rank but for the static columns, which are kept in a journal of their own as they
come.  A run that goes on with it builds the structure again only where a further pair slips, or for the fields on the mesh.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ..continuation.checkpoint import over, under
from ..library.prepare import Outline, Prepared
from ..mesh.data import ContactPairs
from ..points.selection import AllPairs, DissipatingPairs, NonStickingPairs, Selection
from ..receptance.damping import Damping
from ..receptance.modes import DampedModes
from ..receptance.observed import Observed
from ..receptance.reduced_structure import ReducedStructure
from ..receptance.structural_coupling import StructuralCoupling
from ..receptance.truncated_modes import DampingBeyond, TruncatedModes
from ..statics.balance import Balance, BodiesAtRest, JointsAtRest
from ..statics.bolts import BoltsAtRest
from .records import Arrays

SELECTIONS: dict[str, type] = {kind.__name__: kind for kind in (AllPairs, DissipatingPairs, NonStickingPairs)}
STATICS = ("du_static", "out_static", "out_R", "load_static", "outputs_static")  # of a structure with the exact static response
_OF_MESH = ("weights1", "weights2", "notes")  # of pairs: assembly alone needs them


def to_arrays(prepared: Prepared) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and texts of what was prepared, without static columns.  Local, on rank 0."""
    outline, reduction, better = prepared.outline, prepared.reduction, prepared.response.better
    arrays = over("pairs", numbers_of(prepared.pairs)) | over("model", of_reduced(reduction.structure))
    arrays |= over("outline", numbers_of(outline))
    texts: dict[str, Any] = texts_of_pairs(prepared.pairs, outline) | {
        "leaves_out": reduction.leaves_out,
        "selection": [type(reduction.selection).__name__, vars(reduction.selection)],
        "has_bars": better is not None,
    }
    arrays |= of_rest(outline)
    if better is not None:
        arrays |= {} if better.is_solved else over("better", of_reduced(better.structure))
        left_out = better.truncated.of(1)
        arrays |= {} if left_out is None else over("left_out", numbers_of(left_out))
    return arrays, texts


def texts_of_pairs(pairs: ContactPairs, outline: Outline) -> dict[str, Any]:
    """Return the texts of pairs, and the names of bolts, joints and bodies at rest.  Local."""
    texts: dict[str, Any] = {"joint": list(pairs.joint), "laws": list(map(str, pairs.laws))}
    return texts | {name: list(table.names) for name, table in _tables_of(outline).items()}


def of_rest(outline: Outline) -> Arrays:
    """Return the arrays of bolts and of the equilibrium at rest.  Local."""
    tables = [over(name, numbers_of(table)) for name, table in _tables_of(outline).items()]
    return {name: values for table in tables for name, values in table.items()}


def _tables_of(outline: Outline) -> dict[str, BoltsAtRest | JointsAtRest | BodiesAtRest]:
    found: dict[str, Any] = {} if outline.bolts is None else {"bolts": outline.bolts}
    balance = outline.balance
    return found if balance is None else found | {"across_joints": balance.joints, "on_bodies": balance.bodies}


def pairs_of(arrays: Arrays, texts: Mapping[str, Any]) -> ContactPairs:
    """Return the contact pairs.  Local."""
    kept = under("pairs", arrays)
    faces, own = under("faces", kept), under("own", kept)
    whole = {name: values for name, values in kept.items() if "/" not in name}
    return ContactPairs(
        joint=tuple(texts["joint"]),
        laws=np.array(texts["laws"], dtype=str),
        faces=tuple(faces[name] for name in sorted(faces, key=int)),
        own=own,
        **whole,
    )


def outline_of(arrays: Arrays, texts: Mapping[str, Any]) -> Outline:
    """Return the outline of the structure; its node numbers on rank 0 alone, if that passes them.  Local."""
    kept, bolts, balance = under("outline", arrays), None, None
    if "bolts" in texts:
        bolts = BoltsAtRest(tuple(texts["bolts"]), **under("bolts", arrays))
    if "across_joints" in texts:
        joints = JointsAtRest(tuple(texts["across_joints"]), **under("across_joints", arrays))
        balance = Balance(joints, BodiesAtRest(tuple(texts["on_bodies"]), **under("on_bodies", arrays)))
    return Outline(int(kept["n_dof"]), kept["omega_n"], bool(kept["has_mesh"]), kept.get("numbers"), bolts, balance)


def selection_of(texts: Mapping[str, Any]) -> Selection:
    """Return the set B of the method.  Local."""
    kind, values = texts["selection"]
    return SELECTIONS[kind](**values)


def modes_of(arrays: Mapping[str, Any]) -> DampedModes:
    """Return the modes of a model's arrays.  Local."""
    kept = under("family", arrays)
    return DampedModes(damping=Damping(kept.pop("C"), kept.pop("S", None)), **kept)


def observed_of(arrays: Mapping[str, Any]) -> Observed | None:
    """Return what makes outputs of their rows, of a model's arrays.  Local."""
    kept = under("observed", arrays)
    return Observed(**kept) if kept else None


def left_out_of(arrays: Arrays) -> TruncatedModes | None:
    """Return the samples of the modes left out.  Local."""
    kept = under("left_out", arrays)
    coupling, damping = under("coupling", kept), {name: value.item() for name, value in under("damping", kept).items()}
    whole = {name: values.item() if values.ndim == 0 else values for name, values in kept.items() if "/" not in name}
    known = StructuralCoupling(**coupling) if coupling else None
    return TruncatedModes(**whole, damping=DampingBeyond(**damping), coupling=known) if kept else None


def of_reduced(reduced: ReducedStructure) -> Arrays:
    """Return the arrays of a reduced structure with one group of harmonics."""
    receptance = reduced.receptance_of(1)
    modes = receptance.modes
    found = over("family", {"omega_n": modes.omega_n, "R_phi": modes.R_phi, "b": modes.b, "o": modes.o})
    found |= {"family/C": modes.damping.C, **({} if modes.damping.S is None else {"family/S": modes.damping.S})}
    found |= {name: getattr(receptance.static, name) for name in STATICS}
    return found | ({} if reduced.observed is None else over("observed", numbers_of(reduced.observed)))


def numbers_of(of: Any) -> Arrays:
    """Return what a dataclass holds of numbers, by path: arrays, single ones, and those of what it holds in turn."""
    found: Arrays = {}
    for field in fields(of):
        value = getattr(of, field.name)
        if field.name in _OF_MESH or value is None or isinstance(value, (BoltsAtRest, Balance)):
            continue
        if is_dataclass(value):
            found |= over(field.name, numbers_of(value))
        elif isinstance(value, Mapping):
            found |= over(field.name, value)
        elif isinstance(value, tuple) and value and isinstance(value[0], np.ndarray):
            found |= over(field.name, {str(i): one for i, one in enumerate(value)})
        elif isinstance(value, (np.ndarray, float, int, bool, np.generic)) and np.asarray(value).dtype.kind in "iufb":
            found[field.name] = np.asarray(value)
    return found
