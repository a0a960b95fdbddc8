"""Peaks over parameters of a scene, [[response.over]]: the closed form of one mass on a Jenkins element; on any number of ranks."""

import csv
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from discs import write_sector
from matrix_scenes import write_matrix_scene
from oracles import exact, scenes

import microslip
from microslip.continuation import peak_curves, ways_out
from microslip.continuation.maximum import Maximum
from microslip.continuation.peak_curves import PeakRequest, beginnings, beyond_the_end, peak_at
from microslip.continuation.peaks import FromSolution
from microslip.continuation.point_record import HELD
from microslip.continuation.point_solver import PointSolver
from microslip.harmonic.operating_point import LawParameter
from microslip.library.prepare import prepare
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results.read import read_results
from microslip.run import run
from microslip.scene.read import changed

LEVELS, C = (0.02, 5.0), 0.02
SPATIAL = Path(__file__).parents[2] / "jobs" / "spatial.toml"
OVER = """
[[response.over]]
key = "level"
range = [0.02, 1.0]
at = [0.4, 0.8]

[[response.over]]
key = "joints.joint.friction"
range = [1.0, 0.6]
level = 0.8
"""


def amplitude(level, limit=1.0):
    return exact.jenkins_peak(level, limit, C)


@pytest.fixture(scope="module")
def path(comm, tmp_path_factory):
    folder = comm.bcast(tmp_path_factory.mktemp("over"))

    def write():
        loads = [{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}]
        mass = {"K": [[1.0]], "M": [[1.0]], "C": np.array([[C]]), "pair_dofs": [[0, -1, -1, -1, -1, -1]]}
        system = scenes.make_system(
            "one mass", mass["M"], mass["K"], mass["pair_dofs"], mu=1.0, N0=1.0, k_t=1.0, k_n=0.0, C=mass["C"],
            loads=loads, output=[1.0], omega=(0.5, 2.0), levels={},
        )  # fmt: skip
        return write_matrix_scene(folder, system, [0.02], (0.5, 2.0), points=20, harmonics=1, samples=128, error_bars=False)

    return on_root(comm, write)


@pytest.fixture(scope="module")
def structure(comm, path):
    with microslip.build(microslip.read(path), comm) as built:
        yield built


@pytest.mark.ranks(1)
def test_a_peak_over_friction_is_followed_to_small_values(structure):
    """Steps that would lead to negative friction are shortened."""
    (curve,) = microslip.peaks(structure, {"joints.joint.friction": (3.0, 0.02)}, level=0.8)
    assert not curve.points.failure and curve.value[-1] == 0.02 and curve.value.min() >= 0.02
    slips = curve.points.state.any(axis=1)
    np.testing.assert_allclose(
        curve.amplitude[slips], [amplitude(0.8, limit) for limit in curve.value[slips]], rtol=30.0 / 128**2
    )


def test_a_peak_is_the_corner_of_the_curve_where_a_pair_begins_to_slip(comm, monkeypatch):
    """As on the curve; the top of the parabola through three solutions is 0.2 % lower.  There are no corners down to 0.08 N."""
    keys = {"error_bars": False, "harmonics": 3, "samples": 128}
    with microslip.build(microslip.read(SPATIAL), comm) as built:
        curves = microslip.respond(built, levels=[0.1], peaks=True, frequencies=[0.22, 0.24], points=20, **keys)
        peak = next(peak for peak in curves.peaks[0.1] if peak.output == 0)
        at_corners, correct = [], Maximum.correct
        monkeypatch.setattr(Maximum, "correct", lambda *args: at_corners.append(args) or correct(*args))
        (curve,) = microslip.peaks(built, {"level": (0.08, 0.1)}, frequencies=[0.13, 0.25], **keys)
    assert 0 < len(at_corners) <= len(curve.value)
    assert curve.value[-1] == 0.1 and not curve.points.failure
    assert curve.amplitude[-1] == pytest.approx(abs(peak.amplitude), rel=1e-5)
    assert 2.0 * np.pi * curve.frequency[-1] == pytest.approx(peak.omega, rel=1e-5)


@pytest.mark.ranks(1)
def test_a_peak_of_a_curve_is_the_end_of_the_higher_of_two_pieces(comm):
    """The mean position jumps where the pair begins to slip; the maximum of the piece with slip is 3e-4 lower."""
    keys = {"levels": [0.06], "error_bars": False, "harmonics": 3, "samples": 64}
    with microslip.build(microslip.read(SPATIAL), comm) as built:
        curves = microslip.respond(built, peaks=True, frequencies=[0.25, 0.28], points=20, **keys)
        stuck = microslip.respond(built, frequencies=[0.2636408, 0.26366], direction="down", points=5, **keys)
    (peak,) = (peak for peak in curves.peaks[0.06] if peak.output == 0)
    near_its_end = comm.bcast(np.hypot(*stuck.branches[0].points[-1].response[0, 1:3]) if comm.rank == 0 else None)
    assert abs(peak.amplitude) == pytest.approx(near_its_end, rel=1e-5) and peak.slipping == 0


@pytest.mark.ranks(1)
def test_a_peak_that_ends_early_reports_whether_the_maximum_exists(comm):
    """The maximum at 0.2634 Hz joins a minimum at 0.0858 N, where another maximum on the flat top of the curve remains."""
    response, solver = {"frequencies": [0.2, 0.3], "points": 60}, {"error_bars": False, "harmonics": 3, "samples": 128}
    with microslip.build(changed(microslip.read(SPATIAL), {"response": response, "solver": solver}), comm) as built:
        of = prepare(built).response
        request = PeakRequest("level", (0.03, 1.0), (), 0, 0.0)
        stuck = beginnings(of, request)[1]
        ends = [SimpleNamespace(parameters=(level, 2.0 * np.pi * hertz)) for level, hertz in ((0.0853, 0.2634), (0.078, 0.267))]
        ended, remaining = (beyond_the_end(of, request, stuck, end) for end in ends)
    assert "maxima only at 0.23" in ended and "last at 0.2634 Hz, has met a minimum" in ended
    assert "has a maximum near by, at 0.26" in remaining


@pytest.mark.ranks(1)
def test_the_peak_over_contact_stiffness_is_the_closed_form(structure):
    """The structure changes between Newton iterations."""
    (curve,) = microslip.peaks(structure, {"joints.joint.tangential_stiffness": (0.8, 1.5)}, level=0.8)
    assert not curve.points.failure and curve.value[-1] == 1.5
    of_values = [exact.jenkins_peak(0.8, 1.0, C, k_t) for k_t in curve.value]
    np.testing.assert_allclose(curve.amplitude, of_values, rtol=30.0 / 128**2)


@pytest.mark.ranks(1)
def test_the_peak_over_the_level_is_the_closed_form(structure):
    (curve,) = microslip.peaks(structure, {"level": LEVELS}, values=(0.4, 0.8))
    assert not curve.points.failure and curve.value[-1] == LEVELS[1] and len(curve.value) < 100
    sticks = ~curve.points.state.any(axis=1)
    assert sticks[0] and curve.per_level[sticks] == pytest.approx(abs(curve.linear.amplitude), rel=1e-9)
    slips = curve.value > 0.06  # below, the top is flat
    exact = np.array([amplitude(level) for level in curve.value[slips]])
    assert curve.amplitude[slips] == pytest.approx(exact, rel=30.0 / 128**2)
    for level in (0.4, 0.8):
        (i,) = np.flatnonzero(curve.value == level)
        assert curve.points.requested[i]
    assert curve.damping[0] == pytest.approx(0.5 * C / np.sqrt(2.0), rel=1e-3)
    assert curve.damping[-1] < 0.02 < 0.1 < curve.damping.max()


@pytest.mark.ranks(1)
def test_peaks_of_modes_with_little_motion_of_the_joint(comm, shared_path):
    """A mirror-symmetric chain with its joint in the middle: half of the modes do not deform it; all peaks are those of curves."""
    n, levels = 6, (0.5, 3.0)
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[2:4, 2:4] += 0.5 * np.array([[-1.0, 1.0], [1.0, -1.0]])
    first = np.eye(n)[0]
    system = scenes.make_system(
        "mirror", np.eye(n), K, [[2, -1, -1, 3, -1, -1]], mu=1.0, N0=1.0, k_t=0.5, k_n=0.0, zeta=0.01,
        loads=[{"vector": first, "harmonic": 1, "phase": 0.0}], output=first, omega=(0.3, 1.9), levels={},
    )  # fmt: skip

    def write():
        return write_matrix_scene(
            shared_path, system, levels, system["omega"], outputs=[0], points=100, harmonics=1, samples=128, error_bars=False
        )

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        curves = microslip.peaks(structure, {"level": (0.02, levels[1])}, values=levels)
        response = microslip.respond(structure, peaks=True)
    assert len(curves) == 5 and not any(curve.points.failure for curve in curves)
    for level, branch in zip(levels, response.branches):
        there = [curve.value == level for curve in curves]
        amplitudes = [float(curve.amplitude[at][0]) for curve, at in zip(curves, there)]
        assert [at.sum() for at in there] == [1] * 5
        assert amplitudes == pytest.approx([abs(peak.amplitude) for peak in branch.peaks], rel=1e-3)  # corners of 128 samples


@pytest.mark.ranks(1)
def test_a_peak_over_friction_begins_where_the_pair_slides(structure):
    """From far beyond first slip, down over the level and up over friction to the stuck pair."""
    (curve,) = microslip.peaks(structure, {"joints.joint.friction": (0.1, 0.6)}, level=0.8)
    assert not curve.points.failure and curve.value[-1] == 0.6
    slips = curve.points.state.any(axis=1) & (curve.amplitude > 1.2)
    exact_peaks = [amplitude(0.8, limit) for limit in curve.value[slips]]
    np.testing.assert_allclose(curve.amplitude[slips], exact_peaks, rtol=30.0 / 128**2)


@pytest.mark.ranks(1)
def test_a_requested_value_without_a_solution_is_noted_and_the_curve_goes_on(structure, monkeypatch):
    solve_at = PointSolver.solve_at

    def fails_at_one(solver, guess, *rest):
        solution, selected = solve_at(solver, guess, *rest)
        return replace(solution, failure="not here" if guess.parameter == 0.4 else solution.failure), selected

    monkeypatch.setattr(PointSolver, "solve_at", fails_at_one)
    (curve,) = microslip.peaks(structure, {"level": (0.2, 1.0)}, values=(0.4, 0.8))
    assert not curve.points.failure and curve.value[-1] == 1.0 and 0.8 in curve.value and 0.4 not in curve.value
    (note,) = filter(None, curve.points.notes)
    assert "no point before this one at the requested value 0.4" in note


@pytest.mark.study
@pytest.mark.ranks(1)
def test_the_peak_over_friction_begins_where_the_pair_slips(structure):
    """The peak depends on level / limit only."""
    (curve,) = microslip.peaks(structure, {"joints.joint.friction": (1.0, 0.6)}, level=0.8)
    assert curve.value[0] == 1.0 and curve.value[-1] == 0.6 and curve.points.state.all()
    assert curve.amplitude == pytest.approx([amplitude(0.8, limit) for limit in curve.value], rel=30.0 / 128**2)


@pytest.mark.ranks(1)
def test_a_run_writes_table_and_file(comm, path, program, shared_path):
    scene = shared_path / "scene.toml"
    folder = path.parent

    def write():
        text = path.read_text().replace("[response]", "[response]", 1)
        head, tail = text.split("[solver]")
        for name in ("K.mtx", "M.mtx", "C.mtx", "pairs.csv"):
            (shared_path / name).write_bytes((folder / name).read_bytes())
        scene.write_text(head + OVER + "[solver]" + tail)

    on_root(comm, write)
    status, out, err = program("run", scene, "--out", shared_path / "out")
    assert status == 0, out + err
    results = read_results(str(shared_path / "out" / "results.h5"))
    assert [curve.key for curve in results.over] == ["level", "joints.joint.friction"]
    rows = list(csv.DictReader((shared_path / "out" / "peaks_over.csv").open()))
    assert len(rows) == sum(len(curve.value) for curve in results.over)
    assert float(rows[0]["amplitude_m"]) == pytest.approx(results.over[0].amplitude[0], rel=1e-12)
    log = (shared_path / "out" / "run.log").read_text()
    assert (
        f"peak of {results.outputs[results.over[0].linear.output]} over level, 0.02 to 1 N" in log
        and "points at which a pair slips: " in log
    )


@pytest.mark.parametrize(
    "over, message",
    [
        pytest.param({"key": "levl", "range": (1.0, 2.0)}, 'nearest is "level"', id="no such number"),
        pytest.param({"key": "joints.joint.frction", "range": (1.0, 2.0)}, 'nearest is "joints.joint.friction"', id="of a joint"),
        pytest.param({"key": "level", "range": (2.0, 2.0)}, "the same number twice", id="no range"),
        pytest.param({"key": "level", "range": (0.0, 2.0)}, "at 0, where nothing moves", id="from nothing"),
        pytest.param({"key": "level", "range": (1.0, 2.0), "at": (3.0,)}, "at holds 3, outside range", id="outside"),
        pytest.param({"key": "level", "range": (1.0, 2.0), "level": 3.0}, "leave the key level out", id="level twice"),
        pytest.param({"key": "joints.joint.normal_stiffness", "range": (0.0, 2.0)}, "at 0, where nothing", id="no stiffness"),
        pytest.param(
            {"key": "level", "range": (1.0, 2.0), "output": "none"}, "there is no output 'none'.*; there are", id="no output"
        ),
        pytest.param({"key": "damping.ratio", "range": (0.01, 0.02)}, "is not the only damping", id="no ratio"),
        pytest.param({"key": "damping", "range": (0.0, 2.0)}, "at 0, where nothing", id="no damping"),
    ],
)
def test_a_parameter_that_cannot_be_followed_is_rejected(path, over, message):
    with pytest.raises(CaseError, match=message):
        changed(microslip.read(path), {"response": {"over": (over,)}})


@pytest.mark.parametrize("over", ["level", {"level": 3.0}, {"level": (1.0, 2.0, 3.0)}])
def test_an_invalid_range_is_rejected(structure, over):
    with pytest.raises(CaseError, match="peaks: over = .*: expected a mapping of keys to two ends"):
        microslip.peaks(structure, over)


def test_a_range_without_peak_is_rejected(structure):
    with pytest.raises(CaseError, match="has no peak between"):
        microslip.peaks(structure, {"level": LEVELS}, frequencies=(0.01, 0.05))


def test_values_invalid_for_the_law_are_rejected(structure):
    with pytest.raises(CaseError, match="has a gap; vary joints.joint.preload"):
        microslip.peaks(structure, {"joints.joint.gap": (1.0, 2.0)}, level=0.8)
    negative = PeakRequest(LawParameter("mu", np.array([0]), np.array([1.0])), (2.0, -1.0), (), 0, 0.8)
    with pytest.raises(CaseError, match="-1 is no value that the law of these pairs has: .*mu"):
        beginnings(prepare(structure, structure.scene).response, negative)


@pytest.mark.ranks(1)
def test_the_peak_of_a_mass_below_its_stop_is_the_closed_form(comm):
    """The linear response, with the stop closed, has twice the frequency."""
    scene = microslip.read(Path(__file__).parents[2] / "jobs" / "stop.toml")
    with microslip.build(scene, comm) as built:
        keys = {"frequencies": (0.12, 0.4), "points": 20, "error_bars": False}
        (curve,) = microslip.peaks(built, {"level": (0.02, 0.04)}, **keys)
    zeta, touches = 0.03, 0.5 * 0.06 * np.sqrt(1.0 - 0.03**2)  # m times c omega: the level from which the mass strikes
    free = curve.value < touches
    assert free.any() and not free.all() and not curve.points.failure
    assert curve.amplitude[free] == pytest.approx(curve.value[free] / (2.0 * zeta * np.sqrt(1.0 - zeta**2)), rel=1e-6)
    assert (curve.amplitude[~free] < curve.value[~free] * curve.amplitude[0] / curve.value[0]).all()


def test_the_peak_over_damping_of_one_mass(structure):
    """The factor of C is the factor of all damping here: the closed form for the sticking and the slipping mass."""
    (curve,) = microslip.peaks(structure, {"damping": (4.0, 0.5)}, level=0.05, values=(2.0,))
    assert curve.unit == "times the scene's values" and curve.value[0] == 4.0 and curve.value[-1] == 0.5 and 2.0 in curve.value
    sticks, c = ~curve.points.state.any(axis=1), C * curve.value
    assert sticks.any() and not sticks.all() and not curve.points.failure
    assert curve.amplitude[sticks] == pytest.approx((0.05 / (c * np.sqrt(2.0 - 0.25 * c**2)))[sticks], rel=1e-9)
    slips = curve.amplitude > 1.2
    assert curve.amplitude[slips] == pytest.approx([exact.jenkins_peak(0.05, 1.0, of) for of in c[slips]], rel=30.0 / 128**2)


def test_the_peak_over_damping_includes_structural_damping(comm, shared_path):
    """While the mass sticks, |a| is the maximum of level / |2 - omega^2 + i factor (2 zeta sqrt(2) omega + eta)|."""
    zeta, eta = 0.01, 0.04
    loads = [{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}]
    system = scenes.make_system(
        "one mass", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]], mu=1.0, N0=1.0, k_t=1.0, k_n=0.0, zeta=zeta,
        loads=loads, output=[1.0], omega=(0.5, 2.0), levels={},
    )  # fmt: skip

    def write():
        path = write_matrix_scene(shared_path, system, [0.02], (0.5, 2.0), harmonics=1, samples=128, error_bars=False)
        path.write_text(path.read_text().replace(f"ratio = {zeta}", f"ratio = {zeta}\nstructural = {eta}"))
        return path

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        (curve,) = microslip.peaks(structure, {"damping": (4.0, 0.5)}, level=0.02)
    omega = 2.0 * np.pi * curve.frequency
    lost = curve.value * (2.0 * zeta * np.sqrt(2.0) * omega + eta)
    assert curve.value[-1] == 0.5 and not (curve.points.failure or curve.points.state.any())
    np.testing.assert_allclose(curve.amplitude, 0.02 / np.hypot(2.0 - omega**2, lost), rtol=1e-9)
    assert 2.0 * (2.0 - omega**2) * omega == pytest.approx(2.0 * np.sqrt(2.0) * zeta * curve.value * lost, abs=3e-5)


@pytest.mark.study
def test_the_peak_over_the_damping_ratio_of_all_modes(comm, shared_path):
    """It ends at the peaks of a scene with that ratio, including error bars."""
    level, curves = 3.0, []
    for ratio, over in ((0.004, {"damping.ratio": (0.004, 0.006)}), (0.006, {"level": (0.5 * level, level)})):
        system = scenes.chain() | {"zeta": ratio}
        path = on_root(comm, lambda of=system: write_matrix_scene(shared_path, of, [level], (400.0, 800.0), outputs=[6], modes=6))
        with microslip.build(microslip.read(path), comm) as structure:
            curves.append(microslip.peaks(structure, over, **({} if "level" in over else {"level": level})))
    assert curves[0][0].points.state[-1].any()
    for k in (0, 2):  # the peak between them ends where it joins the first
        curve, other = (of_scene[k] for of_scene in curves)
        assert not curve.points.failure and curve.value[-1] == pytest.approx(0.006)
        for name in ("amplitude", "frequency"):
            assert getattr(curve, name)[-1] == pytest.approx(getattr(other, name)[-1], rel=1e-5)
        assert curve.error[-1] == pytest.approx(other.error[-1], rel=1e-3)


def test_without_damping_the_peak_of_the_stuck_structure_is_infinite(comm, shared_path):

    def write():
        loads = [{"vector": np.array([1.0, 0.0]), "harmonic": 1, "phase": 0.0}]
        system = scenes.make_system(
            "two masses", np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]]), [[0, -1, -1, -1, -1, -1]], mu=1.0, N0=1.0, k_t=1.0,
            k_n=0.0, C=np.zeros((2, 2)), loads=loads, output=[1.0, 0.0], omega=(0.5, 3.0), levels={},
        )  # fmt: skip
        return write_matrix_scene(shared_path, system, [0.5], (0.5, 3.0), points=20, harmonics=1, samples=128, error_bars=False)

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        curves = microslip.peaks(structure, {"level": (0.5, 1.0)})
    assert curves and all("the peak is infinite while all pairs stick" in curve.points.failure for curve in curves)


@pytest.mark.ranks(1)
def test_a_peak_begins_on_the_curve_where_no_peak_over_the_level_leads_there(comm, shared_path, monkeypatch):
    n, level = 3, 5.0
    first = np.eye(n)[0]
    system = scenes.make_system(
        "chain", np.eye(n), 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1), [[0, -1, -1, -1, -1, -1]], mu=1.0, N0=1.0, k_t=1.0,
        k_n=0.0, zeta=0.03, loads=[{"vector": first, "harmonic": 1, "phase": 0.0}], output=first, omega=(0.3, 2.5), levels={},
    )  # fmt: skip

    def write():
        keys = {"outputs": [0], "points": 60, "harmonics": 1, "samples": 128, "error_bars": False}
        return write_matrix_scene(shared_path, system, [level], system["omega"], **keys)

    follow_peak = peak_curves.follow_peak

    def without_lead(equation, path, *rest, **keys):
        branch = follow_peak(equation, path, *rest, **keys)
        return replace(branch, failure="lost") if path.sweep.stop == level else branch

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        response = prepare(structure).response
        led, led_one = microslip.peaks(structure, {"level": (level, 4.0)}), peak_at(response, 0, level)
        monkeypatch.setattr(peak_curves, "follow_peak", without_lead)
        begun, one_begun = microslip.peaks(structure, {"level": (level, 4.0)}), peak_at(response, 0, level)
    for each in (led_one, one_begun):
        assert each.there is not None and len(each.curve.branch.points) == 1
    assert one_begun.there.parameter == pytest.approx(led_one.there.parameter, rel=1e-4)
    sizes = [np.hypot(*each.curve.branch.points[0].response[0, 1:3]) for each in (led_one, one_begun)]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-4)
    assert len(led) == len(begun) == n and not any(curve.points.failure for curve in (*led, *begun))
    for one, other in zip(led, begun):
        for place in (0, -1):
            assert one.value[place] == other.value[place]
            assert other.frequency[place] == pytest.approx(one.frequency[place], rel=1e-4)
            assert other.amplitude[place] == pytest.approx(one.amplitude[place], rel=1e-4)


@pytest.mark.ranks(1)
def test_a_peak_that_is_not_near_is_searched_for_without_homotopies(structure, monkeypatch):
    response = prepare(structure).response
    near = peak_at(response, 0, 0.8)
    assert near.there is not None
    monkeypatch.setattr(ways_out, "LevelHomotopy", None)
    monkeypatch.setattr(ways_out, "DampingHomotopy", None)
    there = peak_at(response, 0, 0.8, replace(near, there=replace(near.there, U=0.0 * near.there.U))).there
    assert there is not None and there.parameters == pytest.approx(near.there.parameters, rel=1e-9)


@pytest.mark.ranks(1)
def test_a_peak_in_gross_slip_begins_with_the_mean_slip_held(comm, shared_path, monkeypatch):
    """For a body on its joint alone, where Newton's method fails without it, as along the curve to the peak."""
    n, level, first = 3, 4.0, PointSolver.first
    system = scenes.make_system(
        "two bodies", np.eye(n), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 1.0]]), [[1, -1, -1, 0, -1, -1]], mu=1.0,
        N0=1.0, k_t=0.5, k_n=0.0, zeta=0.05, loads=[{"vector": np.eye(n)[2], "harmonic": 1, "phase": 0.0}], output=np.eye(n)[2],
        omega=(1.25, 2.2), levels={},
    )  # fmt: skip

    def write():
        keys = {"outputs": [2], "points": 60, "harmonics": 1, "samples": 128, "error_bars": False}
        return write_matrix_scene(shared_path, system, [level], system["omega"], **keys)

    def drifting(solver):
        solution, selected = first(solver)
        drifts = solver.equation.held is None and isinstance(solver.problem.curve, FromSolution)
        return replace(solution, failure="drifts") if drifts else solution, selected

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        response = prepare(structure).response
        free = peak_at(response, 0, level)
        monkeypatch.setattr(PointSolver, "first", drifting)
        monkeypatch.setattr(ways_out, "LevelHomotopy", None)
        held = peak_at(response, 0, level)
    if comm.rank == 0:
        (of_free,), (of_held,) = free.curve.branch.points, held.curve.branch.points
        assert (of_free.notes, of_held.notes) == ((), (HELD,))
        assert of_held.omega == pytest.approx(of_free.omega, rel=1e-3)


SECTOR = """[damping]
ratio = 0.01
[response]
levels = [5.0]
frequencies = [1600.0, 1800.0]
points = 4
[solver]
modes = 12
harmonics = 1
error_bars = false
samples = 64
"""


@pytest.mark.ranks(1)
def test_peaks_of_a_whole_disc_are_those_of_its_sector_in_every_sector(comm, shared_path):
    """Of the outputs of all sectors, which have names with the number of the sector."""

    def peak(output, **wave):
        write = partial(write_sector, shared_path, 3, SECTOR, friction=0.05, name="disc", wave={"engine_order": 1, **wave})
        with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
            with pytest.raises(CaseError, match="there is no output 'tip 3'; nearest is \"tip"):
                microslip.peaks(structure, {"level": (5.0, 10.0)}, output="tip 3")
            return microslip.peaks(structure, {"level": (5.0, 10.0)}, output=output)[0]

    one, first, last = peak("tip"), peak("tip", whole=True), peak("tip 2", whole=True)
    assert (first.linear.output, last.linear.output) == (0, 2) and not one.points.failure
    for whole in (first, last):
        assert whole.points.response.shape[1] == 3 and not whole.points.failure
        for end in (0, -1):
            assert whole.value[end] == pytest.approx(one.value[end], rel=1e-9)
            assert whole.amplitude[end] == pytest.approx(one.amplitude[end], rel=1e-5)
            assert whole.points.frequency[end] == pytest.approx(one.points.frequency[end], rel=1e-6)


@pytest.mark.ranks(1)
def test_a_run_of_a_whole_disc_logs_peaks_of_the_outputs_of_all_sectors(comm, shared_path):
    text = SECTOR.replace("points = 4", "points = 4\npeaks = true\nfields = false")
    path = write_sector(shared_path, 3, text, friction=0.05, name="disc", wave={"engine_order": 1, "whole": True})
    run(microslip.read(path), comm, shared_path / "out")
    log = (shared_path / "out" / "run.log").read_text()
    assert all(log.count(f"  peak of tip {sector}: ") == 1 for sector in range(3))
