"""Every bad input and every fault of the catalogue as a user meets it: in separate processes, on some ranks, in limited time.

    python jobs/bench/try_catalogue.py [--ranks 1 2] [--sorts scene model matrices command results machine fault] [--only WORD]
                                   [--every N] [--once] [--messages]

Each entry works on a folder of valid files of which one is spoiled (tests/catalogue).  Expected are the promised status, one
message with the information that a user needs, no traceback, an end in time, and unchanged results of an earlier run; after a
fault also an end within 10 s, and success of the same command afterwards.  `--messages` shows the messages; `--every` takes only
some entries. Any violation makes status 1.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "meshes")]

from microslip.parallel.petsc import initialise

initialise()
import machine
from catalogue import processes
from catalogue.bad_inputs import BY_SORT
from catalogue.faults import FAULTS, WITHIN
from catalogue.judge import MARK
from catalogue.sound import write_sound

ENTRIES = {
    **{sort: [(case.name, case) for case in cases] for sort, cases in BY_SORT.items()},
    "fault": [(one.name, one) for one in FAULTS],
}


def chosen(arguments: argparse.Namespace) -> list[tuple[str, str, object]]:
    """Return sort, name and entry of the requested entries."""
    entries = [(sort, name, entry) for sort in arguments.sorts for name, entry in ENTRIES[sort] if arguments.only in name]
    entries = [one for one in entries if not (getattr(one[2], "not_by_root", False) and os.geteuid() == 0)]
    return entries[:: arguments.every]


def message(stderr: str) -> str:
    """Return the error message in a line."""
    return " ".join((stderr.partition(MARK)[2] or stderr[-200:]).split())[:400]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--sorts", nargs="+", choices=ENTRIES, default=list(ENTRIES))
    parser.add_argument("--only", default="", metavar="WORD", help="of the names")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="the first of each N")
    parser.add_argument("--once", action="store_true", help="do not repeat the command after a fault")
    parser.add_argument("--messages", action="store_true")
    arguments = parser.parse_args()
    print("\n".join(machine.lines(machine.facts())), flush=True)
    counts: dict[tuple[str, int], tuple[int, int, float]] = {}
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="catalogue_") as folder:
        sound = Path(folder, "sound")
        sound.mkdir()
        write_sound(sound)
        for ranks in arguments.ranks:
            for sort, name, entry in chosen(arguments):
                here = Path(folder, "here")
                if sort == "fault":
                    ended, wrong = processes.fault(entry, sound, here, ranks, not arguments.once)
                else:
                    ended, wrong = processes.bad_input(entry, sound, here, ranks)
                shutil.rmtree(here)
                good, n, longest = counts.get((sort, ranks), (0, 0, 0.0))
                is_longer = getattr(entry, "within", WITHIN) > WITHIN  # the watchdog's limit
                counts[sort, ranks] = good + (not wrong), n + 1, longest if is_longer else max(longest, ended.seconds)
                if wrong or arguments.messages:
                    print(
                        f"{sort}, {ranks} ranks, {name}: {'; '.join(wrong) or 'as it should be'} [{ended.status}, {ended.seconds:.1f} s]\n    {message(ended.stderr)}",
                        flush=True,
                    )
    print("\n| sort | ranks | entries | as they should be | seconds, at most |\n| --- | ---: | ---: | ---: | ---: |")
    print(
        "\n".join(f"| {sort} | {ranks} | {n} | {good} | {longest:.1f} |" for (sort, ranks), (good, n, longest) in counts.items())
    )
    print(f"\n{time.monotonic() - began:.0f} s")
    sys.exit(any(good < n for good, n, _ in counts.values()))


if __name__ == "__main__":
    main()
