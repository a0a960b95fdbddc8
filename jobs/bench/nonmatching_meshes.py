"""The accuracy of non-matching meshes: the demo's blade on its own disc (matching), and on discs with other meshes.

    python jobs/bench/nonmatching_meshes.py [--size small medium] [--across 1 2 3] [--levels 1 5 10 15]

Prints contact pairs, and at each level the peak per newton and its difference from that of the same pairing on matching meshes:
for each size of the blade's mesh on coarser and finer discs, and for more and more elements across a flank on discs with one
more.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from microslip.scene.read import changed

JOBS = Path(__file__).parents[1]
sys.path.insert(0, str(JOBS.parent / "meshes"))

from fan_sector import SIZES, Divisions, Shape, fan_sector  # noqa: E402
from msh import write_msh  # noqa: E402


def discs(n: Divisions) -> dict[str, Divisions]:
    """Return the divisions of discs for those of a blade, by name."""
    return {
        "coarser along the slot": replace(n, chord=max(2, n.chord - 1)),
        "finer along the slot": replace(n, chord=n.chord + 3),
        "finer along and across": replace(n, chord=n.chord + 3, flank=n.flank + 1),
        "twice as fine": replace(n, chord=2 * n.chord + 1, flank=2 * n.flank + 1, wall=n.wall + 1, neck=n.neck + 1),
    }


@dataclass(frozen=True)
class Case:
    """A blade on a disc, the pairing, and the body of the first surface."""

    name: str
    pairing: str
    first: str
    blade: Divisions
    disc: Divisions

    def scene(self, folder: Path):
        """Return the demo's scene with these meshes."""
        scene, path = microslip.read(JOBS / "fan_small.toml"), folder / "apart.msh"
        write_msh(str(path), {name: fan_sector(Shape(), getattr(self, name))[name] for name in ("blade", "disc")})
        surfaces = ("blade_root", "disc_slot") if self.first == "blade" else ("disc_slot", "blade_root")
        joint = {scene.joints[0].name: {"pairing": self.pairing, "surfaces": surfaces}}
        return changed(scene, {"model": {"mesh": str(path)}}, joint)


def peaks(scene, levels) -> tuple[int, np.ndarray, float]:
    """Return the number of pairs, the peak per newton at each level [m/N] and the seconds of all."""
    start = perf_counter()
    with microslip.build(scene) as structure:
        curves = microslip.respond(structure, levels=levels, error_bars=False).results.levels
        n_pairs = structure.pairs.n_pairs
    amplitudes = [np.hypot(*level.response[:, 0, 1:3].T).max() / level.level for level in curves]
    return n_pairs, np.array(amplitudes), perf_counter() - start


def discs_apart(size: str) -> list[Case]:
    """Return the blade of a size on its matching disc and on others; for each pairing, the matching case comes first."""
    blade = SIZES[size]
    others = discs(blade)
    cases = []
    for pairing, matching, firsts in (("projected", "nodes", ("blade",)), ("mortar", "mortar", ("blade", "disc"))):
        cases.append(Case("the same", matching, "blade", blade, blade))
        cases += [Case(name, pairing, first, blade, disc) for name, disc in others.items() for first in firsts]
    return cases


def finer_across(n: int) -> list[Case]:
    """Return the small blade with n elements across a flank on a disc of n, and of n + 1 and one more along the slot."""
    blade = replace(SIZES["small"], neck=2, wall=2, flank=n)
    other = replace(blade, flank=n + 1, chord=blade.chord + 1)
    across = [Case(f"{n} elements across a flank", "mortar", "blade", blade, blade)]
    return across + [Case(f"{n}; the disc {n + 1}", "mortar", first, blade, other) for first in ("blade", "disc")]


def rows(cases: list[Case], levels, folder: Path) -> None:
    """Print a row for each case: the peak per newton, and its difference from the preceding case with the same pairing on matching meshes."""
    exact = np.zeros(len(levels))
    for case in cases:
        n_pairs, heights, seconds = peaks(case.scene(folder), levels)
        exact = heights if case.blade == case.disc else exact
        is_own = exact is heights
        cells = [f"{1e3 * a:.3f} mm/N" if is_own else f"{100.0 * (a / own - 1.0):+.1f} %" for a, own in zip(heights, exact)]
        print(f"| {case.name} | {case.pairing}, {case.first} | {n_pairs} | {' | '.join(cells)} | {seconds:.0f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", nargs="*", choices=SIZES, default=["small"])
    parser.add_argument("--across", nargs="*", type=int, default=[], help="elements of the blade across a flank")
    parser.add_argument("--levels", type=float, nargs="+", default=[1.0, 5.0, 10.0, 15.0])
    given = parser.parse_args()
    print("| disc's mesh | contact points, first | number | " + " | ".join(f"{level:g} N" for level in given.levels) + " | s |")
    print("| --- " * (len(given.levels) + 4) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for cases in [*map(discs_apart, given.size), *map(finer_across, given.across)]:
            rows(cases, given.levels, Path(folder))


if __name__ == "__main__":
    main()
