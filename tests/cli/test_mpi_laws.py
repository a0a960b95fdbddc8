"""Scenes with rough surfaces, Iwan joints and several laws, from the file to results, on any number of ranks."""

import csv

import numpy as np
import pytest
from bar_scene import SCENE as BAR
from bar_scene import write_bar
from lap_scene import SCENE, write_mesh
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI
from oracles import scenes

import microslip
from microslip.library.respond import pairs_with
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results.read import read_results

OMEGAS = [540.0, 560.0]
ROUGH = 'law = "rough"\nfriction = 0.3\npreload = 1e6\nroughness_height = 1e-5'
IWAN = 'law = "iwan"\nslip_force = 100.0\ntangential_stiffness = 1e12\nnormal_stiffness = 1e12\nchi = -0.5\nbeta = 0.3'
OF_LAP = SCENE[SCENE.index("friction = ") : SCENE.index("[[loads]]")]


def write_chain(folder, **solver):
    """Write the chain whose first pair is rough and whose second is an Iwan element, each in a separate joint."""
    path = write_matrix_scene(
        folder, scenes.chain(), [30.0], (500.0, 640.0), at=OMEGAS, outputs=[6], points=15, harmonics=3, samples=64, **solver
    )
    header, first, second = (folder / "pairs.csv").read_text().split()
    for name, pair in (("first", first), ("second", second)):
        (folder / f"{name}.csv").write_text(f"{header}\n{pair}\n")
    joints = [
        f'[[joints]]\nname = "{name}"\npairs = "{name}.csv"\n{keys}\n'
        for name, keys in (("first", 'law = "rough"\nexponent = 3.0'), ("second", 'law = "iwan"\nchi = -0.6\nbeta = 0.5'))
    ]
    text = path.read_text()
    old = text[text.index("[[joints]]") : text.index("[[loads]]")]
    path.write_text(text.replace(old, "".join(joints)))
    return path


@pytest.mark.ranks(1, 2, 3)
def test_two_laws_in_one_scene_agree_on_any_number_of_ranks(comm, shared_path):
    path = on_root(comm, write_chain, shared_path)
    (on_all_ranks,) = branches_of(path, comm)
    points = comm.bcast([(p.omega, p.response, p.energy, p.p, p.state) for p in requested(on_all_ranks)])
    folder = shared_path / f"alone{comm.rank}"
    folder.mkdir()
    (on_one_rank,) = branches_of(write_chain(folder), MPI.COMM_SELF)
    assert len(points) == 2
    for (omega, response, energy, p, state), keys in zip(points, requested(on_one_rank)):
        assert omega == keys.omega and np.array_equal(state, keys.state)
        assert np.allclose(response, keys.response, atol=1e-7 * np.abs(keys.response).max())
        assert np.all(energy > 0.0) and np.allclose(energy, keys.energy, rtol=1e-5)
        assert p.any(axis=(1, 2)).all()


@pytest.mark.ranks(2, 3)
def test_the_program_runs_a_mesh_with_each_law(comm, shared_path, program):
    on_root(comm, write_mesh, shared_path / "lap.msh")
    peaks = {}
    for name, keys in (("rough", ROUGH), ("iwan", IWAN)):
        text = SCENE.replace(OF_LAP, keys + "\n")
        for old, new in (("[10.0, 1000.0]", "[80.0, 110.0]"), ("[1.0]", "[0.3]"), ("points = 20", "points = 4")):
            text = text.replace(old, new)
        path = on_root(comm, lambda text=text, name=name: write(shared_path / f"{name}.toml", text))
        status, out, err = program("run", path, "--out", shared_path / name)
        assert (status, err) == (0, "")
        results = read_results(str(shared_path / name / "results.h5"))
        (level,) = results.levels
        joint = results.joint
        assert level.status == "complete" and joint.law_names == (name,) and not joint.laws.any()
        assert set(joint.law_columns) == (
            {"exponent", "sliders"} if name == "rough" else {"slip_force", "chi", "beta", "sliders"}
        )
        peaks[name] = np.abs(level.response[:, 0, 1:3]).max()
        assert np.nanmax(level.error[:, 0].sum(axis=-1)) < 0.2 * peaks[name] and level.energy.sum(axis=1).max() > 0.0
        if name == "rough":
            assert np.allclose(joint.k_n, 1e6 / 1e-5 * joint.area) and np.allclose(joint.N0, 1e6 * joint.area)
        else:
            assert joint.law_columns["slip_force"].sum() == pytest.approx(100.0) and np.isnan(joint.mu).all()
    assert peaks["rough"] != peaks["iwan"]


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_time_integration_verifies_two_laws(comm, shared_path, program):
    path = on_root(comm, write_chain, shared_path)
    given = ("--steps", "32", "--at", "89.0", "--harmonics", "5")
    status, _, err = program("verify", path, "--out", shared_path / "out", *given)
    assert (status, err) == (0, "")
    with open(shared_path / "out" / "verify.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    assert float(row["difference_with_phase"]) < 2e-3 + 2.0 * float(row["own_error"]) and float(row["own_error"]) < 5e-2
    assert abs(float(row["energy_closure"])) < 1e-2


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.ranks(1)
def test_different_parameters_by_direction_on_a_mesh(comm, shared_path):
    """With different stiffness and friction by direction the motion differs from that with either value for both directions."""
    keys = 'friction = [0.05, 0.03]\ntangential_stiffness = [1.0e12, 4.0e11]\nfriction_limit = "separate"'
    plain = "friction = 0.05\ntangential_stiffness = 1.0e12\n"
    assert plain in BAR
    path = on_root(comm, write_bar, shared_path)
    text = comm.bcast(path.read_text() if comm.rank == 0 else None)
    on_root(comm, lambda: write(path, text.replace(plain, keys + "\n") + "modes = 8\n"))
    with microslip.build(microslip.read(path), comm) as structure:
        pairs = structure.pairs
        assert np.allclose(pairs.law_columns["k_ty"], 0.4 * pairs.k_t) and np.all(pairs.law_columns["mu_y"] == 0.03)
        assert np.allclose(pairs.law.stiffness[:, 1], 0.4 * pairs.k_t)
        response = microslip.respond(structure, levels=[30.0])
        assert response.results.levels[0].status == "complete"
        with pytest.raises(CaseError, match="it has a coefficient for each direction"):
            microslip.respond(structure, friction=0.1)


@pytest.mark.ranks(1, 2)
def test_parameters_that_a_law_does_not_have_are_rejected(comm, shared_path):
    on_root(comm, write_mesh, shared_path / "lap.msh")
    path = on_root(comm, lambda: write(shared_path / "lap.toml", SCENE.replace(OF_LAP, ROUGH + "\n")))
    with microslip.build(microslip.read(path), comm) as structure:
        with pytest.raises(CaseError, match="preload of joint 'lap': its law, \"rough\", has none, or its stiffness follows"):
            microslip.respond(structure, preload=2e6)
        slippery = structure.pairs.law.take([0]), pairs_with(structure.pairs, {"friction": 0.1}).law.take([0])
        assert [law.mu[0] for law in slippery] == [0.3, 0.1] and slippery[0].k_t == slippery[1].k_t
