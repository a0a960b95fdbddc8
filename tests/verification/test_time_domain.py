"""Harmonic balance compared with direct time integration; tests/verification/time_domain.py prints the whole tables."""

import numpy as np
import pytest
from oracles import exact
from verification import time_domain


@pytest.mark.parametrize("name", time_domain.CASES)
def test_a_branch_agrees_with_time_integration(name):
    case = time_domain.CASES[name]
    points = time_domain.balanced(case, case.omegas[1:2], 15, 2048, points=20)
    peak = max(map(time_domain.amplitude, points))
    for point in points:
        # starting from the solution of harmonic balance, which it leaves within some ten periods if that is no solution
        steady = time_domain.marched(case, point.omega, 512, start=time_domain.state_at_start(case, point), tolerance=1e-5)
        assert point.state == steady.state
        assert max(time_domain.difference(case, point, steady)) < 1e-3 * peak


def test_all_harmonics_of_a_jenkins_mass_are_exact():
    case = time_domain.CASES["Jenkins mass"]
    for point in time_domain.balanced(case, case.omegas[1:4], 31, 2048, points=20):
        known = exact.jenkins_steady_state(point.omega, case.level, m=1.0, c=0.02, k=1.0, k_t=1.0, muN=1.0)
        assert np.abs(point.response[0] - known.harmonics(31)).max() < 1e-5 * time_domain.amplitude(point)
