"""A range about a mode whose number includes pairs of a closed gap: `check` and `run` state it, with the frequency at rest."""

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes

STIFFNESS = np.array([[2.0, -0.5], [-0.5, 8.0]])
SYSTEM = scenes.make_system(
    "stop of the first of two masses",
    np.eye(2),
    STIFFNESS,
    [[-1, -1, 0, -1, -1, -1]],
    mu=0.0,
    N0=-1.0,
    k_t=0.0,
    k_n=3.0,
    C=0.02 * np.eye(2),
    loads=[{"vector": [1.0, 0.0], "harmonic": 1}],
    output=[1.0, 0.0],
    omega=(0.5, 2.0),
    levels={},
)


@pytest.mark.parametrize(
    ("mode", "changes", "expected"),
    [
        (1, {}, "WARNING: {mode}its frequency is {open}; state"),
        (2, {}, "{mode}its frequency is {open}"),
        (1, {"K": STIFFNESS - np.diag([2.0 - 0.25 / 8.0, 0.0])}, "WARNING: {mode}a body has no support"),
        (1, {"N0": np.ones(1)}, None),
        (None, {}, None),
    ],
)
def test_the_frequency_at_rest_of_a_mode_with_closed_gaps_is_stated(tmp_path, program, mode, changes, expected):
    path = write_matrix_scene(tmp_path, SYSTEM | changes, [0.01], (0.5, 2.0), harmonics=1, samples=32, points=5)
    about = ["--set", f"response={{levels=[0.01], points=5, mode={mode}, span=[0.97, 1.02]}}"] if mode else []
    _, checked, _ = program("check", path, *about)
    _, out, _ = program("run", path, *about, "--out", str(tmp_path / "out"))  # the mass without support is not solved
    notes = [line for line in out.splitlines() if "of a gap closed" in line]
    if expected is None:
        assert not notes and "of a gap closed" not in checked
        return
    at_rest = f"{np.sqrt(np.linalg.eigvalsh(STIFFNESS)[mode - 1]) / (2.0 * np.pi):.6g} Hz"
    counts = f"mode = {mode} counts with 1 pair of a gap closed"
    assert f"WARNING: {counts}; a run states" in checked
    (note,) = notes
    assert note.startswith(expected.format(mode=f"[response] {counts}; with them open ", open=at_rest))
