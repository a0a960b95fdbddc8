"""A list of harmonics in a scene: only these are solved for; on any number of ranks."""

import numpy as np
import pytest
from discs import write_sector
from mpi4py import MPI

from microslip.library.build import build
from microslip.library.respond import respond
from microslip.messages.errors import MicroslipError
from microslip.parallel.agree import on_root
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
END = """[damping]
ratio = 0.01
[response]
levels = [10.0]
frequencies = [1433.0, 1439.0]
at = [1436.0]
points = 4
[solver]
modes = 54
samples = 64
error_bars = false
"""


@pytest.mark.ranks(1)
def test_only_listed_harmonics_are_solved_for(shared_path):
    """[0, 1, 2, 3] equals 3; [1, 3] has no mean, no second harmonic, and another solution, as this joint also moves normally."""
    text = END + "harmonics = [1, 3]\n"
    structure = build(read_scene(on_root(COMM, lambda: write_sector(shared_path, 5, text, friction=0.05))), COMM)
    some, listed, up_to_3 = (
        respond(structure, **keys).level(10.0) for keys in ({}, {"harmonics": [0, 1, 2, 3]}, {"harmonics": 3})
    )
    structure.close()
    np.testing.assert_array_equal(listed.response, up_to_3.response)
    assert not some.failure and some.harmonics.max() == 3 and some.response.shape[-1] == 7
    np.testing.assert_array_equal(some.response[..., [0, 3, 4]], 0.0)
    assert COMM.bcast(int((some.state == 1).sum())) > 0 and np.abs(some.response[..., 5:]).max() > 0.0
    change = np.abs(some.response[0, 0, 1:3] - up_to_3.response[0, 0, 1:3]).max() / np.abs(up_to_3.response[0, 0]).max()
    assert 1e-6 < change < 0.2


def test_lists_without_necessary_harmonics_are_rejected(shared_path):
    def message(solver: str) -> str:
        path = on_root(COMM, lambda: write_sector(shared_path, 5, END.replace("error_bars = false\n", "") + solver))
        with pytest.raises(MicroslipError) as error:
            read_scene(path)
        return str(error.value)

    assert "has no harmonic 1" in message("harmonics = [0, 2]\n")
    assert "an ascending list of harmonics" in message("harmonics = [3, 1]\n")
    assert "an ascending list of harmonics" in message("harmonics = []\n")
    assert "state error_bars = false, or harmonics = 3" in message("harmonics = [1, 3]\n")
    assert "do not resolve harmonics = 40" in message("harmonics = [1, 40]\n")
