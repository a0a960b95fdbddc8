"""The writer on any number of ranks: rank 0 writes, and every rank raises its errors."""

import os

import pytest
from mpi4py import MPI
from synthetic_results import branch, observe, two_flanks, writer_of

from microslip.messages.errors import CaseError, ResourceError
from microslip.results.read import read_results

COMM = MPI.COMM_WORLD


def test_all_ranks_write_one_file(tmp_path):
    folder = COMM.bcast(str(tmp_path / "run"))
    pairs = two_flanks(3, 1)
    writer = writer_of(folder, pairs, comm=COMM)
    observe(writer, [branch(level, pairs, n_points=4) for level in (1.0, 8.0)])
    writer.close()
    COMM.Barrier()
    assert [len(level.frequency) for level in read_results(f"{folder}/results.h5").levels] == [4, 4]
    with open(f"{folder}/frf.csv", encoding="utf-8") as file:
        assert len(file.readlines()) == 1 + 8
    assert sorted(os.listdir(folder)) == ["frf.csv", "results.h5"]


def test_problems_of_rank_0_are_raised_on_every_rank(tmp_path):
    folder = COMM.bcast(str(tmp_path))
    if COMM.rank == 0:
        open(f"{folder}/taken", "w").close()
        os.mkdir(f"{folder}/full")
        os.symlink("/dev/full", f"{folder}/full/frf.csv")
    COMM.Barrier()
    pairs = two_flanks(2, 1)
    with pytest.raises(CaseError, match="taken"):
        writer_of(f"{folder}/taken/run", pairs, comm=COMM)
    with pytest.raises(ResourceError, match="frf.csv"):
        writer_of(f"{folder}/full", pairs, comm=COMM)
    COMM.Barrier()
