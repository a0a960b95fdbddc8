"""Rest of a structure without supports under balanced loads against that of the structure on soft springs."""

import numpy as np
import pytest
from mpi4py import MPI
from rest_scene import SCENE, folder_with_bar, force, scene_of
from scene_text import support

import microslip
from microslip.messages.errors import CaseError

comm = MPI.COMM_WORLD
BASE = support("ground_base")
assert BASE in SCENE
FREE = (BASE, "")
SPRINGS = """[[points]]
name = "soft"
position = [0.02, 0.004, -0.005]
group = "ground_base"
connection = "distributing"
stiffness = [1e4, 1e4, 1e4]
rotational_stiffness = [30.0, 30.0, 30.0]
"""
PRESSED = force(0.0, 0.0, -400.0) + force(0.0, 0.0, 400.0, "ground_base")


folder = pytest.fixture(scope="module")(folder_with_bar)


def rest_of(folder, statics, change, name):
    """Return normal and friction forces at rest and the first two elastic frequencies [rad/s].  Collective."""
    with microslip.build(scene_of(comm, folder, statics, change, name=name), comm) as structure:
        n_soft = 0 if structure.rigid is not None else 6
        assert n_soft or len(structure.rigid.b) == 6
        return structure.pairs.N0, structure.pairs.T0, structure.omega_n[n_soft : n_soft + 2]


def test_rest_and_modes_of_a_free_structure_equal_those_on_soft_springs(folder):
    """Contact forces, elastic frequencies about rest and their shift by stress stiffening are those on soft springs."""
    stiffened, plain = PRESSED, "stress_stiffening = false\n" + PRESSED
    (N, T, omega), (N_soft, T_soft, omega_soft) = (
        rest_of(folder, stiffened, change, name) for change, name in ((FREE, "free"), ((BASE, SPRINGS), "soft"))
    )
    assert N.max() > 0.0 and abs(N[N > 0.0].sum() - 400.0) < 1e-6 * 400.0
    np.testing.assert_allclose(N, N_soft, atol=1e-6 * N.max())
    np.testing.assert_allclose(T, T_soft, atol=1e-5 * N.max())
    np.testing.assert_allclose(omega, omega_soft, rtol=5e-4)
    shift = omega - rest_of(folder, plain, FREE, "free")[2]
    shift_soft = omega_soft - rest_of(folder, plain, (BASE, SPRINGS), "soft")[2]
    assert abs(shift[0]) > 1e-5 * omega[0]
    np.testing.assert_allclose(shift, shift_soft, atol=0.02 * abs(shift[0]))


@pytest.mark.parametrize(
    "statics, message",
    [
        (force(0.0, 0.0, -400.0), r"in balance: a force of \(0, 0, -400\) N and a moment of \(.*\) N m about the middle"),
        ("rotation_speed = 10.0\n" + PRESSED, "rotation_speed needs .*supports"),
        ("large_displacements = true\n" + PRESSED, "large_displacements = true needs .*supports"),
    ],
)
def test_unbalanced_loads_on_a_free_structure_are_refused(folder, statics, message):
    scene = scene_of(comm, folder, statics, FREE)
    with pytest.raises(CaseError, match=message):
        microslip.build(scene, comm)


def test_loads_along_a_free_motion_are_refused(folder):
    free_along_x = (BASE, BASE.replace('"x", ', ""))
    with pytest.raises(CaseError, match="in balance along the rigid-body motions that .* leave free"):
        microslip.build(scene_of(comm, folder, force(400.0, 0.0, -400.0), free_along_x), comm)
