"""The bar of bar_scene.py under any loads, with any outputs and damping, and its linear motion by dense algebra."""

from __future__ import annotations

import numpy as np
from bar_scene import SCENE, write_bar

import microslip
from microslip.library.prepare import reduced
from microslip.library.settings import reduction_settings
from microslip.linear.joint_springs import joint_stiffness
from microslip.modes.lapack import gathered
from microslip.parallel.agree import on_root
from microslip.receptance.reduced_model import ReducedModel

LOADS = SCENE[SCENE.index("[[loads]]") : SCENE.index("[[outputs]]")]
OUTPUTS = SCENE[SCENE.index("[[outputs]]") : SCENE.index("[damping]")]
AXIS = 'mesh = "bar.msh"\naxis = [0.0, 0.0, 1.0]\naxis_point = [0.1, 0.0, 0.0]\n'


def scene_with(
    comm, folder, *, loads=LOADS, outputs=OUTPUTS, damping="ratio = 0.01", axis=False, files=None, name="bar", points=10, **solver
):
    """Return the scene with other tables; ``files`` are written next to it.  Collective."""

    def write():
        path = write_bar(folder, damping, **solver)
        for file, text in (files or {}).items():
            (folder / file).write_text(text)
        text = path.read_text().replace(LOADS, loads).replace(OUTPUTS, outputs)
        if axis:
            text = text.replace('mesh = "bar.msh"\n', AXIS)
        text = text.replace("points = 10", f"points = {points}")
        path = folder / f"{name}.toml"
        path.write_text(text)
        return path

    return microslip.read(on_root(comm, write))


def dense(structure):
    """Return K, M and K_J of a structure as arrays, on every rank.  Collective."""
    system = structure.linearised.system
    K, M = (system.comm.bcast(gathered(A)) for A in (system.K, system.M))
    return K, M, np.diag(joint_stiffness(structure.pairs))


def reduced_model(structure, scene=None):
    """Return the reduced model of a structure by the method of a scene, by default its own.  Collective."""
    settings = reduction_settings(scene or structure.scene)
    return ReducedModel.of(reduced(structure, settings).structure, settings.excitation)
