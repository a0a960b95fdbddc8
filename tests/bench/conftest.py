"""The benchmarks are scripts in jobs/bench that import each other; the tests import them in the same way."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "jobs" / "bench"))
