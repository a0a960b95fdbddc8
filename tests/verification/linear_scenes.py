"""Frequencies of structures without a joint, through all stages from scene and mesh files, compared with theory.

    PYTHONPATH=solver:tests:meshes python tests/verification/linear_scenes.py

- *cantilever*: 10 x 0.8 x 1.2 m of hex20 with nu = 0, so that the clamped end has no lateral contraction: Timoshenko's beam in both
  directions and the bar along the axis;
- *free plate*: 1 x 1 x 0.02 m of hex20. Its modes that are antisymmetric in both directions are those of a quarter whose cuts
  are held along the plate and across it; with half the thickness and the middle plane held along the plate, it has no rigid motion.
  Mindlin's plate by the Ritz method (``oracles.structures``).
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from blocks import box
from mpi4py import MPI
from msh import write_msh
from oracles import structures
from scene_text import driven, response, steel, support, table

from microslip.library.build import build
from microslip.scene.read import read_scene

YOUNG, DENSITY = 210e9, 7850.0  # Pa, kg/m3
BEAM = (10.0, 0.8, 1.2)  # m
SIDE, THICKNESS = 1.0, 0.02  # m


def frequencies(body, supports: dict[str, str], end, poisson: float, modes: int, comm) -> np.ndarray:
    """Return the lowest frequencies [Hz] of one body held at its sides along axes, {side: "xyz"}.  Collective."""
    text = table("model", mesh="body.msh") + steel("body", young=YOUNG, poisson=poisson, density=DENSITY)
    text += "".join(support(side, *axes) for side, axes in supports.items())
    text += driven([end], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], "end") + response(1.0) + table("solver", modes=modes)
    with tempfile.TemporaryDirectory() as folder:
        write_msh(str(Path(folder) / "body.msh"), {"body": body})
        path = Path(folder) / "body.toml"
        path.write_text(text)
        structure = build(read_scene(path), comm)
    structure.linearised.destroy()
    return structure.modes.omega_n / (2.0 * np.pi)


def cantilever(n: int, comm) -> np.ndarray:
    """Return the nine lowest frequencies [Hz] with 10 n x n x n elements."""
    return frequencies(box("hex20", BEAM, (10 * n, n, n)), {"x0": "xyz"}, (BEAM[0], 0.0, 0.0), 0.0, 9, comm)


def cantilever_theory() -> dict[str, np.ndarray]:
    """Return the lowest frequencies [Hz] of bending in either direction and of motion along the axis."""
    length, width, height = BEAM
    steel = dict(young=YOUNG, density=DENSITY)
    bending = {
        axis: structures.timoshenko_rectangle(3, length=length, width=b, height=h, poisson=0.0, **steel) / (2.0 * np.pi)
        for axis, b, h in (("y", height, width), ("z", width, height))
    }
    return {
        "bending along y": bending["y"],
        "bending along z": bending["z"],
        "along x": structures.bar_frequencies(1, length=length, **steel) / (2.0 * np.pi),
    }


def plate(n: int, comm) -> np.ndarray:
    """Return the two lowest frequencies [Hz] of the antisymmetric modes of the plate, n x n elements per quarter."""
    quarter = box("hex20", (SIDE / 2, SIDE / 2, THICKNESS / 2), (n, n, 1))
    return frequencies(quarter, {"x0": "yz", "y0": "xz", "z0": "xy"}, (SIDE / 2, SIDE / 2, 0.0), 0.3, 2, comm)


def plate_theory() -> np.ndarray:
    """Return all lowest elastic frequencies [Hz] of the free plate."""
    D_over_mass = YOUNG * THICKNESS**2 / (12.0 * (1.0 - 0.3**2) * DENSITY)
    return structures.free_plate(16, thickness=THICKNESS / SIDE) * np.sqrt(D_over_mass) / SIDE**2 / (2.0 * np.pi)


def nearest(computed: np.ndarray, theory) -> np.ndarray:
    """Return the relative distance of each theoretical frequency from the nearest computed one."""
    return np.array([min(computed / value - 1.0, key=abs) for value in np.atleast_1d(theory)])


def main():
    for n in (1, 2, 3):
        computed = cantilever(n, MPI.COMM_SELF)
        print(
            f"cantilever, {10 * n} x {n} x {n} hex20: "
            + "; ".join(
                f"{name} " + ", ".join(f"{value:.4f} Hz {error:+.1e}" for value, error in zip(values, nearest(computed, values)))
                for name, values in cantilever_theory().items()
            ),
            flush=True,
        )
    for n in (4, 8, 12):
        computed = plate(n, MPI.COMM_SELF)
        errors = [min(value / plate_theory() - 1.0, key=abs) for value in computed]
        print(
            f"free plate, {n} x {n} x 1 hex20 a quarter: "
            + ", ".join(f"{value:.4f} Hz {error:+.1e}" for value, error in zip(computed, errors)),
            flush=True,
        )


if __name__ == "__main__":
    main()
