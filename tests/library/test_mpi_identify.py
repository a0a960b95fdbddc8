"""Identification: synthetic measurements of a chain, undetermined parameters, and wrong input; on any number of ranks."""

import csv
import tomllib

import numpy as np
import pytest
import scipy.io
from blocks import stacked
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from msh import write_msh
from oracles import scenes
from oracles.exact import jenkins_amplitude
from rest_scene import HEIGHT, LENGTH, WIDTH, force, scene_of
from scipy.optimize import minimize_scalar

import microslip
from microslip.formats.measured import measured_of, read_measured
from microslip.library.fitted_numbers import fitted_numbers, refuse_bounds
from microslip.library.measured_model import MeasuredModel
from microslip.library.respond import scene_with
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root

pytestmark = pytest.mark.ranks(1, 2)
FRICTION, RATIO = "joints.joint.friction", "damping.ratio"
FREQUENCY, LEVELS, DEVIATION = np.linspace(400.0, 600.0, 6) / (2.0 * np.pi), (5.0, 20.0), 0.02
OFFERED = (
    "there are joints.joint.friction, joints.joint.preload, joints.joint.tangential_stiffness, "
    "joints.joint.normal_stiffness and damping.ratio"
)
BOUNDS = {FRICTION: (0.3, 3.0), RATIO: (0.005, 0.1)}


@pytest.fixture(scope="module")
def path(comm, tmp_path_factory):
    folder = comm.bcast(tmp_path_factory.mktemp("identify"))
    options = {"points": 16, "harmonics": 1, "samples": 64, "outputs": (6,), "error_bars": False}
    return on_root(comm, lambda: write_matrix_scene(folder, scenes.chain(), LEVELS, (380.0, 640.0), **options))


@pytest.fixture(scope="module")
def structure(comm, path):
    with microslip.build(microslip.read(path), comm) as built:
        yield built


@pytest.fixture(scope="module")
def exact(structure):
    """Return the columns of a measurement of a changed chain: friction 20 % lower, damping 50 % higher."""
    columns = {"frequency_Hz": np.tile(FREQUENCY, 2), "level_N": np.repeat(LEVELS, len(FREQUENCY))}
    sizes, phases = [], []
    for level in LEVELS:
        mu = {"joint": 0.8 * structure.pairs.mu}
        response = microslip.respond(structure, levels=level, friction=mu, ratio=0.03, at=tuple(FREQUENCY))
        requested = response.level(level).requested.astype(bool)
        a = response["6"].harmonic(1)[0, : len(requested)][requested]
        sizes, phases = [*sizes, np.abs(a)], [*phases, np.angle(a)]
    return columns | {"amplitude_m": np.concatenate(sizes), "phase_rad": np.concatenate(phases)}


def noisy(exact, seed):
    rng, size = np.random.default_rng(seed), exact["amplitude_m"]
    noise = rng.standard_normal((2, len(size)))
    return exact | {
        "amplitude_m": np.maximum(size + DEVIATION * size.max() * noise[0], 1e-3 * size.max()),
        "phase_rad": exact["phase_rad"] + DEVIATION * noise[1],
        "sigma_m": np.full(len(size), DEVIATION * size.max()),
        "sigma_phase_rad": np.full(len(size), DEVIATION),
    }


@pytest.mark.ranks(1)
def test_exact_data_give_the_exact_parameters(structure, exact):
    fit = microslip.identify(structure, exact, BOUNDS)
    assert fit[FRICTION] == pytest.approx(0.8, rel=1e-4) and fit[RATIO] == pytest.approx(0.03, rel=1e-4)
    assert fit.rms < 1e-4 and not fit.unseen and not fit.alike and not fit.at_bounds
    assert fit.factors == {FRICTION: fit[FRICTION]} and fit.scene.damping.ratio == pytest.approx(0.03, rel=1e-4)
    assert fit.fit.amplitude == pytest.approx(exact["amplitude_m"], rel=1e-3)


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_intervals_from_noisy_data_cover_the_exact_parameters(structure, exact):
    """For a single seed; jobs/bench/identify.py counts many."""
    fit = microslip.identify(structure, noisy(exact, 0), BOUNDS)
    assert fit.low[0] <= 0.8 <= fit.high[0] and fit.low[1] <= 0.03 <= fit.high[1]
    assert fit.rms == pytest.approx(1.0, abs=0.4) and np.all(fit.high / fit.low < 1.5) and fit.is_explained
    of_less = {key: 0.25 * values if key.startswith("sigma") else values for key, values in noisy(exact, 0).items()}
    assert not microslip.identify(structure, of_less, BOUNDS).is_explained


@pytest.mark.ranks(1)
def test_missing_deviations_of_phases_are_estimated_from_the_residuals(structure, exact):
    """Deviations of amplitudes are stated; phases are ten times as uncertain as without a statement."""
    columns = noisy(exact, 0)
    columns.pop("sigma_phase_rad")
    few = microslip.identify(structure, columns, BOUNDS)
    noise = 0.3 * np.random.default_rng(1).standard_normal(len(columns["phase_rad"]))
    much = microslip.identify(structure, columns | {"phase_rad": exact["phase_rad"] + noise}, BOUNDS)
    assert few.is_explained and much.is_explained
    assert np.all(np.log(much.high / much.low) > 1.5 * np.log(few.high / few.low))
    assert much.low[1] <= 0.03 <= much.high[1]


@pytest.mark.study
@pytest.mark.ranks(1)
def test_estimated_deviations_are_the_weights_of_the_fit(structure, exact):
    """Deviations of phases are stated; amplitudes are ten times as uncertain as without a statement."""
    columns, size = noisy(exact, 0), exact["amplitude_m"]
    deviation = np.full(len(size), 0.2 * size.max())
    columns |= {"amplitude_m": size + deviation * np.random.default_rng(1).standard_normal(len(size)), "sigma_m": deviation}
    columns["amplitude_m"] = np.maximum(columns["amplitude_m"], 1e-3 * size.max())
    stated = microslip.identify(structure, columns, BOUNDS)
    columns.pop("sigma_m")
    fit = microslip.identify(structure, columns, BOUNDS)
    width = np.log(stated.high / stated.low)
    assert np.all(np.abs(np.log(fit.values / stated.values)) < 0.02 * width)
    np.testing.assert_allclose(np.log(fit.high / fit.low), width, rtol=0.1)


def test_undetermined_parameters_are_reported(structure, exact):
    """While all pairs stick, friction has no effect; friction and preload form a single limit if no pair opens."""
    columns = {name: values[: len(FREQUENCY)] for name, values in noisy(exact, 3).items()} | {
        "level_N": np.full(len(FREQUENCY), 1e-3)
    }
    stuck = microslip.respond(structure, levels=1e-3, at=tuple(FREQUENCY), points=4)
    requested = stuck.level(1e-3).requested.astype(bool)
    a = stuck["6"].harmonic(1)[0, : len(requested)][requested]
    columns |= {"amplitude_m": np.abs(a), "phase_rad": np.angle(a), "sigma_m": 0.02 * np.abs(a)}
    fit = microslip.identify(structure, columns, BOUNDS)
    assert fit.unseen == (FRICTION,) and (fit.low[0], fit.high[0]) == pytest.approx(BOUNDS[FRICTION])
    assert fit[RATIO] == pytest.approx(0.02, rel=1e-3)


@pytest.mark.ranks(1)
def test_parameters_determined_only_by_their_product_have_their_bounds_as_interval(structure, exact):
    bounds = {FRICTION: (0.3, 3.0), "joints.joint.preload": (0.4, 2.0)}
    fit = microslip.identify(structure, noisy(exact, 0), bounds, ratio=0.03)
    assert fit[FRICTION] * fit["joints.joint.preload"] == pytest.approx(0.8, rel=0.05)
    assert fit.low == pytest.approx([0.3, 0.4]) and fit.high == pytest.approx([3.0, 2.0])
    assert len(fit.alike) == 1 and fit.dof == 2 * len(exact["amplitude_m"]) - 1


@pytest.mark.ranks(1)
def test_as_many_parameters_as_rows_have_their_bounds_as_interval(structure, exact):
    single = {name: values[len(FREQUENCY) // 2 :][:1] for name, values in exact.items() if name != "phase_rad"}
    fit = microslip.identify(structure, single, {FRICTION: (0.3, 3.0)}, ratio=0.03)
    assert fit.dof == 0 and (fit.low[0], fit.high[0]) == pytest.approx((0.3, 3.0))


@pytest.mark.ranks(1)
def test_an_undetermined_parameter_does_not_change_the_others(comm, shared_path):
    """The normal stiffness of a mass that moves only tangentially: a column of zeros in the Jacobian."""
    load = {"vector": [1.0], "harmonic": 1}
    system = scenes.make_system(
        "mass", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]],
        mu=1.0, N0=1.0, k_t=1.0, k_n=1.0, zeta=0.015, loads=[load], output=[1.0], omega=(0.9, 1.6), levels={},
    )  # fmt: skip
    at, fits = tuple(np.linspace(1.0, 1.5, 8) / (2.0 * np.pi)), {FRICTION: (0.2, 4.0), RATIO: (0.001, 0.1)}

    def write():
        return write_matrix_scene(shared_path, system, [0.3], (0.9, 1.6), points=16, harmonics=1, samples=128)

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        response = microslip.respond(structure, at=at, ratio=0.01, error_bars=False).level(0.3)
        requested = response.requested.astype(bool)
        a = response.response[requested, 0, 1] - 1j * response.response[requested, 0, 2]
        rows = {"frequency_Hz": at, "amplitude_m": np.abs(a), "phase_rad": np.angle(a)}
        without = microslip.identify(structure, rows, fits)
        with_normal = microslip.identify(structure, rows, fits | {"joints.joint.normal_stiffness": (0.1, 10.0)})
    assert with_normal.unseen == ("joints.joint.normal_stiffness",) and with_normal.is_converged
    assert with_normal.evaluations < 15 and with_normal.values[:2] == pytest.approx(without.values, rel=1e-6)


@pytest.mark.ranks(1)
def test_peaks_of_the_closed_form_give_its_parameters(comm, shared_path):
    """One mass on a Jenkins element, one harmonic: limit 0.8 and stiffness 1.2 of those of the scene, within the intervals."""
    of, levels = {"m": 1.0, "c": 0.02, "k": 1.0, "k_t": 1.2, "muN": 0.8}, (0.2, 0.6, 1.0)

    def write():
        return write_matrix_scene(shared_path, scenes.jenkins_mass(), levels, (0.5, 2.0), points=60, harmonics=1, samples=512)

    def top(F):
        search = {"bounds": (0.95, 1.55), "method": "bounded", "options": {"xatol": 1e-10}}
        return minimize_scalar(lambda omega: -jenkins_amplitude(omega, F, **of), **search)

    tops = list(map(top, levels))
    columns = {"peak_frequency_Hz": [top.x / (2.0 * np.pi) for top in tops], "amplitude_m": [-top.fun for top in tops]}
    columns |= {"sigma_m": [1e-4 * size for size in columns["amplitude_m"]], "sigma_frequency_Hz": [1e-5] * len(levels)}
    stiffness = "joints.joint.tangential_stiffness"
    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        fit = microslip.identify(structure, columns | {"level_N": levels}, {FRICTION: (0.3, 3.0), stiffness: (0.3, 3.0)})
    assert fit.values == pytest.approx([0.8, 1.2], rel=3e-5)
    assert np.all(fit.low < [0.8, 1.2]) and np.all(fit.high > [0.8, 1.2])


@pytest.mark.ranks(1)
def test_the_jacobian_of_peaks_is_that_of_differences(structure):
    """At 64 samples the peaks have corners: within them the Jacobian is that of the differences, too."""
    scene = scene_with(structure.scene, {"sensitivities": True, "error_bars": False}, {})
    columns = {"peak_frequency_Hz": [80.0] * 2, "amplitude_m": [1e-3] * 2, "level_N": LEVELS}
    rows = measured_of(columns, "", ("6",), ("m",), LEVELS)
    model = MeasuredModel(structure, scene, rows, fitted_numbers(scene, structure, BOUNDS))
    begin = np.log([1.0, 0.02])
    jacobian = model.jacobian(begin).copy()
    for i, step in enumerate(0.03 * np.eye(2)):
        differences = (model.residuals(begin + step) - model.residuals(begin - step)) / 0.06
        np.testing.assert_allclose(jacobian[:, i], differences, atol=0.02 * np.abs(differences).max())


@pytest.mark.parametrize(
    ("bounds", "text"),
    [
        ({}, "missing"),
        ({"joints.joint.fricton": (0.1, 1.0)}, "friction"),
        ({FRICTION: (2.0, 3.0)}, "the scene's value, 1, not within"),
        ({FRICTION: (1.0, 0.5)}, "two bounds of at least 0"),
        ({"level": (1.0, 2.0)}, "no number 'level'"),
        ({"joints.joint.gap": (0.0, 1.0)}, OFFERED),
        ({"damping": (0.5, 2.0)}, OFFERED + "; damping.ratio is a number where"),
    ],
)
def test_wrong_parameters_are_rejected(structure, exact, bounds, text):
    with pytest.raises(CaseError, match=text):
        microslip.identify(structure, exact, bounds)
    with pytest.raises(CaseError, match=text):
        refuse_bounds(structure.scene, bounds)  # before the structure is built


@pytest.mark.ranks(1)
def test_only_parameters_that_preserve_the_state_of_rest_can_be_fitted(tmp_path):
    write_msh(str(tmp_path / "bar.msh"), stacked("hex8", (LENGTH, WIDTH, HEIGHT), (4, 2, 1), 0.005))
    at_rest = scene_of(MPI.COMM_SELF, tmp_path, force(0.0, 0.0, -1000.0))
    changes = ('preload = "static"', "gap = 1e-5"), ("ratio = ", "rayleigh = [1.0, 0.0]  # "), ("axis = [0.0, 0.0, 1.0]", "")
    with_gap = scene_of(MPI.COMM_SELF, tmp_path, None, *changes)
    stiffness = "joints.joint.tangential_stiffness"
    for scene, key, text in (
        (at_rest, "joints.joint.x", f"there are {stiffness}, joints.joint.normal_stiffness and damping.ratio$"),
        (at_rest, FRICTION, "changes the state of rest with .statics."),
        (
            with_gap,
            "joints.joint.preload",
            f"there are {FRICTION}, joints.joint.gap, {stiffness} and joints.joint.normal_stiffness$",
        ),
        (with_gap, RATIO, "damping.ratio is a number where it is all damping there is"),
    ):
        with pytest.raises(CaseError, match=text):
            refuse_bounds(scene, {key: (0.1, 1.0)})
    with pytest.raises(CaseError, match="fit one of them"):
        refuse_bounds(with_gap, {"joints.joint.gap": (1e-6, 1e-4), "joints.joint.normal_stiffness": (1e12, 1e13)})


@pytest.mark.parametrize(
    ("lines", "text"),
    [
        ("", "a header and at least one row"),
        ("1,2\n3,4\n", "unknown"),
        ("frequency,amplitude_m\n80,1e-6\n", 'column "frequency" is unknown; nearest is "frequency_Hz"'),
        ("frequency_Hz,amplitude\n80,1e-6\n", "state the unit in the name"),
        ("frequency_Hz,amplitude_N\n80,1e-6\n", "unknown.*the outputs are in m"),
        ("frequency_Hz,level_N\n80,5\n", "neither an amplitude nor a phase"),
        ("amplitude_m,level_N\n1e-6,5\n", "needs a frequency above 0"),
        ("frequency_Hz,amplitude_m\n80,1e-6\n", "2 levels, and no column level_N"),
        ("frequency_Hz,amplitude_m,level_N\n80,much,5\n", 'line 2: amplitude_m = "much"'),
        ("frequency_Hz,amplitude_m,level_N\n80,-1,5\n", "amplitude = -1"),
        ("frequency_Hz;amplitude_m;level_N\n80;1;5\n", "semicolons"),
        ("frequency_Hz,amplitude_m,level_N\n80,1\n", "line 2: 2 values; 3 are needed"),
        ("frequency_Hz,amplitude_m,level_N,output\n80,1,5,tip\n", 'no output "tip"'),
        ("frequency_Hz,peak_frequency_Hz,amplitude_m,level_N\n80,80,1,5\n", "files of their own"),
        ("frequency_Hz,amplitude_m,amplitude_mm,level_N\n80,1,1,5\n", "keep one"),
    ],
)
@pytest.mark.ranks(1)
def test_wrong_measurement_files_are_rejected(tmp_path, lines, text):
    file = tmp_path / "measured.csv"
    file.write_text(lines)
    with pytest.raises(CaseError, match=text):
        read_measured(file, ("6",), ("m",), LEVELS)


@pytest.mark.ranks(1)
def test_units_and_matlab_files(tmp_path):
    columns = {"frequency_kHz": [0.08], "amplitude_um": [3.0], "phase_deg": [-90.0], "level_N": [5.0]}
    scipy.io.savemat(tmp_path / "measured.mat", columns)
    for rows in (
        measured_of(columns, "", ("6",), ("m",), LEVELS),
        read_measured(tmp_path / "measured.mat", ("6",), ("m",), LEVELS),
    ):
        assert rows.frequency == pytest.approx([80.0]) and rows.amplitude == pytest.approx([3e-6])
        assert rows.phase == pytest.approx([-0.5 * np.pi]) and not rows.of_peaks
    scipy.io.savemat(tmp_path / "named.mat", columns | {"output": np.array(["tip"], dtype=object)})
    assert read_measured(tmp_path / "named.mat", ("6", "tip"), ("m", "m"), LEVELS).output == [1]


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"frequency_Hz": [1.0, 2.0], "amplitude_m": [1.0]}, "of one length"),
        ({"frequency_Hz": {"a": 1.0}}, "frequency_Hz is neither numbers nor texts"),
        (b"MATLAB 5.0 MAT-file" + bytes(range(256)), "cannot be read as a MATLAB file"),
    ],
)
@pytest.mark.ranks(1)
def test_wrong_matlab_files_are_rejected(tmp_path, content, text):
    file = tmp_path / "measured.mat"
    file.write_bytes(content) if isinstance(content, bytes) else scipy.io.savemat(file, content)
    with pytest.raises(CaseError, match=text):
        read_measured(file, ("6",), ("m",), LEVELS)


# -- universal files -------------------------------------------------------------------------------------------------------

LINES = np.array([0.0, 70.0, 80.0, 90.0])


def of_pyuff(file, *, write=True, x=LINES, H=None, units=None, **record):
    """Write a response function by pyuff; return its complex values per newton."""
    pyuff = pytest.importorskip("pyuff")
    H = 1e-6 * np.exp(1j * np.arange(len(x))) if H is None else H
    record = {
        "func_type": 4, "rsp_ent_name": "tip", "rsp_node": 3, "rsp_dir": 1, "ref_node": 2, "ref_dir": 1, "ord_data_type": 6,
        "abscissa_spacing": 0, "abscissa_spec_data_type": 18, "ordinate_spec_data_type": 8, "orddenom_spec_data_type": 13,
        "z_axis_spec_data_type": 13, "z_axis_value": 5.0, "binary": 0,
    } | record  # fmt: skip
    sets = [pyuff.prepare_58(data=H, x=x, **record)]
    if units is not None:
        length, force = units
        sets.insert(0, pyuff.prepare_164(units_code=9, temp_mode=2, length=length, force=force, temp=1.0, temp_offset=273.15))
    if write:
        file.unlink(missing_ok=True)  # because its mode "overwrite" loses the header of binary data
    pyuff.UFF(str(file)).write_sets(sets, mode="add")
    return H


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.ranks(1)
def test_functions_written_by_pyuff_are_read(tmp_path, binary):
    """Functions are selected by the level of their Z axis and the range of the scene, and converted from millimetres."""
    file = tmp_path / "measured.uff"
    H = of_pyuff(file, binary=binary)
    rows = read_measured(file, ("6", "tip"), ("m", "m"), LEVELS, (75.0, 95.0))
    assert rows.frequency == pytest.approx([80.0, 90.0]) and (rows.output == 1).all() and (rows.level == 5.0).all()
    assert rows.amplitude == pytest.approx(5.0 * np.abs(H[2:]), rel=1e-6) and rows.phase == pytest.approx(np.angle(H[2:]))
    of_pyuff(file, H=1e3 * H, units=(1e3, 1.0))
    in_mm = read_measured(file, ("tip",), ("m",), (1.0,))
    assert in_mm.frequency == pytest.approx(LINES[1:]) and in_mm.amplitude == pytest.approx(5.0 * np.abs(H[1:]), rel=1e-6)
    of_pyuff(file, z_axis_spec_data_type=0, ordinate_spec_data_type=12)
    assert (read_measured(file, ("tip",), ("m/s2",), (3.0,)).level == 3.0).all()
    coherence = {"func_type": 6, "H": np.ones(4), "ord_data_type": 4}
    of_pyuff(file, write=False, **coherence)
    assert read_measured(file, ("tip",), ("m/s2",), (3.0,)).n == 3


@pytest.mark.parametrize(
    ("record", "text"),
    [
        ({"ordinate_spec_data_type": 12}, "is in m/s2, and the output in m"),
        ({"ordinate_spec_data_type": 17}, "data type 17"),
        ({"rsp_ent_name": "tp"}, 'the response entity "tp" is not the name of one output; nearest is "?tip'),
        ({"z_axis_spec_data_type": 0}, "has 2 levels, and no Z-axis value"),
        ({"func_type": 6, "H": np.ones(4), "ord_data_type": 4}, "no frequency response function"),
        ({"H": np.ones(4), "ord_data_type": 4}, "complex values over frequency"),
        ({"x": np.array([1.0, 2.0])}, "no line within .response. frequencies"),
    ],
)
@pytest.mark.ranks(1)
def test_wrong_universal_files_are_rejected(tmp_path, record, text):
    file = tmp_path / "measured.unv"
    of_pyuff(file, **record)
    with pytest.raises(CaseError, match=text):
        read_measured(file, ("6", "tip"), ("m", "m"), LEVELS, (60.0, 100.0))


@pytest.mark.ranks(1)
def test_damaged_universal_files_are_rejected(tmp_path):
    file = tmp_path / "measured.unv"
    of_pyuff(file, x=np.linspace(1.0, 2.0, 500))
    with pytest.raises(CaseError, match="500 lines; state .response. frequencies"):
        read_measured(file, ("tip",), ("m",), LEVELS)
    text = file.read_text()
    for damaged, message in (
        (text[:700], "no frequency response function|cannot be read"),
        (text.replace("E", "?").replace("e-", "?"), "cannot be read"),
    ):
        file.write_text(damaged)
        with pytest.raises(CaseError, match=message):
            read_measured(file, ("tip",), ("m",), LEVELS)
    with pytest.raises(CaseError, match="No such file"):
        read_measured(tmp_path / "none.unv", ("tip",), ("m",), LEVELS)


@pytest.mark.ranks(1)
def test_a_universal_file_of_results_is_identified(structure, comm, path, program, shared_path):
    """The file written by `convert` is read again: the true parameters are identified at once."""
    pytest.importorskip("pyuff")
    status, _, err = program(
        "run", path, "--out", shared_path / "unv", "--set", "response.levels=[20.0]", "--set", "response.points=4"
    )
    assert status == 0, err
    assert program("convert", shared_path / "unv" / "results.h5", "--to", "unv")[0] == 0
    (file,) = on_root(comm, lambda: [str(each) for each in (shared_path / "unv").rglob("*.unv")])
    fit = microslip.identify(structure, file, BOUNDS)
    assert fit[FRICTION] == pytest.approx(1.0, rel=1e-3) and fit.rms < 1e-3 and (fit.measured.level == 20.0).all()


@pytest.mark.pictures
def test_the_command_writes_tables_and_a_scene(comm, path, exact, program, shared_path):
    def write():
        with open(shared_path / "measured.csv", "w") as file:
            rows = csv.writer(file)
            rows.writerow(exact)
            rows.writerows(zip(*exact.values()))

    on_root(comm, write)
    fit = ("--fit", f"{FRICTION}=0.3:3.0", "--fit", f"{RATIO}=0.005:0.1")
    status, out, err = program("identify", path, shared_path / "measured.csv", *fit, "--out", shared_path / "out")
    assert status == 0, err
    assert FRICTION in out and "in its new file of pairs" in out
    with open(shared_path / "out" / "identified.csv") as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    assert float(rows[FRICTION]["value"]) == pytest.approx(0.8, rel=1e-3)
    scene = microslip.read(shared_path / "out" / "identified.toml")
    assert scene.damping.ratio == pytest.approx(0.03, rel=1e-3) and (shared_path / "out" / "fit.png").exists()
    assert tomllib.loads((shared_path / "out" / "identified.toml").read_text())["joints"][0]["pairs"] == "pairs_1.csv"
    with microslip.build(scene, comm) as built:
        assert built.pairs.mu == pytest.approx(0.8 * np.array(scenes.chain()["mu"]), rel=1e-3)
    for wrong, text in (("friction", "expected KEY=LOW:HIGH"), ("joints.joint.fricton=0.1:1", "friction")):
        status, _, err = program("identify", path, shared_path / "measured.csv", "--fit", wrong, "--out", shared_path / "no")
        assert status == 2 and text in err
