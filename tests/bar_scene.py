"""A bar supported only by its joint, on a plate: 135 DOF and 15 pairs, for the tests of the reduction methods."""

from __future__ import annotations

from pathlib import Path

from blocks import stacked
from msh import write_msh
from scene_text import driven, joint, steel, support, table, with_harmonics

from microslip.library.build import Structure, build
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.scene.read import read_scene
from microslip.scene.schema import Scene

N_DOF, N_PAIRS = 135, 15
COARSE_DOF, COARSE_PAIRS = 54, 6  # of the coarsest bar
COARSE = {"divisions": (2, 1, 1), "modes": COARSE_DOF}
EVERY_METHOD = {
    "receptance": {},
    "adaptive": {},
    "full": {},
    "craig-bampton": {},
    "rubin": {},
    "joint-interface-modes": {"interface_modes": 3 * COARSE_PAIRS},  # all of the coarsest bar
}
SCENE = (
    table("model", mesh="bar.msh")
    + steel("bar", "ground")
    + support("ground_base")
    + joint("bar_bottom", "ground_top", friction=0.05, preload=2.0e7)
    + driven([[0.05, 0.01, 0.02], [0.0, 0.0, 0.02]], [1.0, 0.3, 0.2], [1.0, 0.0, 0.0], "corner")
    + "[damping]\nDAMPING\n"
    + table("response", levels=[30.0], mode=1, span=[0.9, 1.1], points=10)
    + "[solver]\n"
)


def write_bar(folder: Path, damping: str = "ratio = 0.01", divisions=(4, 2, 1), **solver) -> Path:
    """Write mesh and scene with the given keys of [solver].  Local; returns the scene's path."""
    write_msh(str(folder / "bar.msh"), stacked("hex8", (0.05, 0.01, 0.02), divisions, ground_height=0.005))
    keys = [
        f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {str(value).lower()}"
        for key, value in with_harmonics(solver).items()
    ]
    path = folder / "bar.toml"
    path.write_text(SCENE.replace("DAMPING", damping) + "\n".join(keys) + "\n")
    return path


def bar(comm, folder: Path, damping: str = "ratio = 0.01", **options) -> tuple[Scene, Structure]:
    """Return the scene and its stuck structure.  Collective."""
    return stuck(comm, on_root(comm, lambda: write_bar(folder, damping, **options)))


def stuck(comm, path: Path) -> tuple[Scene, Structure]:
    """Return a scene and its stuck structure.  Collective."""
    scene = read_scene(path)
    return scene, build(scene, comm, RunLog(comm, screen=False))


def by(scene, method: str, **solver):
    """Return the scene with another method and other keys of [solver]."""
    return scene.model_copy(update={"solver": scene.solver.model_copy(update={"method": method, **solver})})
