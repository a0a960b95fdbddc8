"""What is wrong with a mesh or a scene is said once, in one message, with status 2 on every rank, and nothing hangs."""

import signal

import numpy as np
import pytest
from lap_scene import SCENE, write_mesh
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.__main__ import main
from microslip.parallel.agree import on_root
from microslip.system.signals import STOPPING


@pytest.fixture(scope="module")
def mesh(comm, tmp_path_factory):
    """The lines of a small Gmsh file of two overlapping beams; the same on every rank."""
    return comm.bcast(write_mesh(tmp_path_factory.mktemp("mesh") / "lap.msh"))


@pytest.fixture
def said(comm, shared_path, capfd):
    """Return what to call with a scene and the lines of a mesh: runs the program and gives its messages.  Collective."""
    handlers = {number: signal.getsignal(number) for number in (*STOPPING, signal.SIGUSR1)}

    def run(scene, lines, command="run"):
        if comm.rank == 0:
            (shared_path / "lap.toml").write_text(scene)
            (shared_path / "lap.msh").write_text("\n".join(lines) + "\n")
        comm.Barrier()
        out = ["--out", str(shared_path / "out")] if command == "run" else []
        status = main([command, str(shared_path / "lap.toml"), *out])
        assert set(comm.allgather(status)) == {2}
        return "".join(comm.allgather(capfd.readouterr().err))

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


TIE = '[[ties]]\nname = "glue"\nsurfaces = ["A", "B"]\n'
POINT = """[[points]]
name = "p"
position = [0.3, 0.0, 0.0]
group = "tip"
[[outputs]]
name = "p"
point = "P"
direction = [0.0, 0.0, 1.0]
"""


def number(lines, section, i):
    """Return the index of the i-th entry of a section of the file."""
    return lines.index(section) + 2 + i


def with_nan(lines):
    row = number(lines, "$Nodes", 4)
    x = lines[row].split()
    return [*lines[:row], f"{x[0]} {x[1]} nan {x[3]}", *lines[row + 1 :]]


def with_inverted_element(lines):
    row = next(row for row in range(number(lines, "$Elements", 0), len(lines)) if lines[row].split()[1] == "5")
    words = lines[row].split()
    return [*lines[:row], " ".join([*words[:-8], *words[-4:], *words[-8:-4]]), *lines[row + 1 :]]


@pytest.mark.parametrize(
    "change, messages",
    [
        (with_nan, ["1 of ", "not a finite number", "node 5 at"]),
        (with_inverted_element, ["1 elements are inverted or collapsed", "det J = -"]),
        (lambda lines: lines[: len(lines) // 2], ["the file is truncated"]),
        (lambda lines: ["not a mesh"], ["this is not a Gmsh file"]),
    ],
)
def test_a_bad_mesh(said, mesh, change, messages):
    text = said(SCENE, change(mesh))
    assert text.count("microslip: error: ") == 1
    assert "Traceback" not in text
    assert all(message in text for message in ["lap.msh", *messages])


@pytest.mark.parametrize(
    "old, new, messages",
    [
        ('"clamp"', '"clmp"', ["[[supports]] 1 group = 'clmp'", "nearest is 'clamp'", "it has: "]),
        ('"lap_2"', '"clamp"', ["joint 'lap'", "have no partner within", "the worst is node"]),
        (SCENE[SCENE.index("[[supports]]") : SCENE.index("[[joints]]")], "", ["nothing holds body 'left'", "it can move freely"]),
        (SCENE[SCENE.index("[[joints]]") : SCENE.index("[[loads]]")], "", ["nothing holds body 'right'", "it can move freely"]),
        (
            "[damping]",
            TIE.replace("A", "clamp").replace("B", "tip") + "[damping]",
            ["tie 'glue': ", "lie farther than", "worst is node"],
        ),
        (
            "[damping]",
            TIE.replace("A", "lap_1").replace("B", "lap_2") + "[damping]",
            ["of joint 'lap' are faces of", "cannot slip"],
        ),
        ("[damping]", POINT + "[damping]", ["[[outputs]] 2 (", 'point = "P": there is no such point; nearest is "p"']),
        ("modes = 5", "modes = 5000", ["[solver] modes = 5000: the structure has only", "degrees of freedom"]),
        ("[0.21, 0.0, 0.0]", "[26.0, 0.0, 0.0]", ["[[outputs]] 'tip' position", "from the nearest node"]),
    ],
)
def test_a_scene_that_does_not_fit_its_mesh(said, mesh, old, new, messages):
    text = said(SCENE.replace(old, new, 1), mesh)
    assert text.count("microslip: error: ") == 1
    assert "Traceback" not in text
    assert all(message in text for message in messages)


def test_the_check_finds_it_as_well(said, mesh):
    text = said(SCENE, with_nan(mesh), command="check")
    assert text.count("microslip: error: ") == 1
    assert "not a finite number" in text


@pytest.mark.parametrize("command", ["check", "run"])
def test_matrices_that_do_not_fit_each_other(comm, shared_path, program, command):
    system = {**scenes.spatial_mass(), "M": np.eye(2)}
    scene = on_root(comm, lambda: write_matrix_scene(shared_path, system, [0.4], (1.0, 1.6), outputs=[0]))
    status, _, text = program(command, scene)
    assert status == 2 and text.count("microslip: error: ") == 1 and "Traceback" not in text
    assert text.count("M.mtx: [model] mass is 2 x 2, but the stiffness 3 x 3") == 1
