"""Runs of two versions are read from their logs and compared in a table."""

from compare_commits import read, table

LOG = """level 1 of 2: 1 N: 67 points in 0.2 s; peak 3.6411e-03 m (3.6411e-03 m/N) at 99.26965 Hz, 0 of 218 pairs slip, 0 open
level 2 of 2: 15 N: 89 points in 3.1 s; peak 2.8028e-02 m (1.8685e-03 m/N) at 99.17562 Hz, 112 of 218 pairs slip, 30 open

stage                                      seconds  share  peak memory, MiB: all ranks  largest
assembly                                     0.965   5.4%                          949      487
modes                                        {modes}  29.1%                         2239     1216
total                                       18.019 100.0%                         2332     1257
"""


def test_two_versions_are_compared():
    before, now = (read(LOG.format(modes=modes), whole) for modes, whole in (("10.00", 30.0), (" 5.00", 15.0)))
    assert now.seconds == {"assembly": 0.965, "modes": 5.0, "whole": 15.0} and now.memory == 2332.0
    assert now.peaks[1] == ("15 N", "89", "2.8028e-02 m", "99.17562 Hz")
    lines = table([before], [now, now], "abc")
    assert "| modes | 10.00 | 5.00 | 2.00 |" in lines and "| whole | 30.00 | 15.00 | 2.00 |" in lines
    assert lines[-1] == "| 15 N | 89, 2.8028e-02 m at 99.17562 Hz | 89, 2.8028e-02 m at 99.17562 Hz |"
