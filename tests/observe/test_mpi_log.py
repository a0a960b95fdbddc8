"""The log on any number of ranks: rank 0 writes, times and memory are those of all ranks, errors cause no deadlock."""

import io
import sys

import numpy as np
import pytest
from mpi4py import MPI

from microslip.messages.errors import CaseError, ResourceError
from microslip.observe.level_log import LevelLog
from microslip.observe.log import RunLog
from microslip.observe.observer import Observers
from microslip.points.branch import Branch, Point
from microslip.points.sweep import Sweep
from microslip.results.measures import AMPLITUDE, MEAN

COMM = MPI.COMM_WORLD


@pytest.fixture
def path(tmp_path):
    """Return one path for all ranks."""
    return COMM.bcast(str(tmp_path / "out" / "run.log"))


def lines(path):
    COMM.Barrier()
    with open(path, encoding="utf-8") as file:
        return file.read().splitlines()


def point(frequency, amplitude, states=(0, 1, 1, 2), **changes):
    values = dict(
        omega=2 * np.pi * frequency,
        response=np.array([[0.0, 0.6 * amplitude, 0.8 * amplitude]]),
        U=None,
        p=None,
        energy=None,
        state=np.array(states, dtype=np.uint8),
        unknowns=42,
        newton=3,
        krylov=7,
        friction=0.0,
        damping=0.0,
        input=0.0,
        seconds=0.25,
    )
    return Point(**{**values, **changes})


def run_level(log, level=4.0, failure=None, shown=AMPLITUDE):
    branch = Branch(level, [point(99.0, 1e-6), point(100.0, 3e-6, notes=("mean slip held",)), point(101.0, 2e-6)], failure)
    notify = Observers(COMM, [1.0, level, 9.0], [LevelLog(log, Sweep(2 * np.pi * 99.0, 2 * np.pi * 101.0), 3, shown)]).notify
    notify("level_started", 1)
    for each in branch.points:
        notify("point", 1, each)
    notify("level_finished", 1, branch)


def test_header_states_version_machine_and_scene(path):
    with RunLog(COMM, path, False, screen=False, command="microslip run x.toml", facts={"PETSc": "3.18.5"}):
        pass
    text = "\n".join(lines(path))
    assert text.startswith("microslip 0.")
    for word in ("microslip run x.toml", f"{COMM.size} rank", "PETSc", "3.18.5", "numpy", "date"):
        assert word in text


def test_stages_take_the_time_of_the_slowest_rank_and_the_memory_of_all(path, monkeypatch):
    clock = {"now": 0.0}
    monkeypatch.setattr("microslip.observe.log.time.perf_counter", lambda: clock["now"])
    with RunLog(COMM, path, False, screen=False) as log:
        with log.stage("outer"):
            with log.stage("inner"):
                clock["now"] += 1.0 + COMM.rank
            clock["now"] = 10.0
    inner, outer, total = log.stages
    assert (inner.name, inner.depth, inner.seconds) == ("inner", 1, float(COMM.size))
    assert (outer.name, outer.depth, outer.seconds) == ("outer", 0, 10.0)
    assert total.seconds == 10.0
    assert outer.memory >= outer.memory_largest > 20.0
    assert outer.memory == pytest.approx(COMM.size * outer.memory_largest, rel=0.5)
    table = [line for line in lines(path) if line.startswith(("outer", "  inner", "total"))][-3:]
    assert [line.split()[0] for line in table] == ["outer", "inner", "total"] and "100.0%" in table[0]


def test_stages_precede_their_parts_and_parts_of_the_same_name_are_one(path, monkeypatch):
    clock = {"now": 0.0}
    monkeypatch.setattr("microslip.observe.log.time.perf_counter", lambda: clock["now"])
    with RunLog(COMM, path, False, screen=False) as log:
        for outer in ("first", "second", "second"):
            with log.stage(outer):
                for inner in ("factor", "modes", "factor"):
                    with log.stage(inner):
                        clock["now"] += 1.0
        with log.stage("unfinished"):
            with log.stage("factor"):
                clock["now"] += 1.0
            inside = log.summary()
    parts = [("factor, 2 times", 1, 2.0), ("modes", 1, 1.0)]
    expected = [("first", 0, 3.0), *parts, ("second", 0, 3.0), *parts, ("second", 0, 3.0), *parts]
    assert [(stage.name, stage.depth, stage.seconds) for stage in inside] == [*expected, ("factor", 1, 1.0)]
    end = [("unfinished", 0, 1.0), ("factor", 1, 1.0), ("total", 0, 10.0)]
    assert [(stage.name, stage.depth, stage.seconds) for stage in log.summary()] == [*expected, *end]


def test_a_stage_without_notes_is_one_line(path):
    with RunLog(COMM, path, False, screen=False) as log:
        with log.stage("quiet"):
            pass
        with log.stage("loud"):
            log.note("one note")
    text = lines(path)
    assert sum(line.startswith("quiet") for line in text) == 2  # the line and the table's
    start = text.index("loud")
    assert text[start + 1] == "one note" and text[start + 2].startswith("loud  ") and text[start + 2].endswith("MiB")


def test_each_point_is_a_line_and_each_level_a_summary(path):
    with RunLog(COMM, path, False, screen=False) as log:
        run_level(log, failure="hb: no convergence beyond 101 Hz")
    text = lines(path)
    start = text.index("level 2 of 3: 4 N, 99 to 101 Hz")
    assert text[start + 3].split() == ["1", "100", "3.00000e-06", "2", "1", "42", "3", "7", "0.2500"]
    assert len({len(text[start + k]) for k in (1, 2, 3, 4)}) == 1 and len(text[start + 1]) < 80
    assert text[start + 5] == (
        "level 2 of 3: 4 N: 3 points in 0.75 s; peak 3.0000e-06 m (7.5000e-07 m/N) at 100 Hz, 2 of 4 pairs slip, 1 open"
    )
    assert text[start + 6].strip() == "mean slip held: 1 of 3 points, 100 to 100 Hz"
    assert text[start + 7].strip() == "stopped early: hb: no convergence beyond 101 Hz"


def test_the_mean_of_statics_is_printed_with_its_sign(path):
    still = Branch(4.0, [point(99.0, 0.0, response=np.array([[-2e-6, 0.0, 0.0]]))])
    with RunLog(COMM, path, False, screen=False) as log:
        notify = Observers(COMM, [4.0], [LevelLog(log, Sweep(2 * np.pi * 99.0, 2 * np.pi * 101.0), 1, MEAN)]).notify
        notify("level_started", 0)
        notify("point", 0, still.points[0])
        notify("level_finished", 0, still)
    head, line, total = [each for each in lines(path) if "mean_m" in each or "e-06" in each]
    assert head.split()[2] == "mean_m" and line.split()[2] == "-2.00000e-06"
    assert "1 point in" in total and "displacement -2.0000e-06 m (-5.0000e-07 m/N) at every frequency" in total


def test_points_of_mixed_levels_are_labelled_and_counted_by_level(path):
    with RunLog(COMM, path, False, screen=False) as log:
        observers = Observers(COMM, [4.0, 8.0], [LevelLog(log, Sweep(10.0, 20.0), 2)])
        for number in (1, 0):
            observers.notify("level_started", number, f"rank {number}")
        for number in (1, 0, 1):
            observers.notify("point", number, point(99.0 + number, 1e-6))
        observers.notify("level_finished", 1, Branch(8.0))
    words = [line.split() for line in lines(path) if "1.00000e-06" in line]
    assert [(line[0], line[1], line[2]) for line in words] == [("8", "0", "100"), ("4", "0", "99"), ("8", "1", "100")]
    assert any(line.startswith("level 2 of 2: 8 N: 2 points in 0.5 s; peak") for line in lines(path))
    assert [len(branch.points) for branch in observers.branches] == ([1, 2] if COMM.rank == 0 else [0, 0])


def test_an_error_of_an_observer_is_raised_on_every_rank():
    class Full:
        def level_started(self, number, level, where):
            raise ResourceError("the disk is full")

    with pytest.raises(ResourceError, match="the disk is full"):
        Observers(COMM, [1.0], [Full()]).notify("level_started", 0)


def test_a_level_without_a_point(path):
    with RunLog(COMM, path, False, screen=False) as log:
        notify = Observers(COMM, [1.0], [LevelLog(log, Sweep(10.0, 20.0), 1)]).notify
        notify("level_started", 0)
        notify("level_finished", 0, Branch(1.0, [], "hb: no convergence at the first frequency"))
    assert any("no point converged" in line for line in lines(path))


def test_an_error_closes_the_log_without_waiting_for_other_ranks(path):
    """All ranks raise, one of them without notifying the others of the log."""
    with pytest.raises(CaseError):
        with RunLog(COMM, path, False, screen=False) as log:
            with log.stage("mesh"):
                pass
            with log.stage("assembly"):
                raise CaseError("element 7 is inverted")
    text = lines(path)
    assert any(line.startswith("assembly ended after") and line.endswith("CaseError") for line in text)
    assert text[-1] == "ended by CaseError: element 7 is inverted"
    assert any(line.startswith("mesh ") for line in text[-4:])
    COMM.Barrier()  # no rank waits in a reduction of the log


def test_an_error_is_printed_by_the_end_of_the_program_only(path, capsys):
    with pytest.raises(CaseError):
        with RunLog(COMM, path, False):
            raise CaseError("element 7 is inverted")
    assert "element 7" not in capsys.readouterr().out


def test_a_file_that_cannot_be_written_is_an_error_on_every_rank(path, tmp_path):
    folder = COMM.bcast(str(tmp_path))
    if COMM.rank == 0:
        open(folder + "/taken", "w").close()
    COMM.Barrier()
    with pytest.raises(CaseError, match="taken"):
        RunLog(COMM, folder + "/taken/run.log", False, screen=False)


def test_a_full_disk_ends_the_log_not_the_run(capsys):
    with RunLog(COMM, "/dev/full", False) as log:
        log.note("still here")
    out = capsys.readouterr().out
    assert ("no longer written" in out) == (COMM.rank == 0) and ("still here" in out) == (COMM.rank == 0)
    assert out.count("no longer written") <= 1


def test_a_batch_screen_has_the_lines_of_the_file(path, capsys):
    with RunLog(COMM, path, False) as log:
        with log.stage("response"):
            run_level(log)
    out = capsys.readouterr().out
    if COMM.rank == 0:
        assert [line for line in out.splitlines()] == [line for line in lines(path) if line != "response"]
    else:
        assert out == "" and lines(path)


def test_a_terminal_has_a_progress_bar_instead_of_points(path, monkeypatch):
    pytest.importorskip("rich")
    screen = io.StringIO()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with RunLog(COMM, path, True) as log:
        with log.stage("response"):
            run_level(log)
        log.note("[not] :smile: markup")
    out = screen.getvalue()
    if COMM.rank > 0:
        assert out == ""
    else:
        assert "level 2 of 3: 4 N" in out and "points" in out and "\x1b[" in out
        assert "1.00000e-06" not in out and "peak 3.0000e-06 m" in out
        assert "[not] :smile: markup" in out
    assert sum("e-06 " in line for line in lines(path)) == 4


def test_no_file_and_no_screen(capsys):
    with RunLog(COMM, None, screen=False) as log:
        run_level(log)
    assert capsys.readouterr() == ("", "")
