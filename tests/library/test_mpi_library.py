"""One structure, many responses: each equals that of a run and of a new structure, and nothing is built twice; on any ranks."""

import gc
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from bar_scene import N_PAIRS, write_bar
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes
from petsc4py import PETSc

import microslip
from microslip.library.respond import TABLES, Keys
from microslip.linear import factor as factors
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results import plots
from microslip.results.fields import read_fields, read_run
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import changed

COMM = MPI.COMM_WORLD
LEVELS = (10.0, 30.0)
NUMBERS = ("frequency", "response", "du", "p", "energy", "state", "error", "unknowns", "newton")
# MUMPS adds contributions of ranks in the order of their arrival; the last digits decide where Newton and GMRES stop
# within their tolerances: differences of 1e-5 of the response occur.  The bar's adjoint is solved to 1e-3.
ROUNDING, COMPARED = (0.0, NUMBERS) if COMM.size == 1 else (1e-4, NUMBERS[:-1])
OF_THE_BAR = 1e-3


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    return comm.bcast(tmp_path_factory.mktemp("library"))


@pytest.fixture(scope="module")
def scene(comm, folder):
    path = on_root(comm, lambda: write_bar(folder, modes=12, harmonics=3, samples=64))
    return changed(microslip.read(path), {"response": {"levels": LEVELS, "points": 12}})


@pytest.fixture(scope="module")
def structure(comm, scene):
    with microslip.build(scene, comm) as structure:
        yield structure


@pytest.fixture(scope="module")
def response(structure):
    return microslip.respond(structure)


def assert_equal(computed, wanted, tolerance=0.0):
    """Compare all points of two results, relative to the largest value of each quantity."""
    for a, b in zip(computed.levels, wanted.levels, strict=True):
        assert (a.level, a.status) == (b.level, b.status) and len(a.frequency) > 5
        for name in COMPARED:
            x, y = getattr(a, name), getattr(b, name)
            most = OF_THE_BAR if name == "error" and tolerance >= 1e-8 else tolerance
            assert x.shape == y.shape and np.abs(x - y).max() <= most * np.abs(y).max(), name


@pytest.mark.slow
def test_a_response_equals_the_results_of_a_run(comm, folder, scene, structure, response, monkeypatch):
    monkeypatch.setattr(plots, "PICTURES", plots.PICTURES[:1])  # drawing takes longer than the rest
    run(scene, comm, folder / "run", RunOptions(screen=False))
    response.save(folder / "saved")
    run_by_program, saved = (read_results(str(folder / name / "results.h5")) for name in ("run", "saved"))
    for results in (response.results, saved):
        assert_equal(results, run_by_program, ROUNDING)
        for name in ("title", "name", "method", "scene_text", "outputs", "versions"):
            assert getattr(results, name) == getattr(run_by_program, name)
        for name in ("mu", "N0", "node1", "frame"):
            assert np.array_equal(getattr(results.joint, name), getattr(run_by_program.joint, name))
        assert results.linear.response == pytest.approx(run_by_program.linear.response, rel=ROUNDING, abs=0.0)
    if comm.rank == 0:
        files, written = (sorted(path.name for path in (folder / name).iterdir() if path.is_file()) for name in ("run", "saved"))
        assert files == sorted([*written, "run.log"]) and "peak_response.vtkhdf" in files and "response.png" in files
        for name in ("modes.vtkhdf", "peak_response.vtkhdf"):
            with h5py.File(folder / "run" / name) as a, h5py.File(folder / "saved" / name) as b:
                assert np.array_equal(a["VTKHDF/Points"], b["VTKHDF/Points"])
    assert_fields_and_log(comm, folder, structure, response)


def assert_fields_and_log(comm, folder, structure, response):
    """Compare the fields of results.h5 on the mesh with the motion of the library, and check the log of the run.  Collective."""
    frequency, u = response.fields(response.levels[-1])

    def check():
        fields, run_record = read_fields(str(folder / "run" / "results.h5")), read_run(str(folder / "run" / "results.h5"))
        motion = fields.peaks[len(response.levels) - 1]
        np.testing.assert_allclose(motion.u, u, atol=max(1e-5, 10.0 * ROUNDING) * np.abs(u).max())
        assert response.results.levels[-1].frequency[motion.point] == pytest.approx(frequency, rel=1e-4)
        assert fields.output_node[0] in fields.mesh.numbers and np.array_equal(fields.mesh.points, structure.mesh.points)
        assert [stage.name for stage in run_record.stages][-1] == "fields for ParaView" and any(
            "contact pairs" in note for note in run_record.notes
        )
        assert not any("frequency_Hz" in note for note in run_record.notes)  # no lines of points
        assert (
            read_run(str(folder / "saved" / "results.h5")).stages == ()
            and read_fields(str(folder / "saved" / "results.h5")).peaks
        )

    on_root(comm, check)


CHANGES = {
    "friction": ({"friction": 0.048}, {}, {"friction": 0.048}),
    "preload": ({"preload": {"joint": 1.8e7}}, {}, {"preload": 1.8e7}),
    "levels": ({"levels": 33.0}, {"response": {"levels": [33.0]}}, {}),
    "harmonics": ({"harmonics": 5}, {"solver": {"harmonics": 5}}, {}),
    "method": ({"method": "rubin"}, {"solver": {"method": "rubin"}}, {}),
    "damping": ({"ratio": 0.02}, {"damping": {"ratio": 0.02}}, {}),
    "range": ({"frequencies": [1.0, 2.0]}, None, {}),
    "modes": ({"modes": 8}, {"solver": {"modes": 8}}, {}),
}
ON_RANKS, ALONE = ("friction",), pytest.mark.ranks(1)  # changes tested on several ranks, too


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name in ON_RANKS else ALONE) for name in CHANGES])
def test_a_changed_response_is_that_of_a_new_structure(comm, scene, structure, response, name):
    keys, tables, of_joint = CHANGES[name]
    if name == "range":
        band = [float(share * structure.modes.frequency[0]) for share in (0.95, 1.05)]
        keys, tables = {"frequencies": band}, {"response": {"frequencies": band, "mode": None, "span": None}}
    computed = microslip.respond(structure, **keys)
    new = changed(scene, tables, {"joint": of_joint})
    with microslip.build(new, comm) as fresh:
        wanted = microslip.respond(fresh)
    assert_equal(computed.results, wanted.results, max(ROUNDING, 1e-10))
    assert computed.prepared.scene == new and computed.results.scene_text == new.text
    assert not np.array_equal(computed["corner"].amplitude, response["corner"].amplitude)


def test_unchanged_parts_are_not_built_again(structure, response, monkeypatch):
    built, factorise, info, columns = [], factors.factorise, structure.linearised.factor.info, structure.statics.G_static
    monkeypatch.setattr(factors, "factorise", lambda *of, **how: built.append(of) or factorise(*of, **how))
    columns.require(np.arange(N_PAIRS))
    solves, batches = info["solves"], columns.batches
    for keys in ({"friction": 0.04}, {"preload": 1.8e7}, {"levels": [5.0, 7.0]}, {"harmonics": 2}, {"method": "adaptive"}):
        computed = microslip.respond(structure, **{"levels": 6.0, **keys})
        assert computed.prepared.structure.projected is structure.projected, keys
        assert computed.prepared.model.receptance_of(1).static.G_static is columns, keys
    assert (info["solves"], columns.batches, built) == (solves, batches, [])
    basis = microslip.respond(structure, method="craig-bampton", error_bars=False, levels=5.0).prepared.reduction
    n_built = len(built)
    computed = microslip.respond(structure, method="craig-bampton", error_bars=False, levels=5.0, friction=0.04, harmonics=2)
    assert len(built) == n_built > 0 and computed.prepared.reduction.structure.receptances is basis.structure.receptances


@pytest.mark.ranks(1)
def test_modes_are_selected_for_the_requested_response(structure):
    def modes_of(**keys):
        response = microslip.respond(structure, modes=None, accuracy=0.05, points=5, error_bars=False, **keys)
        return response.prepared.structure.projected

    weak, strong = modes_of(levels=1.0), modes_of(levels=np.array(20.0))
    assert modes_of(levels=1.0) is weak is not strong is modes_of(levels=20.0)
    assert modes_of(levels=20.0, friction=0.04) is not strong


@pytest.mark.ranks(1)
def test_the_note_on_the_modes_is_part_of_the_response(structure):
    assert microslip.respond(structure, points=5).notes == ()
    (note,) = microslip.respond(structure, modes=3, points=5).notes
    assert note.startswith("modes: 3, stated by [solver] modes")


@pytest.mark.slow
def test_friction_and_preload_of_each_pair(structure):
    mu, pressure = np.linspace(0.02, 0.08, N_PAIRS), np.linspace(1e7, 3e7, N_PAIRS)
    response = microslip.respond(structure, friction={"joint": mu}, preload=pressure, levels=30.0)
    assert np.array_equal(response.results.joint.mu, mu)
    assert response.results.joint.N0 == pytest.approx(pressure * structure.pairs.area)
    alike = microslip.respond(structure, friction=np.full(N_PAIRS, 0.05), preload=2.0e7, levels=30.0)  # those of the scene
    assert_equal(alike.results, microslip.respond(structure, levels=30.0).results, ROUNDING)


def test_every_rank_has_the_same_arrays(comm, response):
    for name in NUMBERS:
        assert np.array_equal(comm.bcast(response.array(name)), response.array(name), equal_nan=True)


def test_fields_agree_with_the_outputs(comm, structure, response):
    frequency, u = response.fields(30.0)
    peaks = response["corner"].peaks
    assert frequency == peaks[0][1] and peaks[1][1] == np.nanmax(response["corner"].amplitude[1])
    points = comm.bcast(None if structure.mesh is None else structure.mesh.points)
    corner = int(np.argmin(np.linalg.norm(points - [0.0, 0.0, 0.02], axis=1)))
    level = response.level(30.0)
    top = int(np.argmax(response["corner"].amplitude[1]))
    assert u.shape == (len(points), 3, 7) and u[corner, 0] == pytest.approx(level.response[top, 0], rel=1e-9, abs=1e-16)
    near, _ = response.fields(30.0, frequency=level.frequency[2] * (1.0 + 1e-9))
    assert near == level.frequency[2]


@pytest.mark.slow
def test_fields_and_forces_of_matrices(comm, folder):
    def write():
        (folder / "matrices").mkdir()
        return write_matrix_scene(folder / "matrices", scenes.spatial_mass(), [0.05, 0.1], (1.0, 1.6), outputs=[2], points=6)

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        mu, N0 = structure.pairs.mu, structure.pairs.N0
        response = microslip.respond(structure, friction=0.5 * mu, preload={"joint": N0}, error_bars=False)
        assert np.array_equal(response.results.joint.mu, 0.5 * mu) and np.array_equal(response.results.joint.N0, N0)
        _, u = response.fields(0.1)
        top = int(np.argmax(response["2"].amplitude[1]))
        assert u[2] == pytest.approx(response["2"].coefficients[1, top], rel=1e-9, abs=1e-12)
        in_groups = microslip.respond(structure, friction=0.5 * mu, error_bars=False, n_groups=min(2, comm.size))
        assert in_groups["2"].peaks[1] == pytest.approx(response["2"].peaks[1], rel=1e-6)


@pytest.mark.parametrize(
    "keys, message",
    [
        ({"level": 1.0}, "respond: unknown key 'level'; nearest is \"levels\""),
        ({"over": ({"key": "level", "range": (1.0, 2.0)},)}, "respond: over: .* microslip.peaks"),
        ({"levels": [-1.0]}, r"bar.toml: \[response\] levels = .*-1.0.*: expected a list of load levels in N"),
        ({"harmonics": 64}, r"bar.toml: \[solver\]: samples = 64 do not resolve harmonics = 64"),
        ({"method": "receptence"}, 'nearest is "receptance"'),
        ({"friction": {"joind": 0.1}}, "respond: friction of joint 'joind': there is no such joint; nearest is \"joint\""),
        ({"friction": [0.1, 0.2]}, "respond: friction of joint 'joint': a number of at least 0 is expected, or one for each"),
        ({"friction": -0.1}, "friction = -0.1: expected the friction coefficient"),
        ({"preload": np.full(N_PAIRS, np.nan)}, "preload of joint 'joint': a number of at least 0"),
        ({"modes": 136}, r"bar.toml: \[solver\] modes = 136: the structure has only 135"),
    ],
)
def test_invalid_keys_of_a_response_are_rejected(structure, keys, message):
    with pytest.raises(CaseError, match=message):
        microslip.respond(structure, **keys)


def test_every_key_of_a_response_has_a_type():
    of_curves = {key for table in TABLES.values() for key in table.model_fields if key != "over"}  # which peaks() takes
    assert set(Keys.__annotations__) == of_curves


def test_a_preload_on_a_gap_is_rejected(structure):
    open_pairs = replace(structure.pairs, N0=-structure.pairs.N0)
    with pytest.raises(CaseError, match="it has a gap, and an open pair carries no preload"):
        microslip.respond(replace(structure, pairs=open_pairs), preload=np.full(N_PAIRS, 1e6))


def test_pictures(comm, folder, response):
    path = folder / "pictures" / "states.png"
    response.plot(path, "states")
    assert Path(path).stat().st_size > 10_000
    figure = response.plot()
    if comm.rank == 0:
        assert figure._repr_png_().startswith(b"\x89PNG") and figure.axes[0].get_ylabel().startswith("amplitude [")
    assert len(response["corner"].plot().axes) == 2
    with pytest.raises(CaseError, match="there is no picture 'respnse' of these results; there are response, "):
        response.plot(path, "respnse")


def test_a_closed_structure_rejects_responses_that_need_its_factor(scene, comm):
    with microslip.build(scene, comm) as structure:
        response = microslip.respond(structure, levels=1e-3, points=5, error_bars=False)
    structure.close()
    assert len(response["corner"].amplitude) == 1
    for asks in (lambda: response.fields(1e-3), *(lambda k=k: microslip.respond(structure, **k) for k in ({}, {"modes": 8}))):
        with pytest.raises(CaseError, match="the structure is closed, and its factor is freed; build it again"):
            asks()


def test_a_closed_structure_frees_its_matrices(scene, comm):
    structure = microslip.build(scene, comm)
    matrices = structure.linearised.K_L, structure.linearised.system.K, structure.linearised.system.M
    assert all(matrices)
    structure.close()
    assert not any(matrices)


def test_an_unreferenced_structure_is_freed_by_the_next_build(scene, comm, capfd):
    dropped, open_structure = microslip.build(scene, comm), microslip.build(scene, comm)
    instances = [each.linearised.factor.solver.mumps for each in (dropped, open_structure)]
    del dropped
    gc.collect()
    assert all(mumps.is_open for mumps in instances)
    with microslip.build(scene, comm):
        assert [mumps.is_open for mumps in instances] == [False, True]
        PETSc.garbage_view(comm)
        assert "Total entries: 0" in capfd.readouterr().out or comm.rank > 0
    assert len(microslip.respond(open_structure, levels=1e-3, points=5, error_bars=False)["corner"].amplitude) == 1
    open_structure.close()
