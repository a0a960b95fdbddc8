"""Growth of time and memory of a point with the pairs of a joint, up to 10,000.

    python jobs/bench/large_joint.py [--pairs 200 500 1000 2000 5000 10000] [--ranks 1 2] [--points 4] [--out DIR] [--draw] [--page PAGE]

The joint is that of synthetic.py, 30 % of its pairs slip, H = 3.  Each measurement is a separate job (cost_measurement.py;
mpirun, or $MPIRUN).  The first point, which computes the columns of the slipping pairs, is excluded from the time and included in
the memory, the peak of all ranks together.  Writes large_joint.json and img/large_joint.png in DIR (results/bench); ``--draw``
draws from the file of an earlier run; ``--page`` writes the table to a page (docs/costs.md).
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import costs
import machine
import matplotlib

matplotlib.use("Agg")
from page_tables import put, table

from microslip.results import style

PAIRS = (200, 500, 1000, 2000, 5000, 10000)
SHARE, H = 0.3, 3
GOAL = {"seconds": 5.0, "memory_MiB": 8192.0}  # of 10,000 pairs
PARTS = {  # as the table and the picture name them
    "static rows of all pairs": ("G p: residuals, steps",),
    "products of GMRES": ("G p", "Krylov products, besides G p"),
    "contact forces": ("AFT",),
    "preconditioner": ("preconditioner: factoring", "preconditioner: applying"),
}
COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7")  # Okabe and Ito


def measured(given) -> list[dict]:
    """Return the measurements of every joint on each number of ranks."""
    base = {"kind": "joint", "share": SHARE, "H": H, "points": given.points}
    return [costs.measure({**base, "n_pairs": n}, ranks) for n in given.pairs for ranks in given.ranks]


def seconds_of(runs: dict, part: str) -> float:
    return sum(runs["groups"].get(name, 0.0) for name in PARTS[part])


def held(n_pairs: int, share: float, n_modes: int = 20) -> float:
    """Return the memory of the columns of the slipping pairs, in double and in single precision [MiB]."""
    rows, columns = 3.0 * n_pairs, 3.0 * share * n_pairs
    return (8.0 * rows * columns + 4.0 * columns * (columns + n_modes)) / 2**20


def rows_of(runs: list[dict]) -> list[str]:
    """Return the table, a row per joint and number of ranks."""
    titles = ["pairs", "slipping", "ranks", "wall, s a point", "processor, s", *PARTS, "the rest", "Newton; GMRES"]
    rows = []
    for r in runs:
        parts = [seconds_of(r, part) for part in PARTS]
        cells = [f"{r['n_pairs']:,}", f"{r['not_sticking']:,.0f}", str(r["ranks"]), f"{r['seconds']:.3g}", f"{r['cpu']:.3g}"]
        cells += [f"{seconds:.2g}" for seconds in (*parts, r["cpu"] - sum(parts))]
        memory = f"{r['memory_MiB']:,.0f}", f"{held(r['n_pairs'], SHARE):,.0f}"
        rows.append([*cells, f"{r['newton']:.1f}; {r['krylov']:.1f}", *memory])
    return table([*titles, "MiB, all ranks", "of it columns"], rows)


def draw(runs: list[dict], path: Path) -> None:
    """Draw time and memory of a point over the pairs."""
    ranks = sorted({r["ranks"] for r in runs})
    curves = {count: [r for r in runs if r["ranks"] == count] for count in ranks}
    one = curves[ranks[0]]
    n = [r["n_pairs"] for r in one]
    with matplotlib.rc_context(style.RC):
        page = style.Page(
            Heading("Large joints"), f"a point over the pairs, of which {100 * SHARE:.0f} % slip, H = {H}", style.WIDTH, 2.9
        )
        times, memory = page.grid(1, 2).subplots(squeeze=False)[0]
        times.plot(n, [r["cpu"] for r in one], ".-", color=style.INK, label="a point")
        for part, colour in zip(PARTS, COLOURS):
            seconds = [seconds_of(r, part) for r in one]
            if max(seconds) > 0.01 * one[-1]["cpu"]:
                times.plot(n, seconds, ".-", lw=0.9, color=colour, label=part)
        for count, colour in zip(ranks, (style.INK, *COLOURS)):
            gib = [r["memory_MiB"] / 1024 for r in curves[count]]
            memory.plot(n, gib, ".-", color=colour, label=f"{count} rank{'s' * (count > 1)}")
        memory.plot(n, [held(k, SHARE) / 1024 for k in n], ":", color=style.FAINT, label="columns of the slipping pairs")
        for axes, most in ((times, GOAL["seconds"]), (memory, GOAL["memory_MiB"] / 1024)):
            axes.plot(10000, most, "x", color=style.INK, ms=6, label="goal, at most")
            axes.set(xscale="log", yscale="log", xlabel="pairs")
            axes.set_xticks(n, [f"{k:,}" for k in n])
            axes.minorticks_off()
            axes.legend()
        memory.set_ylim(bottom=0.5 * min(r["memory_MiB"] for r in runs) / 1024)
        times.set_ylabel(f"processor's time, {ranks[0]} rank{'s' * (ranks[0] > 1)} [s]")
        memory.set_ylabel("memory of all ranks [GiB]")
        page.save(str(path))


@dataclass(frozen=True)
class Heading:
    """The heading of the picture."""

    title: str
    name: str = ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, nargs="+", default=PAIRS)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--points", type=int, default=4)
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--draw", action="store_true")
    parser.add_argument("--page", type=Path, help="page of the documentation that gets the table")
    given = parser.parse_args()
    (given.out / "img").mkdir(parents=True, exist_ok=True)
    file = given.out / "large_joint.json"
    runs = json.loads(file.read_text()) if given.draw else measured(given)
    file.write_text(json.dumps(runs, indent=1))
    draw(runs, given.out / "img" / "large_joint.png")
    if given.page:
        put(given.page, {"large_joint": rows_of(runs), "large_joint_machine": machine.items()})
    print(*rows_of(runs), "", *machine.lines(machine.facts()), sep="\n")


if __name__ == "__main__":
    main()
