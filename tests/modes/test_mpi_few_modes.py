"""Too few converged modes: a search in a larger space, then a failure with its status, the same on all ranks."""

import lattices
import numpy as np
import pytest

from microslip.linear.joint_springs import linearise
from microslip.messages.errors import ConvergenceError
from microslip.modes import shift_invert
from microslip.modes.eigen import lowest_modes
from microslip.modes.shift_invert import ModeSearch

pytestmark = pytest.mark.ranks(1, 2)
SHAPE = (12, 7, 6)


@pytest.fixture
def linearised(comm):
    system, pairs = lattices.lattice(comm, SHAPE)
    computed = linearise(system, pairs)
    yield computed
    computed.destroy()


@pytest.mark.study
def test_a_space_that_is_too_small_is_doubled(comm, linearised, options):
    """With one restart only some of 12 modes converge in a space of 24, and all in a larger space."""
    options(modes_eps_ncv=24, modes_eps_max_it=1)
    modes = lowest_modes(linearised, 10)
    np.testing.assert_allclose(modes.omega_n, lattices.lattice_frequencies(SHAPE)[:10], rtol=1e-9)
    messages = modes.info["messages"]
    assert (
        1 <= len(messages) <= 2
        and "of 12 converged in a space of 24" in messages[0]
        and modes.info["basis"] == 24 * 2 ** len(messages)
    )
    assert len(set(comm.allgather(messages))) == 1


def test_too_few_modes_in_the_largest_space_are_an_error(comm, linearised, options, monkeypatch):
    monkeypatch.setattr(shift_invert, "_TRIES", 2)
    options(modes_eps_ncv=41, modes_eps_max_it=1, modes_eps_tol=1e-30)
    with pytest.raises(
        ConvergenceError, match="in a space of 41; modes: .* in a space of 82.*fewer .solver. modes.*eps_max_it 2"
    ) as caught:
        ModeSearch(linearised).lowest(40)
    assert caught.value.exit_status == 3 and len(set(comm.allgather(str(caught.value)))) == 1


def test_a_sufficient_space_gives_no_message(linearised, options):
    options(modes_eps_type="krylovschur")
    assert lowest_modes(linearised, 5).info["messages"] == ()
