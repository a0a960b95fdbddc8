"""Each format returns the matrix that was written, files of other programs have the documented values, and a damaged file of
any format gives one message."""

import re
import resource
import struct
import zipfile
from contextlib import contextmanager
from pathlib import Path

import matrix_files
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from matrix_files import WITH_DOFS, WRITERS

from microslip.formats.matrices.file_matrix import DofMap
from microslip.formats.matrices.read import ENDINGS, read_any, read_matrix
from microslip.messages.errors import CaseError, ResourceError

DATA = Path(__file__).parents[1] / "data" / "matrices"
N = 9
DOFS = DofMap(np.repeat([3, 17, 40], 3), np.tile([1, 2, 3], 3))


def matrix():
    """Return a sparse, symmetric, positive definite matrix (9, 9) of large and small entries."""
    A = sp.random(N, N, 0.3, random_state=4).toarray()
    return 1e7 * (A @ A.T) + np.diag(np.logspace(-2, 8, N))


def read(path, symbol="K", name=None):
    return read_matrix(path, "[model] stiffness", symbol, name)


@contextmanager
def bounded(n_bytes):
    """Limit the memory of this process to ``n_bytes`` beyond its present size."""
    limits = resource.getrlimit(resource.RLIMIT_AS)
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + n_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


@pytest.mark.parametrize("ending", WRITERS)
def test_the_written_matrix_is_returned(tmp_path, ending):
    write, accuracy = WRITERS[ending]
    A, path = matrix(), tmp_path / f"A.{ending}"
    write(path, A, DOFS)
    computed = read(path)
    np.testing.assert_allclose(computed.matrix.toarray(), A, rtol=0.0, atol=accuracy * np.abs(A).max())
    assert (computed.dofs is not None) == (ending in WITH_DOFS)
    if computed.dofs is not None:
        np.testing.assert_array_equal(computed.dofs.keys(), DOFS.keys())


@pytest.mark.parametrize("order, is_big", [("<", False), (">", False), (">", True)])
def test_op4_of_any_byte_order_with_several_matrices(tmp_path, order, is_big):
    A, path = matrix(), tmp_path / "model.op4"
    matrix_files.write_op4_binary(path, {"KGG": A, "MGG": 2.0 * A, "X": 3.0 * A}, order=order, is_big=is_big)
    np.testing.assert_array_equal(read(path).matrix.toarray(), A)
    np.testing.assert_array_equal(read(path, "M").matrix.toarray(), 2.0 * A)
    np.testing.assert_array_equal(read(path, "M", "X").matrix.toarray(), 3.0 * A)
    with pytest.raises(CaseError, match='"Y" has no matrix of this name; it has KGG, MGG, X'):
        read(path, "M", "Y")


def test_a_superelement_of_ansys_may_have_modes_and_be_a_triangle(tmp_path):
    A, path = matrix(), tmp_path / "se.sub"
    matrix_files.write_sub(path, A, DOFS[np.arange(6)], n_modes=3, is_triangle=True)
    computed = read(path)
    np.testing.assert_array_equal(computed.matrix.toarray(), A)
    np.testing.assert_array_equal(read(path, "M").matrix.toarray(), 7.0 * A)
    np.testing.assert_array_equal(computed.dofs.keys(), [*DOFS.keys()[:6], 0, 0, 0])
    with pytest.raises(CaseError, match="the file holds no C"):
        read(path, "C")


@pytest.mark.parametrize(
    "place, value, message",
    [
        (0, 9, "not of a superelement with full"),
        (9, 1, "a form that is not"),
        (2, 1, "a form that"),
        (43, 10, "does not fit its 9 rows"),
    ]
    + [
        (21, 186, "is of the kind"),
        (31, 186, "does not fit"),
        (12, 1, "a form that is not"),
        (1, 8, "holds 9 numbers where 8 are expected"),
    ],
)
def test_a_superelement_of_another_form_is_refused(tmp_path, place, value, message):
    path = tmp_path / "se.sub"
    matrix_files.write_sub(path, matrix(), DOFS)
    content = np.frombuffer(path.read_bytes(), dtype="<i4").copy()
    content[103 + 2 + place] = value
    path.write_bytes(content.tobytes())
    with pytest.raises(CaseError, match=message):
        read(path)


def test_superelements_with_rows_in_another_order_are_refused(tmp_path):
    """With rows in another order than documented the matrices are not symmetric."""
    A, path = matrix(), tmp_path / "se.sub"
    matrix_files.write_sub(path, A, DOFS)
    content, n = path.read_bytes(), 4 * (2 * N + 3)
    rows = [content[-n * k : len(content) - n * (k - 1)] for k in range(2 * N, 0, -1)]
    path.write_bytes(content[: -n * 2 * N] + b"".join(rows[::2] + rows[1::2]))
    with pytest.raises(CaseError, match="is not symmetric"):
        read(path)


def test_dmig_in_small_fields_and_between_commas(tmp_path):
    path = tmp_path / "k.dmig"
    path.write_text(
        "$ by hand\nDMIG    K       0       6       1       0\n"
        "DMIG    K       5       1               5       1       4.0\n        5       2       -1.5-3\n"
        "DMIG,K,5,2,,5,2,2.5+2\nGRID,1,,0.,0.,0.\n"
    )
    matrix = read(path)
    np.testing.assert_array_equal(matrix.matrix.toarray(), [[4.0, -1.5e-3], [-1.5e-3, 250.0]])
    assert [matrix.dofs.name(row) for row in (0, 1)] == ["node 5 x", "node 5 y"]


# -- files of other programs: tests/data/README.md --------------------------------------------------------------------


@pytest.mark.parametrize("file", ["mat_b_dn.op4", "mat_b_s2.op4", "mat_t_s1.op4"])
def test_nastran_op4_in_three_forms_gives_the_same_matrices(file):
    np.testing.assert_array_equal(read(DATA / file, name="EYE10").matrix.toarray(), np.eye(10))
    named = {name: read_any(DATA / file, "k", "K", name, is_square=False).matrix.toarray() for name in ("RND1RD", "LOW")}
    assert named["LOW"].shape == (5, 7)
    first = read_any(DATA / "mat_b_dn.op4", "k", "K", "RND1RD", is_square=False).matrix.toarray()
    np.testing.assert_allclose(named["RND1RD"], first, rtol=1e-15)
    with pytest.raises(CaseError, match="complex"):
        read_any(DATA / file, "k", "K", "RND1CD")


def test_nastran_op2_holds_products_that_nastran_formed():
    A, B, ATB, BTA = (
        read_any(DATA / "mymatrix.op2", "k", "K", name, is_square=False).matrix.toarray() for name in ("A", "B", "ATB", "BTA")
    )
    np.testing.assert_array_equal(A, [[1.0, 0.0], [3.0, 6.0], [5.0, 0.0], [0.0, 8.0]])
    np.testing.assert_array_equal(ATB, A.T @ B)
    np.testing.assert_array_equal(BTA, B.T @ A)


def test_nastran_punch_file_has_the_stiffness_of_springs():
    matrix = read(DATA / "dmig.pch")
    K, row = matrix.matrix.toarray(), {node: i for i, node in enumerate(matrix.dofs.nodes)}
    assert (matrix.dofs.directions == 1).all() and K[row[101], row[101]] == 155.6 and K[row[106], row[105]] == -3002.7
    np.testing.assert_array_equal(K[row[101]][[row[101], row[102]]], [155.6, -155.6])
    assert np.linalg.eigvalsh(K).min() > -1e-9 * K.max()


def test_abaqus_beam_has_the_stiffness_and_mass_of_theory():
    """B33 of E = 100e6, G = 80e6, A = 0.25, I = 1.5e-4, J = 3e-4, rho = 100, L = 3; nodes below 0 are internal to Abaqus."""
    K, M = read(DATA / "model_STIF1.mtx"), read(DATA / "model_MASS1.mtx", "M")
    L, EI = 3.0, 100e6 * 1.5e-4
    row = {DofMap.name(K.dofs, i): i for i in range(len(K.dofs.nodes))}
    A = K.matrix.toarray()
    for first, second, value in (
        ("node 1 y", "node 1 y", 12 * EI / L**3),
        ("node 1 rz", "node 1 y", 6 * EI / L**2),
        ("node 2 rz", "node 2 rz", 4 * EI / L),
        ("node 1 rx", "node 1 rx", 80e6 * 3e-4 / L),
    ):
        assert A[row[first], row[second]] == pytest.approx(value, rel=1e-12)
    internal = [i for i, node in enumerate(K.dofs.nodes) if node < 0]
    external = [i for i, node in enumerate(K.dofs.nodes) if node > 0]
    condensed = A[np.ix_(external, external)] - A[np.ix_(external, internal)] @ np.linalg.solve(
        A[np.ix_(internal, internal)], A[np.ix_(internal, external)]
    )
    at = external.index(row["node 1 x"])
    assert condensed[at, at] == pytest.approx(100e6 * 0.25 / L, rel=1e-12)  # without the middle node
    assert "2 DOFs belong to internal nodes of Abaqus" in K.notes[0]
    along_y = ((M.dofs.nodes > 0) & (M.dofs.directions == 2)).astype(float)
    assert along_y @ M.matrix @ along_y == pytest.approx(100.0 * 0.25 * 3.0, rel=1e-12)


def test_files_of_matlab_7_are_read():
    values = read_any(DATA / "testhdf5_7.4_GLNX86.mat", "k", "K", is_square=False).matrix
    np.testing.assert_allclose(values, np.arange(9)[None, :] * np.pi / 4.0, atol=1e-15)
    sparse = read_any(DATA / "testsparse_7.4_GLNX86.mat", "k", "K", is_square=False).matrix
    assert sp.issparse(sparse) and sparse.shape == (3, 5)


# -- faults of a file ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", WRITERS)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.7, 0.97])
def test_a_truncated_file_is_named_or_has_fewer_entries(tmp_path, ending, share):
    write, _ = WRITERS[ending]
    A, path = matrix(), tmp_path / f"A.{ending}"
    write(path, A, DOFS)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    try:
        computed = read(path).matrix
    except CaseError as problem:
        assert str(problem).startswith(f"{path}") and "\n" not in str(problem)
        return
    assert ending in ("abaqus.mtx", "pch", "sti"), "lists of entries have no counts that would tell"
    assert computed.nnz < sp.csr_matrix(A).nnz


HUGE = "999999999999"


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("K.mtx", f"%%MatrixMarket matrix coordinate real general\n{HUGE} {HUGE} 1\n1 1 1.0\n", "states 999999999999 rows"),
        (
            "K.mtx",
            "%%MatrixMarket matrix coordinate real general\n2 2 900\n1 1 1.0\n",
            "truncated: its header states 900 entries",
        ),
        ("K.mtx", f"%%MatrixMarket matrix coordinate real general\n2 2 {HUGE}000\n1 1 1.0\n", "not enough memory"),
        (
            "K.mtx",
            "%%MatrixMarket matrix coordinate real general\n2 2 2\n1 1 1.0\n2 2 1.0 3.0\n",
            "states 6 numbers, and it has 7",
        ),
        ("K.mtx", "%%MatrixMarket matrix array real general\n% nothing\n\n", "ends before the line of its size"),
        ("K.mtx", "1,1,1,1\n", "is not a Matrix Market file"),
        ("K.mtx", "1,9,1,9,4.0\n", "degree of freedom 9"),
        ("K.mtx", "1,1,1,1,nan\n", "not a finite number"),
        ("K.sti", "1 1 2.0\n0 1 3.0\n", "rows and columns must be whole numbers from 1"),
        ("K.sti", f"{HUGE} 1 2.0\n", "states 999999999999 rows"),
        ("K.petsc", "nothing", "is not a matrix of PETSc"),
        ("K.pch", "GRID,1\n", "holds no DMIG entries"),
        ("K.pch", "DMIG,K,0,6,1,0\nDMIG,K,1,1,,1,1,abc\n", "must be a float"),
        ("K.pch", "DMIG,K,0,6,3,0\nDMIG,K,1,1,,1,1,1.0,0.5\n", "is complex"),
        ("K.op4", "       2       2       6       2K       1P,3E23.16\n", "it is truncated"),
        ("K.op4", f"{99999999:8d}{99999999:8d}       6       2K       1P,3E23.16\n", "truncated"),
        ("K.op2", "nothing", "does not begin as OUTPUT2"),
        ("K.rua", "title\n1 1 1 1 0\n", "is not a Harwell-Boeing file"),
        ("K.full", "nothing at all", "no record at word 0"),
        ("K.txt", "", "ending '.txt' is not one of " + ", ".join(ENDINGS)),
    ],
)
def test_a_file_without_valid_matrix_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises((CaseError, ResourceError), match=re.escape(message)):
        read(tmp_path / name)


def hdf5(path):
    h5py = pytest.importorskip("h5py")
    return h5py.File(path, "w", userblock_size=512)


def test_links_and_storage_outside_an_hdf5_file_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py")
    secret = tmp_path / "other.h5"
    with h5py.File(secret, "w") as file:
        file["K"] = np.eye(3)
    with hdf5(tmp_path / "external.mat") as file:
        file["K"] = h5py.ExternalLink(str(secret), "/K")
    with hdf5(tmp_path / "soft.mat") as file:
        file["K"] = h5py.SoftLink("/nowhere")
    with hdf5(tmp_path / "raw.mat") as file:
        file.create_dataset("K", (3, 3), "f8", external=[(str(secret), 0, 72)])
    with hdf5(tmp_path / "virtual.mat") as file:
        layout = h5py.VirtualLayout((3, 3), "f8")
        layout[:] = h5py.VirtualSource(str(secret), "K", (3, 3))
        file.create_virtual_dataset("K", layout)
    with hdf5(tmp_path / "huge.mat") as file:
        file.create_dataset("K", (10**9, 10**9), "f8", chunks=(100, 100))
    for name, message in (
        ("external", f"K is a link to {secret}; links are not followed"),
        ("soft", "K is a link to another place"),
        ("raw", "lie in another file"),
        ("virtual", "lie in another file"),
        ("huge", "claims 8000000000000000000 bytes"),
    ):
        with pytest.raises(CaseError, match=re.escape(message)):
            read(tmp_path / f"{name}.mat")


def test_an_archive_with_an_array_larger_than_its_data_is_refused(tmp_path):
    path = tmp_path / "K.npz"
    np.savez(path, K=np.eye(3))
    with zipfile.ZipFile(path) as archive:
        content = archive.read("K.npy")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("K.npy", content.replace(b"(3, 3), ", b"(9,999999999), "[: len(b"(3, 3), ")] + b""))
    with pytest.raises(CaseError):
        read(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "K.npy", np.lib.format.magic(1, 0) + header(b"{'descr': '<f8', 'fortran_order': False, 'shape': (90000, 90000), }")
        )
    with pytest.raises(CaseError, match="K.npy is truncated: its header states an array of shape"):
        read(path)


def header(text: bytes) -> bytes:
    text = text.ljust(117) + b"\n"
    return len(text).to_bytes(2, "little") + text


def test_objects_of_matlab_are_refused():
    with pytest.raises(CaseError, match="a matrix of numbers is needed"):
        read(DATA / "testobject_7.4_GLNX86.mat")


# -- faults of libraries, the reason for readers of this program --------------------------


def test_entries_in_both_triangles_of_a_symmetric_list_count_once(tmp_path):
    """SciPy adds the mirrored entries, which doubles the stiffness outside the diagonal."""
    path = tmp_path / "K.mtx"
    path.write_text("%%MatrixMarket matrix coordinate real symmetric\n2 2 4\n1 1 3D0\n1 2 -1.0\n2 1 -1.0\n2 2 3.0\n")
    np.testing.assert_array_equal(read(path).matrix.toarray(), [[3.0, -1.0], [-1.0, 3.0]])
    path.write_text(path.read_text().replace("3D0", "3.0"))
    np.testing.assert_array_equal(scipy.io.mmread(path).toarray(), [[3.0, -2.0], [-2.0, 3.0]])


def test_scipy_reads_no_symmetric_harwell_boeing_file(tmp_path):
    path = tmp_path / "K.rsa"
    path.write_text(
        f"{'springs':72s}{'K':8s}\n{3:14d}{1:14d}{1:14d}{1:14d}\n{'RSA':14s}{2:14d}{2:14d}{3:14d}{0:14d}\n"
        f"{'(3I3)':16s}{'(3I3)':16s}{'(1P,3E10.2)':20s}\n  1  3  4\n  1  2  2\n  3.00E+00 -1.00E+00  3.00E+00\n"
    )
    np.testing.assert_array_equal(read(path).matrix.toarray(), [[3.0, -1.0], [-1.0, 3.0]])
    with pytest.raises(ValueError, match="Only unsymmetric matrices supported"):
        scipy.io.hb_read(path)


def test_pynastran_reads_no_matrix_of_output2_with_an_unknown_name(tmp_path):
    op2 = pytest.importorskip("pyNastran.op2.op2")
    path = tmp_path / "K.op2"
    matrix_files.write_op2(path, matrix(), name="SPRINGS")
    np.testing.assert_array_equal(read(path).matrix.toarray(), matrix())
    for file, problem in ((path, "Invalid Table"), (DATA / "mymatrix.op2", "Nastran FATAL Error")):
        with pytest.raises(Exception, match=problem):
            op2.OP2(log=None, debug=None, mode="msc").read_op2(str(file))


def test_pynastran_stores_a_band_matrix_of_output4_as_dense(tmp_path):
    """A band of 20,000 rows takes 1.4 MB in the file and 3.2 GB in pyNastran."""
    op4 = pytest.importorskip("pyNastran.op4.op4")
    n, path = 20_000, tmp_path / "K.op4"
    number = struct.Struct("<3i3d")
    columns = [number.pack(j + 1, j, 6, -1.0, 2.0, -1.0) for j in range(1, n - 1)]
    head = [struct.pack("<4i8s", n, n, 6, 2, b"K       ")]
    first, last = struct.pack("<3i2d", 1, 1, 4, 2.0, -1.0), struct.pack("<3i2d", n, n - 1, 4, -1.0, 2.0)
    records = [*head, first, *columns, last, struct.pack("<3id", n + 1, 1, 2, 1.0)]
    path.write_bytes(b"".join(matrix_files.framed(record) for record in records))
    expected = sp.diags([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    assert abs(read(path).matrix - expected).max() == 0.0
    with bounded(2**30), pytest.raises(MemoryError):
        op4.OP4(log=None, debug=None).read_op4(str(path))


def test_petsc_of_32_bits_reads_no_file_of_64_bit_indices(tmp_path):
    from mpi4py import MPI
    from petsc4py import PETSc

    if np.dtype(PETSc.IntType).itemsize != 4:
        pytest.skip("this PETSc has indices of 64 bits")
    path, A = tmp_path / "K.petsc", sp.csr_matrix(matrix())
    head = np.array([1211216, N, N, A.nnz, *np.diff(A.indptr), *A.indices], dtype=">i8")
    path.write_bytes(head.tobytes() + A.data.astype(">f8").tobytes())
    np.testing.assert_array_equal(read(path).matrix.toarray(), A.toarray())
    viewer = PETSc.Viewer().createBinary(str(path), "r", comm=MPI.COMM_SELF)
    target = PETSc.Mat().create(comm=MPI.COMM_SELF)
    with pytest.raises(PETSc.Error):
        target.load(viewer)
    viewer.destroy(), target.destroy()


@pytest.mark.parametrize("is_dense", [False, True])
def test_a_petsc_file_of_complex_numbers_is_refused(tmp_path, is_dense):
    path, values = tmp_path / "M.petsc", np.array([2.0, 0.0, 0.0, 3.0]) if is_dense else np.array([2.0, 3.0])
    head = [1211216, 2, 2, -1] if is_dense else [1211216, 2, 2, 2, 1, 1, 0, 1]
    path.write_bytes(np.array(head, dtype=">i4").tobytes() + values.astype(">c16").tobytes())
    with pytest.raises(CaseError, match="complex; microslip takes real matrices"):
        read(path)
    first = np.array(head, dtype=">i4").tobytes() + values.astype(">f8").tobytes()
    vector = np.array([1211214, 1], dtype=">i4").tobytes() + np.zeros(len(values) - 1).tobytes()
    path.write_bytes(first + vector)  # a further object of the same length
    np.testing.assert_array_equal(read(path).matrix.toarray(), np.diag([2.0, 3.0]))
