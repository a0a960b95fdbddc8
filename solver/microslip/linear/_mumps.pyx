# cython: language_level=3, boundscheck=False, wraparound=False
"""Bridge from NumPy arrays to MUMPS' C interface, in the library that PETSc itself is linked to; mumps.py says what for."""

import ctypes

import numpy as np

from libc.string cimport memcpy

cdef extern from "dmumps_c.h" nogil:
    const char *MUMPS_VERSION
    ctypedef struct DMUMPS_STRUC_C:
        int sym, par, job, comm_fortran
        int icntl[60]
        double cntl[15]
        int n, nblk
        int *blkptr
        long long nnz, nnz_loc
        int *irn
        int *jcn
        double *a
        int *irn_loc
        int *jcn_loc
        double *a_loc
        int *perm_in
        double *rhs
        double *rhs_sparse
        double *sol_loc
        double *rhs_loc
        int *irhs_sparse
        int *irhs_ptr
        int *isol_loc
        int *irhs_loc
        int nrhs, lrhs, nz_rhs, lsol_loc, nloc_rhs, lrhs_loc
        int size_schur, lredrhs
        int *listvar_schur
        double *schur
        double *redrhs
        int info[80]
        int infog[80]
        double rinfo[40]
        double rinfog[40]
        char version_number[32]
        char ooc_tmpdir[256]
        char save_dir[256]
        char save_prefix[256]

ctypedef void (*call_of)(DMUMPS_STRUC_C *) noexcept nogil

cdef struct roomy:  # another version's structure may be longer
    DMUMPS_STRUC_C id
    char more[4096]

BUILT_FOR = MUMPS_VERSION.decode()
_START, _END = -1, -2


cdef class Instance:
    """One matrix in MUMPS: its controls and reports by their numbers in MUMPS' guide, and the arrays it works on.

    Every run is collective on the communicator; the rest is local.  Arrays are kept alive as long as MUMPS may read them.
    """

    cdef roomy c
    cdef call_of call
    cdef object arrays, __weakref__
    cdef readonly bint is_open

    def __init__(self, library: str, int communicator, int sym):
        """Start; collective.  ``library``: holds dmumps_c; ``communicator``: its Fortran handle; ``sym``: MUMPS' SYM."""
        self.call = <call_of><size_t>ctypes.cast(ctypes.CDLL(library).dmumps_c, ctypes.c_void_p).value
        self.arrays = {}
        self.c.id.comm_fortran, self.c.id.par, self.c.id.sym = communicator, 1, sym
        self.is_open = self.run(_START) >= 0

    @property
    def version(self) -> str:
        """Version of the library; nonsense where it is not the one built for."""
        return self.c.id.version_number[:31].split(b"\0")[0].decode(errors="replace").strip()

    def run(self, int job) -> int:
        """Do a job; return INFOG(1).  Collective."""
        self.c.id.job = job
        with nogil:
            self.call(&self.c.id)
        return self.c.id.infog[0]

    def end(self):
        """Free all that MUMPS holds, once.  Collective."""
        if self.is_open:
            self.run(_END)
        self.is_open, self.arrays = False, {}

    def icntl(self, int number) -> int:
        return self.c.id.icntl[number - 1]

    def set_icntl(self, int number, int value):
        self.c.id.icntl[number - 1] = value

    def set_cntl(self, int number, double value):
        self.c.id.cntl[number - 1] = value

    def set_folder(self, folder: str):
        """State where the factor's files go; ValueError if MUMPS has no room for the name."""
        name = folder.encode()
        if len(name) >= sizeof(self.c.id.ooc_tmpdir):
            raise ValueError(f"a folder's name of {len(name)} bytes; MUMPS takes {sizeof(self.c.id.ooc_tmpdir) - 1}")
        memcpy(self.c.id.ooc_tmpdir, <const char *>name, len(name) + 1)

    def set_saved(self, folder: str, prefix: str):
        """State where the factor is saved, or restored from: PREFIX_RANK.mumps; ValueError if MUMPS has no room for the names."""
        place, first = folder.encode(), prefix.encode()
        if len(place) >= sizeof(self.c.id.save_dir) or len(first) >= sizeof(self.c.id.save_prefix):
            raise ValueError(f"a folder's name of {len(place)} bytes; MUMPS takes {sizeof(self.c.id.save_dir) - 1}")
        memcpy(self.c.id.save_dir, <const char *>place, len(place) + 1)
        memcpy(self.c.id.save_prefix, <const char *>first, len(first) + 1)

    def info(self, int number) -> int:
        return self.c.id.info[number - 1]

    def infog(self, int number) -> int:
        return self.c.id.infog[number - 1]

    def rinfo(self, int number) -> float:
        return self.c.id.rinfo[number - 1]

    def rinfog(self, int number) -> float:
        return self.c.id.rinfog[number - 1]

    def set_matrix(self, int n, int[::1] rows, int[::1] columns, double[::1] values, bint is_distributed):
        """State this rank's entries by rows and columns, from 1; all are on rank 0 where they are not distributed."""
        self.arrays["matrix"] = rows, columns, values
        cdef int *i = &rows[0] if rows.shape[0] else NULL
        cdef int *j = &columns[0] if columns.shape[0] else NULL
        cdef double *a = &values[0] if values.shape[0] else NULL
        self.c.id.n = n
        if is_distributed:
            self.c.id.nnz_loc, self.c.id.irn_loc, self.c.id.jcn_loc, self.c.id.a_loc = rows.shape[0], i, j, a
        else:
            self.c.id.nnz, self.c.id.irn, self.c.id.jcn, self.c.id.a = rows.shape[0], i, j, a

    def drop_matrix(self):
        """Let the entries go, which solves need no more."""
        self.arrays.pop("matrix", None)
        self.c.id.irn = self.c.id.jcn = self.c.id.irn_loc = self.c.id.jcn_loc = NULL
        self.c.id.a = self.c.id.a_loc = NULL

    def set_order(self, int[::1] positions, int[::1] starts):
        """State the place of every unknown in the order of elimination, and the first unknowns of blocks that MUMPS may analyse
        as one, with one beyond the last; from 1, none on ranks other than 0."""
        self.arrays["order"] = positions, starts
        self.c.id.perm_in = &positions[0] if positions.shape[0] else NULL
        self.c.id.blkptr = &starts[0] if starts.shape[0] else NULL
        self.c.id.nblk = max(starts.shape[0] - 1, 0)

    def set_schur(self, int[::1] rows, double[::1, :] S):
        """State the unknowns that are not eliminated, from 1, and where their Schur complement goes, (m, m); m = 0 off rank 0."""
        self.arrays["schur"] = rows, S
        self.c.id.size_schur = rows.shape[0]
        self.c.id.listvar_schur = &rows[0] if rows.shape[0] else NULL
        self.c.id.schur = &S[0, 0] if S.shape[0] else NULL

    def set_reduced(self, double[::1, :] B):
        """State where reduced right-hand sides go, or reduced solutions come from, (m, n); m = 0 off rank 0."""
        self.arrays["reduced"] = B
        self.c.id.redrhs = &B[0, 0] if B.shape[0] and B.shape[1] else NULL
        self.c.id.lredrhs = max(B.shape[0], 1)

    def set_dense(self, double[::1, :] B):
        """State the right-hand sides that the solution takes the place of, (n, m); m = 0 off rank 0 where they are not there."""
        self.arrays["rhs"] = B
        self.c.id.rhs = &B[0, 0] if B.shape[0] and B.shape[1] else NULL
        self.c.id.nrhs, self.c.id.lrhs = B.shape[1], max(B.shape[0], 1)

    def set_distributed(self, int[::1] rows, double[::1, :] B_owned):
        """State this rank's rows, from 1, of the right-hand sides, (n_owned, m)."""
        self.arrays["rhs_loc"] = rows, B_owned
        self.c.id.irhs_loc = &rows[0] if rows.shape[0] else NULL
        self.c.id.rhs_loc = &B_owned[0, 0] if B_owned.shape[0] and B_owned.shape[1] else NULL
        self.c.id.nrhs, self.c.id.nloc_rhs, self.c.id.lrhs_loc = B_owned.shape[1], rows.shape[0], max(rows.shape[0], 1)

    def set_sparse(self, int m, int[::1] starts, int[::1] rows, double[::1] values):
        """State m sparse right-hand sides by columns, starts and rows from 1; the arrays are empty off rank 0."""
        self.arrays["sparse"] = starts, rows, values
        self.c.id.irhs_ptr = &starts[0] if starts.shape[0] else NULL
        self.c.id.irhs_sparse = &rows[0] if rows.shape[0] else NULL
        self.c.id.rhs_sparse = &values[0] if values.shape[0] else NULL
        self.c.id.nrhs, self.c.id.nz_rhs = m, rows.shape[0]

    def set_solution(self, int[::1] rows, double[::1, :] X):
        """State where this rank's share of the solution goes: its rows, from 1, and its values, (n_here, m)."""
        self.arrays["sol_loc"] = rows, X
        self.c.id.isol_loc = &rows[0] if rows.shape[0] else NULL
        self.c.id.sol_loc = &X[0, 0] if X.shape[0] and X.shape[1] else NULL
        self.c.id.lsol_loc = max(rows.shape[0], 1)

    def drop_sides(self):
        """Let right-hand sides and solutions go."""
        for name in ("rhs", "rhs_loc", "sparse", "sol_loc"):
            self.arrays.pop(name, None)
        self.c.id.rhs = self.c.id.rhs_loc = self.c.id.rhs_sparse = self.c.id.sol_loc = NULL
        self.c.id.irhs_loc = self.c.id.irhs_ptr = self.c.id.irhs_sparse = self.c.id.isol_loc = NULL


cdef Py_ssize_t merged(int first, const int[::1] starts, const int[::1] columns, const double[::1] values, double sigma,
                       const int[::1] starts_M, const int[::1] columns_M, const double[::1] values_M, const double[::1] scale,
                       int[::1] i, int[::1] j, double[::1] a, bint writes) except -1:
    """Count the entries of :func:`upper_triangle`, and write them if asked to."""
    cdef Py_ssize_t row, k, l, end, end_M, m = 0
    cdef int column
    cdef bint of_K, of_M, is_scaled = scale.shape[0] > 0
    for row in range(starts.shape[0] - 1):
        k, end, l, end_M = starts[row], starts[row + 1], starts_M[row], starts_M[row + 1]
        while k < end or l < end_M:
            of_K = l == end_M or (k < end and columns[k] <= columns_M[l])
            of_M = k == end or (l < end_M and columns_M[l] <= columns[k])
            column = columns[k] if of_K else columns_M[l]
            if column >= first + row:
                if writes:
                    i[m], j[m] = first + row + 1, column + 1
                    a[m] = (values[k] if of_K else 0.0) - (sigma * values_M[l] if of_M else 0.0)
                    if is_scaled:
                        a[m] *= scale[first + row] * scale[column]
                m += 1
            k += of_K
            l += of_M
    return m


def upper_triangle(int first, const int[::1] starts, const int[::1] columns, const double[::1] values, double sigma,
                   const int[::1] starts_M, const int[::1] columns_M, const double[::1] values_M, const double[::1] scale):
    """Return rows and columns, from 1, and values of S (K - sigma M) S on and above the diagonal of rows that begin with ``first``.

    Columns rise in the rows of both; the places are those of either.  ``scale`` is the diagonal of S, of all rows; empty: 1.
    """
    i, j, a = np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0)
    cdef Py_ssize_t m = merged(first, starts, columns, values, sigma, starts_M, columns_M, values_M, scale, i, j, a, False)
    i, j, a = np.empty(m, np.int32), np.empty(m, np.int32), np.empty(m)
    merged(first, starts, columns, values, sigma, starts_M, columns_M, values_M, scale, i, j, a, True)
    return i, j, a


def repeats(const int[::1] starts, const int[::1] columns):
    """Return whether each row has the pattern of the row before it, (n,) bool; rows as of a sparse matrix."""
    cdef Py_ssize_t n = starts.shape[0] - 1, row, k, length
    found = np.zeros(n, bool)
    cdef unsigned char[::1] is_same = found.view(np.uint8)
    for row in range(1, n):
        length = starts[row + 1] - starts[row]
        if length == starts[row] - starts[row - 1]:
            is_same[row] = 1
            for k in range(starts[row], starts[row + 1]):
                if columns[k] != columns[k - length]:
                    is_same[row] = 0
                    break
    return found
