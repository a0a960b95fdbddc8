"""Wear of joints: prescribed slip and a peak with closed forms, redistribution with a dense solution; on any number of ranks."""

import csv
from itertools import product

import h5py
import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes
from rest_scene import GUIDED, LENGTH, folder_with_bar, force, scene_of
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

import microslip
from microslip.library.wear import WearingJoint
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results.read import read_results
from microslip.results.report.tables import wear_table
from microslip.statics.equilibrium import Flexibility
from microslip.statics.rest import worn_at_rest
from microslip.studies.wear.command import NAME

COMM = MPI.COMM_WORLD
FORCE = [{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}]
OF_MATRICES = "[wear]\ncoefficient = {coefficient}\ncycles = {cycles}\narea = {{ joint = 1.0 }}\n{more}"


def scene_with_wear(folder, system, levels, frequencies, wear, **solver):
    """Return the scene of a system with a table [wear].  Collective."""

    def write():
        path = write_matrix_scene(folder, system, levels, frequencies, **solver)
        path.write_text(path.read_text() + wear)
        return path

    return on_root(COMM, write)


# -- prescribed slip: a stiff spring determines the motion of the mass -----------------------------------------------------

X, N0, MU, K, PER_ENERGY, CYCLES = 1e-4, 100.0, 0.5, 1e7, 1e-5, 100.0  # as in test_jumps.py
STIFF, OMEGA = 2e14, 1.0
SAMPLES = 256


def logistic(cycles):
    a, b = 4.0 * MU * K * PER_ENERGY, MU / K
    return 1.0 / (b / X + (1.0 / N0 - b / X) * np.exp(a * X * cycles))


@pytest.mark.ranks(1)
@pytest.mark.parametrize(("law", "coefficient"), [("energy", PER_ENERGY), ("archard", MU * PER_ENERGY)])
def test_wear_by_prescribed_slip_is_logistic(shared_path, law, coefficient):
    system = scenes.make_system(
        "stiff", [[STIFF / 2.0]], [[STIFF]], [[0, -1, -1, -1, -1, -1]], mu=MU, N0=N0, k_t=K, k_n=K,
        C=np.array([[1.0]]), loads=FORCE, output=[1.0], omega=(0.9, 1.1), levels={},
    )  # fmt: skip
    more = f'law = "{law}"\nfrequency = {OMEGA / 2.0 / np.pi!r}\njump = 1e-6\n'
    wear = OF_MATRICES.format(coefficient=coefficient, cycles=CYCLES, more=more)
    level = X * STIFF / 2.0
    solver = {"points": 2, "harmonics": 1, "samples": SAMPLES, "error_bars": False, "tolerance": 1e-12}
    path = scene_with_wear(shared_path, system, [level], (0.9, 1.1), wear, **solver)
    with microslip.build(microslip.read(path), COMM) as structure:
        wearing = WearingJoint(structure)
        states = [first := wearing.start(), *wearing.follow(first)]
    assert states[-1].cycles == CYCLES
    for state in states:
        assert state.depth[0] == pytest.approx((N0 - logistic(state.cycles)) / K, rel=5e-3)
        assert state.cycle.N0[0] == pytest.approx(N0 - K * state.depth[0], rel=1e-12)
        assert state.cycle.energy[0] == pytest.approx(4.0 * MU * state.cycle.N0[0] * (X - MU * state.cycle.N0[0] / K), rel=1e-3)
        assert state.depth == pytest.approx(PER_ENERGY * state.energy, rel=1e-12)


# -- a peak that depends on the preload ------------------------------------------------------------------------------------


def one_mass(**changes):
    system = scenes.make_system(
        "one mass", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]], mu=1.0, N0=1.0, k_t=1.0, k_n=1.0,
        C=np.array([[0.02]]), loads=FORCE, output=[1.0], omega=(0.5, 2.0), levels={},
    )  # fmt: skip
    return system | changes


def amplitude(level, limit):
    """Return the peak amplitude of m = k = k_t = 1 with the friction limit mu N, one harmonic."""

    def level_of(X):
        th = np.arccos(1.0 - 2.0 * limit / X)
        a1, b1 = X / np.pi * (th - np.sin(2.0 * th) / 2.0), 4.0 * limit / np.pi * (1.0 - limit / X)
        return np.sqrt(
            minimize_scalar(
                lambda w: (1.0 + a1 / X - w * w) ** 2 * X * X + (0.02 * w * X + b1) ** 2, bounds=(0.9, 1.5), method="bounded"
            ).fun
        )

    return brentq(lambda X: level_of(X) - level, limit * (1.0 + 1e-9), 1e4, xtol=1e-12)


def depth_after(cycles):
    """Return the depth of the mass at 0.8 N from the loss of its exact peaks, 1e-3 m3/J on 1 m2."""

    def rate(_, depth):
        N = 1.0 - depth[0]
        return [1e-3 * 4.0 * N * (amplitude(0.8, N) - N)]

    return solve_ivp(rate, (0.0, max(cycles)), [0.0], t_eval=cycles, rtol=1e-8, atol=1e-12).y[0]


JENKINS = {"points": 8, "harmonics": 1, "samples": 128, "error_bars": False}
OF_MASS = OF_MATRICES.format(coefficient=1e-3, cycles=60, more="jump = 0.1\ntolerance = 0.3\n")


def test_the_peak_follows_the_preload_and_a_killed_study_continues(program, shared_path):
    path, out = scene_with_wear(shared_path, one_mass(), [0.8], (0.5, 2.0), OF_MASS, **JENKINS), shared_path / "out"
    status, messages, err = program("wear", path, "--out", out, "--set", "wear.cycles=40")
    assert (status, err) == (0, "") and "worn volume" in messages
    first = on_root(COMM, lambda: list(csv.DictReader((out / "wear.csv").open())))
    assert float(first[-1]["cycles"]) == 40.0 and len(first) > 2

    def kill():  # within a record
        with open(out / NAME, "r+b") as file:
            file.truncate((out / NAME).stat().st_size - 100)

    on_root(COMM, kill)
    status, messages, err = program("wear", path, "--out", out)
    assert (status, err) == (0, "") and f"continues after {len(first) - 2} jumps" in messages
    rows = on_root(COMM, lambda: list(csv.DictReader((out / "wear.csv").open())))
    assert rows[: len(first) - 1] == first[:-1] and float(rows[-1]["cycles"]) == 60.0
    for row in rows:
        limit = float(row["joint_normal_force_N"])
        assert limit == pytest.approx(1.0 - float(row["depth_max_m"]), rel=1e-8)
        assert float(row["amplitude"]) == pytest.approx(amplitude(0.8, limit), rel=30.0 / 128**2)
        assert float(row["volume_m3"]) == pytest.approx(1e-3 * float(row["energy_J"]), rel=1e-8)
    assert float(rows[-1]["frequency_Hz"]) < float(rows[0]["frequency_Hz"])
    depth, errors = (np.array([float(row[name]) for row in rows]) for name in ("depth_max_m", "jump_errors_m"))
    exactly = depth_after([float(row["cycles"]) for row in rows])
    assert np.all(np.abs(depth - exactly) <= errors + 30.0 / 128**2 * exactly)

    def check_group():
        with h5py.File(out / "results.h5") as file, h5py.File(out / "worn" / "results.h5") as worn:
            assert file["wear/depth"].shape == (len(rows), 1) and file["wear/depth"].attrs["unit"] == "m"
            assert worn["joint/N0"][0] == pytest.approx(file["wear/N0"][-1, 0])

    on_root(COMM, check_group)


@pytest.mark.pictures
def test_a_sticking_pair_does_not_wear(program, shared_path):
    path = scene_with_wear(shared_path, one_mass(), [0.01], (0.5, 2.0), OF_MASS, **JENKINS)
    status, messages, err = program("wear", path, "--out", shared_path / "out")
    assert (status, err) == (0, "")
    assert "no pair with a coefficient above 0 slides at 0.01 N: nothing wears" in messages
    assert on_root(COMM, (shared_path / "out" / "wear.png").is_file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("area = { joint = 1.0 }\n", "", "[wear] area: the pairs of joint 'joint' are given without areas"),
        ("coefficient = 0.001", "coefficient = 0.0", "[wear] coefficient: 0 of every joint"),
        ("jump = 0.1", "frequency = 9.0", "[wear] frequency = 9 Hz: outside [response] frequencies"),
    ],
)
def test_scenes_that_cannot_wear_are_rejected(program, shared_path, old, new, message):
    assert old in OF_MASS
    path = scene_with_wear(shared_path, one_mass(), [0.8], (0.5, 2.0), OF_MASS.replace(old, new), **JENKINS)
    status, _, err = program("wear", path, "--out", shared_path / "out")
    assert status == 2 and message in err


# -- redistribution --------------------------------------------------------------------------------------------------------

n_pairs = 3


def chain():
    """Return three masses in a row on elastic ground, each pressed on a pair."""
    stiffness = 2.0 * np.eye(n_pairs) + np.diff(np.eye(n_pairs), axis=0).T @ np.diff(np.eye(n_pairs), axis=0)
    pairs = [[-1, -1, i, -1, -1, -1] for i in range(n_pairs)]
    loads = [{"vector": np.eye(n_pairs)[0], "harmonic": 1, "phase": 0.0}]
    return scenes.make_system(
        "chain", np.eye(n_pairs), stiffness, pairs, mu=0.1, N0=[1.0, 2.0, -0.1], k_t=1.0, k_n=[3.0, 4.0, 5.0],
        zeta=0.01, loads=loads, output=np.eye(n_pairs)[0], omega=(0.1, 0.5), levels={},
    )  # fmt: skip


@pytest.mark.parametrize("depth", [[0.1, 0.0, 0.0], [0.1, 0.3, 0.0], [5.0, 0.1, 0.0], [0.0, 0.0, 0.2], [9.0, 9.0, 0.0]])
def test_normal_forces_are_those_of_unilateral_springs(shared_path, depth):
    system, depth = chain(), np.array(depth)
    path = on_root(COMM, lambda: write_matrix_scene(shared_path, system, [1.0], (0.1, 0.5), modes=3))
    with microslip.build(microslip.read(path), COMM) as structure:
        computed = worn_at_rest(Flexibility(structure.linearised), structure.pairs, depth).N0
    solutions = []
    for closed in product([True, False], repeat=n_pairs):  # K u = N - max(N0, 0), N = N0 - k_n (h + u) where closed
        k = np.where(closed, system["k_n"], 0.0)
        held = np.where(closed, system["N0"] - system["k_n"] * depth, 0.0)
        u = np.linalg.solve(system["K"] + np.diag(k), held - np.maximum(system["N0"], 0.0))
        N = system["N0"] - system["k_n"] * (depth + u)
        if np.array_equal(N > 0.0, closed):
            solutions.append(N)
    (exact,) = solutions
    assert computed == pytest.approx(exact, rel=1e-9, abs=1e-12)


folder = pytest.fixture(scope="module")(folder_with_bar)


def test_loads_on_a_worn_joint_are_in_equilibrium(comm, folder):
    """With [statics]: an even depth lowers the bar and changes no force; an uneven depth changes forces with the same sum."""
    scene = scene_of(comm, folder, force(0.0, 0.0, -1000.0), *GUIDED, name="worn")
    wear = {"coefficient": 1e-9, "cycles": 10.0, "jump": 1e-7}
    scene = microslip.scene_of({**scene.model_dump(exclude_unset=True), "wear": wear}, scene.path)
    with microslip.build(scene, comm) as structure:
        wearing, new = WearingJoint(structure), np.maximum(structure.pairs.N0, 0.0)
        even = np.maximum(wearing.worn(np.full(len(new), 1e-7)).pairs.N0, 0.0)
        uneven = np.maximum(wearing.worn(1e-7 * (structure.pairs.position[:, 0] > 0.5 * LENGTH)).pairs.N0, 0.0)
    assert even == pytest.approx(new, rel=1e-6)
    assert uneven.sum() == pytest.approx(new.sum(), rel=1e-8) and abs(uneven - new).max() > 0.02 * new.max()


def test_archard_needs_friction_and_names_the_joint(comm, folder):
    scene = scene_of(comm, folder, force(0.0, 0.0, -1000.0), *GUIDED, name="smooth")
    wear = {"law": "archard", "coefficient": 1e-9, "cycles": 10.0}
    scene = microslip.scene_of({**scene.model_dump(exclude_unset=True), "wear": wear}, scene.path)
    with microslip.build(scene, comm) as structure, pytest.raises(CaseError, match="joint 'joint' has pairs without friction"):
        WearingJoint(structure)


@pytest.mark.ranks(1)
def test_the_library_and_the_program_give_the_same_wear(program, shared_path):
    keys = {"coefficient": 1e-3, "cycles": 20.0, "area": {"joint": 1.0}, "jump": 0.1, "tolerance": 0.3}
    path, out = scene_with_wear(shared_path, one_mass(), [0.8], (0.5, 2.0), OF_MASS, **JENKINS), shared_path / "out"
    status, _, err = program("wear", path, "--out", out, "--set", "wear.cycles=20")
    assert (status, err) == (0, "")
    rows = on_root(COMM, lambda: list(csv.DictReader((out / "wear.csv").open())))
    jumps = []
    scene = microslip.scene_of({**microslip.read(path).model_dump(exclude_unset=True, exclude={"wear"})}, path)
    with microslip.build(scene, COMM) as structure:
        history = microslip.wear(structure, on_jump=jumps.append, **keys)
        with pytest.raises(CaseError, match="cycles"):
            microslip.wear(structure, coefficient=1e-3, cycles=-1.0)
        with pytest.raises(CaseError, match=r"\[wear\] is missing"):
            microslip.wear(structure)
    assert len(history.cycles) == len(rows) == len(jumps) + 1 > 2 and not history.failure
    for record, row in zip(history.records(), rows):
        assert [record[key] for key in ("depth_max_m", "energy_J", "amplitude")] == pytest.approx(
            [float(row[key]) for key in ("depth_max_m", "energy_J", "amplitude")], rel=1e-8
        )
    results = on_root(COMM, read_results, str(out / "results.h5"))
    np.testing.assert_allclose(results.wear.depth, history.depth, rtol=1e-8)
    np.testing.assert_allclose(results.wear.normal_force, history.normal_force, rtol=1e-8)
    lost = 100.0 * (1.0 - history.normal_force[-1].sum() / history.normal_force[0].sum())
    last_row = wear_table(results).split("<tr>")[-1]
    assert f"<td>{lost:.2f} %</td>" in last_row and f"{history.frequency[-1]:.7g} Hz" in last_row


@pytest.mark.study
def test_constant_loads_are_balanced_over_the_life_of_a_joint(comm, folder):
    """With [statics]: the joint carries the load, the pair with most wear loses pressure to the others, depth is worn energy."""
    scene = scene_of(comm, folder, force(0.0, 0.0, -1000.0), name="life")
    with microslip.build(scene, comm) as structure:
        history = microslip.wear(structure, coefficient=1e-12, cycles=5e5, level=30.0, jump=3e-8)
        area = np.where(structure.pairs.area > 0.0, structure.pairs.area, np.nan)
    assert not history.failure and history.cycles[-1] == 5e5 and len(history.cycles) > 2
    np.testing.assert_allclose(history.normal_force.sum(axis=1), 1000.0, rtol=1e-8)
    worn = history.depth[-1] > 0.0
    assert worn.any() and not worn.all()
    np.testing.assert_allclose(history.depth * area, 1e-12 * history.total, rtol=1e-9, atol=1e-30)
    k, change = history.depth[-1].argmax(), history.N0[-1] - history.N0[0]
    assert change[k] == change.min() < 0.0 < change[~worn].min()
