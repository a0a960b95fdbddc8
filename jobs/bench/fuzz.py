"""Coverage-guided fuzzing (atheris) of every file reader of the program: changes small valid files at random and reads them.

    python -m pip install --target /tmp/atheris atheris
    PYTHONPATH=/tmp/atheris python jobs/bench/fuzz.py [READER ...] --seconds 600 --out results/fuzz

A reader may return its data or raise one message about the fault of the file.  Any other exception, a failed allocation, a crash
of a library that the reader uses, and a hang are findings; OUT/READER/findings then has the file and the cause.  Each reader runs
in a separate process that may use MEMORY more than at its start; a process that dies is replaced.  Seconds are processor time,
including that of the reader's processes: a busy machine reads the same number of files, only later.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import io
import json
import os
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "solver"), str(ROOT / "tests")]
LONGEST = 65536  # bytes of a file, or twice the longest seed file
HANG = 90  # seconds on a busy machine, above those after which processes of readers end themselves
INSTRUMENTED = (
    "microslip.formats",
    "microslip.guards.lock",
    "microslip.system.plain_data",
    "microslip.scene",
    "microslip.results.read",
    "microslip.results.checked_datasets",
    "microslip.results.fields",
    "microslip.restart",
    "microslip.mesh.read",
    "microslip.mesh.listed",
    "microslip.mesh.values",
    "microslip.assembly.pair_file",
    "tomllib",
)
BENEATH = {"exodus": ("scipy.io._netcdf",), "ansys": ("mapdl_archive",), "nastran": ("pyNastran.bdf.bdf_interface",)}
BENEATH |= {"ansys_input": ("mapdl_archive",), "op2_model": ("pyNastran.op2",)}
BENEATH |= dict.fromkeys(("vtu", "vtk", "fem"), ("meshio",))  # libraries that a reader uses


def main() -> None:
    """Fuzz the readers one after the other and print the findings."""
    arguments = _arguments()
    if arguments.child:
        _fuzz(arguments.readers[0], Path(arguments.out), Path(arguments.work), arguments)
        return
    if importlib.util.find_spec("atheris") is None:
        sys.exit("fuzzing needs atheris: python -m pip install --target DIR atheris, and DIR in PYTHONPATH")
    from microslip.parallel.petsc import initialise

    initialise()
    from reader_targets import TARGETS

    unknown = set(arguments.readers) - set(TARGETS)
    if unknown:
        sys.exit(f"{', '.join(sorted(unknown))}: no such reader; there are {', '.join(TARGETS)}")
    print("| reader | seconds | files | findings |\n| --- | ---: | ---: | --- |", flush=True)
    n_findings = 0
    for name in arguments.readers or TARGETS:
        n_findings += _report(name, Path(arguments.out) / name, *_in_processes(name, arguments))
    sys.exit(1 if n_findings else 0)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", metavar="READER", help="of tests/reader_targets.py; all if none is named")
    parser.add_argument("--seconds", type=float, default=600.0, help="of the processor, for each reader")
    parser.add_argument(
        "--out", default="results/fuzz", help="folder of the corpus and the findings; the corpus is used again by the next run"
    )
    parser.add_argument("--memory", type=int, default=1024, help="MiB that a file may take")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--work", help=argparse.SUPPRESS)
    return parser.parse_args()


def _in_processes(name: str, arguments: argparse.Namespace) -> tuple[float, int]:
    """Fuzz a reader until its time is over, in a new process after each that dies; return seconds and files."""
    folder = Path(arguments.out) / name
    shutil.rmtree(folder / "findings", ignore_errors=True)
    (folder / "findings").mkdir(parents=True)
    (folder / "corpus").mkdir(exist_ok=True)
    (folder / "count").write_bytes(bytes(16))
    seed, n_short, taken = arguments.seed, 0, 0.0
    environment = {**os.environ, "OMPI_MCA_opal_signal": "", "PYTHONHASHSEED": "0"}  # crashes are the fuzzer's to see
    while arguments.seconds - taken > 1.0 and n_short < 5:
        with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None, prefix="fuzz_") as work:
            command = [sys.executable, __file__, name, "--child", "--out", str(folder), "--work", work]
            command += [
                "--seconds",
                str(int(arguments.seconds - taken) + 1),
                "--seed",
                str(seed),
                "--memory",
                str(arguments.memory),
            ]
            with open(folder / "log", "ab") as log:
                status = subprocess.run(command, stdout=log, stderr=log, env=environment, check=False).returncode
            if status == 0:
                break
            _keep_crash(folder, Path(work), status)
        seed += 1
        before, taken = taken, _counted(folder)[0]
        n_short += taken - before < 1.0
    return _counted(folder)


def _counted(folder: Path) -> tuple[float, int]:
    """Return the processor seconds of reading, and the number of files."""
    n_files, microseconds = np.fromfile(folder / "count", dtype="i8")
    return float(microseconds) * 1e-6, int(n_files)


def _keep_crash(folder: Path, work: Path, status: int) -> None:
    """Move the file that killed the process to the findings."""
    made = [*folder.glob("crash-*"), *folder.glob("timeout-*"), *folder.glob("oom-*")] or list(work.glob("input.*"))
    for path in made:
        is_hang = path.name.startswith("timeout")
        name = hashlib.sha1(path.read_bytes()).hexdigest()[:12]
        shutil.move(path, folder / "findings" / name)
        cause = "hangs" if is_hang else f"the process died with status {status}"
        (folder / "findings" / f"{name}.txt").write_text(cause + "\n")


def _report(name: str, folder: Path, seconds: float, n_files: int) -> int:
    """Print the line of a reader and return its number of findings."""
    causes = sorted({path.read_text().splitlines()[0] for path in (folder / "findings").glob("*.txt")})
    if not n_files:
        causes.append(f"no file was read; see {folder / 'log'}")
    print(f"| {name} | {seconds:.0f} | {n_files} | {'; '.join(causes) or 'none'} |", flush=True)
    (folder / "summary.json").write_text(json.dumps({"reader": name, "seconds": seconds, "files": n_files, "findings": causes}))
    return len(causes)


def _fuzz(name: str, folder: Path, work: Path, arguments: argparse.Namespace) -> None:
    """Fuzz one reader in this process, which ends with it."""
    import atheris

    from microslip.parallel.petsc import initialise

    initialise(["-no_signal_handler"])  # crashes are the fuzzer's to see
    rooms = (*INSTRUMENTED, *BENEATH.get(name, ()))
    with atheris.instrument_imports(include=rooms, exclude=_others(rooms), enable_loader_override=False):
        from reader_seeds import SEEDS
        from reader_targets import TARGETS, verdict

        target, findings = TARGETS[name], folder / "findings"
        seeds = SEEDS[name](work)
        for i, content in enumerate(seeds):
            (folder / "corpus" / f"seed{i}").write_bytes(content)
            (work / f"first{target.ending}").write_bytes(content)
            verdict(target, work / f"first{target.ending}")  # readers are imported when a file asks for them: now
    (folder / "words").write_text("".join(f'"{_escaped(word)}"\n' for word in target.dictionary))
    path, count = work / f"input{target.ending}", np.memmap(folder / "count", dtype="i8", mode="r+")

    before, began = int(count[1]), _taken()

    def one_file(content: bytes) -> None:
        taken = _taken() - began
        if taken > arguments.seconds:
            os._exit(0)  # files with new coverage are stored already
        count[:] = count[0] + 1, before + int(1e6 * taken)
        path.write_bytes(content)
        cause = verdict(target, path)
        if cause is not None:
            _keep(findings, cause, content)

    (held,) = re.findall(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())
    limit = int(held) * 1024 + arguments.memory * 2**20
    options = [f"-timeout={HANG}", f"-max_len={max(LONGEST, 2 * max(map(len, seeds)))}", f"-artifact_prefix={folder}/"]
    options += [f"-dict={folder / 'words'}", f"-seed={arguments.seed}", "-rss_limit_mb=0", "-print_final_stats=1", "-verbosity=1"]
    changed = {"npz": _in_archive, "restart": _in_records, **dict.fromkeys(("results", "exodus", "mat"), _in_place)}
    own = {"custom_mutator": changed[name]} if name in changed else {}
    atheris.Setup([sys.argv[0], *options, str(folder / "corpus")], one_file, enable_python_coverage=True, **own)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    atheris.Fuzz()


def _others(rooms: tuple[str, ...]) -> list[str]:
    """Return the modules of the rooms' packages outside the rooms: atheris instruments whole packages."""
    modules = []
    for package in {room.partition(".")[0] for room in rooms}:
        for folder in importlib.util.find_spec(package).submodule_search_locations:
            names = (path.relative_to(Path(folder).parent).with_suffix("").parts for path in Path(folder).rglob("*.py"))
            modules += [".".join(parts).removesuffix(".__init__") for parts in names]
    return [name for name in modules if not any(f"{name}.".startswith(f"{room}.") for room in rooms)]


def _taken() -> float:
    """Return the processor seconds of this process and of its children that have ended."""
    taken = os.times()
    return taken.user + taken.system + taken.children_user + taken.children_system


def _keep(findings: Path, cause: str, content: bytes) -> None:
    """Store the shortest file of each cause."""
    name = hashlib.sha1(re.sub(r"\d+|'[^']*'", "", cause).encode()).hexdigest()[:12]
    if not (findings / name).exists() or len(content) < (findings / name).stat().st_size:
        (findings / name).write_bytes(content)
        (findings / f"{name}.txt").write_text(cause + "\n")


def _escaped(word: str) -> str:
    return "".join(f"\\x{byte:02x}" for byte in word.encode("latin-1"))


def _in_place(content: bytes, longest: int, seed: int) -> bytes:
    """Return an HDF5 file with some bytes changed and none moved: it is full of addresses; every eighth time anything changes."""
    import atheris

    if seed % 8 == 0 or b"\x89HDF" not in content[:1024]:
        return atheris.Mutate(content, longest)
    random, changed = np.random.default_rng(seed), bytearray(content)
    for at in random.integers(0, len(content), random.integers(1, 6)):
        n = int(random.choice([1, 1, 1, 2, 4, 8]))
        put = random.bytes(n) if random.random() < 0.5 else bytes([int(random.choice([0, 1, 127, 128, 255]))]) * n
        changed[at : at + n] = put[: len(content) - at]
    return bytes(changed)


def _in_archive(content: bytes, longest: int, seed: int) -> bytes:
    """Return an archive with one member changed and correct checksums; every fourth time change the archive itself."""
    import atheris

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:  # no longer an archive
        return atheris.Mutate(content, longest)
    if seed % 4 == 0 or not members:
        return atheris.Mutate(content, longest)
    chosen = sorted(members)[seed // 4 % len(members)]
    members[chosen] = atheris.Mutate(members[chosen], len(members[chosen]) + 64)
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED if seed % 8 == 1 else zipfile.ZIP_STORED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return made.getvalue()[:longest]


def _in_records(content: bytes, longest: int, seed: int) -> bytes:
    """Return records of a restart file, one of them changed, with correct checksums; every eighth time change the file itself."""
    import atheris

    from microslip.restart.records import framed

    bodies, at = [], 0
    while at + 12 <= len(content):
        (length,) = struct.unpack_from("<Q", content, at)
        bodies.append(content[at + 12 : at + 12 + min(length, len(content))])
        at += 12 + min(length, len(content))
    if seed % 8 == 0 or not bodies:
        return atheris.Mutate(content, longest)
    chosen = seed // 8 % len(bodies)
    bodies[chosen] = atheris.Mutate(bodies[chosen], max(1, min(longest, len(bodies[chosen]) + 64)))
    return b"".join(map(framed, bodies))[:longest]


if __name__ == "__main__":
    main()
