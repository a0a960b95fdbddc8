"""A wedge damper under two platforms, with only centrifugal force: forces on its flanks, and loss of contact."""

import numpy as np
import pytest
from damper import Damper, damper
from msh import write_msh
from scene_text import joint, response, steel, support, table

import microslip
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.parallel.agree import on_root

GIVEN = Damper(
    kind="hex8", n_chord=3, n_shank=2, n_thick=1, n_platform=2, n_height=1, n_aerofoil=2, n_damper=2, n_flank=1, n_length=2
)
DENSITY, SPEED, FRICTION = 7850.0, 500.0, 0.3
SCENE = (
    '[model]\nmesh = "wedge.msh"\naxis = [0.0, 1.0, 0.0]\naxis_point = [0.0, 0.0, {height}]\n'
    + steel("damper", density=DENSITY)
    + "[statics]\nrotation_speed = {speed}\nstress_stiffening = false\n"
    + '[[statics.pressures]]\ngroup = "outer_undersides"\npressure = {pressure}\n'
    + table("[loads]", group="left_tip", direction=[1.0, 0.0, 0.0])
    + table("[outputs]", name="tip", position=[-0.02, 0.0, 0.41], direction=[1.0, 0.0, 0.0])
    + response(1.0)
    + table("solver", modes=4)
)
GUIDE = '[[supports]]\ngroup = "damper_end"\nfix = ["y"]\n'  # support of the damper along the axis without friction


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    path = comm.bcast(tmp_path_factory.mktemp("wedge"))
    on_root(comm, lambda: write_msh(str(path / "wedge.msh"), damper(GIVEN)))
    return path


def scene_of(comm, folder, name, friction=FRICTION, speed=SPEED, pressure=1e6, height=0.0, more=""):
    """Return a scene of two blades and their damper.  Collective."""

    def write():
        joints = "".join(
            joint(f"damper_{side}", f"{side}_platform", name=side, friction=friction, k_t=5.0e12)
            + support(f"{side}_root")
            + table(f"bodies.{side}", group=side, material="steel")
            for side in ("left", "right")
        )
        path = folder / f"{name}.toml"
        path.write_text(SCENE.format(speed=speed, pressure=pressure, height=height) + joints + more)
        return path

    return microslip.read(on_root(comm, write))


def pull():
    """Return the centrifugal force of the trapezoid [N]: density, speed squared and the integral of width times z."""
    z_top, z_bottom = (GIVEN.ridge_radius - 0.5 * GIVEN.slope * width for width in (GIVEN.damper_top, GIVEN.damper_bottom))
    z, weight = np.polynomial.legendre.leggauss(2)
    z = 0.5 * (z_top + z_bottom + z * (z_top - z_bottom))
    moment = 0.5 * (z_top - z_bottom) * weight @ (2.0 * (GIVEN.ridge_radius - z) / GIVEN.slope * z)
    return DENSITY * GIVEN.damper_length * moment * SPEED**2


def flanks(comm, scene):
    """Return the normal force of each flank (2,), and the total force on the platforms (3,) [N]."""
    with microslip.build(scene, comm) as structure:
        pairs = structure.pairs
        N = np.maximum(pairs.N0, 0.0)
        left = np.array(pairs.joint) == "left"
        total = np.einsum("pji,pj->i", pairs.frame, np.column_stack([pairs.T0, -N]))
    return np.array([N[left].sum(), N[~left].sum()]), total


def test_without_friction_each_flank_bears_half_of_the_force(comm, folder):
    normal, total = flanks(comm, scene_of(comm, folder, "smooth", friction=0.0, more=GUIDE))
    assert normal == pytest.approx(0.5 * pull() / np.cos(np.radians(GIVEN.flank_angle)), rel=1e-9)
    assert total == pytest.approx([0.0, 0.0, pull()], rel=1e-9, abs=1e-9 * pull())


def test_friction_reduces_the_normal_forces(comm, folder):
    """Friction of at most mu times the normal force bears a part of the centrifugal force."""
    normal, total = flanks(comm, scene_of(comm, folder, "rough"))
    angle = np.radians(GIVEN.flank_angle)
    least = 0.5 * pull() / (np.cos(angle) + FRICTION * np.sin(angle))
    assert normal[0] == pytest.approx(normal[1], rel=1e-6)
    assert 0.999999 * least <= normal[0] < 0.97 * 0.5 * pull() / np.cos(angle)
    assert total == pytest.approx([0.0, 0.0, pull()], rel=1e-9, abs=1e-9 * pull())


def test_an_inward_force_on_the_damper_has_no_equilibrium(comm, folder):
    """With the axis beyond the tips the force is inwards, where the damper has no support."""
    with pytest.raises(ConvergenceError, match=r"no equilibrium beyond .*body 'damper' moves along \(0, 0, -1\)") as caught:
        flanks(comm, scene_of(comm, folder, "away", height=0.6, pressure=1.0))
    assert caught.value.exit_status == 3


def test_a_damper_without_centrifugal_force_is_unsupported(comm, folder):
    """Only the platforms are loaded: no contact pressure acts on the damper, and open pairs do not support it."""
    with pytest.raises(CaseError, match="nothing presses on body 'damper' at rest: .* of 'left' and 'right' is "):
        flanks(comm, scene_of(comm, folder, "slow", speed=0.0, pressure=1e4))
