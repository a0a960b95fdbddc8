"""Nodes and directions of a structure given as matrices, by which loads, outputs and joints may name nodes instead of rows.

A superelement has rows q of its own and a recovery matrix, u = T q: both are places, those of q first.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..formats.csv_table import numbered_rows, read_table
from ..formats.matrices.file_matrix import DIRECTIONS, DofMap, FileMatrix
from ..formats.matrices.read import read_any
from ..formats.model import index_of
from ..mesh.data import ContactPairs, Mesh
from ..mesh.locate import find_node
from ..mesh.read import nodes_alone, read_nodes
from ..messages.errors import CaseError
from ..messages.words import counted, verb
from ..tables.structure_tables import StructureTables
from ..tables.vibration import Load, Output
from .force_file import forces_on_nodes
from .maps import pair_map


@dataclass(frozen=True)
class Places:
    """The nodes that are known, and where their displacements are.  Rank 0 only."""

    mesh: Mesh  # nodes and their places (NaN where they are not stated); with elements and groups where it is a mesh file
    dof: np.ndarray  # (n_nodes, 3) place of each displacement, -1 where there is none
    expand: sp.csr_matrix  # (n_places, n_dof) displacements of all places from the rows: 1, and below it T

    def name_of(self, row: int) -> str:
        """Return the node that a row belongs to, or the row's number."""
        node = np.flatnonzero((self.dof == row).any(axis=1))
        return f"node {self.mesh.numbers[node[0]]}" if len(node) else f"DOF {row}"

    def on_rows(self, row: sp.spmatrix) -> sp.csr_matrix:
        """Return forces on places (n, n_places) as forces on the rows of the matrices, (n, n_dof)."""
        return (row @ self.expand).tocsr()

    def pair_map(self, pairs: ContactPairs, names: tuple[str, str] = ("node1", "node2")) -> sp.csr_matrix:
        """Return R of pairs of nodes, (3 n_pairs, n_dof).  Raises CaseError: a node of a pair that the matrices do not move."""
        for weights in pairs.sides(len(self.dof)):
            used = np.unique(weights.indices)
            lost = used[(self.dof[used] < 0).all(axis=1)]
            if len(lost):
                raise CaseError(
                    f"{self.mesh.path}: joint {pairs.joint[0]!r}: node {self.mesh.numbers[lost[0]]} has no row in the matrices "
                    f"({len(lost)} such nodes); fixed nodes are ground, and condensed nodes need [model] recovery"
                )
        return self.on_rows(pair_map(pairs, self.dof, self.expand.shape[0]))

    def of_load(self, load: Load, where: str) -> sp.csr_matrix:
        """Return the real shapes of a load on nodes, (1 or 2, n_dof)."""
        path = load.file_of("forces")
        if path is not None:
            nodes, forces = forces_on_nodes(path, self.mesh.numbers)
            rows = [self._row(nodes, part, where, path) for part in (forces.real, forces.imag)]
            return sp.vstack(rows).tocsr()
        nodes = self._nodes(load, where)
        shares = np.tile(np.array(load.direction, dtype=float) / len(nodes), (len(nodes), 1))
        return self._row(nodes, shares, where)

    def of_output(self, output: Output, where: str) -> sp.csr_matrix:
        """Return the row of an output at a node, (1, n_dof)."""
        return self._row(self._nodes(output, where)[:1], np.array([output.direction], dtype=float), where)

    def _nodes(self, entry: Load | Output, where: str) -> np.ndarray:
        """Return the nodes that a load or an output names, index into ``mesh.points``."""
        group = getattr(entry, "group", None)
        if entry.position is not None and not np.isfinite(self.mesh.points).all():
            raise CaseError(f"{where} position: the positions of the nodes are unknown; state [model] nodes, or name a node")
        if group is not None and group not in self.mesh.node_groups:
            known = ", ".join(self.mesh.node_groups) or "none; [model] nodes = a mesh file brings them"
            raise CaseError(f"{where} group = {group!r}: there is no such group; known: {known}")
        if entry.node is not None and entry.node not in self.mesh.numbers:
            low, high = self.mesh.numbers.min(), self.mesh.numbers.max()
            raise CaseError(f"{where} node = {entry.node}: the model has no such node; node numbers run from {low} to {high}")
        return find_node(self.mesh, position=entry.position, node=entry.node, group=group, where=where)

    def _row(self, nodes: np.ndarray, values: np.ndarray, where: str, file: Path | None = None) -> sp.csr_matrix:
        """Return values (n, 3) on nodes as a row over the matrices' rows; CaseError if none of them exists."""
        column, value = self.dof[nodes].ravel(), values.ravel()
        is_entry = (column >= 0) & (value != 0.0)
        if value.any() and not is_entry.any():
            along = next(DIRECTIONS[i % 3] for i in np.flatnonzero(value))
            at = f"node {self.mesh.numbers[nodes[0]]}" if len(nodes) == 1 else f"its {len(nodes)} nodes"
            raise CaseError(
                f"{where}{f' {file}' if file else ''}: the matrices have no row for {at} along {along}, or not any more"
            )
        places = np.zeros(is_entry.sum(), dtype=int), column[is_entry]
        return self.on_rows(sp.csr_matrix((value[is_entry], places), (1, self.expand.shape[0])))


def read_places(tables: StructureTables, given: DofMap | None, n_dof: int) -> Places | None:
    """Return the places of a structure; None where nodes and directions are unknown.  Local, rank 0.

    ``given`` are nodes and directions of the rows by the file of the stiffness.

    Raises
    ------
    CaseError, MeshError : a file is at fault, or does not fit the matrices
    """
    dofs = dofs_of_rows(tables.model.file_of("dofs"), given, n_dof, "dofs")
    recovery, recovered = _recovery(tables, n_dof)
    if dofs is None and recovered is None:
        if tables.model.nodes is not None:
            raise CaseError(
                f"{tables.path}: [model] nodes: the nodes of the rows are unknown; state [model] dofs, or give "
                "the matrices in a format that states them"
            )
        return None
    expand = sp.identity(n_dof, format="csr")
    nobody = DofMap(np.zeros(n_dof, dtype=np.int64), np.zeros(n_dof, dtype=np.int64))
    maps = [nobody if dofs is None else dofs]
    if recovery is not None:
        expand = sp.vstack([expand, recovery]).tocsr()
        maps.append(recovered)  # type: ignore[arg-type]
    nodes, directions = (np.concatenate([getattr(each, name) for each in maps]) for name in ("nodes", "directions"))
    mesh = _mesh(tables, nodes)
    return Places(mesh, _table(mesh, nodes, directions), expand)


def dofs_of_rows(path: Path | None, given: DofMap | None, n_rows: int, key: str) -> DofMap | None:
    """Return node and direction of each row: of the CSV file, or as the matrix's own file has it.  Local.

    Raises
    ------
    CaseError : the file is at fault, or both state them
    """
    if path is None:
        return None if given is None else _once(given, "the matrix's own file")
    if given is not None:
        raise CaseError(f"{path}: [model] {key}: the file of the matrix states node and direction of its rows; leave it out")
    columns, lines = read_table(path, ("node", "direction"), what="row")
    table = np.column_stack([columns["node"], columns["direction"]])
    wrong = np.flatnonzero((table % 1.0).any(axis=1) | (table[:, 1] < 0) | (table[:, 1] > 6) | (abs(table[:, 0]) > 2.0**53))
    if len(wrong):
        raise CaseError(
            f"{path}, line {lines[wrong[0]]}: a node number and a direction from 1 (x) to 6 (rotation about z) are needed; "
            "0, 0 for a row of no node"
        )
    if len(table) != n_rows:
        raise CaseError(f"{path}: [model] {key} has {counted(len(table), 'row')}, and the matrix has {n_rows}")
    return _once(DofMap(*table.T.astype(np.int64)), str(path))


def _once(dofs: DofMap, where: str) -> DofMap:
    """Return the map; CaseError where two rows are the same direction of a node."""
    counted = np.flatnonzero((dofs.nodes > 0) & (dofs.directions > 0))
    keys = dofs.keys()[counted]
    order = np.argsort(keys, kind="stable")
    twice = np.flatnonzero(np.diff(keys[order]) == 0)
    if len(twice):
        first, second = counted[order[twice[0] : twice[0] + 2]]
        raise CaseError(f"{where}: rows {first} and {second}, counted from 0, are both {dofs.name(first)}")
    return dofs


def _recovery(tables: StructureTables, n_dof: int) -> tuple[sp.csr_matrix | None, DofMap | None]:
    """Return the recovery matrix T (n_recovered, n_dof) with node and direction of its rows, where there is one."""
    path, name = tables.model.matrices.get("recovery", (None, None))
    if path is None:
        return None, None
    where = f"{path}: [model] recovery"
    recovery: FileMatrix = read_any(path, "[model] recovery", "T", name, is_square=False)
    matrix = sp.csr_matrix(recovery.matrix).astype(float)
    if matrix.shape[1] != n_dof:
        raise CaseError(f"{where} is {matrix.shape[0]} x {matrix.shape[1]}: u = T q needs a column for each of {n_dof} rows")
    if not np.isfinite(matrix.data).all():
        raise CaseError(f"{where} has an entry that is not a finite number")
    of_file = None if recovery.is_triangle else recovery.dofs
    dofs = dofs_of_rows(tables.model.file_of("recovery_dofs"), of_file, matrix.shape[0], "recovery_dofs")
    if dofs is None:
        raise CaseError(f"{where}: the node and direction of its rows are not stated; state [model] recovery_dofs")
    return matrix, dofs


def _mesh(tables: StructureTables, nodes: np.ndarray) -> Mesh:
    """Return the nodes of the rows, with their known places."""
    named = np.unique(nodes[nodes > 0])
    path = tables.model.file_of("nodes")
    if path is None:
        return nodes_alone(tables.model.matrices["stiffness"][0], named)
    mesh = read_nodes(path)
    _, unknown = index_of(mesh.numbers, named)
    if not len(unknown) or mesh.elements:
        return mesh
    no_position = np.full((len(unknown), 3), np.nan)
    note = f"{counted(n := len(unknown), 'node')} of the matrices {verb(n, 'have')} no place, the first is node {unknown[0]}"
    return replace(
        mesh, points=np.concatenate([mesh.points, no_position]), numbers=np.concatenate([mesh.numbers, unknown]), notes=(note,)
    )


def _table(mesh: Mesh, nodes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return the place of each displacement of the mesh's nodes, (n_nodes, 3); of several, the first."""
    table = np.full((len(mesh.numbers), 3), -1, dtype=np.int64)
    moves = np.flatnonzero((nodes > 0) & (directions >= 1) & (directions <= 3))[::-1]
    index, unknown = index_of(mesh.numbers, nodes[moves])
    known = ~np.isin(nodes[moves], unknown)
    table[index[known], directions[moves[known]] - 1] = moves[known]
    return table


def names_nodes(path: Path) -> bool:
    """Return whether the header of a file of forces names nodes, not DOFs.  Local."""
    rows = numbered_rows(path)
    return bool(rows) and "node" in [cell.lower() for cell in rows[0][1]]


def aligned(matrices: dict[str, FileMatrix], files: dict[str, Path]) -> tuple[dict[str, sp.csr_matrix], DofMap | None]:
    """Return the matrices with their rows in the same order, where their files state nodes and directions, and these.  Local.

    Rows that one matrix has and another does not are empty there.

    Raises
    ------
    CaseError : matrices of different size, without nodes and directions in both
    """
    mapped = {key: matrix for key, matrix in matrices.items() if matrix.dofs is not None}
    dofs = next((matrix.dofs for matrix in mapped.values()), None)
    if len(mapped) < len(matrices) or len(mapped) < 2:
        return {key: matrix.matrix for key, matrix in matrices.items()}, dofs
    keys = {key: _once(matrix.dofs, str(files[key])).keys() for key, matrix in mapped.items() if matrix.dofs is not None}
    everything = np.concatenate([keys["stiffness"], np.setdiff1d(np.concatenate(list(keys.values())), keys["stiffness"])])
    order = np.argsort(everything)
    placed = {}
    for key, matrix in mapped.items():
        rows = order[np.searchsorted(everything, keys[key], sorter=order)]
        entries = matrix.matrix.tocoo()
        shape = (len(everything), len(everything))
        placed[key] = sp.csr_matrix((entries.data, (rows[entries.row], rows[entries.col])), shape)
    return placed, DofMap(everything // 8, everything % 8)
