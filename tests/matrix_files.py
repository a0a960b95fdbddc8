"""Functions that write a symmetric matrix in the formats of other programs, to test their readers."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp


def write_mtx(path: Path, A, dofs=None) -> None:
    scipy.io.mmwrite(str(path), sp.coo_matrix(A), precision=17, symmetry="symmetric")


def write_npz(path: Path, A, dofs=None) -> None:
    sp.save_npz(path, sp.csr_matrix(A))


def write_mat(path: Path, A, dofs=None) -> None:
    scipy.io.savemat(path, {"A": sp.csc_matrix(A)}, do_compression=True)


def write_mat73(path: Path, A, dofs=None) -> None:
    """Write a sparse matrix in MATLAB's -v7.3 format: a group with data, ir, jc."""
    import h5py

    A = sp.csc_matrix(A)
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("A")
        group.attrs["MATLAB_sparse"] = np.uint64(A.shape[0])
        group.attrs["MATLAB_class"] = np.bytes_("double")
        for name, values in (("data", A.data), ("ir", A.indices.astype("u8")), ("jc", A.indptr.astype("u8"))):
            group.create_dataset(name, data=values)


def write_petsc(path: Path, A, dofs=None) -> None:
    """Write by PETSc on one rank."""
    from mpi4py import MPI
    from petsc4py import PETSc

    A = sp.csr_matrix(A)
    viewer = PETSc.Viewer().createBinary(str(path), "w", comm=MPI.COMM_SELF)
    matrix = PETSc.Mat().createAIJ(A.shape, csr=(A.indptr, A.indices, A.data), comm=MPI.COMM_SELF)
    viewer.view(matrix)
    viewer.destroy(), matrix.destroy()
    Path(f"{path}.info").unlink(missing_ok=True)


def write_hb(path: Path, A, dofs=None) -> None:
    scipy.io.hb_write(str(path), sp.csc_matrix(A))


def write_op4_text(path: Path, A, dofs=None, name="K") -> None:
    """Write full columns of 64-bit numbers, five per line."""
    A = np.asarray(sp.csr_matrix(A).todense())
    n_rows, n_columns = A.shape
    lines = [f"{n_columns:8d}{n_rows:8d}{6:8d}{2:8d}{name:<8s}1P,3E23.16"]
    for j, column in enumerate(A.T, 1):
        lines.append(f"{j:8d}{1:8d}{n_rows:8d}")
        lines += ["".join(f"{x:23.16E}" for x in column[k : k + 3]) for k in range(0, n_rows, 3)]
    lines += [f"{n_columns + 1:8d}{1:8d}{1:8d}", f"{1.0:23.16E}"]
    path.write_text("\n".join(lines) + "\n")


def write_op4_binary(path: Path, A, dofs=None, name="K", order="<", is_big=True) -> None:
    """Write strings of columns, of any number of matrices: ``A`` may be a dict by name."""
    matrices = A if isinstance(A, dict) else {name: A}
    path.write_bytes(b"".join(_op4_matrix(sp.csc_matrix(own), own_name, order, is_big) for own_name, own in matrices.items()))


def _op4_matrix(A, name, order, is_big) -> bytes:
    n_rows, n_columns = A.shape
    head = struct.pack(f"{order}4i", n_columns, -n_rows if is_big else n_rows, 6, 2) + f"{name:<8s}".encode()
    records = [head]
    for j in range(n_columns):
        words = b""
        rows, values = A.indices[A.indptr[j] : A.indptr[j + 1]], A.data[A.indptr[j] : A.indptr[j + 1]]
        for row, value in sorted(zip(rows, values)):
            string = struct.pack(f"{order}2i", 3, row + 1) if is_big else struct.pack(f"{order}i", 3 * 65536 + row + 1)
            words += string + struct.pack(f"{order}d", value)
        if words:
            records.append(struct.pack(f"{order}3i", j + 1, 0, len(words) // 4) + words)
    records.append(struct.pack(f"{order}3i", n_columns + 1, 1, 2) + struct.pack(f"{order}d", 1.0))
    return b"".join(framed(record, order) for record in records)


def framed(record: bytes, order: str = "<") -> bytes:
    """Return a record of Fortran."""
    mark = struct.pack(f"{order}i", len(record))
    return mark + record + mark


def write_op2(path: Path, A, dofs=None, name="K") -> None:
    """Write a data block of 64-bit numbers, one string per entry."""
    A = sp.csc_matrix(A)
    marker = lambda number: framed(struct.pack("<i", number))  # noqa: E731
    label = f"{name:<8s}".encode()
    out = marker(2) + framed(label) + marker(-1) + marker(7)
    out += framed(struct.pack("<7i", 101, A.shape[1], A.shape[0], 6, 2, A.nnz, 0))
    out += marker(-2) + marker(1) + marker(0) + marker(4) + framed(label + struct.pack("<2i", 170, 170))
    for j in range(A.shape[1]):
        out += marker(-3 - j) + marker(1) + marker(1)
        for row, value in zip(A.indices[A.indptr[j] : A.indptr[j + 1]], A.data[A.indptr[j] : A.indptr[j + 1]]):
            out += marker(2) + framed(struct.pack("<id", row + 1, value))
    path.write_bytes(out + marker(-3 - A.shape[1]) + marker(1) + marker(0) + marker(0) + marker(0))


def write_dmig(path: Path, A, dofs, name="KAAX") -> None:
    """Write one triangle in fields of sixteen, as in a punch file."""
    A = sp.tril(A).tocsc()
    lines = [f"DMIG    {name:<8s}       0       6       2       0{'':16s}{A.shape[0]:8d}"]
    for j in range(A.shape[1]):
        lines.append(f"DMIG*   {name:<16s}{dofs.nodes[j]:16d}{dofs.directions[j]:16d}")
        for i, value in zip(A.indices[A.indptr[j] : A.indptr[j + 1]], A.data[A.indptr[j] : A.indptr[j + 1]]):
            lines.append(f"*{'':7s}{dofs.nodes[i]:16d}{dofs.directions[i]:16d}{f'{value:.9E}'.replace('E', 'D'):>16s}")
    path.write_text("\n".join(lines) + "\n")


def write_abaqus(path: Path, A, dofs) -> None:
    """Write the lower triangle by nodes and degrees of freedom, and a fixed node."""
    A = sp.tril(A).tocoo()
    places = zip(dofs.nodes[A.row], dofs.directions[A.row], dofs.nodes[A.col], dofs.directions[A.col], A.data)
    lines = [f"{i},{a}, {j},{b}, {value:22.15e}" for i, a, j, b, value in places]
    path.write_text("\n".join([*lines, *(f"999,{a}, 999,{a},  1.000000000000000e+36" for a in (1, 2, 3))]) + "\n")


def write_calculix(path: Path, A, dofs) -> None:
    """Write the upper triangle, column by column, and the rows in another file."""
    A = sp.triu(A).tocsc().tocoo()
    path.write_text("".join(f"{i + 1} {j + 1} {value:20.13e}\n" for i, j, value in zip(A.row, A.col, A.data)))
    path.with_suffix(".dof").write_text("".join(f"{node}.{axis}\n" for node, axis in zip(dofs.nodes, dofs.directions)))


def write_full(path: Path, A, dofs, symbol="K") -> None:
    """Write a .full of symbolic assembly with one matrix; the last three equations are constrained."""
    A = sp.csr_matrix(A)
    n = A.shape[0] + 3
    whole = sp.block_diag([A, 7.0 * sp.identity(3)]).tocsr()
    triangle = sp.triu(whole).tocsc()
    nodes = [*dofs.nodes[::3], dofs.nodes.max() + 1]
    head = np.zeros(100, dtype="<i4")
    head[[0, 1, 2, 7, 32]] = -4, n, n - 3, 3, len(nodes)
    first = [_record(np.zeros(100, dtype="<i4")), None, _record(np.array([1, 2, 3])), _record(np.array(nodes))]
    start = (103 * 2) + 6 + len(nodes) + 3
    block = []
    for j in range(n):
        own = slice(triangle.indptr[j], triangle.indptr[j + 1])
        block += [_record(triangle.indices[own] + 1), _record(triangle.data[own])]
    entries = b"".join(block)
    held = np.r_[np.zeros(n - 3), -np.ones(3)].astype("<i4")
    head[{"K": 18, "M": 26}[symbol]], head[35] = start, start + len(entries) // 4
    first[1] = _record(head)
    path.write_bytes(b"".join(first) + entries + _record(np.full(len(nodes), 3)) + _record(held))


def write_sub(path: Path, A, dofs, symbol="K", n_modes=0, is_triangle=False) -> None:
    """Write a .sub with two matrices, of which the other is seven times this one; the last rows are those of modes."""
    A = sp.csr_matrix(A).toarray()
    n, modes = len(A), np.arange(n_modes) + 3 * (dofs.nodes.max() + 5)
    rows = np.r_[3 * (dofs.nodes - 1) + dofs.directions, modes][:n]
    parts = (A, 7.0 * A) if symbol == "K" else (7.0 * A, A)
    head = np.zeros(80, dtype="<i4")
    head[[0, 1, 2, 4, 10, 11, 43]] = 8, n, 2, 3, 1, 1, n_modes
    start = 103 + 83
    head[[30, 31, 21]] = start, start + 6, start + 6 + n + 3
    matrices = [_record(part[i, : i + 1] if is_triangle else part[i]) for i in range(n) for part in parts]
    whole = [_record(np.zeros(100, dtype="<i4")), _record(head), _record(np.array([1, 2, 3])), _record(rows), *matrices]
    path.write_bytes(b"".join(whole))


def _record(values: np.ndarray) -> bytes:
    """Return a record of Ansys: words, kind, content, words."""
    is_number = values.dtype.kind == "f"
    data = values.astype("<f8" if is_number else "<i4").tobytes()
    return struct.pack("<iI", len(data) // 4, 0 if is_number else 0x80000000) + data + struct.pack("<i", len(data) // 4)


WRITERS = {  # ending: function, and its relative precision
    "mtx": (write_mtx, 1e-15),
    "npz": (write_npz, 1e-15),
    "mat": (write_mat, 1e-15),
    "v73.mat": (write_mat73, 1e-15),
    "petsc": (write_petsc, 1e-15),
    "rua": (write_hb, 1e-15),
    "text.op4": (write_op4_text, 1e-15),
    "op4": (write_op4_binary, 1e-15),
    "op2": (write_op2, 1e-15),
    "pch": (write_dmig, 1e-8),
    "abaqus.mtx": (write_abaqus, 1e-14),
    "sti": (write_calculix, 1e-12),
    "full": (write_full, 1e-15),
    "sub": (write_sub, 1e-15),
}
WITH_DOFS = ("pch", "abaqus.mtx", "sti", "full", "sub")
