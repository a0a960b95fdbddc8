"""The leak test, shortened: a response of a few hundred points retains its records, and no other memory."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import leak
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_a_short_run_does_not_grow():
    """A leak of 15 kB per point would be visible: 200 points are 2 % of the program's memory."""
    command = [sys.executable, "jobs/bench/leak.py", "jobs/jenkins.toml", "--points", "400", "--settled", "200"]
    process = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    (rank,) = json.loads(process.stdout)["ranks"]
    assert process.returncode == 0 and rank["growth"] < 0.02
    assert 500.0 < rank["bytes_a_point"] < 20_000.0


def test_growth_excludes_the_memory_of_the_points():
    meter = leak.Meter(4)
    meter.resident[:], meter.recorded[:] = [90e6, 100e6, 105e6, 110e6], [0.0, 1e6, 2e6, 3e6]
    computed = leak.growth(meter, 2)
    assert computed["growth"] == pytest.approx(0.08) and computed["bytes_a_point"] == 1e6 and computed["settled_MB"] == 100.0


def test_the_size_of_a_point_includes_the_memory_of_its_arrays():
    @dataclass
    class Point:
        whole: np.ndarray
        part: np.ndarray

    big = np.zeros(1000)
    assert 16_000 < leak.size_of(Point(np.zeros(1000), big[:10])) < 17_000
