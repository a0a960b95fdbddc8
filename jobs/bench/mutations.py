"""Changes the scenes of the catalogue at random, and checks or runs each: the program may end with status 0, 2, 3 or 4.

    python jobs/bench/mutations.py [--times 1000] [--seed S] [--runs SHARE]

A mutation changes one to three places of a valid scene: a value becomes another of its type (extreme, negative, zero, not
finite), one of another type, or one from elsewhere in the scene; a key or a table is removed, renamed, duplicated or moved.
Scenes are checked; a share of them (`--runs`, a third) is run, without pictures.  One process does all this; it is replaced if it
crashes or takes longer than ten minutes.  Any other status (70 included), a traceback, a crash and a hang are findings: they are
shown with the scene, and make status 1.  Status 4, refused for lack of memory, is counted.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import copy
import io
import json
import os
import random
import select
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "meshes")]
SCENES = ("chain.toml", "lap.toml", *(f"bar_{ending}.toml" for ending in ("inp", "cdb", "bdf", "unv", "exo", "vtu")))
ALLOWED = (0, 2, 3, 4)
HANG = 600.0  # s; a level far above the friction limit takes minutes on a busy machine
NUMBERS = (0, -1, 1, 2, 1e300, -1e300, 1e-300, 1e-320, 1e20, 1e-9, float("nan"), float("inf"), 2**63, 10**30, True)
WORDS = ("", "x", "harmonic", "receptance", "nan", "../x", "\0", "\u00e4", "a" * 5000, "1e3")


def mutated(scene: dict, chance: random.Random) -> dict:
    """Return a scene with one to three places changed.  Local."""
    scene = copy.deepcopy(scene)
    for _ in range(chance.choice((1, 1, 2, 3))):
        places = list(_places(scene))
        numbers = [(holder, key) for holder, key in places if type(holder[key]) in (int, float)]
        if numbers and chance.random() < 0.6:
            _number(*chance.choice(numbers), chance)
        else:
            holder, key = chance.choice(places)
            chance.choice((_value, _value, _removed, _renamed, _moved))(holder, key, places, chance)
    return scene


def as_text(value) -> str:
    """Return a value as one line of TOML.  Local."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {as_text(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_text, value)) + "]"
    return json.dumps(value) if isinstance(value, str | bool) else repr(value)


def _places(item):
    """Yield every entry of tables and arrays: its container, and its key or number."""
    for key in list(item) if isinstance(item, dict) else range(len(item)):
        yield item, key
        if isinstance(item[key], dict | list):
            yield from _places(item[key])


def _number(holder, key, chance: random.Random) -> None:
    """Replace a number by another one."""
    scaled = [type(holder[key])(holder[key] * factor) for factor in (-1, 0.5, 2, 3, 10, 100, 1e3, 1e-3, 1e9, 1e-9)]
    holder[key] = chance.choice(scaled if chance.random() < 0.7 else NUMBERS)


def _value(holder, key, places, chance: random.Random) -> None:
    """Replace a value by one of another type, or by one from elsewhere."""
    elsewhere, other = chance.choice(places)
    taken = [copy.deepcopy(elsewhere[other])] if _is_there(elsewhere, other) else []
    old = holder[key]
    holder[key] = chance.choice([*taken, chance.choice(NUMBERS), chance.choice(WORDS), [], {}, [old], [old, old], [[1.0]]])


def _is_there(holder, key) -> bool:
    return key in holder if isinstance(holder, dict) else key < len(holder)


def _removed(holder, key, places, chance: random.Random) -> None:
    del holder[key]


def _renamed(holder, key, places, chance: random.Random) -> None:
    if isinstance(holder, dict):
        holder[chance.choice((f"{key}s", key[:-1] or "k", key.upper(), "", "a.b", "x"))] = holder.pop(key)
    else:
        holder.append(holder[key])


def _moved(holder, key, places, chance: random.Random) -> None:
    target, name = chance.choice(places)
    value = copy.deepcopy(holder[key])
    if isinstance(target, dict):
        target[chance.choice((key, name)) if isinstance(key, str) else name] = value
    else:
        target.append(value)


def serve() -> None:
    """Check or run the scenes named on standard input, one per line; answer with status and message.  Local."""
    from microslip.parallel.petsc import initialise

    initialise()
    import microslip.results.draw
    from microslip.__main__ import main as program

    microslip.results.draw.draw_share = lambda *share: None
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin:
        arguments = json.loads(line)
        shutil.rmtree("out", ignore_errors=True)
        with contextlib.redirect_stderr(io.StringIO()) as stderr, contextlib.redirect_stdout(io.StringIO()):
            status = program(arguments)
        answers.write(json.dumps([status, stderr.getvalue()]) + "\n")
        answers.flush()


class Worker:
    """The process that checks and runs scenes; replaced when it has died."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.process: subprocess.Popen | None = None

    def do(self, arguments: list[str]) -> tuple[int | str, str]:
        """Return status and message of a command, or how the process ended."""
        process = self.process = self.process or subprocess.Popen(
            [sys.executable, __file__, "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=self.folder
        )
        assert process.stdin is not None and process.stdout is not None, "both are pipes"
        process.stdin.write(json.dumps(arguments) + "\n")
        process.stdin.flush()
        answer = process.stdout.readline() if select.select([process.stdout], [], [], HANG)[0] else "hang"
        if answer not in ("", "hang"):
            return tuple(json.loads(answer))
        process.kill()
        status, self.process = process.wait(), None
        return ("hang" if answer else f"crash, status {status}"), ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--runs", type=float, default=1.0 / 3.0, metavar="SHARE")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve()
        return
    sys.exit(try_mutations(options))


def try_mutations(options: argparse.Namespace) -> bool:
    """Try the requested number of scenes, show findings and counts, and return whether there are findings."""
    from microslip.parallel.petsc import initialise

    initialise()
    from catalogue.sound import write_sound

    chance, n_findings = random.Random(options.seed), 0
    counts: collections.Counter[tuple[str, int | str]] = collections.Counter()
    with tempfile.TemporaryDirectory(prefix="mutations_") as name:
        folder = Path(name)
        write_sound(folder)
        scenes = [tomllib.loads((folder / scene).read_text()) for scene in SCENES]
        worker = Worker(folder)
        for number in range(options.times):
            scene = mutated(chance.choice(scenes), chance)
            text = "".join(f"{json.dumps(key)} = {as_text(value)}\n" for key, value in scene.items())
            (folder / "mutated.toml").write_text(text, encoding="utf-8", errors="surrogateescape")
            arguments = ["run", "mutated.toml", "--out", "out"] if chance.random() < options.runs else ["check", "mutated.toml"]
            status, stderr = worker.do(arguments)
            counts[arguments[0], status] += 1
            if status not in ALLOWED or "Traceback" in stderr or (status != 0 and stderr.count("microslip: error: ") != 1):
                n_findings += 1
                print(f"\n{number}: {arguments[0]}, {status}: {stderr[-1500:]}\n{text}", flush=True)
            if (number + 1) % 100 == 0:
                print(f"{number + 1} scenes: {_in_words(counts)}", flush=True)
    print(f"\nSeed {options.seed}, {options.times} scenes, {n_findings} findings")
    return n_findings > 0


def _in_words(counts: collections.Counter) -> str:
    """Return the counts of each status as text."""
    return ", ".join(f"{command} {status}: {n}" for (command, status), n in sorted(counts.items(), key=str))


if __name__ == "__main__":
    main()
