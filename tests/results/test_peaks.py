"""Solved peaks: in files, in curves, over the level, in the report."""

from dataclasses import fields, replace

import h5py
import matplotlib
import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from synthetic_results import branch, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.points.peak import Peak, top_of_curve
from microslip.restart.results_folder import is_results_file
from microslip.results import style
from microslip.results.curve_plots import draw_response
from microslip.results.mat import write_mat
from microslip.results.over_plots import has_linear
from microslip.results.peak_plots import draw_peaks, resonances
from microslip.results.read import read_results
from microslip.results.report import tables
from microslip.results.report.figures import figures_of
from microslip.results.stability_plots import draw_multipliers

LEVELS = (1.0, 3.0, 8.0)
OUTPUTS = ("tip", "root")


def peak(level, output=0, mode=0):
    """Return a peak of one of two resonances 20 % apart: softer and more damped at higher levels."""
    omega = 2.0 * np.pi * (99.0 + 20.0 * mode - 0.1 * level)
    width = np.nan if mode and level > 5.0 else 2e-3 * omega * (1.0 + level)
    return Peak(output, omega, level * 1e-3 * np.exp(-0.4j) / (1 + output + mode), width, 1e-6 * omega * mode, int(level), 4)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return results whose second resonance begins at the second level; the root has one peak per level."""
    curves = [branch(level, two_flanks(5, 1), n_outputs=2) for level in LEVELS]
    for one in curves:
        one.peaks = [peak(one.level), peak(one.level, 1)] + ([peak(one.level, mode=1)] if one.level > 2.0 else [])
    return write(tmp_path_factory.mktemp("peaks"), curves, two_flanks(5, 1), outputs=OUTPUTS)


@pytest.fixture(scope="module")
def results(path):
    return read_results(path, motion=False)


def drawn(draw, results):
    with matplotlib.rc_context(style.RC):
        return draw(results)


def test_labels_of_near_peaks_do_not_cover_each_other(path):
    results = read_results(path, motion=False)
    first = results.levels[0].peaks[0]
    peaks = tuple(replace(first, omega=(1.0 + 3e-3 * i) * first.omega) for i in range(6))
    levels = (replace(results.levels[0], peaks=peaks, bifurcations=()), *results.levels[1:])
    page = drawn(draw_response, replace(results, levels=levels))["response.png"]
    page.figure.draw_without_rendering()
    for ax in page.figure.axes:
        boxes = [text.get_window_extent() for text in ax.texts]
        assert all(box.count_overlaps(boxes) == 1 for box in boxes)
    assert page.figure.axes[0].texts


def test_large_multipliers_do_not_compress_the_unit_circle(path):
    results = read_results(path, motion=False)
    for level in results.levels:
        n = len(level.frequency)
        multipliers, stable = np.tile([[[0.4, 0.3], [-0.2, 0.0]]], (n, 1, 1)), np.ones(n)
        multipliers[0, 0], stable[0] = (-30.0, 40.0), 0
        level.arrays.update(multipliers=multipliers, stable=stable)
    page = drawn(draw_multipliers, results)["multipliers.png"]
    for ax in page.figure.axes:
        (x, y), *more = (line.get_data() for line in ax.lines if line.get_marker() == "D")
        assert not more and np.allclose([x, y], [[-1.2], [1.6]])
    assert page.figure.legends[0].get_texts()[-1].get_text() == "of size above 2, up to 50"


def test_peaks_are_written_read_and_converted_to_matlab(path, results, tmp_path):
    for level, written in zip(LEVELS, results.levels):
        for wanted, one in zip([peak(level), peak(level, 1), peak(level, mode=1)], written.peaks):
            assert one.by_pairs is None and one.by_common is None
            for field in (field for field in fields(Peak) if not field.name.startswith("by_")):
                assert getattr(one, field.name) == pytest.approx(getattr(wanted, field.name), rel=1e-14, nan_ok=True), field
    write_mat(tmp_path / "x.mat", read_results(path), None)
    of_last = scipy.io.loadmat(tmp_path / "x.mat", simplify_cells=True)["levels"][-1]["peaks"]
    assert of_last["frequency_Hz"] == pytest.approx([98.2, 98.2, 118.2]) and of_last["damping"][0] == pytest.approx(9e-3)


@pytest.mark.parametrize("dataset, value", [("output", 2), ("frequency_Hz", -1.0), ("amplitude", np.inf)])
def test_invalid_peaks_are_rejected(path, tmp_path, dataset, value):
    copy = tmp_path / "results.h5"
    copy.write_bytes(open(path, "rb").read())
    with h5py.File(copy, "r+") as file:
        file[f"levels/0000/peaks/{dataset}"][0] = value
    with pytest.raises(CaseError, match="peaks"):
        read_results(str(copy))


def test_a_resonance_is_followed_from_level_to_level(results):
    first, second = resonances(results.levels, 0)
    assert [level.level for level, _ in first] == [1.0, 3.0, 8.0] and [level.level for level, _ in second] == [3.0, 8.0]
    assert all(one.omega / 2.0 / np.pi > 110.0 for _, one in second)
    assert [len(line) for line in resonances(results.levels, 1)] == [3] and resonances(results.levels, 2) == []


def test_curves_have_their_peaks_with_frequency_amplitude_and_damping(results):
    figure = drawn(draw_response, results)["response.png"].figure
    left, right = figure.axes[:2]
    marks = [line for line in left.lines if line.get_marker() == "o"]
    assert [float(line.get_xdata()[0]) for line in marks] == pytest.approx([98.9, 98.7, 118.7, 98.2, 118.2])
    assert [float(line.get_ydata()[0]) for line in marks] == pytest.approx([1.0, 3.0, 1.5, 8.0, 4.0])
    assert [float(line.get_ydata()[0]) for line in right.lines if line.get_marker() == "o"][3] == pytest.approx(1.0)
    assert left.texts[0].get_text() == "98.2 Hz, 8 mm, \u03b6 0.9 %" and not right.texts
    assert left.get_ylim()[1] > 8.0  # a peak may lie above the points of its curve


def test_peaks_over_the_level(results):
    pages = drawn(draw_peaks, results)
    assert all(map(is_results_file, pages)), "a run moves its pictures by their names"
    figure = pages["peaks.png"].figure
    amplitude, frequency, damping = figure.axes[:3]
    assert [ax.get_ylabel() for ax in (amplitude, frequency, damping)] == [
        "tip, amplitude [mm]",
        "frequency [Hz]",
        "damping ratio [%]",
    ]
    assert list(amplitude.lines[0].get_xdata()) == list(LEVELS) and amplitude.lines[0].get_ydata() == pytest.approx(LEVELS)
    assert damping.lines[0].get_ydata() == pytest.approx([0.2, 0.4, 0.9]) and np.isnan(damping.lines[1].get_ydata()[-1])
    assert len(figure.axes) == 6
    of_root = results.of_output(1)
    assert of_root.levels[0].peaks == (peak(1.0),) or of_root.levels[0].peaks[0].output == 0
    assert len(drawn(draw_peaks, of_root)["peaks.png"].figure.axes) == 3


def test_less_than_two_levels_with_peaks_have_no_picture_over_the_level(tmp_path):
    curves = [branch(level, two_flanks(5, 1)) for level in LEVELS]
    curves[1].peaks, curves[2].peaks = [peak(3.0)], []
    assert drawn(draw_peaks, read_results(write(tmp_path, curves, two_flanks(5, 1)))) == {}


def test_the_report_has_them_as_figures_and_table(results):
    figures = figures_of(results)
    assert figures["peaks_0"]["data"][0]["y"] == pytest.approx(LEVELS) and len(figures["peak_frequency_1"]["data"]) == 1
    assert figures["peak_damping_0"]["data"][1]["y"] == [pytest.approx(0.4), None]
    marks = [trace for trace in figures["response_0"]["data"] if trace["mode"] == "markers"]
    assert [len(trace["x"]) for trace in marks] == [1, 2, 2] and marks[2]["y"] == pytest.approx([8.0, 4.0])
    text = tables.solved_peaks_table(results)
    assert text.count("<tr>") == 1 + 8 and "98.2 Hz" in text and "0.9 %" in text


@pytest.mark.parametrize("key", ["damping", "damping.ratio", "joints.root.normal_stiffness", "joints.root.tangential_stiffness"])
def test_parameters_of_the_stuck_structure_have_no_linear_line(key):
    assert not has_linear(key) and has_linear("level") and has_linear("joints.damping.friction")


@given(st.floats(97.0, 103.0), st.floats(0.005, 0.1), st.integers(2, 7), st.integers(9, 12))
def test_the_maximum_of_a_resonance_is_computed_between_its_points(natural, damping, before, last):
    """1 / amplitude^2 of one mass is a quadratic in the square of the frequency: three coarse points give the maximum."""
    spacing = 0.2 * damping * natural
    omega = natural + spacing * (np.arange(last) - before + 0.3)
    size = 1.0 / np.abs(natural**2 - omega**2 + 2j * damping * natural * omega)
    at, top = natural * np.sqrt(1.0 - 2.0 * damping**2), 1.0 / (2.0 * damping * natural**2 * np.sqrt(1.0 - damping**2))
    for turned in (slice(None), slice(None, None, -1)):
        computed = top_of_curve(omega[turned], size[turned])
        np.testing.assert_allclose(computed, (at, top), rtol=1e-9)


def test_the_maximum_of_a_curve_at_an_end_or_a_fold_is_its_highest_point():
    assert top_of_curve(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0])) == (3.0, 3.0)
    assert top_of_curve(np.array([1.0, 2.0, 1.9]), np.array([1.0, 2.0, 1.5])) == (2.0, 2.0)
    assert top_of_curve(np.array([1.0, 2.0, 3.0]), np.array([0.0, 2.0, 0.0])) == (2.0, 2.0)
