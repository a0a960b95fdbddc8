"""Strong and weak scaling of every stage: measured on 1 and 2 ranks, messages counted on up to 16, modelled for up to 1,024.

    python jobs/bench/scaling.py [--sizes small paper] [--count small:4,8,16 paper:4,8] [--latency 2e-6] [--bandwidth 1e10]
                                 [--seconds 440] [--page docs/scaling.md] [--note TEXT] [--out DIR] [--again]

Writes scaling.json, scaling.md and img/scaling.png in DIR (results/bench), and with --page the page between its markers and its
picture.  --again makes tables and picture of scaling.json as it is.  Ranks beyond the machine's cores share them: what they say
to each other and what processor time each takes is counted; how long they wait is not used.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
import argparse
import json
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import machine
from mpi_counter import compiled, preloading
from scaling_model import RANKS, Network, fitted_network
from scaling_report import draw, models_of, report

ROOT = Path(__file__).parents[2]
HALF = {"small": 2, "medium": 4, "paper": 6}  # elements along the chord that give half the DOFs and pairs of a size
BEGIN, END = "<!-- scaling.py: begin -->", "<!-- scaling.py: end -->"


class Runner:
    """Starts measurements, each in a job of its own, and says what they took."""

    def __init__(self, folder: Path, seconds: float):
        self.folder, self.limit, self.start = folder, seconds, time.monotonic()
        self.library = compiled(folder)

    def left(self) -> float:
        """Return the seconds that are left."""
        return self.limit - (time.monotonic() - self.start)

    def measure(self, request: dict, ranks: int, optional: bool = False) -> dict | None:
        """Return what scaling_of.py reports on so many ranks; None of an optional one for which there is no time."""
        command = [*preloading(self.library), sys.executable, str(Path(__file__).with_name("scaling_of.py")), json.dumps(request)]
        if ranks > 1:
            command = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "--oversubscribe", "-n", str(ranks), *command]
        start, what = time.monotonic(), f"{request['kind']} {Path(request.get('scene', '')).stem} on {ranks}"
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as job:
            try:
                said, _ = job.communicate(timeout=max(self.left(), 0.1) if optional else None)
            except subprocess.TimeoutExpired:
                job.terminate()  # mpirun ends its ranks
                job.communicate()
                print(f"{what}: left out, no time for it", flush=True)
                return None
        if job.returncode != 0:
            sys.exit(f"scaling.py: {shlex.join(command)} ended with status {job.returncode}")
        print(f"{what}: {time.monotonic() - start:.1f} s; {self.left():.0f} s are left", flush=True)
        return json.loads(said.splitlines()[-1])


def scene_of(size: str) -> Path:
    return ROOT / "jobs" / f"fan_{size}.toml"


def halved(size: str, folder: Path) -> Path:
    """Return the scene of a size with a mesh of half its elements along the chord, both made in ``folder``."""
    mesh, scene = folder / f"fan_half_{size}.msh", folder / f"fan_half_{size}.toml"
    make_mesh(size, mesh, "--chord", str(HALF[size]))
    scene.write_text(re.sub(r'(?m)^mesh = ".*"$', f'mesh = "{mesh.name}"', scene_of(size).read_text(), count=1))
    return scene


def make_mesh(size: str, path: Path, *more: str) -> None:
    """Write a mesh of the fan sector, unless it is there."""
    if not path.exists():
        command = [sys.executable, str(ROOT / "meshes" / "fan_sector.py"), "--size", size, "--out", str(path), *more]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def measured(options) -> dict:
    """Return all measurements: of the machine, and of each size on 1, 2 and more ranks, and its half on one."""
    runner = Runner(options.out.resolve(), options.seconds)
    found: dict = {"network": runner.measure({"kind": "machine"}, 2), "sizes": {}}
    for size in options.sizes:
        make_mesh(size, ROOT / "meshes" / f"fan_{size}.msh")
        request = {"kind": "scene", "level": options.level, "points": options.points}
        runs = [runner.measure({**request, "scene": str(scene_of(size))}, ranks) for ranks in (1, 2)]
        half = runner.measure({**request, "scene": str(halved(size, runner.folder))}, 1)
        shares = runner.measure({"kind": "shares", "scene": str(scene_of(size)), "ranks": list(RANKS)}, 1)
        found["sizes"][size] = {"runs": runs, "half": half, "shares": shares}
    for size, ranks in counts(options):  # last, if time is left
        more = runner.measure({**request, "scene": str(scene_of(size))}, ranks, optional=True)
        if more is not None:
            found["sizes"][size]["runs"].append(more)
    return found


def counts(options) -> list[tuple[str, int]]:
    """Return sizes and ranks that are counted, the fewest ranks first."""
    asked = [(size, ranks) for size in options.sizes for ranks in options.count.get(size, ())]
    return sorted(asked, key=lambda one: one[1])


def counted(text: str) -> tuple[str, tuple[int, ...]]:
    size, ranks = text.split(":")
    return size, tuple(map(int, ranks.split(",")))


def into_page(page: Path, text: str) -> None:
    """Put a text between the markers of a page."""
    before, rest = page.read_text().split(BEGIN)
    page.write_text(f"{before}{BEGIN}\n\n{text}\n{END}{rest.split(END)[1]}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", default=["small", "paper"], choices=HALF)
    parser.add_argument("--count", type=counted, nargs="*", default=[("small", (4, 8, 16)), ("paper", (4, 8))], help="SIZE:RANKS")
    parser.add_argument("--level", type=float, default=15.0, help="N")
    parser.add_argument("--points", type=int, default=12, help="as in a scene, along the level that is timed")
    parser.add_argument("--latency", type=float, default=2e-6, help="of the modelled network, s")
    parser.add_argument("--bandwidth", type=float, default=1e10, help="of the modelled network, bytes/s")
    parser.add_argument("--seconds", type=float, default=440.0, help="after which ranks beyond two are no longer counted")
    parser.add_argument("--page", type=Path, help="page whose part between the markers is made anew")
    parser.add_argument("--note", default="", help="a sentence on the machine, a busy one say")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--again", action="store_true", help="tables and picture of what was measured before")
    options = parser.parse_args()
    options.count = dict(options.count)
    options.out.mkdir(parents=True, exist_ok=True)
    kept = options.out / "scaling.json"
    found = json.loads(kept.read_text()) if options.again else {**measured(options), "machine": machine.facts()}
    found["note"] = options.note
    kept.write_text(json.dumps(found, indent=1))
    own = fitted_network(found["network"]["sizes"], [0.5 * one for one in found["network"]["there and back"]])
    cluster = Network(options.latency, options.bandwidth)
    models = {size: models_of(of_size, own) for size, of_size in found["sizes"].items()}
    text = report(found, models, own, cluster)
    pictures = (options.page.parent if options.page else options.out) / "img"
    draw(found, models, cluster, pictures / "scaling.png")
    (options.out / "scaling.md").write_text(text)
    if options.page:
        into_page(options.page, text)
    print(text)


if __name__ == "__main__":
    main()
