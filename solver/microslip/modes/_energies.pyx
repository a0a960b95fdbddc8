# cython: language_level=3, boundscheck=False, wraparound=False
"""x^T A x in extended precision, for rayleigh.py."""

import numpy as np


def energies(const int[::1] starts, const int[::1] columns, const double[::1] values, const double[:, ::1] X_rows,
             const double[:, ::1] X):
    """Return the sums of x_i A_ij x_j over the stored rows i of A and their columns j, (m,) np.longdouble.  Local.

    ``X_rows`` (n_rows, m) are these rows of X (n, m).
    """
    cdef Py_ssize_t i, k, c, m = X.shape[1]
    found = np.zeros(m, dtype=np.longdouble)
    cdef long double[::1] total = found
    cdef long double of_row
    with nogil:
        for i in range(X_rows.shape[0]):
            for c in range(m):
                of_row = 0.0
                for k in range(starts[i], starts[i + 1]):
                    of_row += <long double> values[k] * X[columns[k], c]
                total[c] += of_row * X_rows[i, c]
    return found
