"""The bar on a friction foundation; tests/verification/friction_bar.py prints the whole tables."""

import numpy as np
import pytest
from mpi4py import MPI
from verification import friction_bar

ALONE = MPI.COMM_SELF


@pytest.fixture(scope="module")
def hex20():
    """Return the errors with 8 and 16 elements along the bar."""
    return [friction_bar.errors("hex20", (n, 1, 1), ALONE) for n in (8, 16)]


@pytest.mark.study
def test_end_stiffness_and_load_at_first_slip(hex20):
    assert abs(hex20[1].stiffness) < 1e-3
    assert abs(hex20[1].first_slip) < 1e-3


def test_motion_of_the_end(hex20):
    assert hex20[1].motion.max() < 1e-3  # harmonic 1, amplitude and phase
    assert hex20[1].loop.max() < 1e-3  # harmonics 1 to 15 combined


def test_loss_per_cycle(hex20):
    # at the lowest load the slip zone has a length of two elements
    assert abs(hex20[1].loss[0]) < 4e-2
    assert np.abs(hex20[1].loss[1:]).max() < 5e-3


def test_errors_fall_with_the_mesh(hex20):
    assert friction_bar.rate(hex20[0].stiffness, hex20[1].stiffness) > 1.9
    assert friction_bar.rate(hex20[0].motion, hex20[1].motion) > 1.5
    assert friction_bar.rate(hex20[0].loss, hex20[1].loss) > 1.3


def test_energy_balance_of_the_friction_bar(hex20):
    assert max(each.closure for each in hex20) < 1e-6


@pytest.mark.study
@pytest.mark.parametrize("kind, cells", [("hex8", 32), ("tet10", 16)])
def test_friction_bar_of_other_elements(kind, cells):
    computed = friction_bar.errors(kind, (cells, 1, 1), ALONE, levels=(250.0,))
    assert max(abs(computed.stiffness), computed.motion.max(), abs(computed.loss).max()) < 3e-3
    assert abs(computed.first_slip) < 2e-3 and computed.closure < 1e-6
