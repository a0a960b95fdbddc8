"""A disc with the pairs of all sectors, [cyclic] whole, compared with the same full ring; on any number of ranks."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from discs import write_ring, write_ring_of_blades, write_sector
from mpi4py import MPI
from scipy.spatial import cKDTree

from microslip.library.backbone import backbone
from microslip.library.build import build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.library.response import Response
from microslip.library.sweep import sweep
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.points.error_parts import total
from microslip.points.peak import top_of_curve
from microslip.receptance.motions import output_motion
from microslip.results.fields import read_fields
from microslip.results.plots import draw_one
from microslip.results.read import read_results
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
N_DOF, N_SHROUDED = 54, 90  # of a sector of hex8, without and with shrouds


def end(modes, level, frequency, **solver):
    """Return the tables of damping, response and solver for one frequency."""
    more = "".join(
        f"{key} = {str(value).lower()}\n"
        for key, value in ({"harmonics": 3, "error_bars": False, "tolerance": 1e-10, "samples": 120} | solver).items()
    )
    return (
        f"[damping]\nratio = 0.01\n[response]\nlevels = [{level}]\nfrequencies = [{0.995 * frequency}, {1.005 * frequency}]\n"
        f"at = [{frequency}]\npoints = 8\n[solver]\nmodes = {modes}\n{more}"
    )


def built(write, folder, *args, **how):
    """Return the structure of a scene that rank 0 writes.  Collective."""
    return build(read_scene(on_root(COMM, lambda: write(folder, *args, **how))), COMM)


def at_frequency(structure, level, frequency):
    """Return the coefficients of the outputs, the number of pairs that slip, and p, at a frequency."""
    prepared = prepare(structure)
    branch = Response(prepared, follow(prepared.response)).level(level)
    assert not branch.failure
    i = int(np.argmin(np.abs(branch.frequency - frequency)))
    assert branch.frequency[i] == pytest.approx(frequency, rel=1e-12)
    return branch.response[i], int((branch.state[i] == 1).sum()), branch.p[i]


def sector_factors(**columns):
    """Return the tables of sectors."""
    n = len(next(iter(columns.values())))
    rows = [
        "[[cyclic.sector]]\n" + f"number = {s}\n" + "".join(f"{key} = {values[s]}\n" for key, values in columns.items())
        for s in range(n)
    ]
    return "".join(rows)


ALIKE = [pytest.param(5, 2, 1420.0, 20.0, 0.05, marks=pytest.mark.ranks(1)), (6, 7, 1436.0, 20.0, 0.05)]


@pytest.mark.parametrize(("N", "h", "frequency", "level", "friction"), ALIKE)
def test_a_disc_of_equal_sectors_has_the_response_of_one_sector(shared_path, N, h, frequency, level, friction):
    how = {"friction": friction, "wave": {"engine_order": h}}
    of_sector = built(write_sector, shared_path, N, end(N_DOF, level, frequency), name="one", **how)
    of_one, n_slip, _ = at_frequency(of_sector, level, frequency)
    how["wave"] = how["wave"] | {"whole": True}
    whole = built(write_sector, shared_path, N, end(N_DOF, level, frequency), name="whole", **how)
    of_whole, n_slip_of_whole, _ = at_frequency(whole, level, frequency)
    assert n_slip_of_whole == N * n_slip > 0
    assert whole.alike.group == h % N and whole.alike.per_group.groups == of_sector.per_group.groups
    size = np.abs(of_one).max()
    np.testing.assert_allclose(of_whole[0], of_one[0], atol=1e-8 * size)
    c, lead = of_whole[:, 1] - 1j * of_whole[:, 2], np.exp(2j * np.pi * h * np.arange(N) / N)
    np.testing.assert_allclose(c, c[0] * lead, atol=1e-8 * size)
    of_sector.close()
    whole.close()


DIFFER = [0.7, 1.1, 0.9, 1.25, 1.0, 0.85]


@pytest.mark.ranks(1)
@pytest.mark.parametrize("d", (0, 3))
def test_a_simple_nonlinear_mode_of_equal_sectors_is_that_of_one_sector(shared_path, d):
    """All sectors move alike, or neighbours in opposite directions; modes of the other nodal diameters occur in pairs, and are rejected."""
    wave, of = {"engine_order": d or 6}, end(N_DOF, 20.0, 1436.0)
    of_sector = built(write_sector, shared_path, 6, of, name="one", wave=wave, friction=0.05)
    whole = built(write_sector, shared_path, 6, of, name="whole", wave=wave | {"whole": True}, friction=0.05)
    number = int(np.argmin(np.abs(whole.omega_n - of_sector.omega_n[0])))
    options = {"farthest": 1.3, "quasi_static": False, "error_bars": False}
    one, every = backbone(of_sector, **options), backbone(whole, mode=number + 1, **options)
    assert one.failure is None and every.failure is None
    last, last_of_whole = one.points[-1], every.points[-1]
    assert last.amplitude / one.first_slip == pytest.approx(1.3, rel=1e-9)
    assert last_of_whole.amplitude / every.first_slip == pytest.approx(1.3, rel=1e-9)
    assert np.count_nonzero(last_of_whole.state == 1) == 6 * np.count_nonzero(last.state == 1) > 0
    assert last_of_whole.omega == pytest.approx(last.omega, rel=1e-9)
    assert last_of_whole.sigma == pytest.approx(last.sigma, rel=1e-8)
    pair = int(np.argmin(np.diff(whole.omega_n[:6])))
    with pytest.raises(CaseError, match=f"modes {pair + 1}, {pair + 2} have the same frequency"):
        backbone(whole, mode=pair + 1, **options)
    of_sector.close()
    whole.close()


@pytest.mark.ranks(1)
def test_a_sweep_takes_the_peak_of_any_sector(shared_path):
    """The output of sector 1 in a sweep of one sample is that of the response."""
    wave = {"engine_order": 2, "whole": True}
    path = write_sector(shared_path, 5, end(N_DOF, 2.0, 1420.0), wave=wave, friction=0.05)
    whole = build(read_scene(path, ["cyclic.scatter={load=0.3, seed=1}"]), COMM)
    table = sweep(whole, {"level": [2.0]}, output="tip 1")
    sizes = np.array([table_of.nominal.amplitude for table_of in (table, sweep(whole, {"level": [2.0]}, output="tip"))])
    assert table.output == "tip 1" and table.samples[0].amplitude == pytest.approx(sizes[0], rel=1e-9)
    assert abs(sizes[0] / sizes[1] - 1.0) > 1e-2
    with pytest.raises(CaseError, match="there are tip, each followed by a sector, 0 to 4"):
        sweep(whole, {"level": [2.0]}, output="tip 5")
    whole.close()


def of_sectors(ring, whole):
    """Return the pair of the whole disc at the position of each pair of the ring, and its sector."""
    distance, at = cKDTree(whole.pairs.position).query(ring.pairs.position)
    assert distance.max() < 1e-12 and len(np.unique(at)) == whole.pairs.n_pairs == ring.pairs.n_pairs
    return at, at // (whole.pairs.n_pairs // len(whole.weights))


@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    ("N", "frequency", "level", "n_least"), [(6, 1436.0, 20.0, 7), pytest.param(12, 1320.0, 4.0, 7, marks=pytest.mark.slow)]
)
def test_the_response_of_different_sectors_is_that_of_the_ring(shared_path, N, frequency, level, n_least):
    """Friction, preload and load differ between sectors."""
    h, random = 1, np.random.default_rng(5)
    factors = {name: random.uniform(0.8, 1.2, N) for name in ("friction", "preload", "load")}
    solved = end(N_DOF, level, frequency) + sector_factors(**factors)
    whole = built(write_sector, shared_path, N, solved, wave={"engine_order": h, "whole": True}, friction=0.05)
    solved = end(N * N_DOF, level, frequency)
    ring = built(write_ring, shared_path, N, solved, h=h, n_outputs=N, loads=factors["load"], friction=0.05)
    at, sector = of_sectors(ring, whole)
    mu, N0 = ring.pairs.mu * factors["friction"][sector], ring.pairs.N0 * factors["preload"][sector]
    ring = replace(ring, pairs=replace(ring.pairs, mu=mu, N0=N0))
    of_ring, n_slip_of_ring, p_of_ring = at_frequency(ring, level, frequency)
    of_whole, n_slip, p = at_frequency(whole, level, frequency)
    errors = np.abs(of_whole - of_ring).max() / np.abs(of_ring).max(), np.abs(p[at] - p_of_ring).max() / np.abs(p).max()
    print(f"N = {N}, {n_slip} of {whole.pairs.n_pairs} pairs slip: response off by {errors[0]:.1e}, forces by {errors[1]:.1e}")
    assert n_slip == n_slip_of_ring >= n_least
    np.testing.assert_allclose(of_whole, of_ring, atol=1e-6 * np.abs(of_ring).max())
    np.testing.assert_allclose(p[at], p_of_ring, atol=1e-6 * np.abs(p).max())
    ring.close()
    whole.close()


def stuck_response(structure, frequencies):
    """Return the complex amplitudes of the outputs with all pairs stuck, (n_frequencies, n_outputs)."""
    model = prepare(structure).model
    none = np.zeros((3 * model.n_pairs, model.N_H))
    u = np.array([output_motion(model, 1.0, 2.0 * np.pi * f, none) for f in frequencies])
    return u[:, :, 1] - 1j * u[:, :, 2]


def misses(shared_path, modes, **factors):
    """Return the largest errors of the outputs with some numbers of modes, relative to the peak of the ring with all modes."""
    N, h, frequencies = 4, 1, np.linspace(1380.0, 1450.0, 15)
    ring = built(write_ring_of_blades, shared_path, N, end(N * N_DOF, 1.0, 1410.0), h, 0.05, **factors)
    of_ring, errors = stuck_response(ring, frequencies), []
    ring.close()
    for n in modes:
        solved = end(n, 1.0, 1410.0) + sector_factors(**factors)
        wave = {"engine_order": h, "whole": True, "blades": ["blade"]}
        whole = built(write_sector, shared_path, N, solved, wave=wave, friction=0.05)
        errors.append(np.abs(stuck_response(whole, frequencies) - of_ring).max() / np.abs(of_ring).max())
        whole.close()
    return errors


def test_the_response_with_different_contact_stiffness_is_that_of_the_ring(shared_path):
    assert misses(shared_path, [N_DOF], contact_stiffness=np.array([0.7, 1.2, 1.0, 1.4]))[0] < 1e-9


@pytest.mark.ranks(1)
def test_the_response_of_different_blades_is_that_of_the_ring(shared_path):
    """They are exact with all modes; with fewer modes the error falls with their number."""
    factors = {"stiffness": np.array([1.02, 0.97, 1.01, 0.985]), "density": np.array([0.99, 1.0, 1.02, 1.01])}
    errors = misses(shared_path, [8, 24, N_DOF], **factors)
    assert errors[2] < 1e-9 and errors[1] < errors[0] < 1e-6


def test_the_response_of_different_blades_with_slip_is_that_of_the_ring(shared_path):
    N, h, frequency, level = 6, 1, 1436.0, 20.0
    factors, how = {"stiffness": np.array([1.02, 0.97, 1.01, 0.985, 1.0, 1.03])}, {"harmonics": 1, "samples": 64}
    ring = built(write_ring_of_blades, shared_path, N, end(N * N_DOF, level, frequency, **how), h, 0.05, **factors)
    of_ring, n_slip_of_ring, _ = at_frequency(ring, level, frequency)
    solved, wave = end(8, level, frequency, **how) + sector_factors(**factors), {"whole": True, "blades": ["blade"]}
    whole = built(write_sector, shared_path, N, solved, wave=wave | {"engine_order": h}, friction=0.05)
    of_whole, n_slip, _ = at_frequency(whole, level, frequency)
    assert n_slip == n_slip_of_ring > N
    np.testing.assert_allclose(of_whole, of_ring, atol=1e-4 * np.abs(of_ring).max())
    ring.close()
    whole.close()


def test_a_disc_with_other_differences_of_its_sectors_is_that_of_its_own_scene(shared_path):
    """From the factor and the modes of the first disc; a scene that differs in more is refused."""
    N, frequency = 6, 1436.0
    solved = end(8, 20.0, frequency, samples=64)
    wave = {"whole": True, "blades": ["blade"], "engine_order": 1}
    path = on_root(COMM, lambda: write_sector(shared_path, N, solved, wave=wave, friction=0.05))
    scenes = [read_scene(path, [f"cyclic.scatter={{stiffness=0.02, friction=0.1, load=0.1, seed={seed}}}"]) for seed in (1, 2)]
    first, second = (build(scene, COMM) for scene in scenes)
    shared = first.with_sectors(scenes[1])
    expected, n_slip, _ = at_frequency(second, 20.0, frequency)
    found, n_slip_of_shared, _ = at_frequency(shared, 20.0, frequency)
    assert n_slip == n_slip_of_shared > N
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())
    assert np.abs(at_frequency(first, 20.0, frequency)[0] - expected).max() > 1e-3 * np.abs(expected).max()
    shared.close()  # the first disc is as before
    for setting in ("joints.root.friction=0.06", "cyclic.engine_order=2"):
        with pytest.raises(CaseError, match="only scatter, sector and table of"):
            first.with_sectors(read_scene(path, [*scenes[1].settings, setting]))
    elsewhere = on_root(COMM, lambda: shutil.copytree(shared_path, shared_path / "elsewhere")) / path.name
    with pytest.raises(CaseError, match="from a scene in the same folder"):  # its mesh may be another
        first.with_sectors(read_scene(elsewhere, scenes[1].settings))
    alike_blades = build(read_scene(path, ["cyclic.scatter={friction=0.1, seed=1}"]), COMM)
    with pytest.raises(CaseError, match="the blades differ only if they differ there"):
        alike_blades.with_sectors(scenes[0])
    with pytest.raises(CaseError, match="no disc whose sectors may differ"):
        first.alike.with_sectors(scenes[0])
    for structure in (first, second, alike_blades):
        structure.close()


def test_a_sweep_of_the_differences_of_sectors_has_the_modes_of_its_disc(shared_path, monkeypatch):
    N, level = 4, 0.05
    solved = re.sub(r"frequencies = .*\nat = .*", "mode = 1\nspan = [0.97, 1.03]", end(8, level, 1420.0, samples=32))
    wave = {"whole": True, "blades": ["blade"], "engine_order": 1}
    path = on_root(COMM, lambda: write_sector(shared_path, N, solved, wave=wave))
    scenes = [read_scene(path, [f"cyclic.scatter={{stiffness=0.005, load=0.2, seed={seed}}}"]) for seed in (1, 2)]
    structure, other = (build(scene, COMM) for scene in scenes)
    monkeypatch.setattr("microslip.library.sample_peaks.build", None)
    table = sweep(structure, {"cyclic.scatter.seed": [1, 2]})
    curves = [Response(each, follow(each.response)).level(level) for each in map(prepare, (structure, other))]
    tops = [top_of_curve(curve.frequency, np.hypot(*curve.response[:, 0, 1:3].T))[1] for curve in curves]
    np.testing.assert_allclose(table.amplitude, tops, rtol=2e-3)
    assert abs(tops[0] - tops[1]) > 0.01 * tops[0]
    structure.close()
    other.close()


def test_a_run_writes_fields_of_different_sectors(shared_path, program):
    """Fields are those of the outputs, and are continuous where sectors meet."""
    N, frequency = 5, 1420.0
    text = end(8, 0.01, frequency, samples=32).replace("points = 8", "points = 8\nstability = true\nsensitivities = true")
    text += sector_factors(load=[1.0, 0.2, 1.5, -0.3, 0.8])
    path = on_root(COMM, lambda: write_sector(shared_path, N, text, wave={"engine_order": 2, "whole": True}))
    status, _, messages = program("run", str(path), "--out", str(shared_path / "out"))
    assert status == 0, messages
    COMM.barrier()
    results, fields = read_results(str(shared_path / "out" / "results.h5")), read_fields(str(shared_path / "out" / "results.h5"))
    assert results.outputs == tuple(f"tip {s}" for s in range(N))
    (motion,), (level,) = fields.peaks.values(), results.levels
    table = np.genfromtxt(shared_path / "out" / "sectors.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["sector"], np.arange(N))
    sizes = np.hypot(*np.moveaxis(level.response[:, :, 1:3], -1, 0))
    peaks = np.array([top_of_curve(level.frequency, size)[1] for size in sizes.T])
    assert (peaks >= sizes.max(axis=0)).all() and (peaks < 1.01 * sizes.max(axis=0)).all()
    np.testing.assert_allclose(table["peak"], peaks, rtol=1e-8)
    alike = table["peak"] / table["amplification"]
    np.testing.assert_allclose(alike, alike[0], rtol=1e-8)
    assert 0.5 * peaks.mean() < alike[0] < 2.0 * peaks.max()
    (page,) = draw_one(results, "sectors")
    np.testing.assert_allclose(page.figure.axes[0].lines[0].get_ydata() / peaks, 1e9 / level.level, rtol=1e-8)  # nm/N
    u = motion.u[:, :, 1] - 1j * motion.u[:, :, 2]
    at = np.searchsorted(fields.mesh.numbers, fields.output_node)
    reported = np.einsum("si,si->s", fields.output_direction, u[at])
    response = level.response[motion.point]
    np.testing.assert_allclose(reported, response[:, 1] - 1j * response[:, 2], rtol=1e-6)
    disc = np.unique(np.concatenate([each.nodes.ravel() for each in fields.mesh.elements if each.group == "disc"]))
    close = cKDTree(fields.mesh.points[disc]).query_pairs(1e-9, output_type="ndarray")
    assert len(close) == 4 * N  # where sectors meet
    np.testing.assert_allclose(u[disc[close[:, 0]]], u[disc[close[:, 1]]], atol=1e-6 * np.abs(u).max())


@pytest.mark.study
@pytest.mark.parametrize(
    ("N", "frequency"), [(3, 1415.0), pytest.param(5, 1436.0, marks=[pytest.mark.slow, pytest.mark.ranks(1)])]
)
def test_multipliers_of_all_sectors_are_those_of_the_ring(shared_path, N, frequency):
    """All pairs of three sectors stick, and half of the pairs of five sectors slip."""
    multipliers = []
    for write, n_dof, how in (
        (write_sector, N_DOF, {"wave": {"engine_order": 1, "whole": True}}),
        (write_ring, N * N_DOF, {"h": 1}),
    ):
        solved = end(n_dof, 20.0, frequency, samples=60).replace("points = 8", "points = 4\nstability = true")
        structure = built(write, shared_path, N, solved, friction=0.05, **how)
        (branch,) = follow(prepare(structure).response)
        point = min(branch.points, key=lambda point: abs(point.omega / (2.0 * np.pi) - frequency))
        assert not branch.failure and int((point.state == 1).sum()) == (10 if N == 5 else 0)
        multipliers.append(point.multipliers[:, 0] + 1j * np.abs(point.multipliers[:, 1]))
        structure.close()
    np.testing.assert_allclose(*multipliers, atol=1e-6)


@pytest.mark.study
def test_the_response_with_different_gaps_is_that_of_the_ring(shared_path):
    """Shrouds that are open at rest by a different gap in each sector close under the load in some sectors only."""
    N, h, frequency, level = 4, 1, 930.0, 60.0
    gap, how = np.array([0.4, 1.0, 1.8, 0.7]), {"how": {"shroud": True}, "of_shrouds": {"gap": 2.0e-6}}
    solved = end(N_SHROUDED, level, frequency) + sector_factors(gap=gap)
    whole = built(write_sector, shared_path, N, solved, wave={"engine_order": h, "whole": True}, **how)
    ring = built(write_ring, shared_path, N, end(N * N_SHROUDED, level, frequency), h=h, n_outputs=N, **how)
    at, sector = of_sectors(ring, whole)
    N0 = np.where(ring.pairs.N0 < 0.0, gap[sector], 1.0) * ring.pairs.N0
    np.testing.assert_allclose(whole.pairs.N0[at], N0, rtol=1e-12)
    ring = replace(ring, pairs=replace(ring.pairs, N0=N0))
    of_ring, _, p_of_ring = at_frequency(ring, level, frequency)
    of_whole, _, p = at_frequency(whole, level, frequency)
    closes = np.abs(p_of_ring[N0 < 0.0]).max(axis=(1, 2)) > 1e-6 * np.abs(p).max()
    assert closes.any()
    np.testing.assert_allclose(of_whole, of_ring, atol=1e-6 * np.abs(of_ring).max())
    in_axes, in_axes_of_ring = (  # the axes of the pairs differ if "tangent" is not stated
        np.einsum("pji,pjh->pih", pairs.frame, forces) for pairs, forces in ((whole.pairs, p), (ring.pairs, p_of_ring))
    )
    np.testing.assert_allclose(in_axes[at], in_axes_of_ring, atol=1e-6 * np.abs(p).max())
    ring.close()
    whole.close()


def test_error_bars_of_different_sectors_bound_the_truncation_error(shared_path):
    """Errors of few modes, harmonics and samples compared with many, in every sector."""
    N, level, frequency = 3, 20.0, 1436.0
    factors = sector_factors(friction=[0.8, 1.3, 1.0], load=[1.0, 0.9, 1.2])

    def points(modes, **solver):
        solved = end(modes, level, frequency, **solver) + factors
        whole = built(write_sector, shared_path, N, solved, wave={"engine_order": 1, "whole": True}, friction=0.05)
        (branch,) = follow(prepare(whole).response)
        assert not branch.failure
        point = branch.points[int(np.argmin(np.abs([point.omega / (2.0 * np.pi) - frequency for point in branch.points])))]
        whole.close()
        return point.response[:, 1] - 1j * point.response[:, 2], point.error

    coarse, error = points(6, samples=64, error_bars=True)
    fine, _ = points(N_DOF, harmonics=9, samples=512)
    bars, missed = np.array([total(of_output) for of_output in error]), np.abs(coarse - fine)
    assert bars.shape == (N,) and (missed <= bars).all() and (bars < 30.0 * missed).all() and (missed > 0.0).all()
