"""Prescribed displacements of supports, and large displacements at rest, against theory; on one rank and on several."""

import numpy as np
import pytest
from blocks import box, stacked
from msh import write_msh
from rest_scene import HEIGHT, WIDTH, force
from rest_scene import LENGTH as BAR
from rest_scene import scene_of as bar_scene_of
from scene_text import response, steel, support, table

import microslip
from microslip.messages.errors import CaseError, ConvergenceError, MeshError
from microslip.parallel.agree import on_root

YOUNG, DENSITY, LENGTH, SIDE = 2.0e11, 8000.0, 1.0, 0.02
GUIDED = '[[supports]]\ngroup = "beam"\nfix = ["y", "z"]\n[[supports]]\ngroup = "tip"\nfix = ["x"]\n'
ALONG = "direction = [1.0, 0.0, 0.0]"
SCENE = (
    '[model]\nmesh = "KIND.msh"\n'
    + steel("beam", young=YOUNG, poisson=0.0, density=DENSITY)
    + support("hub")
    + "SUPPORTS\n[[loads]]\nposition = [0.5, 0.01, 0.01]\nDIRECTION\n"
    + '[[outputs]]\nname = "middle"\nposition = [0.5, 0.01, 0.01]\nDIRECTION\n'
    + response(1.0)
    + table("solver", modes=3)
    + "[statics]\n"
)


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    path = comm.bcast(tmp_path_factory.mktemp("large"))

    def write():
        for kind, cells in (("hex20", (12, 1, 1)), ("hex8", (12, 1, 1))):
            beam = box(kind, (LENGTH, SIDE, SIDE), cells, (0.0, -0.5 * SIDE, -0.5 * SIDE), {"x0": "hub", "x1": "tip"})
            write_msh(str(path / f"{kind}.msh"), {"beam": beam})
        write_msh(str(path / "bar.msh"), stacked("hex8", (BAR, WIDTH, HEIGHT), (4, 2, 1), 0.005))

    on_root(comm, write)
    return path


def scene_of(comm, folder, statics, kind="hex20", supports=GUIDED, direction=ALONG):
    text = SCENE.replace("KIND", kind).replace("SUPPORTS", supports).replace("DIRECTION", direction)
    path = folder / "beam.toml"
    on_root(comm, lambda: path.write_text(text + statics))
    try:
        return microslip.read(path)
    finally:
        comm.barrier()  # before the next test writes it


def moved_by(d, more=""):
    return f'{more}\n[[statics.displacements]]\ngroup = "tip"\ndisplacement = [{d}, 0.0, 0.0]\n'


@pytest.mark.parametrize("large", [True, False])
def test_a_bar_stretched_by_its_supports_has_the_frequency_of_theory(comm, folder, large):
    """omega = pi / L sqrt(A / rho); A, the slope of the force by the stretch l, is E (3 l^2 - 1) / 2, or E (l^2 + l - 1) linearly."""
    stretch = 1.05
    scene = scene_of(comm, folder, moved_by(stretch - 1.0, f"{'large_displacements' if large else 'deformed_shape'} = true"))
    with microslip.build(scene, comm) as structure:
        omega = structure.modes.omega_n[0]
    slope = 0.5 * (3.0 * stretch**2 - 1.0) if large else stretch**2 + stretch - 1.0
    assert omega == pytest.approx(np.pi / LENGTH * np.sqrt(YOUNG / DENSITY * slope), rel=1e-5)


@pytest.mark.parametrize("kind", ["hex20", "hex8"])
def test_large_bending_of_a_beam_is_that_of_theory(comm, folder, kind):
    """K. E. Bisshopp and D. C. Drucker, Quarterly of Applied Mathematics 3 (1945) 272: P L^2 = E I."""
    P = YOUNG * SIDE**4 / 12.0 / LENGTH**2
    pull = f'large_displacements = true\n[[statics.forces]]\ngroup = "tip"\nforce = [0.0, 0.0, {P}]\n'
    scene = scene_of(comm, folder, pull, kind, supports="", direction="direction = [0.0, 0.0, 1.0]")
    with microslip.build(scene, comm) as structure:
        system = structure.linearised.system
        u = system.at_nodes(np.concatenate(comm.allgather(system.rest_owned)))
        tip = on_root(comm, lambda: u[np.isclose(structure.mesh.points[:, 0], LENGTH)].mean(axis=0))
    assert tip[2] == pytest.approx(0.3017 * LENGTH, rel=5e-3)
    assert tip[0] == pytest.approx(-0.0564 * LENGTH, rel=5e-3)


def test_small_loads_give_the_rest_of_small_displacements(comm, folder):
    load = force(0.15, 0.05, -1.0)
    values = []
    for first in ("", "large_displacements = true\n"):
        with microslip.build(bar_scene_of(comm, folder, first + load), comm) as structure:
            values.append((structure.pairs.N0, structure.modes.omega_n))
    for small, large in zip(*values, strict=True):
        assert large == pytest.approx(small, rel=1e-5)


def test_springs_of_a_joint_act_on_the_deformed_area(comm, folder):
    """Heated bar and ground are larger by their free strain in all directions."""
    strain = 1e-2
    temperature = f"temperature = {strain / 1.2e-5}\n"
    both = "".join(f'[[statics.temperatures]]\ngroup = "{group}"\n{temperature}' for group in ("bar", "ground"))
    free = (
        'fix = ["x", "y", "z"]',
        'fix = ["z"]\n[[springs]]\ngroups = ["ground_base"]\ndirection = [1.0, 0.0, 0.0]\nstiffness = 1e6\n'
        '[[springs]]\ngroups = ["ground_base"]\ndirection = [0.0, 1.0, 0.0]\nstiffness = 1e6',
    )
    scene = bar_scene_of(comm, folder, "large_displacements = true\n" + force(0.0, 0.0, -100.0) + both, free)
    with microslip.build(scene, comm) as structure:
        area, stiffness = structure.pairs.area.sum(), structure.pairs.k_n.sum()
    larger = 1.0 + 2.0 * strain  # Green's strain: F^T F = 1 + 2 strain
    assert area == pytest.approx(BAR * WIDTH * larger, rel=1e-5)
    assert stiffness == pytest.approx(2e12 * area, rel=1e-12)


WRONG = {
    "free": ("", "[0.01, 0.0, 0.0]", r'\[\[statics.displacements\]\] 1 group = "tip": node \d+ .* held along x by none'),
    "held elsewhere": (GUIDED.replace('fix = ["x"]', 'fix = ["y"]'), "[0.01, 0.0, 0.0]", "held along x by none"),
}


EXCLUDED = {
    "stress": ("stress_stiffening = false\n" + moved_by(0.01), "large_displacements = true needs stress_stiffening"),
    "bolts": ('[[statics.bolts]]\ngroup = "tip"\nforce = 1.0\n', "bolts are tightened with small displacements"),
}


@pytest.mark.parametrize("statics, message", EXCLUDED.values(), ids=EXCLUDED)
def test_keys_that_large_displacements_exclude_are_refused(comm, folder, statics, message):
    with pytest.raises(CaseError, match=message):
        scene_of(comm, folder, "large_displacements = true\n" + statics)


def test_a_missing_group_of_displacements_is_refused(comm, folder):
    with pytest.raises(
        MeshError, match=r"\[\[statics.displacements\]\] 1 group = 'tap': there is no such group .* nearest is 'tip'"
    ):
        microslip.build(scene_of(comm, folder, moved_by(0.01).replace('"tip"', '"tap"')), comm)


@pytest.mark.parametrize("supports, by, message", WRONG.values(), ids=WRONG)
def test_prescribed_displacements_need_supports(comm, folder, supports, by, message):
    moved = f'[[statics.displacements]]\ngroup = "tip"\ndisplacement = {by}\n'
    with pytest.raises(MeshError, match=message):
        microslip.build(scene_of(comm, folder, moved, supports=supports), comm)


def test_a_displaced_support_must_not_lead_other_nodes(comm, folder):
    """A point with a mass follows the displaced nodes of the tip."""
    tied = GUIDED + '[[points]]\nname = "p"\nposition = [1.0, 0.0, 0.0]\ngroup = "tip"\nconnection = "distributing"\nmass = 1.0\n'
    with pytest.raises(MeshError, match="is moved, and leads a tie, a point or an equation"):
        microslip.build(scene_of(comm, folder, moved_by(0.01), supports=tied), comm)


@pytest.mark.ranks(1)
def test_a_load_beyond_buckling_has_no_equilibrium(comm, folder):
    """The load is four times Euler's load of a cantilever."""
    P = np.pi**2 * YOUNG * SIDE**4 / 12.0 / LENGTH**2
    pushed = f'large_displacements = true\n[[statics.forces]]\ngroup = "tip"\nforce = [{-P}, 0.0, 0.0]\n'
    scene = scene_of(comm, folder, pushed, "hex8", supports="", direction="direction = [0.0, 0.0, 1.0]")
    with pytest.raises(ConvergenceError, match="no equilibrium beyond (1[89]|2[0-5])[.0-9]*% of the load"):
        microslip.build(scene, comm)
