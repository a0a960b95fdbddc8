"""Twenty modes of a clamped block of 118,443 degrees of freedom: processor time of CalculiX and of this program, same input file.

    python jobs/bench/calculix_time.py [--ccx PATH] [--cells 12 12 60] [--modes 20]

12 x 12 x 60 hexahedra of 20 nodes (C3D20), one thread each.  Timed is the whole command: reading, assembly, factorisation, modes;
for this program also the check that no mode is missing, result files and pictures.  Prints user plus system time of both [s],
their ratio, and the largest relative difference of the frequencies (CalculiX prints seven digits).  Needs ``ccx`` (Debian:
calculix-ccx); without it only the time of this program is printed.
"""

import argparse
import csv
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "tests")]

from box_meshes import box  # noqa: E402
from calculix_set import eigenvalues_in  # noqa: E402
from verification import calculix  # noqa: E402

SIZE = (1.0, 1.1, 5.0)  # m
SCENE = """[model]
mesh = "block.inp"
units = "m-kg-s"

[[loads]]
position = [0.0, 0.0, 5.0]
direction = [1.0, 0.0, 0.0]

[[outputs]]
name = "corner"
position = [0.0, 0.0, 5.0]
direction = [1.0, 0.0, 0.0]

[damping]
ratio = 1e-3

[response]
mode = 1
span = [0.9, 1.1]
levels = [1.0]
"""


def processor_time(command: list[str], folder: str) -> float:
    """Run a command in a folder on one thread; return its user plus system time [s]."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MICROSLIP_CACHE": "off"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=folder, check=True, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print both times and the difference."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ccx", default=shutil.which("ccx"))
    parser.add_argument("--cells", type=int, nargs=3, default=[12, 12, 60])
    parser.add_argument("--modes", type=int, default=20)
    given = parser.parse_args()
    points, nodes = box("hex20", tuple(given.cells), SIZE)
    text = calculix.deck("C3D20", static=False, made=(points, nodes, len(points) - 1))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "block.inp").write_text(text.replace("*FREQUENCY\n6", f"*FREQUENCY\n{given.modes}"))
        Path(folder, "block.toml").write_text(SCENE)
        command = [sys.executable, "-m", "microslip", "modes", "block.toml", "--count", str(given.modes), "--out", "modes"]
        ours = processor_time(command, folder)
        with Path(folder, "modes", "modes.csv").open() as file:
            table = list(csv.DictReader(line for line in file if not line.startswith("#")))
        frequencies = np.array([float(next(value for name, value in row.items() if "Hz" in name)) for row in table])
        print(f"{3 * len(points)} DOF, microslip {ours:.1f} s", flush=True)
        if not given.ccx:
            sys.exit("ccx not found: install CalculiX (Debian: calculix-ccx) or give its path with --ccx")
        theirs = processor_time([given.ccx, "block"], folder)
        hertz = np.sqrt(eigenvalues_in(Path(folder, "block.dat").read_text())) / (2.0 * np.pi)
        difference = np.abs(frequencies[: len(hertz)] / hertz - 1.0).max()
        print(f"CalculiX {theirs:.1f} s, {theirs / ours:.1f} times; largest difference {difference:.1e}")


if __name__ == "__main__":
    main()
