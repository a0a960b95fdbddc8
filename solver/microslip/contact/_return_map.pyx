# cython: language_level=3, boundscheck=False, wraparound=False
"""Bridge from NumPy arrays to return_map.c; the meaning of every argument is stated there."""

cdef extern from "return_map.h" nogil:
    ctypedef struct spring_pairs:
        Py_ssize_t n
        const double *mu
        const double *k_t
        const double *w0
        const double *N0
        const double *k_n
        const unsigned char *separate
    void return_steps(const spring_pairs *pairs, Py_ssize_t n_points, const double *du, const double *before, Py_ssize_t stride,
                      double *p, double *L, unsigned char *state)
    void vary_period(const spring_pairs *pairs, const Py_ssize_t *motion, Py_ssize_t n_steps, Py_ssize_t n_sub, const double *du,
                     Py_ssize_t most_periods, double *M, unsigned char *sticks, unsigned char *moves)


cdef class SpringPairs:
    """Parameters of at least one pair, kept alive for the kernel."""

    cdef spring_pairs c
    cdef object arrays

    def __init__(self, const double[:, ::1] mu, const double[:, ::1] k_t, const double[:, ::1] w0, const double[::1] N0,
                 const double[::1] k_n, const unsigned char[::1] separate):
        self.arrays = (mu, k_t, w0, N0, k_n, separate)
        self.c.n = mu.shape[0]
        self.c.mu, self.c.k_t, self.c.w0 = &mu[0, 0], &k_t[0, 0], &w0[0, 0]
        self.c.N0, self.c.k_n, self.c.separate = &N0[0], &k_n[0], &separate[0]


def steps(SpringPairs pairs, const double[:, :, ::1] du, const double[:, :, ::1] before, double[:, :, ::1] p,
          double[:, :, :, ::1] L, unsigned char[:, ::1] state):
    """Write p, L and state of a step to ``du`` at one or more points, by point."""
    if du.shape[0] > 0:
        with nogil:
            return_steps(&pairs.c, du.shape[0], &du[0, 0, 0], &before[0, 0, 0], before.shape[2], &p[0, 0, 0], &L[0, 0, 0, 0],
                         &state[0, 0])


def vary(SpringPairs pairs, const Py_ssize_t[::1] motion, const double[:, :, ::1] du, Py_ssize_t n_sub, Py_ssize_t most_periods,
         double[:, :, :, ::1] M, unsigned char[::1] sticks, unsigned char[::1] moves):
    """Write M (n, n_steps, 3, 16) and sticks (n,) of pairs that follow the periodic motions du (.., n_steps n_sub, 3).

    ``moves`` (n_steps n_sub,) is work space.
    """
    with nogil:
        vary_period(&pairs.c, &motion[0], M.shape[1], n_sub, &du[0, 0, 0], most_periods, &M[0, 0, 0, 0], &sticks[0],
                    &moves[0])
