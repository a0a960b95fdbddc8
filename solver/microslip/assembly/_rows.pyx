# cython: language_level=3, boundscheck=False, wraparound=False
"""Rows of a PETSc matrix on this rank, read where they are: PETSc's Python package gives a copy of the whole matrix."""

import ctypes

import numpy as np

ctypedef int (*of_row)(void *, long long, void *, const void **, const double **) noexcept nogil


cdef class Rows:
    """This rank's rows of a matrix, columns rising, one at a time.

    PETSc's integers have 32 or 64 bits: a row's number is passed in a register, of which PETSc reads its part, and of the number
    of columns it writes the lower bytes (little-endian, as MUMPS' interface on all processors of this program).
    """

    cdef of_row get, restore
    cdef void *A
    cdef bint is_long
    cdef long long n  # columns of the row
    cdef const void *columns
    cdef const double *values
    cdef readonly Py_ssize_t first, end, width

    def __init__(self, A, part=None):
        """Read the rows of A, or of a part of them at the address ``part``, as PETSc's matrix of one rank: :func:`parts`."""
        from petsc4py import PETSc

        library = ctypes.CDLL(PETSc.__file__)
        self.get = <of_row><size_t>ctypes.cast(library.MatGetRow, ctypes.c_void_p).value
        self.restore = <of_row><size_t>ctypes.cast(library.MatRestoreRow, ctypes.c_void_p).value
        self.A, self.is_long = <void *><size_t>(A.handle if part is None else part), PETSc.IntType().nbytes == 8
        self.first, self.end = A.getOwnershipRange() if part is None else (0, A.getLocalSize()[0])
        self.width = A.getSize()[1]

    cdef inline int open(self, Py_ssize_t row) except -1 nogil:
        self.n = 0
        if self.get(self.A, row, &self.n, &self.columns, &self.values) != 0:
            with gil:
                raise RuntimeError(f"PETSc gives no row {row} of a matrix")
        return 0

    cdef inline void close(self, Py_ssize_t row) noexcept nogil:
        self.restore(self.A, row, &self.n, &self.columns, &self.values)

    cdef inline Py_ssize_t column(self, Py_ssize_t k) noexcept nogil:
        return (<const long long *>self.columns)[k] if self.is_long else (<const int *>self.columns)[k]


def upper_triangle(A, M, double sigma, const double[::1] scale):
    """Return rows and columns, from 1, and values of S (A - sigma M) S on and above the diagonal, of this rank's rows; each once.

    Local.  M is None for that of A.  ``scale`` is the diagonal of S, of all rows; empty: 1.
    """
    cdef Rows of_A = Rows(A), of_M = None if M is None else Rows(M)
    cdef bint is_shifted = M is not None, is_scaled = scale.shape[0] > 0, is_filled
    cdef Py_ssize_t row, i, k, n, m, j, j_A, j_M, place = 0
    cdef int[::1] rows, columns
    cdef double[::1] values
    cdef double value
    for is_filled in (False, True):
        if is_filled:
            rows, columns, values = np.empty(place, np.int32), np.empty(place, np.int32), np.empty(place)
            place = 0
        with nogil:
            for row in range(of_A.first, of_A.end):
                of_A.open(row)
                i, n, k, m = 0, of_A.n, 0, 0
                if is_shifted:
                    of_M.open(row)
                    m = of_M.n
                while i < n or k < m:
                    j_A = of_A.column(i) if i < n else of_A.width
                    j_M = of_M.column(k) if k < m else of_A.width
                    j, value = min(j_A, j_M), 0.0
                    if j_A == j:
                        value += of_A.values[i]
                        i += 1
                    if j_M == j and k < m:
                        value -= sigma * of_M.values[k]
                        k += 1
                    if j < row:
                        continue
                    if is_filled:
                        rows[place], columns[place] = row + 1, j + 1
                        values[place] = value * scale[row] * scale[j] if is_scaled else value
                    place += 1
                of_A.close(row)
                if is_shifted:
                    of_M.close(row)
    return rows.base, columns.base, values.base


def groups(A):
    """Return groups of this rank's rows that follow each other and have one pattern: first rows, numbers of columns, columns.

    Local.  First rows (n_groups,) are counted from this rank's first, columns are those of all groups, rising in each.
    """
    cdef Rows of_A = Rows(A)
    cdef Py_ssize_t row, k, n_before = -1, total = 0, place = 0
    cdef int[::1] before = np.empty(of_A.width, np.int32), columns
    is_first = np.zeros(of_A.end - of_A.first, bool)
    counts = np.zeros(of_A.end - of_A.first, np.int32)
    cdef unsigned char[::1] starts_group = is_first.view(np.uint8)
    cdef int[::1] lengths = counts
    for is_filled in (False, True):
        if is_filled:
            columns = np.empty(total, np.int32)
        with nogil:
            for row in range(of_A.first, of_A.end):
                if is_filled and not starts_group[row - of_A.first]:
                    continue
                of_A.open(row)
                if is_filled:
                    for k in range(of_A.n):
                        columns[place + k] = of_A.column(k)
                    place += of_A.n
                else:
                    starts_group[row - of_A.first] = of_A.n != n_before
                    for k in range(of_A.n):
                        if of_A.column(k) != before[k]:
                            starts_group[row - of_A.first] = True
                            before[k] = of_A.column(k)
                    lengths[row - of_A.first] = n_before = of_A.n
                    total += of_A.n if starts_group[row - of_A.first] else 0
                of_A.close(row)
    return np.flatnonzero(is_first), counts[is_first], columns.base


def energies(A, const double[:, ::1] X_rows, const double[:, ::1] X):
    """Return the sums of x_i A_ij x_j over this rank's rows i of A, in extended precision, (m,) np.longdouble.

    Local.  ``X_rows`` (n_owned, m) are these rows of X (n, m).
    """
    cdef Rows of_A = Rows(A)
    cdef Py_ssize_t row, k, c, m = X.shape[1]
    total = np.zeros(m, dtype=np.longdouble)
    cdef long double[::1] sums = total
    cdef long double product
    with nogil:
        for row in range(of_A.first, of_A.end):
            of_A.open(row)
            for c in range(m):
                product = 0.0
                for k in range(of_A.n):
                    product += <long double> of_A.values[k] * X[of_A.column(k), c]
                sums[c] += product * X_rows[row - of_A.first, c]
            of_A.close(row)
    return total


ctypedef fused integer:
    int
    long long


cdef inline void add_row(Py_ssize_t n, const integer *columns, const double *values, const double *X, Py_ssize_t width, double *y,
                         Py_ssize_t stride, Py_ssize_t m) noexcept nogil:
    """Add the products of a row of n entries with the first m columns of X, (n_columns, width), to every ``stride`` th of y."""
    cdef Py_ssize_t k, c, i
    cdef double[8] sums
    cdef double value
    cdef const double *x
    for c in range(0, width, 8):
        for i in range(8):
            sums[i] = 0.0
        for k in range(n):
            value, x = values[k], X + columns[k] * width + c
            for i in range(8):
                sums[i] += value * x[i]
        for i in range(min(8, m - c)):
            y[(c + i) * stride] += sums[i]


def parts(A):
    """Return the addresses of the parts of this rank's rows, with its own and with others' columns, and these columns (k,).

    Local, of PETSc's type "mpiaij"; valid until the pattern of A changes.
    """
    from petsc4py import PETSc

    library, (own, others, columns) = ctypes.CDLL(PETSc.__file__), (ctypes.c_void_p() for _ in range(3))
    n_rows, n_columns = ctypes.c_longlong(), ctypes.c_longlong()  # of which PETSc may write the lower bytes
    failed = library.MatMPIAIJGetSeqAIJ(ctypes.c_void_p(A.handle), *map(ctypes.byref, (own, others, columns)))
    if failed or library.MatGetLocalSize(others, ctypes.byref(n_rows), ctypes.byref(n_columns)):
        raise RuntimeError("PETSc gives no parts of a matrix")
    numbers = np.zeros(n_columns.value, dtype=PETSc.IntType)
    ctypes.memmove(numbers.ctypes.data, columns, numbers.nbytes)
    return own.value, others.value, numbers


def add_products(A, const double[:, ::1] X, double[::1, :] Y, part=None):
    """Add A X to Y, (n, m), of a matrix on one rank, or of a part of it: :func:`parts`.

    Local.  X (k, width) has a row for each column; its width, a multiple of 8, which become vector instructions, is m or more.
    """
    cdef Rows of_A = Rows(A, part)
    cdef Py_ssize_t row, width = X.shape[1], n = Y.shape[0], m = Y.shape[1]
    if X.shape[0] == 0 or n == 0 or m == 0:
        return
    with nogil:
        for row in range(n):
            of_A.open(row)
            if of_A.is_long:
                add_row(of_A.n, <const long long *>of_A.columns, of_A.values, &X[0, 0], width, &Y[row, 0], n, m)
            else:
                add_row(of_A.n, <const int *>of_A.columns, of_A.values, &X[0, 0], width, &Y[row, 0], n, m)
            of_A.close(row)
