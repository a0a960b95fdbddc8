"""What the nodal diameters of a disc cost beside the sector standing alone: `microslip modes` of both, in turn.

    python meshes/fan_sector.py --size paper --out meshes/fan_paper.msh
    python meshes/fan_sector.py --size paper --n-blades 24 --out meshes/fan_disc_paper.msh
    python jobs/bench/disc_costs.py [--alone jobs/fan_paper.toml] [--disc jobs/fan_disc_paper.toml] [--diameters 0,3,6] [--count 9]

Each is a process of its own: assembly, factor, modes with the proof, one table and its pictures.  Prints processor time and peak
memory, and those of the disc over those of the sector alone; targets are those of all nodal diameters.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile

from page_tables import table

TARGETS = {"processor time, s": 3.0, "peak memory, MiB": 1.5}


def measured(scene: str, *more: str) -> dict[str, float]:
    """Return processor time [s] and peak memory [MiB] of the modes of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "microslip", "modes", scene, "--out", folder, *more]
        silent = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
        process = os.posix_spawn(command[0], command, os.environ | {"OPENBLAS_NUM_THREADS": "1"}, file_actions=silent)
        _, status, used = os.wait4(process, 0)
    if status != 0:
        sys.exit(f"disc_costs.py: {' '.join(command)} ended with status {os.waitstatus_to_exitcode(status)}")
    return dict(zip(TARGETS, (used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--alone", default="jobs/fan_paper.toml", help="scene of the sector by itself (%(default)s)")
    parser.add_argument("--disc", default="jobs/fan_disc_paper.toml", help="scene of the disc (%(default)s)")
    parser.add_argument("--diameters", default="", help="nodal diameters, 0,3,6 (all)")
    parser.add_argument("--count", default="9", help="modes of each (%(default)s)")
    asked = parser.parse_args()
    alone = measured(asked.alone, "--count", asked.count)
    chosen = ["--diameters", asked.diameters] if asked.diameters else []
    disc = measured(asked.disc, "--count", asked.count, *chosen)
    rows = [
        [name, f"{alone[name]:,.1f}", f"{disc[name]:,.1f}", f"{disc[name] / alone[name]:.2f}", f"{target:g}"]
        for name, target in TARGETS.items()
    ]
    what = f"nodal diameters {asked.diameters}" if asked.diameters else "all nodal diameters"
    print("\n".join(table(["", "sector alone", what, "ratio", "target of all"], rows)))


if __name__ == "__main__":
    main()
