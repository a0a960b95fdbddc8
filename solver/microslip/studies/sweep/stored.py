"""Samples on disk: each is stored when it is solved, as a line of JSON with a key of all its inputs.

    samples/all-0.jsonl, ...        of each group of ranks; of part 3 of a job array samples/3-0.jsonl, ...

A line that an interruption has cut is no JSON and is passed over; so is one of another key.
"""

import hashlib
import json
import os
from pathlib import Path

from ...library.design import Design
from ...library.sample_peaks import Sample
from ...system.files import file_errors, make_folder

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
