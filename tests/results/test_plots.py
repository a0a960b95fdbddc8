"""Pictures: drawn for every kind of result, complete, with correct contents."""

import dataclasses
import itertools
import os
import subprocess
import sys
from types import SimpleNamespace

import h5py
import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.image import imread
from synthetic_results import branch, curve, no_pairs, pairs_of, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.restart.results_folder import is_results_file
from microslip.results import curve_plots, joint_plots, style
from microslip.results.plots import draw_all
from microslip.results.read import read_results

ALL = {"response.png", "states.png", "slip_map.png", "rom_size.png", "energy.png", "energy_map.png"}


@pytest.fixture(scope="module")
def pairs():
    return two_flanks(5, 1)


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Render few pixels: the layout is that of the full pictures."""
    monkeypatch.setattr(style, "DPI", 60)


def drawn(tmp_path, branches, pairs, **options):
    files = draw_all(write(tmp_path, branches, pairs, **options), str(tmp_path / "out"))
    assert all(is_results_file(os.path.basename(file)) for file in files), "a run moves its pictures by their names"
    assert all(os.path.dirname(file) == str(tmp_path / "out") for file in files)
    for file in files:
        picture = imread(file)[:, :, :3]
        assert picture.std() > 0.01
        # nothing touches the rim, so nothing is cut off
        rim = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert rim.min() > 0.99, file
    return {os.path.basename(file) for file in files}


@pytest.fixture
def pages(monkeypatch):
    """Store the pages instead of rendering and saving them."""
    saved = {}
    monkeypatch.setattr(style.Page, "save", lambda page, path: saved.setdefault(os.path.basename(path), page) and path)
    return saved


def drawn_files(files):
    return [os.path.basename(file) for file in files]


def draw_only(draw, path):
    with matplotlib.rc_context(style.RC):
        return [page.save(name) for name, page in draw(read_results(path, motion=False)).items()]


def texts(page):
    return [text.get_text() for text in page.figure.findobj(matplotlib.text.Text)]


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_all_pictures_of_complete_and_incomplete_levels(tmp_path, pairs):
    """Complete levels, an unloaded level, one that ended early, one without any point, one with a single point."""
    stopped, empty, single = branch(5.0, pairs), branch(6.0, pairs), branch(8.0, pairs, n_points=1)
    stopped.points[20:], empty.points[:] = [], []
    stopped.failure = empty.failure = "hb: no convergence"
    assert drawn(tmp_path, [branch(0.0, pairs), branch(3.0, pairs), stopped, empty, single], pairs) == ALL


@pytest.mark.filterwarnings("error")
def test_a_linear_scene_has_no_pictures_of_a_joint(tmp_path):
    assert drawn(tmp_path, [branch(1.0, no_pairs())], no_pairs()) == {"response.png", "rom_size.png", "energy.png"}


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_pictures_of_pairs_without_positions_and_titles_with_formulas(tmp_path):
    nowhere = pairs_of(np.full((7, 3), np.nan), np.tile(np.eye(3), (7, 1, 1)), np.ones(7), ("a",) * 7, ())
    title = "$\\frac{$ x_1^2 \n\u4e2d " + 40 * "many words "
    assert drawn(tmp_path, [branch(8.0, nowhere)], nowhere, title=title, linear=False) == ALL


def test_without_points_nothing_is_drawn(tmp_path, pairs):
    assert drawn(tmp_path, [], pairs) == set()


def test_a_file_that_is_no_result_is_status_2(tmp_path):
    (tmp_path / "x.h5").write_text("no")
    with pytest.raises(CaseError, match="no HDF5 file"):
        draw_all(str(tmp_path / "x.h5"), str(tmp_path))


def test_a_folder_that_cannot_be_written_to_is_status_2(tmp_path, pairs):
    path = write(tmp_path, [branch(8.0, pairs)], pairs)
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(CaseError, match="taken"):
        draw_all(path, str(tmp_path / "taken"))


def test_pictures_do_not_read_the_large_arrays(tmp_path, pairs, pages):
    path = write(tmp_path, [branch(8.0, pairs)], pairs)
    with h5py.File(path, "r+") as file:
        del file["levels/0000/du"], file["levels/0000/p"]
    assert len(draw_all(path, str(tmp_path))) == 6


@pytest.mark.parametrize("bound", [1e-6, 3e-3])
def test_energy_shows_the_bound_of_the_balance_of_the_run(tmp_path, pairs, pages, bound):
    curve = branch(8.0, pairs)
    curve.closes_to = bound
    draw_only(curve_plots.draw_energy, write(tmp_path, [curve], pairs))
    (line,) = [line for line in pages["energy.png"].figure.axes[-1].lines if line.get_linestyle() == "--"]
    assert line.get_ydata() == [bound, bound]


def test_response_shows_each_level_its_peak_and_the_linear_curve(tmp_path, pairs, pages):
    curves = [branch(level, pairs) for level in (1.0, 8.0)]
    draw_only(curve_plots.draw_response, write(tmp_path, curves, pairs))
    left, right = pages["response.png"].figure.axes
    assert left.get_ylabel() == "amplitude [mm]" and right.get_ylabel() == "amplitude [mm/N]"
    assert left.get_yscale() == "linear"
    size = np.array([np.hypot(*point.response[0, 1:3]) for point in curves[1].points])
    lines = [line for line in left.lines if len(line.get_xdata()) == len(size)]
    assert lines[1].get_ydata() == pytest.approx(1e3 * size)
    peaks = [line for line in left.lines if line.get_marker() == "o"]
    assert peaks[1].get_ydata() == pytest.approx([1e3 * size.max()])
    assert len(right.lines) == len(left.lines) + 1
    per_newton = [line for line in right.lines if len(line.get_xdata()) == len(size)]
    assert per_newton[1].get_ydata() == pytest.approx(1e3 * size / 8.0)
    names = [text.get_text() for text in pages["response.png"].figure.legends[0].get_texts()]
    assert names == ["1 N", "8 N", "all stuck, linear", "peak"]


def test_curves_over_decades_are_logarithmic(tmp_path, pairs, pages):
    wide = branch(8.0, pairs)
    frequencies = np.geomspace(20.0, 800.0, len(wide.points))
    for i, (f, u) in enumerate(zip(frequencies, curve(8.0, 1, frequencies, 0.0))):
        wide.points[i] = dataclasses.replace(wide.points[i], omega=2 * np.pi * f, response=u)
    draw_only(curve_plots.draw_response, write(tmp_path, [wide], pairs, linear=False))
    assert [ax.get_yscale() for ax in pages["response.png"].figure.axes] == ["log", "log"]


def test_an_output_that_does_not_move_is_drawn(tmp_path, pairs, pages):
    curve = branch(8.0, pairs, n_outputs=2)
    curve.points[:] = [dataclasses.replace(point, response=point.response * [[1.0], [0.0]]) for point in curve.points]
    draw_only(curve_plots.draw_response, write(tmp_path, [curve], pairs, outputs=("tip", "node")))
    assert len(pages["response.png"].figure.axes) == 4


def with_errors(computed, parts):
    """Return a branch with error bars: ``parts`` (6,) over the amplitude at every point."""
    largest = max(np.hypot(*point.response[0, 1:3]) for point in computed.points)
    computed.points[:] = [dataclasses.replace(point, error=largest * np.array([parts])) for point in computed.points]
    return computed


def at_rest(level, pairs, displacement):
    """Return one point of statics: every output is displaced, without vibration."""
    curve = branch(level, pairs, n_points=1)
    response = np.zeros_like(curve.points[0].response)
    response[:, 0] = displacement
    curve.points[:] = [dataclasses.replace(curve.points[0], response=response)]
    return curve


@pytest.mark.filterwarnings("error")
def test_statics_are_drawn_over_the_load(tmp_path, pairs, pages):
    loads, displacements = [4.0, 1.0, 2.0], [-9e-3, -1e-3, -3e-3]
    path = write(tmp_path, [at_rest(*entry) for entry in zip(loads, [pairs] * 3, displacements)], pairs, linear=False)
    assert {os.path.basename(file) for file in draw_all(path, str(tmp_path / "out"))} == {
        "response.png",
        "states.png",
        "slip_map.png",
    }
    (line,) = pages["response.png"].figure.axes[0].lines
    assert list(line.get_xdata()) == [1.0, 2.0, 4.0] and list(line.get_ydata()) == pytest.approx([-1.0, -3.0, -9.0])
    assert any("[mm]" in text for text in texts(pages["response.png"]))
    stick, slip, open_ = pages["states.png"].figure.axes[0].lines
    assert list(stick.get_ydata() + slip.get_ydata() + open_.get_ydata()) == 3 * [pairs.n_pairs]


@pytest.mark.parametrize("bar, top", [(0.0, 1.06), (0.3, 1.3 * 1.02), (5.0, 1.5 * 1.02)])
def test_axis_of_the_response_includes_error_bars_of_up_to_half_the_peak(tmp_path, pairs, pages, bar, top):
    computed = with_errors(branch(3.0, pairs), (0.0, bar / 3.0, 0.0, 0.0, 0.0, 0.0))
    draw_only(curve_plots.draw_response, write(tmp_path, [computed], pairs, linear=False))
    for ax in pages["response.png"].figure.axes:
        assert ax.get_ylim()[1] == pytest.approx(top * max(line.get_ydata().max() for line in ax.lines))


@pytest.mark.filterwarnings("error")
def test_error_shows_only_significant_parts(tmp_path, pairs, pages):
    some, none = (
        with_errors(branch(3.0, pairs), (1e-3, 1e-2, 0.0, 0.0, 1e-11, 0.0)),
        with_errors(branch(1.0, pairs), (0.0, 0, 0, 0, 1e-14, 0)),
    )
    assert "error.png" in drawn_files(draw_only(curve_plots.draw_error, write(tmp_path, [none, some], pairs)))
    page = pages["error.png"]
    legend = [text.get_text() for text in page.figure.legends[0].get_texts()]
    assert legend == ["error bar", "modes", "harmonics"]
    low, high = page.figure.axes
    assert not low.lines and "below 1e-12 everywhere" in [text.get_text() for text in low.texts]
    heights = sorted(float(np.max(line.get_ydata())) for line in high.lines)
    np.testing.assert_allclose(heights, [1e-3, 1e-2, 3.0 * (1.1e-2 + 1e-11)], rtol=1e-9)
    assert all(line.get_ydata().max() > high.get_ylim()[0] for line in high.lines)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_error_of_zero_everywhere_is_stated(tmp_path, pairs):
    assert "error.png" in drawn(tmp_path, [with_errors(branch(1.0, pairs), np.zeros(6))], pairs)


@pytest.mark.slow
def test_many_outputs_and_levels_have_several_pages(tmp_path, pairs, pages):
    curves = [branch(level, pairs, n_outputs=7, n_points=9) for level in np.arange(1.0, 16.0)]
    path = write(tmp_path, curves, pairs, outputs=[f"u{i}" for i in range(7)])
    assert len(draw_only(curve_plots.draw_response, path)) == 2
    draw_only(curve_plots.draw_states, path)
    assert len(pages["states.png"].figure.axes) == style.MOST_PANELS
    assert any("12 of 15 levels" in text for text in texts(pages["states.png"]))


def test_states_sum_to_all_pairs(tmp_path, pairs, pages):
    draw_only(curve_plots.draw_states, write(tmp_path, [branch(8.0, pairs)], pairs))
    (ax,) = pages["states.png"].figure.axes
    curves = [line.get_ydata() for line in ax.lines if len(line.get_xdata()) > 2]
    assert len(curves) == 3 and (sum(curves) == pairs.n_pairs).all() and curves[1].max() > 20


def test_states_of_few_pairs_are_counted_in_whole_pairs(tmp_path, pages):
    few = pairs_of(np.zeros((10, 3)), np.tile(np.eye(3), (10, 1, 1)), np.ones(10), ("a",) * 10, ())
    draw_only(curve_plots.draw_states, write(tmp_path, [branch(level, few) for level in (1.0, 4.0, 8.0)], few))
    with matplotlib.rc_context(style.RC):
        pages["states.png"].figure.draw_without_rendering()
        ticks = np.array([ax.get_yticks() for ax in pages["states.png"].figure.axes])
    assert (ticks == np.round(ticks)).all()


def test_slip_map_colours_each_pair_by_its_state_at_the_peak(tmp_path, pairs, pages):
    curve = branch(8.0, pairs)
    draw_only(joint_plots.draw_slip_map, write(tmp_path, [curve], pairs))
    top = max(curve.points, key=lambda point: np.hypot(*point.response[0, 1:3]))
    colours = np.array([matplotlib.colors.to_rgba(colour) for colour in style.STATE_COLOURS])
    axes = pages["slip_map.png"].figure.axes
    assert len(axes) == 2
    rings = pairs.faces[0][:, [0, 4, 1, 5, 2, 6, 3, 7]].reshape(2, -1)
    for ax, ring in zip(axes, rings):
        assert np.array_equal(ax.collections[0].get_facecolor(), colours[top.state[ring]])
    n_slip, n_open = np.sum(top.state == 1), np.sum(top.state == 2)
    assert any(f"{n_slip} slip, {n_open} open" in text for text in texts(pages["slip_map.png"]))


def test_energy_map_ignores_rounding_of_stuck_pairs(tmp_path, pairs, pages):
    curve = branch(0.5, pairs)
    curve.points[:] = [dataclasses.replace(point, energy=point.energy + 1e-20) for point in curve.points]
    draw_only(joint_plots.draw_energy_map, write(tmp_path, [curve], pairs))
    assert any("none" in text for text in texts(pages["energy_map.png"]))


def test_energy_of_pairs_without_areas_is_that_of_each_pair(tmp_path, pages):
    nowhere = pairs_of(np.full((7, 3), np.nan), np.tile(np.eye(3), (7, 1, 1)), np.ones(7), ("a",) * 7, ())
    draw_only(joint_plots.draw_energy_map, write(tmp_path, [branch(8.0, nowhere)], nowhere))
    assert "friction loss per cycle [J]" in texts(pages["energy_map.png"])


def test_a_scale_of_one_power_of_ten_has_several_labels(pages):
    """Below two powers of ten the scale may have a single label; multiples of it are then labelled."""
    page = style.Page(SimpleNamespace(title="title"), "heading", 7.0, 2.0)
    joint_plots._colour_bar(page, matplotlib.colormaps["inferno_r"], LogNorm(2e-4, 3e-3), "loss")
    (bar,) = page.figure.axes
    page.figure.canvas.draw()
    labels = [label.get_text() for label in bar.get_xticklabels(which="both") if label.get_text()]
    assert len(labels) >= 3 and "10\u207b\u00b3" in labels


def test_pictures_need_no_petsc():
    code = "import sys, microslip.results.plots; sys.exit('petsc4py' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_energy_map_has_one_scale_and_none_when_all_stick(tmp_path, pairs, pages):
    path = write(tmp_path / "a", [branch(level, pairs) for level in (1.0, 5.0, 8.0)], pairs)
    draw_only(joint_plots.draw_energy_map, path)
    assert len(pages["energy_map.png"].figure.axes) == 3 * 2 + 1
    pages.clear()
    draw_only(joint_plots.draw_energy_map, write(tmp_path / "b", [branch(0.5, pairs)], pairs))
    assert len(pages["energy_map.png"].figure.axes) == 2
    assert any("none" in text for text in texts(pages["energy_map.png"]))


@pytest.mark.parametrize(
    "sizes, n_levels",
    [
        ([(0.066, 0.012)] * 2, 4),
        ([(0.05, 0.05)], 8),
        ([(1.0, 1e-4)], 4),
        ([(0.01, 0.01)] * 12, 12),
        ([(1e-3, 1e-3)], 1),
        ([(0.3, 0.02), (0.01, 0.01)], 5),
    ],
)
def test_layouts_fit_the_page(sizes, n_levels):
    layout = joint_plots.choose_layout(np.array(sizes), n_levels, len(sizes) > 1)
    assert layout.level_columns * layout.block[0] + layout.LEFT <= style.WIDTH
    assert layout.height(n_levels) < 12.0
    for k, size in enumerate(sizes):
        x, y = layout.corner(k)
        assert x + layout.scale * size[0] <= layout.block[0] and y + layout.scale * layout.stretch * size[1] <= layout.block[1]


def test_units_suit_the_values():
    assert style.with_prefix(np.array([2e-3, -4e-4]), "m")[1] == "mm"
    assert style.with_prefix(np.array([3.0]), "J") == (1.0, "J")
    assert style.with_prefix(np.array([2e-7]), "m/N") == (pytest.approx(1e9), "nm/N")
    assert style.with_prefix(np.zeros(3), "m") == (1.0, "m") and style.with_prefix(np.zeros(0), "m") == (1.0, "m")
    assert style.with_prefix(np.array([1e-3]), "m")[1] == "mm"


def test_axes_of_a_page_do_not_overlap(tmp_path, pairs, pages):
    branches = [branch(level, pairs) for level in (1.0, 2.0, 4.0, 8.0)]
    draw_all(write(tmp_path, branches, pairs), str(tmp_path))
    for name, page in pages.items():
        canvas = FigureCanvasAgg(page.figure)
        canvas.draw()
        boxes = [ax.get_tightbbox(canvas.get_renderer()) for ax in page.figure.axes]
        for box, other in itertools.combinations(boxes, 2):
            assert box.x1 <= other.x0 + 1 or other.x1 <= box.x0 + 1 or box.y1 <= other.y0 + 1 or other.y1 <= box.y0 + 1, name
