"""The message before the end of a run's time limit."""

import pytest
from mpi4py import MPI

from microslip.messages.errors import Interrupted
from microslip.observe.log import RunLog
from microslip.observe.stops import Stops
from microslip.system.walltime import TimeLimit


@pytest.mark.parametrize(
    ("left", "time_left", "stopped"), [(3.0, "3 s are left", "3 s before"), (-100.0, "0 s are left", "100 s after")]
)
def test_a_run_stops_before_the_end_of_its_time_limit(left, time_left, stopped):
    saved = []
    log = RunLog(MPI.COMM_SELF, screen=False)
    stops = Stops(log, lambda: saved.append(True), TimeLimit(left, "the queue"))
    assert log.notes[-1].startswith(f"{time_left} by the queue")
    with pytest.raises(Interrupted, match=f"stopped {stopped} the end of the queue"):
        stops.level_started(0, 1.0, "")
    assert saved == [True]
