"""The libraries used in a run, from the reports of its solvers, its points and its result file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py

from ..messages.words import counted
from ..parallel.agree import on_root
from ..points.branch import Branch
from ..system.versions import versions
from .build import Structure
from .prepare import Prepared

_CACHED = "from an earlier run"
_NOT_ASSEMBLED = {name: f"{_CACHED}, in its reduced model" for name in ("matrices", "factor", "order", "modes")}


def libraries_used(prepared: Prepared, branches: Sequence[Branch], results: Path) -> str:
    """Return lines on the library used for each part.  Collective; before the factor is freed."""
    version, structure = versions(), prepared.structure
    is_written = on_root(prepared.model.comm, h5py.is_hdf5, str(results))
    parts = {
        **(_NOT_ASSEMBLED if structure.factored.value is None else _of_structure(structure, version)),
        "points": _of_points(branches),
        "files": f"HDF5 {version['HDF5']}, {results.name}" if is_written else f"no {results.name}",
    }
    return "\n  ".join(["libraries of this run:", *(f"{part:<9}  {text}" for part, text in parts.items())])


def _of_structure(structure: Structure, version: dict[str, str]) -> dict[str, str]:
    """Return the libraries used for the structure.  Local; the same on every rank."""
    K_L, info, n_ranks = structure.K_L, structure.factor.info, structure.comm.size
    known = f", {_CACHED}" if "restored_from" in info else ""
    by_option, is_ours = f"{info['package']}, by PETSc's options", "ordering" in info
    return {
        "matrices": f"PETSc {version['PETSc']} {K_L.getType()}, {K_L.getSize()[0]} DOF",
        "partition": f"{structure.system.split_by}, {n_ranks} ranks" if n_ranks > 1 else "none on one rank",
        "factor": f"MUMPS {version.get('MUMPS', '')} Cholesky{known}" if is_ours else by_option,
        "order": info["ordering"] + known if is_ours else by_option,
        "modes": structure.modes.info.get("method", _CACHED),
    }


def _of_points(branches: Sequence[Branch]) -> str:
    """Return the solvers and how many points each of them solved.  Local; the same on every rank."""
    points = [point for branch in branches for point in branch.points]
    solved = [point for point in points if point.newton > 0]
    if not solved:
        return f"no Newton iteration at {counted(len(points), 'point')}"
    kinds = ", ".join(sorted({branch.solver for branch in branches if branch.solver}))
    iterations = [sum(getattr(point, name) for point in solved) for name in ("newton", "krylov")]
    return f"{kinds} at {len(solved)} of {len(points)}, {iterations[0]} Newton and {iterations[1]} Krylov iterations"
