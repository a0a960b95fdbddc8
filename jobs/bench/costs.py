"""Time and memory of the stages of a scene, compared with the speed of the machine.

    python jobs/bench/costs.py [SCENE.toml] [--levels 1 15] [--points 98] [--ranks 1 2] [--out DIR] [--page docs/costs.md]

SCENE is jobs/fan_paper.toml by default.  Prints tables, writes them to a page, and costs.json to DIR (results/bench): the stages
of the set-up and, for each level, the parts of the response by `receptance`.  Each measurement is a separate job on each number
of ranks (mpirun, or $MPIRUN).  Times of parts are processor time of rank 0.  large_joint.py measures how the cost of a point
grows with the pairs of a joint.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import json
import shlex
import subprocess
import sys
from pathlib import Path

import machine
from page_tables import put, table


def measure(request: dict, ranks: int) -> dict:
    """Return the report of cost_measurement.py on this number of ranks."""
    command = [sys.executable, str(Path(__file__).with_name("cost_measurement.py")), json.dumps(request)]
    if ranks > 1:
        command = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "--oversubscribe", "-n", str(ranks), *command]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"costs.py: {shlex.join(command)} ended with status {done.returncode}")
    result = json.loads(done.stdout.splitlines()[-1])
    print(f"{request} on {ranks}: {1e3 * result['seconds']:.3g} ms a point, {result['memory_MiB']:.0f} MiB", flush=True)
    return result


def ms(seconds: float) -> str:
    return f"{1e3 * seconds:,.3g}" if seconds < 1.0 else f"{1e3 * seconds:,.0f}"


def of_stages(runs: list[dict]) -> list[str]:
    """Return the table of the set-up: seconds and memory on each number of ranks."""
    by_ranks = {result["ranks"]: result["stages"] for result in runs}
    ranks = sorted(by_ranks)
    titles = ["stage"] + [f"s, {n} rank{'s' * (n > 1)}" for n in ranks] + [f"MiB in all, {n}" for n in ranks]
    rows = []
    for i, stage in enumerate(by_ranks[ranks[0]]):
        of_all = [by_ranks[n][i] for n in ranks]
        rows.append([stage["name"], *(f"{one['seconds']:.3f}" for one in of_all), *(f"{one['memory']:,.0f}" for one in of_all)])
    return table(titles, rows)


def of_response(runs: list[dict]) -> list[str]:
    """Return the table of the parts of the response, a column per level and number of ranks."""
    total = {group: sum(r["groups"].get(group, 0.0) for r in runs) for r in runs for group in r["groups"]}
    titles = ["CPU ms a point (calls)"] + [f"{r['level']:g} N, {r['ranks']} rank{'s' * (r['ranks'] > 1)}" for r in runs]
    rows = [
        ["wall time, ms", *(ms(r["seconds"]) for r in runs)],
        ["processor time, ms", *(ms(r["cpu"]) for r in runs)],
        ["points; not sticking, mean", *(f"{r['points']}; {r['not_sticking']:.0f} of {r['n_pairs']}" for r in runs)],
        ["Newton; GMRES", *(f"{r['newton']:.1f}; {r['krylov']:.1f}" for r in runs)],
    ]
    for group in sorted(total, key=lambda group: -total[group]):
        cells = [(r["groups"].get(group, 0.0), r["calls"].get(group)) for r in runs]
        rows.append([group, *(ms(seconds) + ("" if calls is None else f" ({calls:.1f})") for seconds, calls in cells)])
    return table(titles, rows)


def report(runs: list[dict], scene: str) -> list[str]:
    """Return the lines of the tables below a line that describes the scene."""
    one = runs[0]
    title = f"{Path(scene).stem}: {one['n_dof']:,} DOF, {one['n_pairs']} pairs, {one['n_modes']} modes, H = {one['H']}"
    return [title, "", *of_stages([r for r in runs if r["level"] == one["level"]]), "", *of_response(runs)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="jobs/fan_paper.toml")
    parser.add_argument("--levels", type=float, nargs="+", default=[1.0, 15.0], help="N")
    parser.add_argument("--points", type=int, default=98)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--page", type=Path, help="page of the documentation that gets the tables")
    options = parser.parse_args()
    base = {"kind": "scene", "scene": options.scene, "points": options.points}
    runs = [measure({**base, "level": level}, ranks) for level in options.levels for ranks in options.ranks]
    # last: child processes may inherit this process's peak memory
    rates, facts = {"GFLOP/s": machine.matrix_product_rate(), "GB/s": machine.memory_bandwidth()}, machine.facts()
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "costs.json").write_text(json.dumps({"machine": facts, "rates": rates, "scene": runs}, indent=1))
    if options.page:
        stages = of_stages([run for run in runs if run["level"] == runs[0]["level"]])
        put(options.page, {"stages": stages, "point": of_response(runs), "costs_machine": machine.items()})
    limits = f"Limits of one process: matrix product {rates['GFLOP/s']:.1f} GFLOP/s, memory {rates['GB/s']:.1f} GB/s."
    print(*report(runs, options.scene), "", *machine.lines(facts), limits, sep="\n")


if __name__ == "__main__":
    main()
