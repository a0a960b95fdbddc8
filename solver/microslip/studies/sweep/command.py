"""The command `sweep`: samples, structures and peaks on groups of ranks, table, files, pictures."""

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mpi4py import MPI

from ...library.build import build
from ...library.design import Design
from ...library.sample_peaks import DONE, MISSING, OUTSIDE, Sample, SamplePeaks, output_of
from ...library.settings import output_names, units_of
from ...library.sweep import SweepTable, outside, table_of
from ...library.varied import Varied
from ...messages.errors import CaseError, ConvergenceError, Interrupted
from ...messages.words import counted
from ...observe.log import RunLog
from ...observe.stops import explaining_continuation
from ...parallel.agree import on_root
from ...parallel.rank_groups import Counter, Groups, Reports, dealt, split
from ...restart.identity import identity_of
from ...scene.schema import Scene
from ...system.files import file_errors, make_folder
from ...system.signals import raise_stop
from ...system.walltime import TimeLimit, time_limit
from ...system.watchdog import unwatched
from ..log import log_of
from .report import write_sweep
from .request import Request, design_of, refusal

MARGIN, SLOWEST = 5.0, 2.0  # s before the end of the time, and times the slowest sample, at which no further one begins
MOST_LISTED = 10  # samples that failed


@dataclass(frozen=True, eq=False)
class Planned:
    """The samples of a sweep, and those that are known already."""

    design: Design
    varied: Varied
    keys: list[str]  # of the samples on disk
    known: dict[int, Sample]  # from an earlier run, and those that the scene does not allow
    left: list[int]  # to be solved by this run


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Compute the peaks of samples that an earlier run in the folder has not, and write them.  Collective on ``comm``.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    ConvergenceError : samples without a peak, after everything was written; on every rank
    Interrupted : a signal or the time limit, with every finished sample on the disk; on every rank
    """
    limit = on_root(comm, time_limit, request.walltime)
    name = "sweep.log" if request.part[1] == 1 else f"sweep-{request.part[0]}.log"
    with explaining_continuation(folder), log_of(comm, folder / name, scene, options) as log:
        planned = on_root(comm, planned_of, scene, folder, request, options)
        log.note(in_words(planned, request))
        table = solved(scene, comm, folder, request, planned, log, limit)
        with log.stage("table and pictures"):
            text = on_root(comm, partial(write_sweep, table, scene, folder, request.design == "indices"))
        log.note(text)
        log.note(f"results in {folder}")
    failed = table.failures
    if failed:
        more = [f"and {len(failed) - MOST_LISTED} more"] * (len(failed) > MOST_LISTED)
        message = "\n".join(
            [f"sweep: {len(failed)} of {counted(len(table), 'sample')} have no peak", *failed[:MOST_LISTED], *more]
        )
        raise ConvergenceError(f"{message}\nthe others are in {folder}")


def planned_of(scene: Scene, folder: Path, request: Request, options: tuple[str, ...]) -> Planned:
    """Return the samples of a sweep, and those on the disk.  Local, on rank 0.

    Raises
    ------
    CaseError : invalid samples, or samples that the scene does not allow
    """
    if not scene.awaits_file:
        output_of(scene, request.output)
    design = design_of(scene, request)
    varied = Varied.of(scene, design.keys, request.keep_modes)
    refused = outside(varied, design)
    if refused and request.outside != "skip":
        raise CaseError(refusal(refused, len(design)))
    part = _part_name(request)
    if request.fresh:
        remove_samples(folder, part)
    keys = keys_of(design, identity_of(scene, options).whole, request.output, request.curves, request.keep_modes)
    stored = read_samples(folder)
    known = {i: stored[key] for i, key in enumerate(keys) if key in stored and stored[key].status == DONE}
    known |= {i: Sample(tuple(map(float, design.values[i])), OUTSIDE, why) for i, why in refused.items()}
    number, parts = request.part
    in_order = varied.from_the_scene(design.values, design.spread)
    left = [i for i in in_order if i not in known and i % parts == number - 1]
    return Planned(design, varied, keys, known, left)


def _part_name(request: Request) -> str:
    return "all" if request.part[1] == 1 else str(request.part[0])


def in_words(planned: Planned, request: Request) -> str:
    """Return a line that describes the samples of a sweep."""
    n, n_outside = len(planned.design), sum(sample.status == OUTSIDE for sample in planned.known.values())
    axes = " x ".join(map(str, planned.design.shape))
    kinds = ", ".join(f"{key} ({_RECOMPUTED[kind]})" for key, kind in zip(planned.varied.keys, planned.varied.kinds))
    n_known = len(planned.known) - n_outside
    parts = f"; part {request.part[0]} of {request.part[1]}" if request.part[1] > 1 else ""
    return "\n".join(
        [
            f"{counted(n, 'sample')}, {planned.design.kind} {axes}{parts}: {kinds}",
            *[f"{n_outside} of them are outside what the scene allows and are left out"] * (n_outside > 0),
            *[f"{n_known} of them were computed by an earlier run"] * (n_known > 0),
        ]
    )


_RECOMPUTED = {
    "level": "on the same structure",
    "law": "on the same structure",
    "rest": "another state of rest",
    "settings": "on the same structure",
    "load": "on the same structure",
    "build": "built again",
}


def solved(
    scene: Scene, comm: MPI.Comm, folder: Path, request: Request, planned: Planned, log: RunLog, limit: TimeLimit | None
) -> SweepTable:
    """Return the table of a sweep, with the samples that this run solves.  Collective."""
    units = blocks(planned)
    groups = split(comm, max(1, min(request.groups or comm.size, len(units))))
    with log.stage("structure"), unwatched():
        of_rest = "rest" in planned.varied.kinds
        structure = build(scene, groups.comm, log if groups.n == 1 else None, keeps_reference=of_rest)
    with log.stage("the scene itself"), unwatched():
        peaks = SamplePeaks(structure, planned.varied, request.output, planned.design.spread, request.curves)
    log.note(_nominal_in_words(peaks.nominal, output_names(scene)[peaks.output], units_of(scene).outputs[peaks.output], groups))
    samples = dict(planned.known)
    with log.stage("samples"):
        samples |= follow(peaks, units, groups, planned, folder, request, log, limit)
    peaks.close()
    structure.close()
    samples = comm.bcast(samples)
    if request.part[1] > 1:
        samples |= on_root(comm, _of_other_parts, folder, planned)
    all_of_them = [
        samples.get(i, Sample(tuple(map(float, row)), MISSING, "not computed yet")) for i, row in enumerate(planned.design.values)
    ]
    groups.comm.Free()
    return table_of(scene, planned.design, planned.varied, all_of_them, peaks.nominal, peaks.output, peaks.grid)


def _of_other_parts(folder: Path, planned: Planned) -> dict[int, Sample]:
    stored = read_samples(folder)
    return {i: stored[key] for i, key in enumerate(planned.keys) if key in stored}


def _nominal_in_words(nominal: Sample, name: str, unit: str, groups: Groups) -> str:
    of_groups = f"; samples on {groups.n} groups of ranks" if groups.n > 1 else ""
    return (
        f"the scene itself: peak of {name} {nominal.amplitude:.6g} {unit} at {nominal.frequency:.7g} Hz, "
        f"damping {100.0 * nominal.damping:.4g} %{of_groups}"
    )


def blocks(planned: Planned) -> list[list[int]]:
    """Return the remaining samples in blocks, one per structure, or singly if all have the same structure.  Local."""
    by_structure: dict[tuple, list[int]] = {}
    for i in planned.left:
        by_structure.setdefault(planned.varied.items(planned.design.values[i], "build"), []).append(i)
    if len(by_structure) > 1:
        return list(by_structure.values())
    return [[i] for i in planned.left]


def follow(
    peaks: SamplePeaks,
    units: Sequence[list[int]],
    groups: Groups,
    planned: Planned,
    folder: Path,
    request: Request,
    log: RunLog,
    limit: TimeLimit | None,
) -> dict[int, Sample]:
    """Return the samples, on rank 0 those of all groups; each is on the disk when it is solved.  Collective.

    Raises
    ------
    MicroslipError : the error that ended a group, on the ranks of all groups
    """
    samples: dict[int, Sample] = {}

    def receive(i: int, sample: Sample) -> None:
        samples[i] = sample
        log.note(_line(i, sample, len(samples), len(planned.left)), in_results=False)

    counter, reports, slowest = Counter(groups.world), Reports(groups, receive), 0.0

    def finished(i: int, sample: Sample) -> None:
        store(folder, _part_name(request), groups.number, planned.keys[i], sample)
        reports.notify(i, sample)

    with reports.shared_failure():
        for task in dealt(groups, counter, len(units)):
            for i in units[task]:
                on_root(groups.comm, _check_time, limit, slowest)
                sample = peaks.solve(planned.design.values[i])
                slowest = max(slowest, sample.seconds)
                on_root(groups.comm, finished, i, sample)
        with unwatched():
            on_root(groups.comm, reports.finish)
    reports.free()
    counter.free()
    return samples


def _check_time(limit: TimeLimit | None, slowest: float) -> None:
    """Raise Interrupted after a signal, or if the time left does not suffice for another sample.  Local, on a group's root."""
    raise_stop()
    if limit is not None and limit.remaining < MARGIN + SLOWEST * slowest:
        raise Interrupted(f"stopped {max(limit.remaining, 0.0):.0f} s before the end of {limit.source}")


def _line(i: int, sample: Sample, n: int, of: int) -> str:
    values = " ".join(f"{value:.6g}" for value in sample.values)
    if sample.status != DONE:
        return f"  {n} of {of}: sample {i}: {values}: {sample.why}"
    along = ", along its curve" if sample.is_followed else ""
    return (
        f"  {n} of {of}: sample {i}: {values}: {sample.amplitude:.6g} at {sample.frequency:.7g} Hz, "
        f"{sample.newton} Newton iterations{along}, {sample.seconds:.3g} s{'; ' * bool(sample.why)}{sample.why}"
    )


FOLDER = "samples"


def keys_of(design: Design, identity: str, output: str | None, *options: bool) -> list[str]:
    """Return the key of each sample.  Local."""
    head = json.dumps([identity, design.keys, output, *options])
    return [hashlib.sha256(f"{head} {[float(x).hex() for x in row]}".encode()).hexdigest()[:24] for row in design.values]


def read_samples(folder: Path) -> dict[str, Sample]:
    """Return the stored samples by their keys.  Local."""
    samples = {}
    for path in sorted((folder / FOLDER).glob("*.jsonl")):
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                texts = json.loads(line)
                key = texts.pop("key")
                samples[key] = Sample.from_texts(texts)
            except (ValueError, TypeError, KeyError, AttributeError):
                continue
    return samples


def remove_samples(folder: Path, part: str) -> None:
    """Remove the samples of a part, or with "all" every one.  Local."""
    for path in (folder / FOLDER).glob("*.jsonl" if part == "all" else f"{part}-*.jsonl"):
        with file_errors(str(path)):
            path.unlink()


def store(folder: Path, part: str, group: int, key: str, sample: Sample) -> None:
    """Append a sample; it is on the disk when this returns.  Local, on the root of a group.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    path = folder / FOLDER / f"{part}-{group}.jsonl"
    make_folder(str(path.parent))
    line = json.dumps({"key": key, **sample.as_texts()}) + "\n"
    with file_errors(str(path)), open(path, "ab+") as file:
        if file.tell() > 0:
            file.seek(-1, os.SEEK_END)
            line = line if file.read(1) == b"\n" else f"\n{line}"
        file.write(line.encode())
        file.flush()
        os.fsync(file.fileno())
