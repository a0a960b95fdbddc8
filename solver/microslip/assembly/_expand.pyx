# cython: language_level=3, boundscheck=False, wraparound=False
"""Rows of free DOFs from blocks between nodes; what for is stated in node_blocks.py."""

ctypedef fused integer:
    int
    long long


def expand_blocks(const long long[::1] starts, const long long[::1] nodes, const double[:, :, ::1] data, const integer[:, ::1] dof,
                  Py_ssize_t first, integer[::1] indptr, integer[::1] columns, double[::1] values):
    """Write the rows of the free DOFs of some nodes, a compressed row each; return how many entries they have.  Local.

    The nodes are ``first`` and those after it; ``starts`` and ``nodes`` are their compressed rows, ``data`` (3, 3, n_blocks) or
    (1, 1, n_blocks) the blocks of these, ``dof`` (n_nodes, 3) the row of each DOF, -1 where fixed.
    """
    cdef Py_ssize_t node, i, j, k, row = 0, n = 0, n_components = data.shape[0]
    with nogil:
        indptr[0] = 0
        for node in range(starts.shape[0] - 1):
            for i in range(3):
                if dof[first + node, i] < 0:
                    continue
                for k in range(starts[node], starts[node + 1]):
                    for j in range(n_components):
                        if n_components == 1:  # multiples of the unit block: equal directions alone
                            columns[n], values[n] = dof[nodes[k], i], data[0, 0, k]
                        else:
                            columns[n], values[n] = dof[nodes[k], j], data[i, j, k]
                        n += columns[n] >= 0
                row += 1
                indptr[row] = <integer> n
    return n
