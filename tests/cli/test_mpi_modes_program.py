"""`microslip modes`: frequencies, effective masses and shares of the joints compared with independent results; on any ranks."""

import csv

import numpy as np
import pytest
from bar_scene import N_DOF, write_bar
from blocks import box
from discs import write_ring, write_sector
from matrix_scenes import write_matrix_scene
from msh import write_msh
from oracles import scenes
from scene_text import driven, response, steel, support, table
from scipy.linalg import eigh

from microslip.library.build import build
from microslip.modes.lapack import gathered
from microslip.parallel.agree import on_root
from microslip.scene.read import read_scene
from microslip.scene.toml_text import as_toml
from microslip.studies.modes.campbell import Campbell, crossings
from microslip.studies.modes.disc import alias

pytestmark = pytest.mark.ranks(1, 2)


END = response(1.0) + table("solver", modes=48)


def column(folder, name, file="modes.csv"):
    with open(folder / file, newline="") as file:
        return np.array([float(row[name]) for row in csv.DictReader(file)])


@pytest.fixture
def bar(comm, shared_path, program):
    """Return a function of a folder's name and further arguments that returns the folder with the results.  Collective."""
    path = on_root(comm, write_bar, shared_path)

    def run(name, *more):
        status, out, err = program("modes", path, "--out", shared_path / name, *more)
        assert (status, err) == (0, "")
        return shared_path / name, out

    return run


@pytest.mark.ranks(1, 2, 3)
def test_all_modes_have_the_whole_mass_and_the_stuck_frequencies(bar, comm, shared_path):
    folder, out = bar("all", "--count", N_DOF)
    assert "none is missing" in out
    for axis in "xyz":
        assert column(folder, f"effective_mass_{axis}_percent").sum() == pytest.approx(100.0, rel=1e-9)
    structure = build(read_scene(shared_path / "bar.toml"), comm)
    omega_n = np.sqrt(eigh(*(comm.bcast(gathered(A)) for A in (structure.K_L, structure.M)), eigvals_only=True))
    assert column(folder, "frequency_Hz") == pytest.approx(omega_n / (2 * np.pi), rel=1e-8)
    structure.close()


def test_the_share_of_a_joint_is_the_sensitivity_of_the_frequency_to_its_stiffness(bar):
    share = column(bar("as_is")[0], "joint_joint_energy_percent") / 100.0
    assert len(share) == 12
    h = 2e-3
    softer, stiffer = (
        column(
            bar(
                name,
                "--set",
                f"joints.joint.tangential_stiffness={1e12 * f}",
                "--set",
                f"joints.joint.normal_stiffness={2e12 * f}",
            )[0],
            "frequency_Hz",
        )
        for name, f in (("softer", 1.0 - h), ("stiffer", 1.0 + h))
    )
    assert share == pytest.approx(np.log(stiffer**2 / softer**2) / np.log((1.0 + h) / (1.0 - h)), rel=1e-4, abs=1e-6)
    assert share.max() > 0.1


@pytest.mark.pictures
def test_modes_of_a_mesh_have_shapes_and_a_picture(bar):
    folder, out = bar("drawn", "--count", 3)
    assert {"modes.csv", "modes.log", "modes.png", "modes.vtkhdf"} == {file.name for file in folder.iterdir()}
    assert "none is missing" in out


def test_modes_of_matrices_have_frequencies_only(comm, shared_path, program):
    path = on_root(comm, write_matrix_scene, shared_path, scenes.spatial_mass(), [0.02], (1.0, 1.6))
    if comm.rank == 0:
        (shared_path / "out").mkdir()
        for name in ("campbell.csv", "campbell.png", "crossings.csv", "interference.png", "modes_diameter_02.vtkhdf"):
            (shared_path / "out" / name).touch()  # file of an earlier command
    status, out, err = program("modes", path, "--out", shared_path / "out")
    assert (status, err) == (0, "") and "mass x" not in out
    assert {"modes.csv", "modes.log"} == {file.name for file in (shared_path / "out").iterdir()}
    assert len(column(shared_path / "out", "frequency_Hz")) > 0


def write_of_structure_alone(path):
    """Write next to a scene the same scene without loads, outputs, [response] and engine order."""
    tables = read_scene(path).model_dump(exclude_unset=True)
    for name in ("loads", "outputs", "response"):
        del tables[name]
    if "cyclic" in tables:
        del tables["cyclic"]["engine_order"]
    alone = path.with_name(f"{path.stem}_alone.toml")
    alone.write_text(as_toml(tables))
    return alone


@pytest.mark.parametrize("kind", ["mesh", "matrices", "disc", "turning"])
def test_modes_need_no_loads_outputs_or_range(comm, shared_path, program, kind):
    write, more, file = {
        "mesh": (lambda: write_bar(shared_path), (), "modes.csv"),
        "matrices": (lambda: write_matrix_scene(shared_path, scenes.spatial_mass(), [0.02], (1.0, 1.6)), (), "modes.csv"),
        "disc": (lambda: write_sector(shared_path, 5, END, wave={"engine_order": 2}), ("--diameters", "0,2"), "modes.csv"),
        "turning": (lambda: write_beam(shared_path), ("--count", 2, "--speeds", "5,15"), "campbell.csv"),
    }[kind]
    path = on_root(comm, write)
    alone = on_root(comm, write_of_structure_alone, path)
    for scene, out in ((path, "whole"), (alone, "alone")):
        status, _, err = program("modes", scene, *more, "--out", shared_path / out)
        assert (status, err) == (0, "")
    assert (shared_path / "alone" / file).read_text() == (shared_path / "whole" / file).read_text()
    status, _, err = program("run", alone, "--out", shared_path / "no")
    assert status == 2 and "[[loads]] is missing" in err and "[response] is missing" in err


def test_more_modes_than_degrees_of_freedom_are_rejected(comm, shared_path, program):
    path = on_root(comm, write_bar, shared_path)
    status, _, err = program("modes", path, "--out", shared_path / "out", "--count", N_DOF + 1)
    assert status == 2 and f"modes = {N_DOF + 1}" in err and str(N_DOF) in err


def write_beam(folder):
    """Write a beam clamped on its axis of rotation, 2 % stiffer in the plane of rotation than out of it."""
    beam = box("hex20", (1.0, 0.0202, 0.02), (12, 1, 1), (0.0, -0.0101, -0.01), {"x0": "hub", "x1": "tip"})
    write_msh(str(folder / "beam.msh"), {"beam": beam})
    path = folder / "beam.toml"
    path.write_text(
        table("model", mesh="beam.msh", axis=[0.0, 0.0, 1.0])
        + steel("beam", young=2.0e11, poisson=0.0, density=8000.0)
        + support("hub")
        + table("statics", rotation_speed=5.0)
        + driven([[1.0, 0.0, 0.0]], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], "tip")
        + response(1.0)
    )
    return path


@pytest.mark.pictures
def test_bending_families_of_a_spinning_beam_cross_by_spin_softening(comm, shared_path, program):
    """Both families stiffen equally; in the plane omega^2 is less by Omega^2: one passes the other."""
    path, out = on_root(comm, write_beam, shared_path), shared_path / "out"
    status, _, err = program("modes", path, "--count", 2, "--speeds", "5,15,20,25,40,60", "--orders", "1,4", "--out", out)
    assert (status, err) == (0, "")
    speed, first, second = (column(out, name, "campbell.csv") for name in ("speed_rad_s", "family_1_Hz", "family_2_Hz"))
    assert speed == pytest.approx([5.0, 15.0, 20.0, 25.0, 40.0, 60.0])
    split = (2 * np.pi) ** 2 * (second**2 - first**2) + speed**2
    assert split == pytest.approx(np.full(6, split[0]), rel=2e-2) and split[0] > 0.0
    assert second[0] > first[0] and second[-1] < first[-1]
    met = {name: column(out, name, "crossings.csv") for name in ("family", "engine_order", "speed_rad_s", "frequency_Hz")}
    assert met["frequency_Hz"] == pytest.approx(met["engine_order"] * met["speed_rad_s"] / (2 * np.pi), rel=1e-8)
    assert (out / "campbell.png").exists()


def test_engine_orders_cross_a_mode_that_stiffens_with_the_square_of_the_speed():
    speed = np.array([10.0, 30.0, 70.0])
    squares = 400.0 + 1.7 * speed**2
    met = crossings(Campbell(speed, np.sqrt(squares)[None] / (2 * np.pi)), (1, 2, 3))
    expected = {order: np.sqrt(400.0 / (order**2 - 1.7)) for order in (2, 3)}  # order 1 does not reach the mode
    assert {crossing.order: crossing.speed for crossing in met if crossing.speed > 10.0} == pytest.approx(
        {order: value for order, value in expected.items() if 10.0 <= value <= 70.0}
    )


@pytest.mark.parametrize(
    "more, printed",
    [
        (("--speeds", "10,20"), "[statics] rotation_speed: [model] axis is missing"),
        (("--speeds", "10"), "is one speed; for one, use --set statics.rotation_speed=10"),
        (("--speeds", "10,20", "--orders", "1.5"), "'1.5' is not a number of at least 1"),
        (("--orders", "1,2"), "--orders: engine orders meet modes at speeds of rotation; state --speeds A,B, too"),
        (("--speeds", "10,20", "--orders", "1,1"), "'1,1' holds a number twice"),
        (("--diameters", "1,1"), "'1,1' holds a number twice"),
        (("--diameters", "1"), "has no table [cyclic], and so no nodal diameters"),
        (("--diameters", "-1"), "'-1' are not whole numbers of at least 0"),
        (("--count", "none"), "'none' is not a number of at least 1"),
    ],
)
def test_invalid_speeds_and_orders_are_rejected_with_one_message(comm, shared_path, program, more, printed):
    path = on_root(comm, write_bar, shared_path)
    status, _, err = program("modes", path, "--out", shared_path / "out", *more)
    assert status == 2 and printed in err and "Traceback" not in err


@pytest.mark.pictures
def test_a_disc_has_the_modes_of_the_ring_by_nodal_diameter(comm, shared_path, program):
    path, out = on_root(comm, lambda: write_sector(shared_path, 6, END)), shared_path / "disc"
    status, _, err = program("modes", path, "--count", 8, "--speeds", "1000,4000", "--out", out)
    assert (status, err) == (0, "")
    diameter, frequency = column(out, "nodal_diameter"), column(out, "frequency_Hz")
    assert sorted(set(diameter)) == [0, 1, 2, 3] and np.bincount(diameter.astype(int)).tolist() == [8] * 4
    in_ring = np.sort(np.concatenate([frequency, frequency[(diameter > 0) & (diameter < 3)]]))
    structure = build(read_scene(on_root(comm, lambda: write_ring(shared_path, 6, END))), comm)
    assert in_ring[:30] == pytest.approx(structure.modes.frequency[:30], rel=1e-8)
    structure.close()
    order, speed, at = (column(out, name, "crossings.csv") for name in ("engine_order", "speed_rad_s", "frequency_Hz"))
    assert speed * order == pytest.approx(2 * np.pi * at, rel=1e-8) and speed.min() >= 1000.0 and speed.max() <= 4000.0
    met = column(out, "nodal_diameter", "crossings.csv")
    assert [alias(int(E), 6) for E in order] == met.tolist()
    assert {"interference.png", "modes_diameter_02.vtkhdf"} <= {file.name for file in out.iterdir()}


def test_engine_orders_fold_at_half_of_the_sectors():
    assert [alias(E, 6) for E in range(1, 8)] == [1, 2, 3, 2, 1, 0, 1]
    assert [alias(E, 5) for E in range(1, 7)] == [1, 2, 2, 1, 0, 1]
