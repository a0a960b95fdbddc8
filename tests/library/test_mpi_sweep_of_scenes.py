"""microslip.sweep of a scene with [statics] and of a disc, compared with separate structures."""

import numpy as np
import pytest
from discs import write_sector
from rest_scene import folder_with_bar, force, scene_of
from scene_text import table

import microslip
from microslip.continuation.point_record import HELD
from microslip.library.sample_peaks import SamplePeaks, half_power_of
from microslip.library.varied import Varied
from microslip.parallel.agree import on_root

pytestmark = pytest.mark.ranks(1, 2)

SHARPER = "samples = 64\ntolerance = 1e-10"  # springs of a thousandth hold the mean slip: 1e-8 leaves 1e-6 of the amplitude
SMOOTH = ("amplitude", "frequency", "damping")


def check(comm, scene, samples):
    """Compare each sample with the peak of a separate structure; return the table.  Collective."""
    with microslip.build(scene, comm) as structure:
        swept = microslip.sweep(structure, samples, paired=True)
    assert swept.is_done.all()
    for i in range(len(swept)):
        settings = [f"{key}={values[i]}" for key, values in samples.items()]
        with microslip.build(microslip.read(scene.path, settings), comm) as structure:
            separate = microslip.sweep(structure, {"level": max(scene.response.levels)}).nominal
        for name in SMOOTH:
            bound = 1e-5 if name == "damping" else 1e-6
            assert swept[name][i] == pytest.approx(getattr(separate, name), rel=bound), name
    return swept


folder = pytest.fixture(scope="module")(folder_with_bar)


def sliding(comm, folder, samples=SHARPER):
    """Return a bar pressed onto the ground; most pairs slip at a friction of 0.1, but not at its nominal friction.  Collective."""
    more = ("levels = [5.0]", "levels = [20.0]"), ("span = [0.9, 1.1]", "span = [0.8, 1.1]"), ("samples = 64", samples)
    return scene_of(comm, folder, force(50.0, 0.0, -1000.0), *more, ("harmonics = 3", "harmonics = 1"))


@pytest.mark.study
@pytest.mark.ranks(2)
def test_a_sliding_sample_is_held_from_the_start_and_has_the_width_of_its_curve(comm, folder, monkeypatch):
    searched, searches = [], SamplePeaks._searched
    with microslip.build(sliding(comm, folder, "samples = 64"), comm) as structure:
        peaks = SamplePeaks(structure, Varied.of(structure.scene, ["joints.joint.friction"]))
        monkeypatch.setattr(SamplePeaks, "_searched", lambda *args: searched.append(args[4]) or searches(*args))
        sample = peaks.solve([0.1])
        peaks.close()
        points = microslip.respond(structure, friction=0.1, error_bars=False).branches[0].points
    assert searched[0] and HELD in sample.why
    sizes, omega = [float(np.hypot(*point.response[0, 1:3])) for point in points], [point.omega for point in points]
    top, ends = int(np.argmax(sizes)), []
    for way in (range(top, len(sizes)), range(top, -1, -1)):
        before, after, share = half_power_of(sizes, way)
        ends.append(omega[before] + share * (omega[after] - omega[before]))
    assert 2.0 * np.pi * sample.width == pytest.approx(abs(ends[0] - ends[1]), rel=0.02)


@pytest.mark.slow
@pytest.mark.ranks(2)
def test_friction_changes_the_state_of_rest(comm, folder):
    more = ("levels = [5.0]", "levels = [15.0]"), ("harmonics = 3", "harmonics = 1")
    scene = scene_of(comm, folder, force(10.0, 0.0, -1000.0), *more)
    swept = check(comm, scene, {"joints.joint.friction": [0.12]})
    assert swept.slipping[0] > 0 and swept.amplitude[0] != pytest.approx(swept.nominal.amplitude, rel=1e-3)


@pytest.mark.study
@pytest.mark.ranks(2)
def test_a_sliding_sample_has_another_state_of_rest(comm, folder):
    swept = check(comm, sliding(comm, folder), {"joints.joint.friction": [0.1]})
    assert HELD in swept.samples[0].why and HELD not in swept.nominal.why


@pytest.mark.study
@pytest.mark.ranks(1)
def test_a_sweep_varies_the_friction_of_a_disc(comm, folder):
    end = table("damping", ratio=0.01) + table("response", levels=[40.0], mode=1, span=[0.9, 1.03], points=10)
    end += table("solver", modes=4, harmonics=1, samples=60, error_bars=False)
    scene = microslip.read(on_root(comm, lambda: write_sector(folder, 5, end, preload=2.0e6)))
    swept = check(comm, scene, {"joints.root.friction": [0.05]})
    assert swept.slipping[0] > 0 and swept.amplitude[0] != pytest.approx(swept.nominal.amplitude, rel=1e-3)
