"""Every reader returns a model or a single message for small files with some bytes changed.

The quick part of fuzzing; ``jobs/bench/fuzz.py`` runs for a given time.
"""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reader_seeds import SEEDS
from reader_targets import TARGETS, verdict

CASES = Path(__file__).parent / "fuzz_cases"
SLOW = ("results", "mat", "exodus")  # a separate process reads each file


@pytest.mark.parametrize("case", sorted(CASES.iterdir()), ids=lambda path: path.name)
def test_cases_of_fuzzing_are_read_or_refused(tmp_path, case):
    target = TARGETS[case.name.partition("-")[0]]
    path = tmp_path / f"input{target.ending}"
    path.write_bytes(case.read_bytes())
    assert verdict(target, path) is None


def changed(content: bytes, edits: list[tuple[int, int, bytes]]) -> bytes:
    """Return a file with some bytes replaced, at random positions modulo its length."""
    for at, n, put in edits:
        start = at % (len(content) + 1)
        content = content[:start] + put + content[start + n :]
    return content


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seeds")
    return folder, {name: write(folder) for name, write in SEEDS.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_changed_files_are_read_or_refused(seeds, name):
    folder, files = seeds
    target = TARGETS[name]
    path = folder / f"input{target.ending}"
    words = st.sampled_from([word.encode("latin-1") for word in target.dictionary]) | st.binary(max_size=8)
    edit = st.tuples(st.integers(0, 1 << 17), st.integers(0, 12), words)

    @settings(
        max_examples=4 if name in SLOW else 20,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.sampled_from(range(len(files[name]))), st.lists(edit, min_size=1, max_size=4), st.none() | st.floats(0.0, 1.0))
    def check_file(i, edits, share):
        content = changed(files[name][i], edits)
        path.write_bytes(content if share is None else content[: int(share * len(content))])
        assert verdict(target, path) is None

    check_file()
