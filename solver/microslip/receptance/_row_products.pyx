# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
"""Bridge from NumPy arrays to row_products.c; see there and rows.py for the formulas."""

cdef extern from "row_products.h" nogil:
    ctypedef void (*of_double)(Py_ssize_t m, const double **rows, Py_ssize_t n, const double *p, Py_ssize_t N, double *y) nogil
    ctypedef void (*of_float)(Py_ssize_t m, const float **rows, Py_ssize_t n, const float *p, Py_ssize_t N, float *y) nogil
    of_double combine_double "OF_THIS_PROCESSOR(combine_rows_double)"
    of_float combine_float "OF_THIS_PROCESSOR(combine_rows_float)"
    of_double project_double "OF_THIS_PROCESSOR(project_rows_double)"
    of_float project_float "OF_THIS_PROCESSOR(project_rows_float)"

    ctypedef struct modal_answer:
        Py_ssize_t m
        Py_ssize_t first
        const double *c
        Py_ssize_t n_harmonics
        const Py_ssize_t *cosines
        int has_mean
        Py_ssize_t N_H
    ctypedef void (*answer_double_of)(double *y, Py_ssize_t N, Py_ssize_t n, modal_answer modes, const double *R, Py_ssize_t n_rows) nogil
    ctypedef void (*answer_float_of)(float *y, Py_ssize_t N, Py_ssize_t n, modal_answer modes, const float *R, Py_ssize_t n_rows) nogil
    answer_double_of answer_double "OF_THIS_PROCESSOR(answer_rows_double)"
    answer_float_of answer_float "OF_THIS_PROCESSOR(answer_rows_float)"

ctypedef fused real:
    double
    float


def combine(const Py_ssize_t[::1] places, Py_ssize_t n, const real[:, ::1] p, real[:, ::1] y):
    """Write p^T A into ``y`` (N, n), for p (m, N) and rows of A of length ``n`` at the addresses ``places`` (m,); none empty."""
    cdef Py_ssize_t m = places.shape[0], N = p.shape[1]
    with nogil:
        if real is double:
            combine_double(m, <const double **> &places[0], n, &p[0, 0], N, &y[0, 0])
        else:
            combine_float(m, <const float **> &places[0], n, &p[0, 0], N, &y[0, 0])


def project(const Py_ssize_t[::1] places, Py_ssize_t n, const real[:, ::1] x, real[:, ::1] y):
    """Write A x^T into ``y`` (m, N), for x (N, n) and rows of A of length ``n`` at the addresses ``places`` (m,); none empty."""
    cdef Py_ssize_t m = places.shape[0], N = x.shape[0]
    with nogil:
        if real is double:
            project_double(m, <const double **> &places[0], n, &x[0, 0], N, &y[0, 0])
        else:
            project_float(m, <const float **> &places[0], n, &x[0, 0], N, &y[0, 0])


def pick(const Py_ssize_t[::1] places, const Py_ssize_t[::1] columns, double unit, real[:, :] out):
    """Write the ``columns`` (k,) of A divided by ``unit`` into ``out`` (m, k); rows of A are in double precision at ``places``."""
    cdef Py_ssize_t i, j
    cdef const double *row
    with nogil:
        for j in range(places.shape[0]):
            row = <const double *> places[j]
            for i in range(columns.shape[0]):
                out[j, i] = <real> (row[columns[i]] / unit)


def answer(real[:, ::1] y, const real[:, ::1] R, const double complex[:, ::1] c, const Py_ssize_t[::1] cosines, bint has_mean,
           Py_ssize_t N_H, Py_ssize_t first):
    """Add to the first n_rows columns of ``y`` (N, n) the response of modes to the modal forces in its columns from ``first``.

    R (m, n_rows) are the modes in these rows, c (m, n_harmonics) their complex flexibilities, ``cosines`` (n_harmonics,) the
    columns of the harmonics among N_H coefficients; N is a multiple of N_H.
    """
    cdef modal_answer modes
    if R.shape[0] == 0 or R.shape[1] == 0 or y.shape[0] == 0 or cosines.shape[0] == 0:
        return
    modes.m, modes.first, modes.c, modes.n_harmonics = R.shape[0], first, <const double *> &c[0, 0], cosines.shape[0]
    modes.cosines, modes.has_mean, modes.N_H = &cosines[0], has_mean, N_H
    with nogil:
        if real is double:
            answer_double(&y[0, 0], y.shape[0], y.shape[1], modes, &R[0, 0], R.shape[1])
        else:
            answer_float(&y[0, 0], y.shape[0], y.shape[1], modes, &R[0, 0], R.shape[1])
