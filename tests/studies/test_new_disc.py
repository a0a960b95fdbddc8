"""The table [cyclic] of a first scene: from the file, or from named faces that match by a rotation; the faces in check's picture."""

import re

import numpy as np
import pytest
from discs import sector
from msh import write_msh

from microslip.mesh.read import read_mesh
from microslip.scene.read import read_scene
from microslip.studies.check.marks import marks_of_scene
from microslip.studies.new.command import _write


def filled(path):
    """Fill in the missing entries of the scene; return its new text."""
    path.write_text(re.sub(r"^#> ", "", path.read_text(), flags=re.MULTILINE))
    return path.read_text()


def first_scene(folder, name, N=5, axis=(0.0, 0.0, 1.0), names=None):
    """Write the mesh of a sector at another position, and its first scene; return the scene's text and path."""
    bodies = {"disc": sector("hex8", N)["disc"]}
    z = np.array(axis) / np.linalg.norm(axis)
    x = np.cross(z, [0.3, -0.5, 0.2])
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(z, x), z]) if tuple(axis) != (0.0, 0.0, 1.0) else np.eye(3)
    disc = bodies["disc"]
    disc.points[:] = disc.points @ frame + [0.1, 0.2, 0.3]
    for old, new in (names or {}).items():
        disc.faces[new] = disc.faces.pop(old)
    write_msh(str(folder / f"{name}.msh"), bodies)
    out = folder / f"{name}.toml"
    return "\n".join(_write(str(folder / f"{name}.msh"), out, False)), out


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 2.0, -4.0)])
@pytest.mark.parametrize("N", [3, 7, 40])
def test_named_faces_that_match_by_a_rotation_give_the_table(tmp_path, N, axis):
    """Axis, a point of it and the order of the faces are those of the sector's definition."""
    report_text, out = first_scene(tmp_path, "sector", N, axis)
    first = filled(out)
    assert f"sector of {N}: " in report_text and "[cyclic]" in first
    stated = read_scene(out).cyclic
    along = np.array(axis) / np.linalg.norm(axis)
    reversed_ = along @ stated.axis < 0.0
    np.testing.assert_allclose(np.cross(stated.axis, along), 0.0, atol=1e-7)
    np.testing.assert_allclose(np.cross(np.subtract(stated.axis_point, [0.1, 0.2, 0.3]), along), 0.0, atol=1e-7)
    assert stated.sectors == N and stated.faces == (("high0", "low0") if reversed_ else ("low0", "high0"))


def test_matching_faces_with_other_names_are_a_comment(tmp_path):
    report_text, out = first_scene(tmp_path, "plain", names={"low0": "a", "high0": "b"})
    assert "sector of 5: a to b" in report_text and '#| faces = ["a", "b"]' in out.read_text()
    assert "[cyclic]" not in [line.strip() for line in out.read_text().splitlines()]


def test_a_box_is_no_sector(tmp_path):
    """Two sides at a right angle match by a quarter turn about their common edge."""
    from blocks import block

    def box(u, v, w):
        return 0.1 * np.stack([u, v, w], axis=-1)

    sides = {"x0": "low", "y0": "high", "z0": "left", "x1": "right", "y1": "sector", "z1": "period"}
    write_msh(str(tmp_path / "box.msh"), {"box": block("hex8", box, (2, 2, 2), sides)})
    report_text = "\n".join(_write(str(tmp_path / "box.msh"), tmp_path / "box.toml", False))
    assert "sector of" not in report_text and "cyclic" not in (tmp_path / "box.toml").read_text()


def test_the_picture_of_a_mesh_marks_both_faces(tmp_path):
    _, out = first_scene(tmp_path, "sector")
    filled(out)
    scene = read_scene(out)
    labels = [mark.label for mark in marks_of_scene(read_mesh(scene, None), scene) if "face" in mark.label]
    assert labels == ["low face: low0", "high face: high0"]
