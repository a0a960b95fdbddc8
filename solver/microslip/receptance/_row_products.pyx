# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
"""Bridge from NumPy arrays to row_products.c; what it computes is stated there and in rows.py."""

cdef extern from "row_products.h" nogil:
    ctypedef void (*of_double)(Py_ssize_t m, const double **rows, Py_ssize_t n, const double *p, Py_ssize_t N, double *y) nogil
    ctypedef void (*of_float)(Py_ssize_t m, const float **rows, Py_ssize_t n, const float *p, Py_ssize_t N, float *y) nogil
    of_double combine_double "OF_THIS_PROCESSOR(combine_rows_double)"
    of_float combine_float "OF_THIS_PROCESSOR(combine_rows_float)"
    of_double project_double "OF_THIS_PROCESSOR(project_rows_double)"
    of_float project_float "OF_THIS_PROCESSOR(project_rows_float)"

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
    """Write the ``columns`` (k,) of A, over ``unit``, into ``out`` (m, k), for rows of A in double precision at ``places`` (m,)."""
    cdef Py_ssize_t i, j
    cdef const double *row
    with nogil:
        for j in range(places.shape[0]):
            row = <const double *> places[j]
            for i in range(columns.shape[0]):
                out[j, i] = <real> (row[columns[i]] / unit)
