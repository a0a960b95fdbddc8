"""A stuck structure as arrays and texts: all data of a response except static columns and data as large as the mesh.

All arrays are small and the same on every rank.  A restored structure computes its matrices, factor and modes over all DOFs when
they are first needed.
"""

from collections.abc import Hashable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from ..continuation.checkpoint import over, under
from ..library.build import Structure
from ..mesh.data import ContactPairs
from ..receptance.modes import ProjectedModes
from ..receptance.observed import Observed
from ..receptance.rigid_motion import RigidMotion
from ..receptance.static_response import StaticResponse
from ..receptance.structural_coupling import StructuralCoupling
from ..reduction.enriched_model import COUPLED, SAMPLED, Samples
from ..reduction.mistuning import FORMS, BladeForms
from ..reduction.reduction import Basis
from ..reduction.stuck import OnDemand, StuckStructure
from ..scene.schema import Scene
from ..statics.balance import Balance, BodiesAtRest, JointsAtRest
from ..statics.bolts import BoltsAtRest
from .records import Arrays

_OF_MESH = ("weights1", "weights2", "notes")  # attributes of pairs that only the assembly needs
_GROUP = "group/0"  # where the arrays of the only group of harmonics are
_MADE: dict[str, type] = {
    SAMPLED: Samples,
    COUPLED: StructuralCoupling,
    FORMS: BladeForms,
}  # types of data computed once per group, by key


# -- to arrays -----------------------------------------------------------------------------------------------------


def to_arrays(structure: Structure, basis: Basis | None = None) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and texts of a structure, and of the basis of a Galerkin method.  Local, on rank 0."""
    tables = _tables_of(structure)
    parts: dict[str, Any] = {"pairs": structure.pairs, "observed": structure.observed, **tables}
    arrays = {"n_dof": np.array(structure.n_dof), "has_mesh": np.array(structure.has_mesh)}
    if structure.numbers is not None:
        arrays["numbers"] = structure.numbers
    arrays |= over(_GROUP, _of_group(structure))
    texts: dict[str, Any] = {"joint": list(structure.pairs.joint), "laws": list(map(str, structure.pairs.laws))}
    texts |= {name: list(table.names) for name, table in tables.items()}
    if basis is not None:
        parts["basis"] = basis.modes
        texts["basis"] = [basis.unknowns, basis.leaves_out]
    for name, part in parts.items():
        arrays |= over(name, numbers_of(part)) if part is not None else {}
    return arrays, texts


def _of_group(stuck: StuckStructure) -> Arrays:
    """Return the arrays of one group of harmonics."""
    arrays = {name: np.array(getattr(stuck, name)) for name in ("n_modes", "n_proved")}
    made = {name: stuck.results.get((name, stuck.projected)) for name in _MADE}
    for name, part in {"projected": stuck.projected, "statics": stuck.statics, "rigid": stuck.rigid, **made}.items():
        arrays |= over(name, numbers_of(part)) if part is not None else {}
    return arrays


def _tables_of(structure: Structure) -> dict[str, BoltsAtRest | JointsAtRest | BodiesAtRest]:
    """Return the tables of the equilibrium at rest."""
    tables: dict[str, Any] = {} if structure.bolts is None else {"bolts": structure.bolts}
    balance = structure.balance
    return tables if balance is None else tables | {"across_joints": balance.joints, "on_bodies": balance.bodies}


def numbers_of(of: Any) -> Arrays:
    """Return the numbers in a dataclass by path: arrays, scalars, and numbers of nested dataclasses."""
    arrays: Arrays = {}
    for field in fields(of):
        value = getattr(of, field.name)
        if field.name in _OF_MESH or value is None:
            continue
        if is_dataclass(value):
            arrays |= over(field.name, numbers_of(value))
        elif isinstance(value, Mapping):
            arrays |= over(field.name, value)
        elif isinstance(value, tuple) and value and isinstance(value[0], np.ndarray):
            arrays |= over(field.name, {str(i): each for i, each in enumerate(value)})
        elif isinstance(value, (np.ndarray, float, int, bool, np.generic)) and np.asarray(value).dtype.kind in "iufbc":
            arrays[field.name] = np.asarray(value)
    return arrays


# -- and back ------------------------------------------------------------------------------------------------------


def structure_of(arrays: Arrays, texts: Mapping[str, Any], scene: Scene, comm: MPI.Comm, factored: OnDemand) -> Structure:
    """Return the structure of arrays and texts, the same on every rank, without static columns.  Local.

    ``factored`` computes its large parts.
    """
    bolts, balance, observed = None, None, under("observed", arrays)
    if "bolts" in texts:
        bolts = BoltsAtRest(tuple(texts["bolts"]), **under("bolts", arrays))
    if "across_joints" in texts:
        joints = JointsAtRest(tuple(texts["across_joints"]), **under("across_joints", arrays))
        balance = Balance(joints, BodiesAtRest(tuple(texts["on_bodies"]), **under("on_bodies", arrays)))
    stuck = under(_GROUP, arrays)
    projected, statics = ProjectedModes(**under("projected", stuck)), under("statics", stuck)
    is_complex = np.iscomplexobj(projected.R_phi) or np.iscomplexobj(statics["out_R"])
    columns = factored.pair_columns(comm, statics["row_sums"], is_complex)
    results: dict[Hashable, Any] = {
        (name, projected): _made_of(kind, under(name, stuck)) for name, kind in _MADE.items() if under(name, stuck)
    }
    rigid = under("rigid", stuck)
    return Structure(
        scene=scene,
        comm=comm,
        n_dof=int(arrays["n_dof"]),
        has_mesh=bool(arrays["has_mesh"]),
        numbers=arrays.get("numbers"),
        pairs=pairs_of(arrays, texts),
        observed=Observed(**observed) if observed else None,
        bolts=bolts,
        balance=balance,
        projected=projected,
        rigid=RigidMotion(**rigid) if rigid else None,
        statics=StaticResponse(columns, **statics),
        factored=factored,
        results=results,
        n_modes=int(stuck["n_modes"]),
        n_proved=int(stuck["n_proved"]),
    )


def _made_of(kind: type, arrays: Arrays) -> Any:
    """Return a dataclass with the given arrays as fields, scalars as floats."""
    return kind(**{name: value if value.ndim else float(value) for name, value in arrays.items()})


def pairs_of(arrays: Arrays, texts: Mapping[str, Any]) -> ContactPairs:
    """Return the contact pairs.  Local."""
    of_pairs = under("pairs", arrays)
    faces, law_columns = under("faces", of_pairs), under("law_columns", of_pairs)
    columns = {name: values for name, values in of_pairs.items() if "/" not in name}
    return ContactPairs(
        joint=tuple(texts["joint"]),
        laws=np.array(texts["laws"], dtype=str),
        faces=tuple(faces[name] for name in sorted(faces, key=int)),
        law_columns=law_columns,
        **columns,
    )


def basis_of(arrays: Arrays, texts: Mapping[str, Any]) -> Basis | None:
    """Return the basis of a Galerkin method; None without a basis.  Local."""
    if "basis" not in texts:
        return None
    unknowns, leaves_out = texts["basis"]
    return Basis(ProjectedModes(**under("basis", arrays)), int(unknowns), leaves_out)
