# cython: language_level=3, boundscheck=False, wraparound=False
"""Bridge from NumPy arrays to elastic_coulomb.c; the meaning of every argument is stated there and in elastic_coulomb.py."""

import numpy as np

cdef extern from "elastic_coulomb.h" nogil:
    ctypedef struct aft_tables:
        Py_ssize_t N_H
        Py_ssize_t N_t
        Py_ssize_t stride
        const double *E
        const double *E_T
        int sampled
        const double *F
        const double *S
    ctypedef struct aft_pairs:
        const double *mu
        const double *N0
        const double *k_t
        const double *k_n
        const unsigned char *separate
        const double *w0
        const double *U

ctypedef int (*leaves_of)(const aft_tables *t, const aft_pairs *pairs, Py_ssize_t n, unsigned char *leaves) nogil
ctypedef int (*march_of)(const aft_tables *t, const aft_pairs *pairs, Py_ssize_t m, const Py_ssize_t *active, double *p,
                         unsigned char *state, unsigned char *drifts, double *P) nogil

cdef extern from "elastic_coulomb.h":
    leaves_of chosen_leaves "OF_THIS_PROCESSOR(aft_leaves)"
    march_of chosen_march "OF_THIS_PROCESSOR(aft_march)"


cdef class Sampling:
    """Tables of one set of harmonics and number of samples, kept alive for the kernel."""

    cdef aft_tables c
    cdef object arrays
    cdef readonly object synthesis
    cdef readonly Py_ssize_t n_coefficients

    def __init__(self, const double[:, ::1] E, const double[:, ::1] E_T, const double[:, ::1] F,
                 const double[:, ::1] S, bint sampled):
        self.arrays = (E, E_T, F, S)
        self.c.N_H, self.c.N_t, self.c.stride = E_T.shape[0], E_T.shape[1], E.shape[1]
        self.n_coefficients, self.c.sampled = E_T.shape[0], sampled
        self.synthesis = np.asarray(E_T)
        self.c.E, self.c.E_T, self.c.F, self.c.S = &E[0, 0], &E_T[0, 0], &F[0, 0], &S[0, 0]

    def least(self, U):
        """Return the least sample of motions with coefficients ``U`` (n, N_H), (n,)."""
        return (U @ self.synthesis).min(axis=1)


cdef class Pairs:
    """Parameters and harmonics of at least one pair, kept alive for the kernel."""

    cdef aft_pairs c
    cdef object arrays

    def __init__(self, const double[:, :, ::1] U, const double[::1] mu, const double[::1] N0, const double[::1] k_t,
                 const double[::1] k_n, const unsigned char[::1] separate, const double[:, ::1] w0):
        self.arrays = (U, mu, N0, k_t, k_n, separate, w0)
        self.c.U, self.c.mu, self.c.N0 = &U[0, 0, 0], &mu[0], &N0[0]
        self.c.k_t, self.c.k_n, self.c.separate, self.c.w0 = &k_t[0], &k_n[0], &separate[0], &w0[0, 0]


def leaves(Sampling sampling, Pairs pairs, unsigned char[::1] leaving):
    """Set ``leaving`` (n,) to 1 where a pair leaves sticking."""
    cdef int status
    with nogil:
        status = chosen_leaves(&sampling.c, &pairs.c, leaving.shape[0], &leaving[0])
    if status != 0:
        raise MemoryError("contact kernel: no memory for its samples")


def march(Sampling sampling, Pairs pairs, const Py_ssize_t[::1] active, double[:, :, ::1] p, unsigned char[::1] state,
          unsigned char[::1] drifts, double[:, :, ::1] P):
    """Write p, state and drifts of the ``active`` pairs, at least one, and P unless it is None."""
    cdef int status
    cdef double *to_P = NULL
    if P is not None:
        to_P = &P[0, 0, 0]
    with nogil:
        status = chosen_march(&sampling.c, &pairs.c, active.shape[0], &active[0], &p[0, 0, 0], &state[0], &drifts[0],
                              to_P)
    if status != 0:
        raise MemoryError("contact kernel: no memory for its samples")
