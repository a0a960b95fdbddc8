"""Tables and picture of scaling.py, from its measurements and the models of them."""

from __future__ import annotations

from pathlib import Path

import machine
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from costs import table
from scaling_model import KINDS, RANKS, Growth, Measured, Network, StageModel, exponent, gains_until, stage_model, weak_seconds

from microslip.results.style import INK, RC, WIDTH

ORDER = (
    "reading",
    "partition",
    "assembly",
    "factor: analysis",
    "factor",
    "modes",
    "proof of modes: analysis",
    "proof of modes",
    "reduction",
    "static columns",
    "response",
)
POINT = "response"  # whose numbers are those of a point
SHARED_BY = {  # what says how the parallel work of a stage is shared; else evenly
    "assembly": "elements",
    "factor": "flops",
    "proof of modes": "flops",
    "modes": "entries",
    "reduction": "entries",
    "static columns": "entries",
    "response": "pairs",
}
GROWS = {  # with DOF^g, least and most of g by theory: solids ordered by nested dissection, joints that are surfaces
    "flops": (1.0, 2.0),
    "entries": (1.0, 4.0 / 3.0),
    "pairs": (2.0 / 3.0, 4.0 / 3.0),
}
GROWTH = (
    "Work grows with DOF to a power that two sizes show, within what theory bounds it by: 1 for what passes elements, 1 to 4/3 for "
    "what passes the factor of a solid, 1 to 2 for making it, 2/3 to 4/3 for the pairs of a joint, which is a surface."
)
SHOWN = (1, 2, 4, 16, 64, 256, 1024)
WEAK = (2, 8, 64, 1024)
QUIET = 1.25  # wall over processor time of one rank, of a machine with nothing else to do
COLOURS = plt.get_cmap("tab10").colors


# -- from measurements to models ---------------------------------------------------------------------------------------


def amount(run: dict, stage: str, name: str) -> np.ndarray:
    """Return a number of every rank in a stage, of the response a point; zeros where the stage did not come to pass."""
    values = np.array(run["stages"].get(stage, {}).get(name, [0.0] * run["ranks"]))
    return values / run["points"] if stage == POINT else values


def work(run: dict, stage: str) -> np.ndarray:
    """Return the processor time outside MPI of every rank [s]."""
    return np.maximum(amount(run, stage, "cpu") - amount(run, stage, "mpi_cpu"), 0.0)


def wall(run: dict, stage: str) -> float:
    """Return the wall time of the slowest rank [s]."""
    return float(amount(run, stage, "wall").max())


def shares_of(size: dict, stage: str) -> dict[int, list[float]]:
    """Return by number of ranks what part of the parallel work each rank has; of elements and pairs for all numbers modelled."""
    name = SHARED_BY.get(stage)
    if name == "elements":
        return {int(ranks): shares for ranks, shares in size["shares"]["elements"].items()}
    if name == "pairs":
        n = size["runs"][0]["n_pairs"]
        return {ranks: [len(range(rank, n, ranks)) / n for rank in range(ranks)] for ranks in RANKS}
    if name is None:
        return {}
    of_runs = {run["ranks"]: np.array(run["shares"][name]) for run in size["runs"]}
    whole = of_runs[1].sum()  # of flops more are done on more ranks
    return {ranks: (shares / whole).tolist() for ranks, shares in of_runs.items()}


def is_quiet(size: dict) -> bool:
    """Return whether the machine had nothing else to do: otherwise wall times tell nothing of who waits for whom."""
    one = size["runs"][0]
    wall_, cpu = (sum(amount(one, stage, name).sum() for stage in ORDER) for name in ("wall", "cpu"))
    return bool(wall_ < QUIET * cpu)


def models_of(size: dict, network: Network) -> list[StageModel]:
    """Return the models of all stages of a size."""
    runs = size["runs"]
    models = []
    for stage in ORDER:
        shares = shares_of(size, stage)
        several = [run for run in runs if run["ranks"] > 1]
        calls, bytes_ = (
            {kind: {run["ranks"]: float(amount(run, stage, f"{kind}, {what}").max()) for run in several} for kind in KINDS}
            for what in ("calls", "bytes")
        )
        measured = Measured(
            # between the many gathers of a point, ranks that share cores lose their caches: more than two say nothing
            {run["ranks"]: work(run, stage).tolist() for run in runs if stage != POINT or run["ranks"] <= 2},
            shares,
            calls,
            bytes_,
            {run["ranks"]: wall(run, stage) for run in runs if run["ranks"] <= 2 and is_quiet(size)},
        )
        models.append(stage_model(stage, measured, network))
    return models


# -- words and numbers ---------------------------------------------------------------------------------------------------


def seconds(value: float) -> str:
    """Return a time, in ms below a second."""
    return f"{value:.3g} s" if value >= 1.0 else f"{1e3 * value:.3g} ms"


def short(value: float) -> str:
    return "–" if value == 0.0 else f"{value:,.0f}" if value >= 100 else f"{value:.2g}"


def name_of(stage: str) -> str:
    return "a point of the response" if stage == POINT else stage


def title_of(size: str, run: dict) -> str:
    return f"fan_{size}: {run['n_dof']:,} DOF, {run['n_pairs']} pairs"


def of_machine(found: dict, own: Network, cluster: Network) -> list[str]:
    """Return what the machine takes for a message and for collectives on two ranks."""
    network = found["network"]
    sizes = [size for size in network["sizes"] if size in (8, 512, 32768, 2097152)]
    at = [network["sizes"].index(size) for size in sizes]
    rows = [["a message, half of there and back", *(f"{0.5e6 * network['there and back'][i]:,.3g}" for i in at)]]
    rows += [[name, *(f"{1e6 * network[name][i]:,.3g}" for i in at)] for name in ("Allreduce", "Bcast", "Allgather")]
    return [
        *table(["µs on two ranks, bytes", *(f"{size:,}" for size in sizes)], rows),
        f"Fitted: latency {1e6 * own.latency:.2g} µs, {1e-9 * own.bandwidth:.2g} GB/s. Network of the models below (an assumption): "
        f"{1e6 * cluster.latency:.2g} µs, {1e-9 * cluster.bandwidth:.2g} GB/s.",
        "",
    ]


def of_strong(size: dict) -> list[str]:
    """Return the table of a size on one rank and on two."""
    one, two = size["runs"][:2]
    half = size["half"]
    titles = ["stage", "1 rank", "2 ranks", "speed-up", "work of ranks 0; 1, outside MPI", "in MPI, rank 0; 1"]
    titles += ["MiB in all, 1", "2", "half of it, 1 rank", "weak efficiency"]
    rows = []
    for stage in ORDER:
        times = wall(one, stage), wall(two, stage)
        if times[0] == 0.0:
            continue
        memory = [run["memory_MiB"].get(stage) for run in (one, two)]
        rows.append(
            [
                name_of(stage),
                *map(seconds, times),
                f"{times[0] / times[1]:.2f}",
                "; ".join(map(seconds, work(two, stage))),
                "; ".join(
                    f"{100 * part:.0f} %"
                    for part in amount(two, stage, "mpi_wall") / np.maximum(amount(two, stage, "wall"), 1e-12)
                ),
                *("" if value is None else f"{value:,.0f}" for value in memory),
                seconds(wall(half, stage)),
                f"{wall(half, stage) / times[1]:.2f}",
            ]
        )
    return table(titles, rows)


def of_messages(size: dict, own: Network) -> list[str]:
    """Return the table of what ranks say to each other, on two ranks and on the most that were counted."""
    runs = [size["runs"][1], *([size["runs"][-1]] if len(size["runs"]) > 2 else [])]
    titles = ["stage"]
    for run in runs:
        titles += [f"{run['ranks']} ranks: sums", "gathers", "messages", "kB"]
    titles += ["their time on two ranks by latency and volume", "measured in MPI, least of both ranks"]
    rows = []
    for stage in ORDER:
        cells, wire = [], 0.0
        for run in runs:
            calls = {kind: amount(run, stage, f"{kind}, calls").max() for kind in KINDS}
            size_of = {kind: amount(run, stage, f"{kind}, bytes").max() for kind in KINDS}
            cells += [short(calls[kind]) for kind in ("sums", "gathers", "messages")] + [short(1e-3 * sum(size_of.values()))]
            if run["ranks"] == 2:
                wire = sum(own.seconds(kind, 2, calls[kind], size_of[kind]) for kind in KINDS)
        rows.append([name_of(stage), *cells, seconds(wire), seconds(float(amount(runs[0], stage, "mpi_wall").min()))])
    return table(titles, rows)


def of_models(models: list[StageModel], size: dict, own: Network, cluster: Network) -> list[str]:
    """Return the table of what the models are made of, and that of their times."""
    made = [
        [
            name_of(model.name),
            *map(seconds, (model.serial, model.replicated, model.parallel)),
            SHARED_BY.get(model.name, "evenly"),
            "; ".join(f"{model.share.at(ranks):.2g}" for ranks in (2, 8, 64, 1024)),
            f"{model.idle:.2g}",
        ]
        for model in models
    ]
    titles = [
        "stage",
        "rank 0 alone",
        "every rank",
        "shared",
        "by",
        "largest share on 2; 8; 64; 1,024",
        "waiting over it, 2 ranks",
    ]
    lines = table(titles, made)
    rows = [of_model(model, own, cluster) for model in models]
    set_up = [model for model in models if model.name != POINT]
    rows.append(
        [
            "**set-up**",
            *(seconds(total(set_up, ranks, cluster)) for ranks in SHOWN),
            band(set_up, cluster),
            *of_total(set_up, own, cluster),
        ]
    )
    ends = ["1,024: best to worst", "gains until", "what holds it then", "until, on this machine's network"]
    return [*lines, *table(["modelled", *(f"{ranks:,}" for ranks in SHOWN), *ends], rows)]


def of_model(model: StageModel, own: Network, cluster: Network) -> list[str]:
    ranks, why = model.gains_until(cluster)
    times = (seconds(model.seconds(n, cluster)) for n in SHOWN)
    return [name_of(model.name), *times, band([model], cluster), f"{ranks:,}", why, f"{model.gains_until(own)[0]:,}"]


def total(models: list[StageModel], ranks: int, network: Network, bound: str = "likely") -> float:
    return sum(model.seconds(ranks, network, bound) for model in models)


def band(models: list[StageModel], network: Network) -> str:
    return " to ".join(seconds(total(models, 1024, network, bound)) for bound in ("best", "worst"))


def of_total(models: list[StageModel], own: Network, cluster: Network) -> list[str]:
    """Return until how many ranks the sum of stages gains, and the stage and its term that hold it then."""
    ranks, on_own = (gains_until([total(models, n, network) for n in RANKS]) for network in (cluster, own))
    holds = max(models, key=lambda model: model.seconds(ranks, cluster))
    return [f"{ranks:,}", f"{holds.name}: {holds.most(ranks, cluster)}", f"{on_own:,}"]


def of_weak(models: list[StageModel], size: dict, cluster: Network) -> list[str]:
    """Return the table of structures that grow with the ranks, beginning with this size on one."""
    one, half = size["runs"][0], size["half"]
    rows = []
    for model in models:
        small, large = (work(run, model.name).sum() for run in (half, one))
        least, most = GROWS.get(SHARED_BY.get(model.name, ""), (1.0, 1.0))
        g = exponent(small, large, half["n_dof"], one["n_dof"], least, most)
        times = [weak_seconds(model, g, ranks, cluster) for ranks in WEAK]
        rows.append([name_of(model.name), f"{g:.2f}", seconds(model.seconds(1, cluster)), *map(seconds, times)])
    return table(["times as large on as many ranks, modelled", "work ~ DOF^", "1", *(f"{n:,}" for n in WEAK)], rows)


def checked(size: dict) -> list[str]:
    """Return a sentence on how well counts on the most ranks follow from those on fewer, which the models do beyond them."""
    runs = [run for run in size["runs"] if run["ranks"] > 1]
    if len(runs) < 3:
        return []
    errors = []
    for stage in ORDER:
        for name in [f"{kind}, {what}" for kind in KINDS for what in ("calls", "bytes")]:
            counts = {run["ranks"]: float(amount(run, stage, name).max()) for run in runs}
            known = {run["ranks"]: counts[run["ranks"]] for run in runs[:-1]}
            if min(counts.values()) > 0.0:
                last = runs[-1]["ranks"]
                errors.append(abs(np.log2(Growth(known).at(last) / counts[last])))
    n, most = len(errors), runs[-1]["ranks"]
    return [
        f"Counts and bytes on {most} ranks, foretold from those on fewer: {n} numbers, off by a factor of "
        f"{2 ** np.median(errors):.2f} in the median and {2 ** max(errors):.1f} at most.",
        "",
    ]


def meaning(found: dict, models: dict[str, list[StageModel]], cluster: Network) -> list[str]:
    """Say in sentences what the tables show."""
    said = []
    for size, of_size in models.items():
        one, two = found["sizes"][size]["runs"][:2]
        set_up = [model for model in of_size if model.name != POINT]
        times = [sum(wall(run, model.name) for model in set_up) for run in (one, two)]
        ranks = gains_until([total(set_up, n, cluster) for n in RANKS])
        n, why = of_size[-1].gains_until(cluster)
        said.append(
            f"- **{title_of(size, one)}**: the set-up takes {seconds(times[0])} on one rank and {seconds(times[1])} on two, "
            f"{times[0] / times[1]:.2f} times as fast; by the model it gains until {ranks:,} rank{'s' * (ranks > 1)} "
            f"({seconds(total(set_up, ranks, cluster))}), and most of that is {of_total(set_up, cluster, cluster)[1]}. "
            f"A point takes {seconds(wall(one, POINT))} and {seconds(wall(two, POINT))}; by the model it gains until "
            f"{n:,} rank{'s' * (n > 1)} ({seconds(of_size[-1].seconds(n, cluster))}), and most of that is {why}."
        )
        if not is_quiet(found["sizes"][size]):
            said.append(
                "- The machine had other work: wall times are longer than those of a quiet one, and waiting is left out of the model."
            )
    return [*said, ""]


def report(found: dict, models: dict[str, list[StageModel]], own: Network, cluster: Network) -> str:
    """Return the page's part that is measured."""
    lines = [*([f"**{found['note']}**", ""] if found.get("note") else []), *meaning(found, models, cluster)]
    lines += ["![Time of every stage over ranks](img/scaling.png)", "", "## The machine", "", *of_machine(found, own, cluster)]
    for size, of_size in models.items():
        one = found["sizes"][size]
        lines += [f"## {title_of(size, one['runs'][0])}", "", "### Measured on 1 and 2 ranks", "", *of_strong(one)]
        lines += ["### What ranks say to each other", "", *of_messages(one, own), *checked(one)]
        lines += ["### Modelled", "", *of_models(of_size, one, own, cluster)]
        lines += ["### Growing with the ranks", "", GROWTH, "", *of_weak(of_size, one, cluster)]
    return "\n".join([*lines, "## How it was measured", "", *(f"- {line}" for line in machine.lines(found["machine"])), ""])


def draw(found: dict, models: dict[str, list[StageModel]], network: Network, path: Path) -> None:
    """Draw the time of every stage over ranks, modelled, with what was measured on 1 and 2."""
    with plt.rc_context(RC):
        ratios = [3.0] * len(models) + [1.3]
        figure, (*panels, names) = plt.subplots(1, len(ratios), figsize=(WIDTH, 3.6), layout="constrained", width_ratios=ratios)
        for panel, (size, of_size) in zip(panels, models.items()):
            draw_size(panel, found["sizes"][size]["runs"][:2], of_size, network)
            panel.set_title(title_of(size, found["sizes"][size]["runs"][0]), loc="left")
        panels[0].set_ylabel("seconds")
        names.axis("off")
        names.legend(*panels[0].get_legend_handles_labels(), loc="center left", bbox_to_anchor=(-0.2, 0.5))
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
        plt.close(figure)


def draw_size(panel, runs: list[dict], models: list[StageModel], network: Network) -> None:
    """Draw one size: set-up in ink with its band, stages in colours, a point dashed."""
    set_up = [model for model in models if model.name != POINT]
    panel.fill_between(
        RANKS, *([total(set_up, n, network, bound) for n in RANKS] for bound in ("best", "worst")), color="#dddddd"
    )
    panel.plot(RANKS, [total(set_up, n, network) for n in RANKS], color=INK, lw=2, label="set-up, best to worst")
    for i, model in enumerate(set_up):
        style = "--" if i >= len(COLOURS) else "-"
        panel.plot(
            RANKS, [model.seconds(n, network) for n in RANKS], style, color=COLOURS[i % len(COLOURS)], lw=1, label=model.name
        )
    panel.plot(RANKS, [models[-1].seconds(n, network) for n in RANKS], ":", color=INK, label=name_of(POINT))
    for run in runs:
        panel.plot(run["ranks"], sum(wall(run, model.name) for model in set_up), "o", color=INK, ms=4)
        panel.plot(run["ranks"], wall(run, POINT), "o", color=INK, ms=3, mfc="none")
        for i, model in enumerate(set_up):
            panel.plot(run["ranks"], wall(run, model.name), ".", color=COLOURS[i % len(COLOURS)], ms=4)
    panel.set(xscale="log", yscale="log", xlabel="ranks")
    panel.set_xticks(RANKS[::2], [f"{n:,}" for n in RANKS[::2]])
    panel.minorticks_off()
