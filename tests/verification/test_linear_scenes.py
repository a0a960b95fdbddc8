"""Structures without a joint compared with theory; tests/verification/linear_scenes.py prints the whole tables."""

import numpy as np
from mpi4py import MPI
from verification import linear_scenes


def test_cantilever_has_timoshenkos_frequencies():
    computed = linear_scenes.cantilever(2, MPI.COMM_SELF)
    for name, theory in linear_scenes.cantilever_theory().items():
        assert np.abs(linear_scenes.nearest(computed, theory)).max() < 2e-3, name


def test_free_plate_has_mindlins_frequencies():
    computed, theory = linear_scenes.plate(12, MPI.COMM_SELF), linear_scenes.plate_theory()
    assert abs(computed[0] / theory[0] - 1.0) < 2e-3  # the twist, the lowest of all
    assert min(abs(computed[1] / theory - 1.0)) < 2e-3
