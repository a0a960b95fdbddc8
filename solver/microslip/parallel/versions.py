"""Versions of what a run uses, for the log and the result file."""

from __future__ import annotations


def versions() -> dict[str, str]:
    """Return versions by name.  Local; after PETSc was started."""
    import h5py
    import mpi4py
    from mpi4py import MPI
    from petsc4py import PETSc
    from slepc4py import SLEPc

    def dotted(numbers) -> str:
        return ".".join(map(str, numbers))

    return {
        "PETSc": dotted(PETSc.Sys.getVersion()),
        "SLEPc": dotted(SLEPc.Sys.getVersion()),
        "mpi4py": mpi4py.__version__,
        "MPI": MPI.Get_library_version().split(",")[0].split("\n")[0],
        "HDF5": h5py.version.hdf5_version,
    }
