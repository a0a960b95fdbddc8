"""Where the time goes, and how it grows, beside what the machine can do.

    python jobs/bench/costs.py [SCENE.toml] [--levels 1 15] [--points 98] [--ranks 1 2] [--parts scene pairs share harmonics]
                               [--pairs 50 ... 2000] [--joint-points 6] [--out DIR]

SCENE is jobs/fan_paper.toml unless given.  Writes costs.json, costs.md and img/costs.png in DIR (results/bench).

`scene` times the stages of the set-up and, at each level, the parts of the response of `receptance`.  The other parts time a
point of a synthetic joint (synthetic.py) over pairs, share of slipping pairs, and harmonics.  Each measurement is a job of
its own on each number of ranks (mpirun, or what $MPIRUN names).  Times of parts are processor time of rank 0.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
import argparse
import json
import shlex
import subprocess
import sys
from pathlib import Path

import machine
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

PARTS = ("scene", "pairs", "share", "harmonics")
PAIRS, SHARES, HARMONICS = (50, 100, 200, 500, 1000, 2000), (0.0, 0.1, 0.3, 0.6, 1.0), (1, 3, 5, 7, 10, 15)
GOAL = {"n_pairs": 2000, "share": 0.3, "H": 5}  # a point in under 2 s and 8 GiB
NAMES = {
    "AFT": "AFT",
    "G p": "G p",
    "Krylov products, besides G p": "Krylov, besides G p",
    "PETSc: GMRES, SNES, calls": "PETSc",
    "columns of G: picking": "picking G",
}


def measure(request: dict, ranks: int) -> dict:
    """Return what cost_of.py reports on so many ranks."""
    command = [sys.executable, str(Path(__file__).with_name("cost_of.py")), json.dumps(request)]
    if ranks > 1:
        command = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "--oversubscribe", "-n", str(ranks), *command]
    found = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if found.returncode != 0:
        sys.exit(f"costs.py: {shlex.join(command)} ended with status {found.returncode}")
    result = json.loads(found.stdout.splitlines()[-1])
    print(f"{request} on {ranks}: {1e3 * result['seconds']:.3g} ms a point, {result['memory_MiB']:.0f} MiB", flush=True)
    return result


def joints(part: str, options) -> list[dict]:
    """Return the requests of one growth."""
    base = {"kind": "joint", "n_pairs": 200, "share": 0.3, "H": 3, "points": options.joint_points}
    vary = {"pairs": ("n_pairs", options.pairs), "share": ("share", SHARES), "harmonics": ("H", HARMONICS)}
    key, values = vary[part]
    requests = [{**base, key: value} for value in values]
    return requests + ([{**base, **GOAL}] if part == "pairs" and GOAL["n_pairs"] in values else [])


# -- tables -----------------------------------------------------------------------------------------------------------


def table(titles, rows) -> list[str]:
    lines = ["| " + " | ".join(titles) + " |", "| " + " | ".join(["---"] + ["---:"] * (len(titles) - 1)) + " |"]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def ms(seconds: float) -> str:
    return f"{1e3 * seconds:,.3g}" if seconds < 1.0 else f"{1e3 * seconds:,.0f}"


def of_stages(found: list[dict]) -> list[str]:
    """Return the table of the set-up: seconds and memory on each number of ranks."""
    by_ranks = {result["ranks"]: result["stages"] for result in found}
    ranks = sorted(by_ranks)
    titles = ["stage"] + [f"s, {n} rank{'s' * (n > 1)}" for n in ranks] + [f"MiB in all, {n}" for n in ranks]
    rows = []
    for i, stage in enumerate(by_ranks[ranks[0]]):
        of_all = [by_ranks[n][i] for n in ranks]
        rows.append([stage["name"], *(f"{one['seconds']:.3f}" for one in of_all), *(f"{one['memory']:,.0f}" for one in of_all)])
    return table(titles, rows)


def of_response(found: list[dict]) -> list[str]:
    """Return the table of the parts of the response, a column a level and number of ranks."""
    total = {group: sum(r["groups"].get(group, 0.0) for r in found) for r in found for group in r["groups"]}
    titles = ["CPU ms a point (calls)"] + [f"{r['level']:g} N, {r['ranks']} rank{'s' * (r['ranks'] > 1)}" for r in found]
    rows = [
        ["wall time, ms", *(ms(r["seconds"]) for r in found)],
        ["processor time, ms", *(ms(r["cpu"]) for r in found)],
        ["points; not sticking, mean", *(f"{r['points']}; {r['not_sticking']:.0f} of {r['n_pairs']}" for r in found)],
        ["Newton; GMRES", *(f"{r['newton']:.1f}; {r['krylov']:.1f}" for r in found)],
    ]
    for group in sorted(total, key=lambda group: -total[group]):
        cells = [(r["groups"].get(group, 0.0), r["calls"].get(group)) for r in found]
        rows.append([group, *(ms(seconds) + ("" if calls is None else f" ({calls:.1f})") for seconds, calls in cells)])
    return table(titles, rows)


def of_growth(found: list[dict]) -> list[str]:
    """Return the table of a growth, with the rates of G p beside the times."""
    titles = [
        "pairs, slipping, H",
        "ranks",
        "unknowns",
        "ms a point",
        "CPU ms",
        *NAMES.values(),
        "rest",
        "Newton",
        "GMRES",
        "G p GFLOP/s",
        "G p GB/s",
        "MiB",
    ]
    rows = []
    for r in found:
        parts = [r["groups"].get(name, 0.0) for name in NAMES]
        flops, bytes_ = work_of_G(r)
        busy, calls = r["groups"].get("G p", 0.0), r["calls"].get("G p", 0.0)
        rates = [f"{1e-9 * amount * calls / busy:.2g}" if busy > 0.0 else "–" for amount in (flops, bytes_)]
        rows.append(
            [
                f"{r['n_pairs']:,}, {r['not_sticking']:.0f}, {r['H']}",
                str(r["ranks"]),
                f"{r['unknowns']:,}",
                ms(r["seconds"]),
                ms(r["cpu"]),
                *(ms(seconds) for seconds in (*parts, r["cpu"] - sum(parts))),
                f"{r['newton']:.1f}",
                f"{r['krylov']:.1f}",
                *rates,
                f"{r['memory_MiB']:,.0f}",
            ]
        )
    return table(titles, rows)


def work_of_G(r: dict) -> tuple[float, float]:
    """Return operations and bytes of a rank's static product G p in GMRES: between pairs that do not stick, single precision."""
    entries = 9.0 * r["not_sticking"] ** 2 / r["ranks"]
    return 2.0 * entries * (2 * r["H"] + 1), 4.0 * entries


AXES = {
    "pairs": ("n_pairs", "pairs, 30 % slip, H = 3"),
    "share": ("share", "share of slipping pairs, 200 pairs, H = 3"),
    "harmonics": ("H", "harmonics, 200 pairs, 30 % slip"),
}


def draw(growths: dict[str, list[dict]], path: Path) -> None:
    """Draw the time of a point and its parts over pairs, share and harmonics."""
    figure, panels = plt.subplots(1, len(growths), figsize=(4.4 * len(growths), 4), layout="constrained", squeeze=False)
    for panel, (part, found) in zip(panels[0], growths.items()):
        key, label = AXES[part]
        curve = sorted((r for r in found if part != "pairs" or r["H"] == 3), key=lambda r: r[key])
        one = [r for r in curve if r["ranks"] == 1]
        panel.plot([r[key] for r in one], [1e3 * r["cpu"] for r in one], "k.-", label="a point")
        for name, short in NAMES.items():
            panel.plot([r[key] for r in one], [1e3 * r["groups"].get(name, np.nan) for r in one], ".-", lw=1, label=short)
        for ranks in sorted({r["ranks"] for r in found} - {1}):
            more = [r for r in curve if r["ranks"] == ranks]
            panel.plot([r[key] for r in more], [1e3 * r["seconds"] for r in more], "k--", lw=1, label=f"{ranks} ranks, wall time")
        panel.set(xlabel=label, ylabel="processor time a point, ms", yscale="log", xscale="log" if part == "pairs" else "linear")
        panel.set_xticks([r[key] for r in one], [f"{r[key]:,}" for r in one])
        panel.minorticks_off()
    panels[0][0].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def measured(options) -> dict[str, list[dict]]:
    """Return what every part asked for has measured."""
    results: dict[str, list[dict]] = {}
    for part in options.parts:
        requests = (
            joints(part, options)
            if part != "scene"
            else [{"kind": "scene", "scene": options.scene, "level": level, "points": options.points} for level in options.levels]
        )
        results[part] = [measure(request, ranks) for request in requests for ranks in options.ranks]
    return results


def meaning(results: dict[str, list[dict]]) -> str:
    """Say in sentences what the tables show."""
    said = []
    if found := results.get("scene"):
        low, high = ([r for r in found if r["level"] == level] for level in (found[0]["level"], found[-1]["level"]))
        *stages, total = low[0]["stages"]
        longest = max(stages, key=lambda stage: stage["seconds"])
        said.append(
            f"The set-up is paid for once: {total['seconds']:.0f} s, {100 * longest['seconds'] / total['seconds']:.0f} % of it for the stage "
            f"'{longest['name']}'. After it a point takes "
            + " and ".join(
                f"{ms(r['seconds'])} ms at {r['level']:g} N ({r['not_sticking']:.0f} of {r['n_pairs']} pairs not sticking)"
                for r in (low[0], high[0])
            )
            + "."
        )
        said += [
            f"On {more['ranks']} ranks the set-up takes {more['stages'][-1]['seconds'] / total['seconds']:.2g} of that time, "
            f"a point at {more['level']:g} N {more['seconds'] / high[0]['seconds']:.2g}."
            for more in high[1:]
        ]
    if found := [r for r in results.get("pairs", []) if r["H"] == 3 and r["ranks"] == 1]:
        first, last = (choose(found, key=lambda r: r["n_pairs"]) for choose in (min, max))
        said.append(
            f"From {first['n_pairs']:,} to {last['n_pairs']:,} pairs, of which 30 % slip, "
            f"a point takes {last['seconds'] / first['seconds']:.0f} times as long."
        )
    return " ".join(said)


def report(results: dict[str, list[dict]], scene: str) -> list[str]:
    """Return the lines of the page: what it means, the picture, the tables."""
    lines = [meaning(results), ""]
    if any(part != "scene" for part in results):
        lines += ["![Time of a point and of its parts](img/costs.png)", ""]
    for part, found in results.items():
        if part == "scene":
            one = found[0]
            lines += [
                f"## {Path(scene).stem}: {one['n_dof']:,} DOF, {one['n_pairs']} pairs, {one['n_modes']} modes, H = {one['H']}",
                "",
            ]
            lines += [*of_stages([r for r in found if r["level"] == one["level"]]), *of_response(found)]
        else:
            lines += [f"## A point of a synthetic joint over {part}", "", *of_growth(found)]
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="jobs/fan_paper.toml")
    parser.add_argument("--levels", type=float, nargs="+", default=[1.0, 15.0], help="N")
    parser.add_argument("--points", type=int, default=98)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--parts", nargs="+", default=list(PARTS), choices=PARTS)
    parser.add_argument("--pairs", type=int, nargs="+", default=list(PAIRS))
    parser.add_argument("--joint-points", type=int, default=6, help="points of a synthetic joint that are timed")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    results = measured(options)
    # last: what these take must not be in this process while it starts the others, which may count its memory as their own
    rates, facts = {"GFLOP/s": machine.matrix_product_rate(), "GB/s": machine.memory_bandwidth()}, machine.facts()
    limits = f"Limits of one process: matrix product {rates['GFLOP/s']:.1f} GFLOP/s, memory {rates['GB/s']:.1f} GB/s."
    page = machine.page("Where the time goes", report(results, options.scene)[:-1], [*machine.lines(facts), limits])
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "costs.json").write_text(json.dumps({"machine": facts, "rates": rates, **results}, indent=1))
    growths = {part: found for part, found in results.items() if part != "scene"}
    if growths:
        draw(growths, options.out / "img" / "costs.png")
    (options.out / "costs.md").write_text(page)
    print(page)


if __name__ == "__main__":
    main()
