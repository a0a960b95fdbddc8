"""microslip.sweep: peaks of samples compared with a closed form and with separate structures; on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
from bar_scene import write_bar
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import exact, scenes

import microslip
from microslip.continuation.peak_at import _Lost, _Search
from microslip.library import sample_peaks
from microslip.library.sample_peaks import DONE, FAILED, SamplePeaks, _Problem, affine_weights
from microslip.library.sensitivities import unit_of_key
from microslip.library.sweep import SMOOTH
from microslip.library.varied import Varied
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root

pytestmark = pytest.mark.ranks(1, 2)

C = 0.02
FRICTION, STIFFNESS = "joints.joint.friction", "joints.joint.tangential_stiffness"


def one_mass(folder, k_t=1.0, mu=1.0, highest=4.0, samples=128):
    """Write m = k = k_t = mu N = 1, c = 0.02, and return its path.  Local."""
    folder.mkdir(exist_ok=True)
    loads = [{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}]
    system = scenes.make_system(
        "one mass", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]], mu=mu, N0=1.0, k_t=k_t, k_n=0.0, C=np.array([[C]]),
        loads=loads, output=[1.0], omega=(0.5, 2.0), levels={},
    )  # fmt: skip
    return write_matrix_scene(folder, system, [0.8], (0.5, highest), points=30, harmonics=1, samples=samples, error_bars=False)


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    return comm.bcast(tmp_path_factory.mktemp("sweep"))


@pytest.fixture(scope="module")
def mass(comm, folder):
    with microslip.build(microslip.read(on_root(comm, one_mass, folder / "mass")), comm) as built:
        yield built


@pytest.fixture(scope="module")
def bar(comm, folder):
    return on_root(comm, lambda: write_bar(folder, modes=8, harmonics=3, samples=64, error_bars=False))


def test_peaks_over_friction_and_level_have_their_closed_form(mass):
    table = microslip.sweep(mass, {FRICTION: [0.5, 0.8, 1.2], "level": [0.8, 1.0]})
    assert table.is_done.all() and len(table) == 6 and table.on_axes("amplitude").shape == (3, 2)
    exactly = [exact.jenkins_peak(level, limit, C) for limit, level in zip(table[FRICTION], table["level"])]
    assert table.amplitude == pytest.approx(exactly, rel=30.0 / 128**2)
    assert table.nominal.amplitude == pytest.approx(exact.jenkins_peak(0.8, 1.0, C), rel=30.0 / 128**2)
    loss = [exact.jenkins_harmonic(X, 1.0, limit)[2] for X, limit in zip(table.amplitude, table[FRICTION])]
    assert table.friction_J == pytest.approx(loss, rel=1e-3)


def test_a_scale_of_the_load_equals_another_level(mass):
    table = microslip.sweep(mass, {"loads.1.scale": [0.5, 1.25]})
    exactly = [exact.jenkins_peak(0.8 * scale, 1.0, C) for scale in (0.5, 1.25)]
    assert table.amplitude == pytest.approx(exactly, rel=30.0 / 128**2)


@pytest.mark.ranks(1)
def test_a_stuck_peak_has_the_width_and_damping_of_its_mode(mass):
    table = microslip.sweep(mass, {"level": [0.01, 0.02]})
    zeta = 0.5 * C / np.sqrt(2.0)
    assert table.damping == pytest.approx([zeta] * 2, rel=1e-3)
    assert 2.0 * np.pi * table.width == pytest.approx([C] * 2, rel=2e-4)
    assert 2.0 * np.pi * table.frequency == pytest.approx([np.sqrt(2.0)] * 2, rel=1e-3)
    assert (table.friction_J == 0.0).all() and (table.slipping == 0).all()


def test_a_structure_without_joints_has_its_linear_peaks(comm, folder):
    def without_joint():
        path = one_mass(folder / "no joint")
        path.write_text(
            path.read_text().replace('[[joints]]\nname = "joint"\npairs = "pairs.csv"\nfriction_limit = "circle"\n', "")
        )
        return path

    with microslip.build(microslip.read(on_root(comm, without_joint)), comm) as structure:
        table = microslip.sweep(structure, {"level": [0.5, 3.0]}, curves=True)
    zeta = 0.5 * C
    assert table.amplitude == pytest.approx([level / (2.0 * zeta * np.sqrt(1.0 - zeta**2)) for level in (0.5, 3.0)], rel=1e-6)
    assert 2.0 * np.pi * table.frequency == pytest.approx([np.sqrt(1.0 - 2.0 * zeta**2)] * 2, rel=1e-5)
    assert 2.0 * np.pi * table.width == pytest.approx([C] * 2, rel=1e-3)
    assert table.damping_J == pytest.approx(np.pi * C * table.amplitude**2, rel=3e-4) and (table.friction_J == 0.0).all()
    tops = np.nanmax(table.curves, axis=1)  # at the frequencies of the grid
    assert tops[1] == pytest.approx(6.0 * tops[0]) and (tops < table.amplitude).all() and tops[0] > 0.5 * table.amplitude[0]


@pytest.mark.ranks(1)
def test_updated_contact_stiffness_equals_another_structure(comm, folder, mass):
    """Factors from 1/100 to 10 with all modes, so that the update is exact."""
    values = [0.01, 0.5, 10.0]
    table = microslip.sweep(mass, {STIFFNESS: values})
    for value, sample in zip(values, table.samples):
        path = on_root(comm, one_mass, folder / f"k_t {value}", value)
        with microslip.build(microslip.read(path), comm) as other:
            nominal = microslip.sweep(other, {FRICTION: [1.0]}).nominal
        assert sample.amplitude == pytest.approx(nominal.amplitude, rel=1e-8)
        assert sample.frequency == pytest.approx(nominal.frequency, rel=1e-8)
        assert not sample.is_followed


@pytest.mark.study
def test_contact_stiffness_with_truncated_modes_is_that_of_separate_structures(comm, bar):
    """Factors of 100 and 1/100; with the modes of the scene the peaks differ by the truncation error."""
    finer = ["response.points=30", "response.levels=[10.0]", "solver.samples=128"]
    scene = microslip.read(bar, finer)
    values = [factor * scene.joints[0].tangential_stiffness for factor in (0.01, 100.0)]
    key, levels = "joints.joint.tangential_stiffness", [10.0]
    with microslip.build(scene, comm) as structure:
        table = microslip.sweep(structure, {key: values, "level": levels})
        with_modes_of_scene = microslip.sweep(structure, {key: values[1:], "level": levels}, keep_modes=True)
    for i, value in enumerate(values):
        with microslip.build(microslip.read(bar, [*finer, f"{key}={value!r}"]), comm) as other:
            separate = microslip.sweep(other, {"level": levels})
        for name in ("amplitude", "frequency", "width"):
            here = getattr(table, name)[i : i + 1]
            np.testing.assert_allclose(here, getattr(separate, name), rtol=1e-6 if name == "width" else 1e-8)
    assert table.slipping.any() and 1e-8 < abs(with_modes_of_scene.amplitude[0] / table.amplitude[1] - 1.0) < 1e-2


def test_factors_of_gaps_and_preloads_change_the_pairs_that_have_them(mass):
    """The gap of a pair without a gap is no parameter, and does not change its preload."""
    with pytest.raises(CaseError, match="joints.joint.gap: no pair of the joint has a gap; vary joints.joint.preload"):
        microslip.sweep(mass, {"joints.joint.gap": [0.5]})
    pressed, rubbed = (microslip.sweep(mass, {key: [0.8]}) for key in ("joints.joint.preload", FRICTION))
    assert pressed.amplitude == pytest.approx(rubbed.amplitude, rel=1e-9)


@pytest.mark.ranks(1)
def test_a_distant_sample_is_reached_through_other_samples(mass, monkeypatch):
    table = microslip.sweep(mass, {STIFFNESS: [0.01, 10.0]})
    monkeypatch.setattr(sample_peaks, "MOST_BETWEEN", 1)
    directly = microslip.sweep(mass, {STIFFNESS: [0.01, 10.0]})
    assert any(sample.is_followed for sample in directly.samples) and not any(sample.is_followed for sample in table.samples)
    assert table.amplitude == pytest.approx(directly.amplitude, rel=1e-8)


@pytest.mark.ranks(1)
def test_a_solution_whose_mean_slip_has_drifted_is_no_peak(bar, comm, monkeypatch):
    """Where all pairs slip without springs, Newton's method may converge to any mean."""
    values, peak = [], _Search.peak

    def with_drift(search):
        here, corrector = peak(search), search.solver.workspace.corrector(search.equation, search.solver.resolution)
        correct = corrector.correct

        def drifts(system, guess, *more):
            solution = correct(system, guess, *more)
            U = solution.iterate.U.copy()
            U[:, 0, 0] = 1e4 * comm.allreduce(np.abs(U).max(initial=0.0), op=MPI.MAX)
            return replace(solution, iterate=replace(solution.iterate, U=U))

        with monkeypatch.context() as patched:
            patched.setattr(corrector, "correct", drifts)
            with pytest.raises(_Lost, match="lies elsewhere"):
                search.at(here.iterate, 0.0, here.iterate)
        values.append(here)
        return here

    monkeypatch.setattr(_Search, "peak", with_drift)
    with microslip.build(microslip.read(bar), comm) as structure:
        microslip.sweep(structure, {FRICTION: [0.06]})
    assert values


@pytest.mark.ranks(1)
@pytest.mark.parametrize("mu", [1.0, pytest.param(1e3, marks=pytest.mark.study)])
def test_the_update_is_accurate_for_factors_from_1_100_to_100(comm, folder, mu):
    def of(k_t):
        path = on_root(comm, one_mass, folder / f"mu {mu} k_t {k_t}", k_t, mu, 12.0)
        return microslip.build(microslip.read(path), comm)

    values = [0.01, 100.0]
    with of(1.0) as structure:
        table = microslip.sweep(structure, {STIFFNESS: values})
    for value, sample in zip(values, table.samples):
        with of(value) as other:
            separate = microslip.sweep(other, {FRICTION: [1.0]}).nominal
        assert sample.amplitude == pytest.approx(separate.amplitude, rel=1e-8)


@pytest.mark.ranks(1)
def test_samples_are_those_of_separate_structures(comm, bar):
    """Friction, preload, level, damping and harmonics on the same structure; density by another structure."""
    samples = {
        "joints.joint.friction": [0.05, 0.045],
        "joints.joint.preload": [1.8e7, 2.0e7],
        "level": [35.0, 34.0],
        "damping.ratio": [0.01, 0.011],
        "solver.harmonics": [3, 5],
        "materials.steel.density": [7800.0, 8000.0],
    }
    with microslip.build(microslip.read(bar), comm) as structure:
        table = microslip.sweep(structure, samples, paired=True)
    assert table.is_done.all() and (table.slipping + table.open > 0).all()
    for i in range(2):
        settings = [f"{key}={values[i]}" for key, values in samples.items() if key != "level"]
        scene = microslip.read(bar, [*settings, f"response.levels=[{samples['level'][i]}]"])
        with microslip.build(scene, comm) as structure:
            nominal = microslip.sweep(structure, {"level": samples["level"][i]}).nominal
        for name in SMOOTH:
            bound = 1e-4 if name in ("width", "friction_J") else 1e-6
            assert table[name][i] == pytest.approx(getattr(nominal, name), rel=bound, nan_ok=True), name


@pytest.mark.ranks(1)
def test_a_stated_accuracy_raises_the_harmonics_of_a_sample(comm, shared_path):
    """The scene needs three harmonics, a sample with less friction more; the reference has 15."""
    level, friction = 10.0, 0.3
    path = on_root(
        comm, lambda: write_matrix_scene(shared_path, scenes.chain(), [level], (400.0, 700.0), outputs=[6], accuracy=1e-3)
    )
    with microslip.build(microslip.read(path), comm) as structure:
        (sample,) = microslip.sweep(structure, {"joints.joint.friction": [friction]}).samples
        fine = {"harmonics": 15, "samples": 2048, "error_bars": False, "friction": {"joint": friction * structure.pairs.mu}}
        (peak,) = microslip.respond(structure, peaks=True, **fine).peaks[level]
    assert sample.error < 2e-3 * sample.amplitude  # 3.6e-3 with the harmonics of the scene
    assert sample.amplitude == pytest.approx(abs(peak.amplitude), rel=1e-3)


def test_a_failed_sample_does_not_stop_the_others(mass):
    table = microslip.sweep(mass, {STIFFNESS: [1.0, 1e3, 1.2]})  # the second peak lies beyond the range
    assert [sample.status for sample in table.samples] == [DONE, FAILED, DONE]
    assert len(table.failures) == 1 and "sample 1 (joints.joint.tangential_stiffness = 1000)" in table.failures[0]
    with pytest.raises(AttributeError):
        _ = table.amplitud


@pytest.mark.parametrize(
    "key, value, message",
    [("friction", -1.0, "mu in pairs.csv must not be negative"), ("preload", 0.0, "n0 in pairs.csv must be above 0")],
)
def test_factors_invalid_for_the_file_of_pairs_are_rejected_before_a_solve(mass, key, value, message):
    with pytest.raises(CaseError, match=rf"scene\.toml: joints\.joint\.{key} = {value:g}: the factor of {message}"):
        microslip.sweep(mass, {f"joints.joint.{key}": [1.0, value]})


@pytest.mark.parametrize("is_loose", [True, False])
@pytest.mark.ranks(1)
def test_holding_of_the_mean_slip_is_decided_at_the_peak(mass, monkeypatch, is_loose):
    """As along a curve: held where most pairs slip and the body has no other support; the search begins with the other state."""
    held, highest_of, forced = [], sample_peaks.highest_of, _Problem.forced
    peaks = SamplePeaks(mass, Varied.of(mass.scene, [FRICTION]))
    monkeypatch.setattr(SamplePeaks, "_starts", lambda *arguments: [])
    monkeypatch.setattr(sample_peaks, "highest_of", lambda *arguments: (highest_of(*arguments)[0], not is_loose))
    monkeypatch.setattr(sample_peaks, "is_held_by_its_joint_alone", lambda *arguments: is_loose)
    monkeypatch.setattr(_Problem, "forced", lambda problem, is_held: held.append(is_held) or forced(problem, is_held))
    sample = peaks.solve([1.1])
    assert sample.status == DONE and held[-1] == is_loose and (not is_loose) in held
    assert sample.amplitude == pytest.approx(exact.jenkins_peak(0.8, 1.1, C), rel=2e-3 if is_loose else 30.0 / 128**2)
    peaks.close()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"joints.joint.frction": [1.0]}, 'nearest is "friction"'),
        ({"joints.jiont.friction": [1.0]}, "joint"),
        ({"level": [-1.0]}, "levels"),
        ({"level": []}, "at least one"),
        ({"level": ["high"]}, "expected numbers"),
        ({"solver.method": [1.0]}, "is no number"),
        ({}, "nothing varies"),
    ],
)
def test_parameters_that_cannot_vary_are_rejected(mass, values, message):
    with pytest.raises(CaseError) as problem:
        microslip.sweep(mass, values)
    assert message in str(problem.value)


def test_a_sweep_without_output_or_peak_is_rejected(comm, folder, mass):
    with pytest.raises(CaseError, match="no output 'tip'"):
        microslip.sweep(mass, {"level": 1.0}, output="tip")
    path = on_root(comm, one_mass, folder / "beside")
    scene = microslip.read(path, ["response.frequencies=[0.01, 0.1]"])
    with microslip.build(scene, comm) as structure, pytest.raises(CaseError, match="has no maximum between the ends"):
        microslip.sweep(structure, {"level": 1.0})


def test_motions_are_interpolated_linearly():
    places = np.array([[0.1, 0.0], [0.3, -0.4], [-0.5, 0.2], [0.0, 0.9], [2.0, 1.0]])
    order = np.argsort(np.linalg.norm(places, axis=1))
    weights = affine_weights(places[order])
    assert weights is not None and weights.sum() == pytest.approx(1.0)
    assert weights @ places[order] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert affine_weights(np.array([[0.0, 0.0], [1.0, 1.0]])) is None


@pytest.mark.ranks(1)
def test_the_width_of_a_sliding_peak_has_its_closed_form(mass):
    """The two frequencies at which one harmonic of 1 / sqrt 2 of the amplitude balances the level determine it."""
    table = microslip.sweep(mass, {FRICTION: [0.6, 0.8, 1.1]})
    for limit, amplitude, width in zip(table[FRICTION], table.amplitude, table.width):
        low, high = exact.jenkins_frequencies(amplitude / np.sqrt(2.0), 0.8, m=1.0, c=C, k=1.0, k_t=1.0, muN=limit)
        assert 2.0 * np.pi * width == pytest.approx(high - low, rel=2e-3)


@pytest.mark.ranks(1)
def test_the_width_has_its_closed_form_where_half_power_points_stick(comm, folder):
    """With a limit of 2.3 to 3 times the level, the mass slips at the peak and little or not at all at half power."""

    def write():
        return one_mass(folder / "sharp", samples=1024)

    with microslip.build(microslip.read(on_root(comm, write)), comm) as sharp:
        for limit in (1.9, 2.0, 2.4):  # each from the scene, which slips at half power
            table = microslip.sweep(sharp, {FRICTION: [limit]})
            X = exact.jenkins_peak(0.8, limit, C)
            low, high = exact.jenkins_frequencies(X / np.sqrt(2.0), 0.8, m=1.0, c=C, k=1.0, k_t=1.0, muN=limit)
            assert limit < X < 1.5 * limit and table.amplitude == pytest.approx([X], rel=1e-4)
            assert 2.0 * np.pi * table.width == pytest.approx([high - low], rel=2e-4)
            assert table.samples[0].newton < 120 and not table.samples[0].is_followed


@pytest.mark.ranks(1)
@pytest.mark.parametrize("way_out", ["_through_shares", "_along_branch"])
def test_half_power_points_have_their_closed_form_by_each_method(mass, monkeypatch, way_out):
    def half_power(search, peak, way, start):
        computed = getattr(search, way_out)(peak, way)
        return None if computed is None else computed.iterate

    monkeypatch.setattr(_Search, "half_power", half_power)
    test_the_width_of_a_sliding_peak_has_its_closed_form(mass)


@pytest.mark.ranks(1)
def test_units_of_parameters(bar):
    scene, units = microslip.read(bar), {"preload": "Pa", "friction": "1", "normal_stiffness": "N/m3", "gap": "m"}
    assert {name: unit_of_key(scene, f"joints.joint.{name}") for name in units} == units
    assert unit_of_key(scene, "materials.steel.young") == "Pa" and unit_of_key(scene, "solver.modes") == ""
