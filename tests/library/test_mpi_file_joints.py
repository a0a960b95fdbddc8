"""A contact pair of a model file as a joint of the scene: preloaded by loads at rest, stated, ignored, or rejected."""

import numpy as np
import pytest
from mpi4py import MPI

from microslip.library.build import from_mesh
from microslip.library.complete import read_completed
from microslip.linear.joint_springs import linearise
from microslip.messages.errors import CaseError
from microslip.modes.eigen import lowest_modes
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.scene.read import scene_of

COMM = MPI.COMM_WORLD
STIFFNESS, SLOPE, DENSITY = 2.0, 0.5, 7.8e-9  # N/mm3, N/mm3, t/mm3
# a block of 1 x 2 x 1 mm on another, pressed by forces on its end
DECK = f"""*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 2, 0
4, 0, 2, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 2, 1
8, 0, 2, 1
11, 0, 0, 1
12, 1, 0, 1
13, 1, 2, 1
14, 0, 2, 1
15, 0, 0, 2
16, 1, 0, 2
17, 1, 2, 2
18, 0, 2, 2
*ELEMENT, TYPE=C3D8, ELSET=BLOCKS
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 11, 12, 13, 14, 15, 16, 17, 18
*NSET, NSET=BASE
1, 2, 3, 4
*NSET, NSET=END
15, 16, 17, 18
*SURFACE, NAME=LOWER
1, S2
*SURFACE, NAME=UPPER
2, S1
*MATERIAL, NAME=STEEL
*ELASTIC
210000., .3
*DENSITY
{DENSITY}
*SOLID SECTION, ELSET=BLOCKS, MATERIAL=STEEL
*BOUNDARY
BASE, 1, 3
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE
UPPER, LOWER
*SURFACE INTERACTION, NAME=DRY
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{STIFFNESS}
*FRICTION
0.5, {SLOPE}
"""
LOADED = "*STEP\n*STATIC\n*CLOAD\nEND, 3, -1e-4\n*END STEP\n*STEP, PERTURBATION\n*FREQUENCY\n6\n*END STEP\n"
BARE = "*STEP\n*FREQUENCY\n6\n*END STEP\n"


def scene(folder, of_model=None, **more):
    tables = {
        "model": {"mesh": "job.inp", "units": "mm-t-s", **(of_model or {})},
        "loads": ({"node": 15, "direction": (0.0, 0.0, 1.0)},),
        "outputs": ({"name": "end", "node": 15, "direction": (0.0, 0.0, 1.0)},),
        "damping": {"ratio": 0.01},
        "response": {"levels": (1.0,), "frequencies": (1.0, 2.0)},
    }
    return scene_of({**tables, **more}, folder / "scene.toml")


def frequencies(scene):
    """Return the six lowest frequencies [rad/s] about rest, the joint's name and its pairs.  Collective."""
    file, whole, _ = read_completed(scene, COMM)
    _, rest, _ = from_mesh(whole, file, COMM, RunLog(COMM, screen=False))
    linearised = linearise(rest.system, rest.pairs, "job.inp")
    modes = lowest_modes(linearised, 6, verify=False)
    linearised.destroy()
    return modes.omega_n, whole, rest.pairs


def test_a_block_on_a_contact_pair_vibrates_as_a_rigid_body(tmp_path):
    folder = COMM.bcast(tmp_path)
    on_root(COMM, (folder / "job.inp").write_text, DECK + LOADED)
    omega, whole, pairs = frequencies(scene(folder))
    (joint,) = whole.joints
    assert (joint.name, joint.surfaces, joint.pairing) == ("UPPER_LOWER", ("UPPER", "LOWER"), "mortar")
    assert (joint.friction, joint.normal_stiffness, joint.tangential_stiffness) == (0.5, 2e9, 5e8)
    assert (joint.preload, joint.gap) == ("static", "geometry") and pairs.N0.sum() == pytest.approx(4e-4)
    lift = np.sqrt(2e9 * 2e-6 / (2.0 * DENSITY * 1e3))
    assert min(abs(omega / lift - 1.0)) < 1e-5  # the block deforms by K L / E
    assert omega.max() < 5.0 * lift  # six rigid-body motions of the block


def test_a_contact_pair_becomes_a_joint_only_with_loads(tmp_path):
    folder = COMM.bcast(tmp_path)
    on_root(COMM, (folder / "job.inp").write_text, DECK + BARE)
    with pytest.raises(
        CaseError, match=r"(?s)1 entry .*line 38: \*CONTACT PAIR: UPPER and LOWER in contact, friction 0.5: a joint that"
    ):
        read_completed(scene(folder), COMM)
    pressed = {"forces": ({"group": "END", "force": (0.0, 0.0, -4e-4)},)}
    _, whole, notes = read_completed(scene(folder, statics=pressed), COMM)
    assert whole.joints[0].preload == "static" and "1 joint taken over from job.inp: UPPER_LOWER" in notes
