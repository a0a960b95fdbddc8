"""Matrices of other programs are read from each format, and every fault of a file gives one message that names it."""

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from microslip.formats.matrices.read import read_matrix
from microslip.messages.errors import CaseError, ResourceError

K = np.array([[4.0, -1.0, 0.0], [-1.0, 3.0, 0.5], [0.0, 0.5, 2.0e6]])


def save(path, value, **others):
    """Write ``value``, and further variables, in the format of the path's ending."""
    if path.suffix.lower() == ".mtx":
        scipy.io.mmwrite(str(path), value, precision=17)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {"value": value, **others})
    elif sp.issparse(value):
        sp.save_npz(path, value)
    else:
        np.savez(path, value=value, **others)
    return path


def message(path):
    with pytest.raises(CaseError) as caught:
        read_matrix(path, "[model] stiffness", "K")
    assert str(caught.value).startswith(f"{path}: [model] stiffness")
    return str(caught.value).removeprefix(f"{path}: [model] stiffness")


@pytest.mark.parametrize("ending", ["mtx", "mat", "npz"])
@pytest.mark.parametrize("form", [np.array, sp.csr_matrix, sp.csc_matrix, sp.coo_matrix])
def test_every_format_returns_the_same_matrix(tmp_path, ending, form):
    matrix = read_matrix(save(tmp_path / f"K.{ending}", form(K)), "[model] stiffness", "K").matrix
    assert matrix.dtype == float and sp.isspmatrix_csr(matrix)
    np.testing.assert_array_equal(matrix.toarray(), K)


@pytest.mark.parametrize("ending", ["mat", "npz"])
def test_of_several_variables_the_name_of_the_matrix_selects(tmp_path, ending):
    path = save(tmp_path / f"model.{ending}", 7.0 * K, K=K)
    np.testing.assert_array_equal(read_matrix(path, "[model] stiffness", "K").matrix.toarray(), K)
    with pytest.raises(CaseError, match="one variable, or with one named M; this one has K, value"):
        read_matrix(path, "[model] mass", "M")


def test_repeated_entries_are_added_and_integers_are_accepted(tmp_path):
    path = tmp_path / "K.MTX"
    path.write_text("%%MatrixMarket matrix coordinate integer symmetric\n% a comment\n2 2 3\n1 1 2\n1 1 3\n2 1 -1\n")
    np.testing.assert_array_equal(read_matrix(path, "[model] stiffness", "K").matrix.toarray(), [[5.0, -1.0], [-1.0, 0.0]])


def test_asymmetry_of_rounding_is_removed(tmp_path):
    noisy = K * (1.0 + 1e-12 * np.random.default_rng(1).standard_normal(K.shape))
    matrix = read_matrix(save(tmp_path / "K.npz", noisy), "[model] stiffness", "K").matrix.toarray()
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_allclose(matrix, K, rtol=1e-11)


@pytest.mark.parametrize(
    "value, expected",
    [
        (np.ones((3, 2)), " has the shape (3, 2); a matrix must be square"),
        (np.zeros((0, 0)), " has the shape (0, 0); a matrix must be square"),
        (np.ones((2, 2, 2)), " has the shape (2, 2, 2); a matrix must be square"),
        (K * (1.0 + 0.1j), " is complex; microslip takes real matrices: damping goes into [model] damping or [damping]"),
        (np.where(K == 0.5, np.nan, K), " has an entry in row 1 that is not a finite number (rows count from 0)"),
        (np.where(K == 3.0, np.inf, K), " has an entry in row 1 that is not a finite number"),
        (
            100.0 * np.tril(K) + K,
            " is not symmetric: entries (0, 1) and (1, 0), counted from 0, are -1 and -101; both triangles are "
            "needed, or a Matrix Market file with 'symmetric' in its first line",
        ),
        (np.array([["a"]]), " holds no numbers"),
    ],
)
def test_a_faulty_matrix_is_named(tmp_path, value, expected):
    assert message(save(tmp_path / "K.npz", value)).startswith(expected)


HEAD = "%%MatrixMarket matrix coordinate real symmetric\n"


@pytest.mark.parametrize(
    "name, content, expected",
    [
        ("K.txt", "1 2\n", ": ending '.txt' is not one of .mtx, .npz, .mat"),
        ("K.mtx", "", " is not a Matrix Market file; its first line must begin with %%MatrixMarket matrix"),
        ("K.mtx", "1 1 2.0\n", " is not a Matrix Market file"),
        ("K.mtx", HEAD.replace("real", "pattern") + "2 2 1\n1 1\n", " is a pattern without numbers"),
        ("K.mtx", HEAD + "2 2 3\n1 1 1.0\n", " cannot be read as a matrix: "),
        ("K.mtx", HEAD + "2 2 1\n3 1 1.0\n", " cannot be read as a matrix: row index exceeds matrix dimensions"),
        ("K.mtx", HEAD + "2 2 1\n1 1 abc\n", " cannot be read as a matrix: "),
        ("K.npz", "nothing", " is not a file of scipy.sparse.save_npz or numpy.savez"),
        ("K.mat", "nothing", " cannot be read as a matrix: "),
    ],
)
def test_a_file_without_matrix_is_named(tmp_path, name, content, expected):
    (tmp_path / name).write_text(content)
    assert message(tmp_path / name).startswith(expected)


def test_pickled_objects_are_refused(tmp_path):
    np.savez(tmp_path / "K.npz", value=np.array([{}], dtype=object))
    assert "Object arrays cannot be loaded" in message(tmp_path / "K.npz")


def test_a_matrix_larger_than_memory_is_refused(tmp_path):
    (tmp_path / "K.mtx").write_text("%%MatrixMarket matrix array real general\n10000000 10000000\n1.0\n")
    with pytest.raises(ResourceError, match="not enough memory to read it"):
        read_matrix(tmp_path / "K.mtx", "[model] stiffness", "K")
