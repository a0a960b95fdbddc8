"""The benchmark of memory reads the output of check and run.log."""

import memory
import pytest

CHECKED = """memory     peak by the end of each stage, MiB: all ranks, largest, with 24 modes
           partition                           162      162 measured
           factor of the stuck structure       253      130
           including 30.3 MB for the factor, less with 20.1 MB of it on disk; 0.152 MB for static columns
           this machine has 21.7 GB available
"""
LOGGED = """stage                                      seconds  share  peak memory, MiB: all ranks  largest
partition                                    0.005   0.1%                          160      160
assembly                                     0.226   2.9%                          206      206
factor of the stuck structure                0.204   2.6%                          220      120
total                                        7.762 100.0%                          318      318
"""


def test_stages_of_both_are_compared():
    comparison = memory.compared(memory.stages(CHECKED, memory.FORESEEN), memory.stages(LOGGED, memory.TAKEN))
    assert [one["stage"] for one in comparison] == ["partition", "factor of the stuck structure"]
    assert comparison[1]["foreseen"] == (253.0, 130.0) and comparison[1]["taken"] == (220.0, 120.0)
    assert comparison[1]["ratio"] == pytest.approx(1.15)
    runs = [
        {"scene": "fan_small", "ranks": 1, "stages": comparison},
        {"scene": "lap_joint", "ranks": 2, "stages": comparison[1:]},
    ]
    assert memory.measured(runs) == [
        "| stage | fan_small, 1 rank | ratio | lap_joint, 2 ranks | ratio |",
        "| --- | ---: | ---: | ---: | ---: |",
        "| partition | 160 | 1.01 |  |  |",
        "| factor of the stuck structure | 220 | 1.15 | 220 | 1.15 |",
    ]
