"""The benchmarks are scripts beside each other in jobs/bench; the tests import them as they import each other."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "jobs" / "bench"))
