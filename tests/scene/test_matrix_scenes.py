"""Scene files for matrices: every key is read, and a key of a mesh gives one message."""

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.messages.errors import CaseError
from microslip.scene.read import read_scene

DAMPING, MASS, PAIRS = "[damping]\nratio = 0.03\n", 'mass = "M.mtx"', 'pairs = "pairs.csv"'


@pytest.fixture
def path(tmp_path):
    return write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.4], (0.8, 2.4), outputs=[2])


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_every_key_is_read(path):
    scene = read_scene(path)
    assert (scene.model.mesh, scene.model.stiffness, scene.model.mass, scene.model.damping) == (None, "K.mtx", "M.mtx", None)
    assert (scene.joints[0].pairs, scene.joints[0].surfaces, scene.joints[0].friction_limit) == ("pairs.csv", None, "circle")
    loads = [(load.dof, load.scale, load.harmonic, load.phase) for load in scene.loads]
    assert loads == [
        (0, 1.0, 1, 0.0),
        (2, 0.3, 1, 0.0),
        (1, 0.7, 1, np.pi / 3),
        (1, 0.1, 2, 0.4),
        (2, 0.2, 2, 0.4),
        (0, 0.05, 0, 0.0),
        (2, -0.1, 0, 0.0),
    ]
    assert (scene.outputs[0].dof, scene.outputs[0].direction, scene.solver.modes) == (2, None, None)


def test_a_damping_matrix_replaces_damping(path):
    (path.parent / "C.mtx").touch()
    change(path, 'mass = "M.mtx"\n', 'mass = "M.mtx"\ndamping = "C.mtx"\n')
    change(path, DAMPING, "")
    assert (read_scene(path).model.damping, read_scene(path).damping) == ("C.mtx", None)


@pytest.mark.parametrize(
    "old, new, expected",
    [
        # keys of a mesh
        (
            "[damping]",
            "[materials.a]\nyoung = 1.0\npoisson = 0.3\ndensity = 1.0\n[damping]",
            "[materials.NAME]: belongs to a mesh",
        ),
        (MASS, MASS + "\nscale = 1.0", "[model]: scale belongs to a mesh; matrices are taken in SI units"),
        (
            PAIRS,
            PAIRS + "\nfriction = 0.3",
            '[[joints]] 1 ("joint"): friction belongs to a joint of surfaces; a CSV file states it',
        ),
        (PAIRS, PAIRS + "\ntolerance = 0.3", '[[joints]] 1 ("joint"): tolerance belongs to a joint of surfaces'),
        (
            '"2"\ndof = 2',
            '"2"\nposition = [0.0, 0.0, 0.0]\ndirection = [1.0, 0.0, 0.0]',
            '[[outputs]] 1 ("2"): a model given as matrices has no nodes',
        ),
    ],
)
def test_a_mistake_gives_one_message(path, old, new, expected):
    change(path, old, new)
    with pytest.raises(CaseError) as caught:
        read_scene(path)
    assert expected in str(caught.value) and "\n" not in str(caught.value)
