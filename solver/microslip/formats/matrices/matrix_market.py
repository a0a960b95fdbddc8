"""Matrix Market: SciPy reads it, after its header has been checked against the size of the file."""

import io

import numpy as np
import scipy.io

from ...messages.errors import CaseError
from .file_matrix import FileMatrix, Wanted

_LEAST_BYTES = {"coordinate": 5.0, "array": 1.0}  # bytes per entry; an array may have only one triangle
_FORTRAN = bytes.maketrans(b"Dd", b"Ee")  # exponents as 1.5D+03


def read_matrix_market(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file.  Local.

    For a header "symmetric" SciPy adds the other triangle even if the list has both triangles, which doubles the entries;
    therefore the list is read as general, and ``read_matrix`` completes it.

    Raises
    ------
    CaseError, ResourceError : the file is faulty or exceeds memory
    """
    with open(wanted.path, "rb") as file:
        head, text = file.readline(200).lower(), file.read().translate(_FORTRAN)
    words = head.decode("latin-1").split()
    if words[:2] != ["%%matrixmarket", "matrix"]:
        raise CaseError(f"{wanted.where} is not a Matrix Market file; its first line must begin with %%MatrixMarket matrix")
    if "pattern" in words:
        raise CaseError(f"{wanted.where} is a pattern without numbers")
    if words[-1] == "skew-symmetric":
        raise CaseError(f"{wanted.where} is skew-symmetric; microslip takes symmetric matrices")
    if not any(line.strip() and not line.startswith(b"%") for line in io.BytesIO(text)):
        raise wanted.error("it ends before the line of its size")  # SciPy 1.10 would read forever
    is_triangle = words[2:3] == ["coordinate"] and words[-1] in ("symmetric", "hermitian")
    if is_triangle:
        words[-1] = "general"
    content = io.BytesIO(b"%%MatrixMarket " + " ".join(words[1:]).encode("latin-1") + b"\n" + text)
    n_rows, n_columns, n_entries, form, kind, symmetry = scipy.io.mminfo(content)
    wanted.check_entries(n_entries, _LEAST_BYTES[form])
    wanted.check_rows(max(n_rows, n_columns))
    n_lines = n_entries if symmetry == "general" else n_rows * (n_rows + 1) // 2
    _check_count(content, n_lines * ((2 if form == "coordinate" else 0) + (2 if kind == "complex" else 1)), wanted)
    content.seek(0)
    return FileMatrix(scipy.io.mmread(content), is_triangle=is_triangle)


def _check_count(content: io.BytesIO, n: int, wanted: Wanted) -> None:
    """Raise CaseError unless the count of numbers matches the header; SciPy ignores extra numbers on a line."""
    is_blank = np.frombuffer(content.getbuffer(), dtype=np.uint8, offset=content.tell() - 1) <= ord(" ")
    n_words = np.count_nonzero(is_blank[:-1] & ~is_blank[1:])
    if n_words != n:
        raise wanted.error(f"its header states {n} numbers, and it has {n_words}")
