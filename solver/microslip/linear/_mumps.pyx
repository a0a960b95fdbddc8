# cython: language_level=3, boundscheck=False, wraparound=False
"""Bridge from NumPy arrays to MUMPS' C interface, in the library that PETSc itself is linked to; mumps.py says what for."""

import ctypes

from libc.string cimport memcpy

ctypedef int *integers
ctypedef double *reals

cdef extern from "dmumps_c.h" nogil:
    const char *MUMPS_VERSION
    ctypedef struct DMUMPS_STRUC_C:
        int sym, par, job, comm_fortran, n, nblk
        int icntl[60]
        double cntl[15]
        long long nnz, nnz_loc
        integers irn, jcn, irn_loc, jcn_loc, blkptr, perm_in, irhs_sparse, irhs_ptr, isol_loc, irhs_loc, listvar_schur
        reals a, a_loc, rhs, rhs_sparse, sol_loc, rhs_loc, schur, redrhs
        reals wk_user
        int nrhs, lrhs, nz_rhs, lsol_loc, nloc_rhs, lrhs_loc, size_schur, lredrhs, lwk_user
        int info[80]
        int infog[80]
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


cdef integers first(int[::1] numbers) noexcept:
    return &numbers[0] if numbers.shape[0] else NULL


cdef reals corner(double[::1, :] B) noexcept:
    return &B[0, 0] if B.shape[0] and B.shape[1] else NULL


cdef int copied(char *place, Py_ssize_t room, str name) except -1:
    """Copy a name to where MUMPS reads it; ValueError if it has no room for it."""
    text = name.encode()
    if len(text) >= room:
        raise ValueError(f"a folder's name of {len(text)} bytes; MUMPS takes {room - 1}")
    memcpy(place, <const char *>text, len(text) + 1)


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
        self.is_open = self.run(-1) >= 0

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
            self.run(-2)
        self.is_open, self.arrays = False, {}

    def icntl(self, int number) -> int:
        return self.c.id.icntl[number - 1]

    def set_icntl(self, int number, int value):
        self.c.id.icntl[number - 1] = value

    def set_cntl(self, int number, double value):
        self.c.id.cntl[number - 1] = value

    def set_folder(self, folder: str):
        """State where the factor's files go; ValueError if MUMPS has no room for the name."""
        copied(self.c.id.ooc_tmpdir, sizeof(self.c.id.ooc_tmpdir), folder)

    def set_saved(self, folder: str, prefix: str):
        """State where the factor is saved, or restored from: PREFIX_RANK.mumps; ValueError if MUMPS has no room for the names."""
        copied(self.c.id.save_dir, sizeof(self.c.id.save_dir), folder)
        copied(self.c.id.save_prefix, sizeof(self.c.id.save_prefix), prefix)

    def info(self, int number) -> int:
        return self.c.id.info[number - 1]

    def infog(self, int number) -> int:
        return self.c.id.infog[number - 1]

    def rinfog(self, int number) -> float:
        return self.c.id.rinfog[number - 1]

    def set_matrix(self, int n, int[::1] rows, int[::1] columns, double[::1] values, bint is_distributed):
        """State this rank's entries by rows and columns, from 1; all are on rank 0 where they are not distributed."""
        self.arrays["matrix"] = rows, columns, values
        self.c.id.n = n
        cdef reals a = &values[0] if values.shape[0] else NULL
        if is_distributed:
            self.c.id.nnz_loc, self.c.id.irn_loc, self.c.id.jcn_loc = rows.shape[0], first(rows), first(columns)
            self.c.id.a_loc = a
        else:
            self.c.id.nnz, self.c.id.irn, self.c.id.jcn, self.c.id.a = rows.shape[0], first(rows), first(columns), a

    def set_order(self, int[::1] positions, int[::1] starts):
        """State the place of every unknown in the order of elimination, and the first unknowns of blocks that MUMPS may analyse
        as one, with one beyond the last; from 1, none on ranks other than 0."""
        self.arrays["order"] = positions, starts
        self.c.id.perm_in, self.c.id.blkptr, self.c.id.nblk = first(positions), first(starts), max(starts.shape[0] - 1, 0)

    def set_schur(self, int[::1] rows, double[::1, :] S):
        """State the unknowns that are not eliminated, from 1, and where their Schur complement goes, (m, m); m = 0 off rank 0."""
        self.arrays["schur"] = rows, S
        self.c.id.size_schur, self.c.id.listvar_schur, self.c.id.schur = rows.shape[0], first(rows), corner(S)

    def set_workspace(self, double[::1] S, int size):
        """State the memory for factors, of INFO(8) entries, as ``size`` states them too; size = 0: MUMPS allocates it."""
        self.arrays["workspace"] = S
        self.c.id.wk_user, self.c.id.lwk_user = &S[0] if size else NULL, size

    def set_reduced(self, double[::1, :] B):
        """State where reduced right-hand sides go, or reduced solutions come from, (m, n); m = 0 off rank 0."""
        self.arrays["reduced"] = B
        self.c.id.redrhs, self.c.id.lredrhs = corner(B), max(B.shape[0], 1)

    def set_dense(self, double[::1, :] B):
        """State the right-hand sides that the solution takes the place of, (n, m); m = 0 off rank 0 where they are not there."""
        self.arrays["rhs"] = B
        self.c.id.rhs, self.c.id.nrhs, self.c.id.lrhs = corner(B), B.shape[1], max(B.shape[0], 1)

    def set_distributed(self, int[::1] rows, double[::1, :] B_owned):
        """State this rank's rows, from 1, of the right-hand sides, (n_owned, m)."""
        self.arrays["rhs_loc"] = rows, B_owned
        self.c.id.irhs_loc, self.c.id.nloc_rhs, self.c.id.lrhs_loc = first(rows), rows.shape[0], max(rows.shape[0], 1)
        self.c.id.rhs_loc, self.c.id.nrhs = corner(B_owned), B_owned.shape[1]

    def set_sparse(self, int m, int[::1] starts, int[::1] rows, double[::1] values):
        """State m sparse right-hand sides by columns, starts and rows from 1; the arrays are empty off rank 0."""
        self.arrays["sparse"] = starts, rows, values
        self.c.id.irhs_ptr, self.c.id.irhs_sparse = first(starts), first(rows)
        self.c.id.rhs_sparse = &values[0] if values.shape[0] else NULL
        self.c.id.nrhs, self.c.id.nz_rhs = m, rows.shape[0]

    def set_solution(self, int[::1] rows, double[::1, :] X):
        """State where this rank's share of the solution goes: its rows, from 1, and its values, (n_here, m)."""
        self.arrays["sol_loc"] = rows, X
        self.c.id.isol_loc, self.c.id.sol_loc, self.c.id.lsol_loc = first(rows), corner(X), max(rows.shape[0], 1)

    def drop(self):
        """Let the entries of a matrix that is factored, right-hand sides and solutions go."""
        for name in ("matrix", "rhs", "rhs_loc", "sparse", "sol_loc"):
            self.arrays.pop(name, None)
        self.c.id.irn = self.c.id.jcn = self.c.id.irn_loc = self.c.id.jcn_loc = NULL
        self.c.id.irhs_loc = self.c.id.irhs_ptr = self.c.id.irhs_sparse = self.c.id.isol_loc = NULL
        self.c.id.a = self.c.id.a_loc = self.c.id.rhs = self.c.id.rhs_loc = self.c.id.rhs_sparse = self.c.id.sol_loc = NULL
