"""Two results compared: exact curves with a fold, other points, parts of curves, settings, verdicts."""

import json
from dataclasses import replace

import numpy as np
import pytest
from synthetic_results import branch, head, no_pairs, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.points.error_parts import PARTS, total
from microslip.results.origin import InputFile, Origin
from microslip.results.read import read_results
from microslip.results.record import COMPLETE, RUNNING, STOPPED, ResultFile, level_result
from microslip.studies.diff.command import compared
from microslip.studies.diff.compared_inputs import NOT_STATED, Change, facts_changed, flattened, inputs_changed, keys_changed
from microslip.studies.diff.curves import Curve, half_width
from microslip.studies.diff.report import compare_files, json_of, text_of, verdict

ZETA, F_N = 0.005, 100.0


@pytest.fixture(scope="module")
def pairs():
    return two_flanks(4, 1)


@pytest.fixture(scope="module")
def results(pairs, tmp_path_factory) -> ResultFile:
    """Return results with two levels and two outputs."""
    curves = [branch(level, pairs, n_outputs=2) for level in (1.0, 8.0)]
    return read_results(write(tmp_path_factory.mktemp("diff"), curves, pairs, outputs=("tip", "root")))


def other(results: ResultFile, number: int = 1, **arrays) -> ResultFile:
    """Return results with changed arrays of a level."""
    levels = list(results.levels)
    levels[number] = replace(levels[number], arrays={**levels[number].arrays, **arrays})
    return replace(results, levels=tuple(levels))


# -- curves ---------------------------------------------------------------------------------------------------------------


def bent(s: np.ndarray, bend: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Return frequency [Hz] and complex amplitude of a resonance inclined to the left by ``bend``, so that it folds.

    s is the angle of phase: the amplitude is sin s, exactly, at F_N (1 - bend sin^2 s) - ZETA F_N / tan s.
    """
    return F_N * (1.0 - bend * np.sin(s) ** 2) - ZETA * F_N / np.tan(s), np.sin(s) * np.exp(-1j * s)


def of_curve(frequency, z) -> ResultFile:
    """Return results of one level with these points, with a mean and harmonic 3 that depend on them."""
    first = branch(1.0, no_pairs(), n_points=len(frequency))
    level = level_result(first, (1, 0, 7), COMPLETE)
    response = np.zeros((len(frequency), 1, 7))
    response[:, 0, 1], response[:, 0, 2], response[:, 0, 5] = z.real, -z.imag, 0.1 * np.abs(z) ** 2
    return replace(
        head(no_pairs()), levels=(replace(level, arrays={**level.arrays, "frequency": frequency, "response": response}),)
    )


def test_the_curve_folds_and_its_width_is_that_of_its_damping():
    frequency, z = bent(np.linspace(0.05, np.pi - 0.05, 400))
    assert (np.diff(frequency) < 0.0).any()
    frequency, z = bent(np.linspace(0.05, np.pi - 0.05, 2001), bend=0.0)
    assert half_width(frequency, np.abs(z)) == pytest.approx(ZETA * F_N, rel=0.01)


def test_a_folded_curve_at_other_points_is_the_same():
    first = of_curve(*bent(np.linspace(0.15, np.pi - 0.15, 90)))
    second = of_curve(*bent(0.15 + (np.pi - 0.3) * np.linspace(0.0, 1.0, 131) ** 1.2))
    for a, b in ((first, second), (second, first)):
        comparison = compared(a, b)
        (level,) = comparison.levels
        assert comparison.is_same and level.n_points != level.n_points[::-1] and level.is_whole
        assert 1e-8 < level.difference < 1e-3 and level.beyond < 1e-12
        assert level.outputs[0].peak == pytest.approx((1.0, 1.0), rel=1e-4)
        assert not compared(a, b, tolerance=1e-8).is_same


def test_common_points_of_two_curves_agree_to_rounding():
    s = np.linspace(0.15, np.pi - 0.15, 201)
    comparison = compared(of_curve(*bent(s)), of_curve(*bent(np.delete(s, np.arange(3, 200, 7)))))
    assert comparison.is_same and 1e-8 < comparison.levels[0].difference < 1e-3
    backwards = compared(of_curve(*bent(s)), of_curve(*(column[::-1] for column in bent(s))), tolerance=1e-12)
    assert backwards.is_same and not backwards.levels[0].same_points


@pytest.mark.parametrize("factor", [1.01, 1.2])
def test_the_difference_of_a_higher_curve_is_its_factor(factor):
    frequency, z = bent(np.linspace(0.05, np.pi - 0.05, 200))
    higher, w = bent(np.linspace(0.06, np.pi - 0.06, 170))
    comparison = compared(of_curve(frequency, z), of_curve(higher, factor * w))
    (level,) = comparison.levels
    assert not comparison.is_same and level.outputs[0].peak[1] == pytest.approx(factor, rel=1e-4)
    assert (factor - 1.0) * 0.9 < level.beyond < (factor - 1.0) * 1.4  # harmonic 3 adds a small part


def test_a_shift_by_a_hundredth_of_the_width_is_detected_on_the_flanks():
    frequency, z = bent(np.linspace(0.05, np.pi - 0.05, 400), bend=0.0)
    shifted, w = bent(np.linspace(0.05, np.pi - 0.05, 333), bend=0.0)
    comparison = compared(of_curve(frequency, z), of_curve(shifted + 0.01 * ZETA * F_N, w))
    (level,) = comparison.levels
    (low, high) = level.outputs[0].peak_at
    assert high - low == pytest.approx(0.01 * ZETA * F_N, rel=0.05)
    assert 0.006 < level.difference < 0.0105  # the slope of z over the frequency in half widths is 1 at most


def test_resolution_bounds_the_interpolation_error_and_is_zero_at_points():
    s = np.linspace(0.05, np.pi - 0.05, 60)
    frequency, z = bent(s)
    X = np.column_stack([frequency / (ZETA * F_N), z.real, z.imag])
    between, w = bent(0.5 * (s[1:] + s[:-1]))
    coarse = Curve(X, np.zeros(len(X)))
    foot = coarse.nearest(np.column_stack([between / (ZETA * F_N), w.real, w.imag]))
    assert np.all(foot.distance < coarse.resolution(foot.place)) and foot.distance.max() > 1e-6
    assert coarse.nearest(X).distance.max() < 1e-12 and coarse.resolution(coarse.nearest(X).place).max() < 1e-9


@pytest.mark.parametrize("n", [1, 2, 3])
def test_curves_of_few_points(n):
    frequency, z = bent(np.linspace(1.0, 2.0, n + 1))
    few, all_of_them = of_curve(frequency[:n], z[:n]), of_curve(frequency, z)
    assert compared(few, few).is_same
    assert len(text_of(compared(few, all_of_them))) > 100


def test_coincident_points_are_merged():
    frequency, z = bent(np.linspace(0.05, np.pi - 0.05, 50))
    twice = np.repeat(np.arange(50), 1 + (np.arange(50) % 3 == 0))
    assert compared(of_curve(frequency, z), of_curve(frequency[twice], z[twice]), tolerance=1e-12).is_same


def test_segments_are_not_joined():
    frequency, z = bent(np.linspace(0.05, np.pi - 0.05, 100), bend=0.0)
    segment = (np.arange(100) >= 60).astype("u1")
    order = np.r_[0:60, 99:59:-1]
    whole = of_curve(frequency, z)
    parts = other(of_curve(frequency[order], z[order]), 0, segment=segment)
    assert compared(whole, parts, tolerance=1e-12).is_same and compared(parts, whole, tolerance=1e-3).is_same


# -- levels, outputs, parts -----------------------------------------------------------------------------------------------


def test_the_same_results_are_the_same(results):
    comparison = compared(results, results)
    assert comparison.is_same and verdict(comparison) == "the same: the curves are equal (tolerance 0.0001 %)"
    assert comparison.keys == [] and comparison.facts == [] and comparison.only == ((), ())
    assert comparison.levels[1].n_other_state == 0 and comparison.levels[1].same_points


def test_the_order_of_levels_and_outputs_does_not_matter(results):
    levels = [replace(level, arrays={**level.arrays, "response": level.response[:, ::-1]}) for level in reversed(results.levels)]
    comparison = compared(results, replace(results, levels=tuple(levels), outputs=("root", "tip")))
    assert (
        comparison.is_same
        and [one.name for one in comparison.levels[0].outputs] == ["tip", "root"]
        and comparison.levels[0].difference == 0.0
    )


def test_a_difference_at_the_same_points_is_relative_to_the_peak_of_its_output(results):
    response = results.levels[1].response.copy()
    peak = np.hypot(*response[:, 1, 1:3].T).max()
    response[10, 1, 5] += 2e-5 * peak
    comparison = compared(results, other(results, response=response))
    tip, root = comparison.levels[1].outputs
    assert (tip.difference, root.difference) == (0.0, pytest.approx(2e-5)) and root.at == results.levels[1].frequency[10]
    assert not comparison.is_same and compared(results, other(results, response=response), tolerance=3e-5).is_same
    assert "different: the curves differ by up to 0.002 % of the peak, at 8 N" in verdict(comparison)


def test_additional_zero_harmonics_are_no_difference(results):
    wider = [np.pad(level.response, [(0, 0), (0, 0), (0, 4)]) for level in results.levels]
    both = other(other(results, 0, response=wider[0]), 1, response=wider[1])
    assert compared(results, both).is_same and compared(both, results).is_same


def test_only_common_levels_and_outputs_are_compared(results):
    shorter = replace(results, levels=results.levels[:1])
    comparison = compared(results, shorter)
    assert not comparison.is_same and comparison.only == (("level 8 N",), ())
    assert verdict(comparison).startswith("different: level 8 N in A only; in the common range the curves are equal")
    renamed = compared(results, replace(results, outputs=("tip", "foot")))
    assert renamed.only == (('output "root" in m',), ('output "foot" in m',)) and len(renamed.levels[0].outputs) == 1
    assert verdict(compared(results, replace(results, levels=()))) == "different: no common level"


@pytest.mark.parametrize("status, failure", [(RUNNING, ""), (STOPPED, "no convergence")])
def test_the_common_part_of_an_incomplete_run_is_compared(results, status, failure):
    n = 35  # beyond the peak
    part = other(results, **{name: None if one is None else one[:n] for name, one in results.levels[1].arrays.items()})
    level = replace(part.levels[1], status=status, failure=failure)
    part = replace(part, levels=(part.levels[0], level))
    for a, b, side in ((results, part, "B"), (part, results, "A")):
        comparison = compared(a, b)
        assert not comparison.is_same and comparison.incomplete == (side,) and comparison.levels[1].difference < 1e-12
        assert verdict(comparison).startswith(f"different: {side} is not complete; in the common range the curves")
        how = "ended early: no convergence" if failure else "was not finished when the file was written"
        assert f"8 N: {side} {how} (35 points)" in text_of(comparison) and "compared in the overlap" in text_of(comparison)


def test_a_wider_range_is_reported(results):
    n = len(results.levels[1].frequency)
    part = other(results, **{name: None if one is None else one[5 : n - 5] for name, one in results.levels[1].arrays.items()})
    comparison = compared(results, part)
    assert "the frequency ranges differ; in the common range the curves are equal" in verdict(comparison)


def test_ranges_without_a_common_frequency_are_not_compared(results):
    level = results.levels[1]
    shifted = other(results, frequency=level.frequency + 2.0 * np.ptp(level.frequency))
    comparison = compared(results, shifted)
    assert comparison.levels[1].is_disjoint and comparison.levels[1].outputs == () and not comparison.is_same
    assert "no common frequency at 8 N; in the common range" in verdict(comparison)
    assert "Hz; no common frequency" in text_of(comparison)
    only = [replace(side, levels=side.levels[1:]) for side in (results, shifted)]
    assert verdict(compared(*only)) == "different: no common frequency at any level"


def test_levels_without_points_are_compared(results):
    empty = other(results, **{name: None if one is None else one[:0] for name, one in results.levels[1].arrays.items()})
    comparison = compared(results, empty)
    assert not comparison.is_same and comparison.levels[1].outputs == () and comparison.levels[1].n_points[1] == 0
    assert text_of(comparison) and json.loads(json_of(comparison))["levels"][1]["outputs"] == []
    assert compared(empty, empty).is_same


def test_differences_inside_the_error_bars(results):
    level = results.levels[1]
    error = np.zeros((len(level.frequency), 2, len(PARTS)))
    error[..., 1] = 1e-3 * np.hypot(*level.response[:, :, 1:3].transpose(2, 0, 1)).max(axis=0)
    bar = total(error)[0] / np.hypot(*level.response[:, :, 1:3].transpose(2, 0, 1)).max(axis=0)
    known = other(results, error=error)
    for share, inside in ((1.9, True), (2.1, False)):
        response = level.response * (1.0 + share * bar[0])
        changed = other(known, response=response)
        comparison = compared(known, changed)
        assert comparison.levels[1].inside_bars is inside and not comparison.is_same
        both = compared(known, changed, bars=True)
        assert both.is_level_same(both.levels[1]) is inside
    assert compared(results, other(results, response=1.001 * level.response)).levels[1].outputs[0].inside_bars is None


def test_states_losses_and_peaks_are_those_of_the_peak(results, pairs):
    level = results.levels[1]
    top = int(np.argmax(np.hypot(*level.response[:, 0, 1:3].T)))
    state, friction = level.state.copy(), level.friction.copy()
    state[top, :3] = (state[top, :3] + 1) % 3
    friction[top] *= 1.5
    comparison = compared(results, other(results, state=state, friction=friction)).levels[1]
    assert comparison.n_other_state == 3 and comparison.friction[1] == pytest.approx(1.5 * comparison.friction[0])
    assert comparison.outputs[0].peak_at == (level.frequency[top], level.frequency[top])


def test_statics_are_compared_by_their_means(results):
    still = [np.where(np.arange(7) == 0, 1.0 + level.response, 0.0) for level in results.levels]
    a = other(other(results, 0, response=still[0]), 1, response=still[1])
    b = other(a, response=1.1 * still[1])
    assert compared(a, a).is_same and compared(a, b).levels[1].difference == pytest.approx(0.1, rel=1e-3)
    with pytest.raises(CaseError, match="one of them is a static result"):
        compared(a, results)


# -- settings -------------------------------------------------------------------------------------------------------------


def test_keys_are_named_as_on_the_command_line():
    tables = {"solver": {"modes": 5}, "joints": [{"name": "lap", "friction": 0.3}], "loads": [{"phase": 0.5}, {"at": [1.0, 2.0]}]}
    assert flattened(tables) == {
        "solver.modes": "5",
        "joints.lap.name": '"lap"',
        "joints.lap.friction": "0.3",
        "loads.1.phase": "0.5",
        "loads.2.at": "[1.0, 2.0]",
    }


def test_keys_that_differ_are_listed_with_both_values(results):
    a = replace(results, scene_text="[solver]\nharmonics = 3\n[[joints]]\nname = 'lap'\nfriction = 0.3\n")
    b = replace(results, scene_text="# another\n[[joints]]\nfriction = 0.2\nname = 'lap'\n[solver]\nharmonics = 3\nmodes = 7\n")
    assert keys_changed(a, b) == [Change("joints.lap.friction", "0.3", "0.2"), Change("solver.modes", NOT_STATED, "7")]
    assert "joints.lap.friction  0.3  ->  0.2" in text_of(compared(a, b))
    assert keys_changed(a, replace(b, scene_text="no TOML"))[0].key == "the text of the scene"


def test_versions_options_ranks_and_files_that_differ_are_listed(results):
    origin = Origin(
        command="microslip run a.toml",
        started="2026-11-22 18:00:00 +0000",
        scene_path="/a/a.toml",
        hosts=("one",),
        environment={"OMP_NUM_THREADS": "1"},
        inputs=(InputFile("[model] mesh", "/a/m.msh", 6, 64 * "a"),),
    )
    a = replace(results, origin=origin)
    moved = replace(origin, hosts=("one", "one"), inputs=(InputFile("[model] mesh", "/b/n.msh", 6, 64 * "a"),))
    b = replace(results, origin=moved, versions={**results.versions, "numpy": "0"}, options=())
    assert [change.key for change in facts_changed(a, b)] == ["PETSc options", "version of numpy", "ranks"]
    assert inputs_changed(a, b) == [] and "files read: the same 1, by their hashes" in text_of(compared(a, b))
    edited = replace(b, origin=replace(moved, inputs=(InputFile("[model] mesh", "/b/n.msh", 7, 64 * "b"),)))
    (change,) = inputs_changed(a, edited) or ()
    assert change.a.startswith("6 bytes, SHA-256 aaaa") and change.b.startswith("7 bytes, SHA-256 bbbb")
    assert inputs_changed(results, b) is None and "A was written by an earlier version" in text_of(compared(results, b))


def test_the_structure_is_compared(results):
    joint = replace(results.joint, mu=0.9 * results.joint.mu)
    comparison = compared(
        replace(results, n_dof=5), replace(results, n_dof=6, joint=joint, mode_frequency=np.array([100.0, 312.6, 400.0]))
    )
    assert comparison.structure.pairs["mu"] == pytest.approx(0.1) and comparison.structure.same_pairs
    assert comparison.structure.modes == pytest.approx(0.1 / 312.5) and comparison.structure.mode == 2
    text = text_of(comparison)
    assert "5 -> 6 DOF" in text and "mu of the pairs by up to 10 %" in text and "2 -> 3 modes" in text
    moved = replace(results.joint, node1=results.joint.node1 + 1)
    assert "the pairs have other positions" in text_of(compared(results, replace(results, joint=moved)))


# -- the command ----------------------------------------------------------------------------------------------------------


def test_picture_json_and_status(pairs, tmp_path):
    a = write(tmp_path / "a", [branch(8.0, pairs)], pairs)
    b = write(tmp_path / "b", [branch(8.0, pairs, n_points=80)], pairs)
    c = write(tmp_path / "c", [branch(8.5, pairs)], pairs)
    text, status = compare_files(a, b, None, False, tmp_path / "out", True)
    assert status == 0 and json.loads(text) == json.loads((tmp_path / "out" / "diff.json").read_text())
    assert json.loads(text)["levels"][0]["is_same"] is True
    assert (tmp_path / "out" / "diff.png").read_bytes().startswith(b"\x89PNG")
    text, status = compare_files(a, c, None, False, tmp_path / "none", False)
    assert status == 1 and text.splitlines()[-1] == "different: no common level"
    assert not (tmp_path / "none" / "diff.png").exists()


def test_controls_in_titles_do_not_reach_the_terminal(results):
    comparison = compared(replace(results, scene_text='title = "\\u001b[31m"'), results)
    assert "\x1b" not in text_of(comparison)
