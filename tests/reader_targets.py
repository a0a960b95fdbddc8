"""Every reader of the program, as a function of one file, and its permitted outcomes for any contents."""

from __future__ import annotations

import contextlib
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

from microslip.assembly.force_file import forces_on_dofs, forces_on_nodes
from microslip.assembly.matrix_places import dofs_of_rows, names_nodes
from microslip.assembly.pair_file import read_pairs
from microslip.formats.csv_table import read_table
from microslip.formats.matrices.read import read_any, read_matrix
from microslip.formats.read import read_model
from microslip.guards import lock
from microslip.mesh.data import Mesh
from microslip.mesh.listed import listed_nodes
from microslip.mesh.locate import nodes_numbered
from microslip.mesh.read import read_nodes
from microslip.mesh.values import COLUMNS, PLACES
from microslip.messages.errors import CaseError, MicroslipError, ResourceError
from microslip.points.branch import Point
from microslip.receptance.static_columns import StaticColumns
from microslip.reduction.stuck import Factored, OnDemand
from microslip.restart.branch_files import BranchFiles, to_point
from microslip.restart.columns_file import ColumnsFile
from microslip.restart.identity import Identity
from microslip.restart.records import Latest, checked_read, length_of, read_record, read_records, unpack
from microslip.restart.structure_arrays import basis_of, structure_of
from microslip.results.fields import read_fields, read_run
from microslip.results.read import read_in_sandbox, read_results
from microslip.scene.read import read_scene
from microslip.tables.joint import Joint

MOST_SECONDS = 5.0  # processor time for any file of 64 kB
_NUMBERS = (
    "-1",
    "0",
    "1e308",
    "1e400",
    "-1e308",
    "nan",
    "inf",
    "0.5",
    "2147483648",
    "9223372036854775807",
    "99999999999999999999",
)


@dataclass(frozen=True)
class Target:
    """A reader."""

    ending: str  # of the names of its files
    read: Callable[[Path], Any]
    words: tuple[str, ...] = ()  # words of its files, in addition to numbers
    is_own: bool = False  # files of this program: if damaged, they are treated as missing

    @property
    def dictionary(self) -> tuple[str, ...]:
        return self.words + _NUMBERS


def verdict(target: Target, path: Path) -> str | None:
    """Return the fault of a reader on a file, one line per cause; None if it reads the file or reports a fault of the file."""
    began = time.process_time()
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always", RuntimeWarning)
            target.read(path)
    except MicroslipError as problem:
        if isinstance(problem, ResourceError) and _out_of_memory(problem):
            return "asked for more memory than there is"
        if not str(problem).strip() or len(str(problem)) > 5000:
            return f"a message of {len(str(problem))} characters"
    except BaseException as problem:  # of the reader, or of a library
        if isinstance(problem, KeyboardInterrupt):
            raise
        own = [frame for frame in traceback.extract_tb(problem.__traceback__) if "/microslip/" in frame.filename]
        last = own[-1] if own else traceback.extract_tb(problem.__traceback__)[-1]
        return f"{type(problem).__name__} in {Path(last.filename).name}, {last.name}: {' '.join(str(problem).split())[:120]}"
    loud = next((each for each in warned if issubclass(each.category, RuntimeWarning)), None)
    if loud is not None:
        return f"warns in {Path(loud.filename).name}: {loud.message}"
    took = time.process_time() - began
    return f"took {MOST_SECONDS:g} s and more" if took > MOST_SECONDS else None


def _out_of_memory(problem: BaseException | None) -> bool:
    """Return whether an error represents a failed allocation."""
    while problem is not None:
        if isinstance(problem, MemoryError):
            return True
        problem = problem.__cause__ or problem.__context__
    return False


def _matrix(path: Path) -> Any:
    return read_matrix(path, "[model] stiffness", "K")


def _forces(path: Path) -> Any:
    return forces_on_nodes(path, np.array([1, 2, 5])) if names_nodes(path) else forces_on_dofs(path, 30)


def _node_pairs(path: Path) -> Any:
    mesh = Mesh("model.msh", np.eye(3), np.array([1, 2, 5]), (), (), {})
    return listed_nodes(mesh, Joint.of_file(name="joint", node_pairs=str(path)))


def _parameters(path: Path) -> Any:
    return read_table(path, (), (*PLACES, *COLUMNS), "contact point")


def _temperatures(path: Path) -> Any:
    table, lines = read_table(path, ("node", "temperature"), (), "node")
    return nodes_numbered(np.array([1, 2, 5]), table["node"], lines, path)


def _recovery(path: Path) -> Any:
    return sp.csr_matrix(read_any(path, "[model] recovery", "T", is_square=False).matrix).astype(float)


def _all_steps(path: Path) -> Any:
    """Read a file without a step, and with the conditions of its first two steps."""
    model = read_model(path)
    return [read_model(path, step.number) for step in model.steps[1:3]]


def _lock(path: Path) -> Any:
    with open(path, "rb") as file:
        holder = lock._read(file.fileno())
    return lock._in_words(holder), lock.started(holder.get("process"))


def _restart(path: Path) -> Any:
    """Read a file as each kind of restart file."""
    for read in (_points, _ended, _identity, _set_up, _columns):
        with contextlib.suppress(CaseError):
            checked_read(path, read, path)
    return Latest(path.with_suffix("")).read()


def _points(path: Path) -> list[Point]:
    return [to_point(*unpack(record)) for record in read_records(path)]


def _ended(path: Path) -> Any:
    """Read the first record as the end of a branch, and the others as its points."""
    content, first = path.read_bytes(), length_of(read_records(path)[:1])
    path.with_name("end.0").write_bytes(content[:first])
    path.with_name("points.0").write_bytes(content[first:])
    return BranchFiles(MPI.COMM_SELF, path.parent, 0)._read_end()


def _identity(path: Path) -> list[str]:
    records = read_record(path)
    return [] if records is None else Identity({}, {}, {}, ()).differences(Identity.from_texts(records[1]))


def _set_up(path: Path) -> Any:
    records = read_record(path)
    if records is None:
        return None
    return structure_of(*records, None, MPI.COMM_SELF, OnDemand(_nothing)), basis_of(*records)


def _nothing() -> Factored:
    raise AssertionError("a file alone is read")


def _columns(path: Path) -> None:
    ColumnsFile(MPI.COMM_SELF, path).restore(StaticColumns(2, 2, lambda pairs: np.zeros((6, 3 * len(pairs)))), is_known=True)


def _results(path: Path) -> Any:
    read_in_sandbox(str(path))
    return read_results(str(path)), read_fields(str(path)), read_run(str(path))


TARGETS = {
    "msh": Target(
        ".msh",
        read_model,
        (
            "$MeshFormat",
            "$Nodes",
            "$EndNodes",
            "$Elements",
            "$EndElements",
            "$Entities",
            "$PhysicalNames",
            "$NodeData",
            "2.2",
            "4.1",
        ),
    ),
    "abaqus": Target(
        ".inp",
        _all_steps,
        ("*NODE", "*ELEMENT, TYPE=C3D8", "*NSET, NSET=", "GENERATE", "*INCLUDE, INPUT=", "*SURFACE", "*TIE", "*EQUATION", "*STEP")
        + ("*MATERIAL", "*ELASTIC", "*BOUNDARY", "*PART", "*INSTANCE", "*MPC", "*COUPLING", "*SYSTEM", "*TRANSFORM", "*MASS")
        + ("*CONTACT PAIR, INTERACTION=", "*SURFACE INTERACTION, NAME=", "*SURFACE BEHAVIOR", "*FRICTION", "*DASHPOT")
        + (
            "*NGEN, NSET=",
            "*NFILL",
            "*NCOPY, CHANGE NUMBER=",
            "*NMAP",
            "*ELGEN",
            "*ELCOPY",
            "*RIGID BODY, REF NODE=",
            "*EXPANSION",
        )
        + ("*TEMPERATURE", "*INITIAL CONDITIONS, TYPE=TEMPERATURE", "*PRE-TENSION SECTION", "*CYCLIC SYMMETRY MODEL, N=6")
        + ("*TIE, CYCLIC SYMMETRY", "*MODEL CHANGE", "*DISTRIBUTING", "*ORIENTATION, NAME=", "*CHANGE FRICTION", "*BASE MOTION"),
    ),
    "ansys": Target(
        ".cdb",
        read_model,
        (
            "NBLOCK,",
            "EBLOCK,",
            "CMBLOCK,",
            "(3i9,6e21.13e3)",
            "(19i9)",
            "(8i10)",
            "ET,",
            "KEYOP,",
            "MPDATA,",
            "RLBLOCK,",
            "CE,",
            "CP,",
        )
        + ("CERIG,", "D,", "ETBLOCK,", "SOLID", "ALL", "R,", "TYPE,", "UX", "DBLOCK,", "CMSEL,", "UNBL", "EN,", "CYCLIC", "KEYO,")
        + ("MASS21", "COMBIN14", "RMODIF,", "LOCAL,", "MP,EX,1,"),
    ),
    "nastran": Target(
        ".bdf",
        read_model,
        (
            "GRID",
            "GRID*",
            "CHEXA",
            "CTETRA",
            "PSOLID",
            "MAT1",
            "RBE2",
            "RBE3",
            "CONM2",
            "SPC1",
            "MPC",
            "INCLUDE '",
            "CORD2R",
            "THRU",
        )
        + ("BEGIN BULK", "CEND", "ENDDATA", "SET 1 =", "CELAS2", "PARAM,WTMASS", "1.5-3")
        + ("BOLT", "BSURFS", "BCTSET", "CBUSH", "CROD", "CONROD", "RBAR", "RBE1", "CORD1R", "GRDSET", "MAT9", "SPOINT", "MPCADD"),
    ),
    "ansys_input": Target(
        ".dat",
        read_model,
        (
            "nblock,3,,",
            "eblock,10,,,",
            "eblock,19,solid",
            "(1i9,3e20.9e3)",
            "(15i9)",
            "et,1,185",
            "CMBLOCK,",
            "keyo,",
            "-1",
            "/wb,",
        )
        + ("*set,tid,", "type,tid", "real,", "mat,", "r,tid", "en,", "cmsel,s,", "d,all,all", "mp,ex,1,", "local,12,1,", "nmod,"),
    ),
    "op2_model": Target(
        ".op2",
        read_model,
        ("GEOM1S  ", "GEOM2S  ", "EPTS    ", "MPTS    ", "GEOM4S  ", "\4\0\0\0", "\2\0\0\0", "\0\0\0\0")
        + ("\x95\x11\0\0\x2d\0\0\0\1\0\0\0",),
    ),
    "unv": Target(".unv", read_model, ("    -1\n", "  2411\n", "  2412\n", "  2420\n", "  2467\n", "   164\n", "1.0D+00")),
    "exodus": Target(".e", read_model, ("coordx", "connect1", "elem_type", "num_nodes", "HEX8", "CDF\x01", "CDF\x02")),
    "vtu": Target(".vtu", read_model, ("<DataArray", 'format="appended"', 'NumberOfComponents="', "<!ENTITY", "&lt;", "offset=")),
    "vtk": Target(
        ".vtk", read_model, ("POINTS", "CELLS", "CELL_TYPES", "BINARY", "ASCII", "SCALARS", "FIELD", "LOOKUP_TABLE", "METADATA")
    ),
    "fem": Target(".fem", read_model, ("GRID", "CHEXA", "GRID*", "BEGIN BULK", "ENDDATA", "+", "*")),
    "mtx": Target(
        ".mtx", _matrix, ("%%MatrixMarket matrix", "coordinate", "array", "real", "complex", "symmetric", "general", "*")
    ),
    "npz": Target(
        ".npz", _matrix, ("descr", "fortran_order", "shape", "<f8", "|O", "format.npy", "csr", "bsr", "dia", "PK\x01\x02")
    ),
    "mat": Target(".mat", _matrix, ("MATLAB 5.0", "MATLAB_sparse", "MATLAB_class", "K", "jc", "ir", "\x0f\0\0\0", "\x0e\0\0\0")),
    "calculix": Target(".sti", _matrix),
    "op4": Target(".op4", _matrix, ("1P,5E16.9", "1P,3E23.16", "K       ")),
    "op2": Target(".op2", _matrix, ("K       ", "\4\0\0\0", "\2\0\0\0")),
    "dmig": Target(".pch", _matrix, ("DMIG", "DMIG*", "KAAX", "*       ", "1.5D+03", "UACCEL")),
    "full": Target(".full", _matrix, ("\0\0\0\x80",)),
    "sub": Target(".sub", _matrix, ("\0\0\0\x80",)),
    "harwell_boeing": Target(".rua", _matrix, ("RUA", "RSA", "(16I5)", "(4E20.12)", "(1I1)", "(0I0)")),
    "petsc": Target(".petsc", _matrix, ("\0\x12\x7b\x50", "\xff\xff\xff\xff")),
    "scene": Target(
        ".toml",
        read_scene,
        ("[[joints]]", "[model]", "[response]", "mesh = ", "stiffness = ", "[[loads]]", "= [", "{", "}", "'''", "\\u0000", "true")
        + ("parameters = ", "pairs = ", "[materials.", "levels = ", "2026-11-22"),
    ),
    "pairs": Target(".csv", lambda path: read_pairs(path, 30), ("x1,y1,z1", "n0", "\n", ",", '"', "#")),
    "forces": Target(".csv", _forces, ("node,fx,fy,fz", "dof,value", "imag", ",", '"', "#")),
    "recovery": Target(".mtx", _recovery, ("%%MatrixMarket matrix", "coordinate", "array", "real", "general")),
    "temperatures": Target(".csv", _temperatures, ("node,temperature", ",", '"', "#")),
    "dofs": Target(".csv", lambda path: dofs_of_rows(path, None, 6, "dofs"), ("node,direction", ",", '"', "#")),
    "nodes": Target(".csv", read_nodes, ("node,x,y,z", ",", '"', "#")),
    "node_pairs": Target(".csv", _node_pairs, ("node1,node2,nx,ny,nz,area", ",", '"', "#")),
    "parameters": Target(".csv", _parameters, ("friction", "preload", "gap", ",", '"', "#")),
    "restart": Target(
        ".0",
        _restart,
        ('"<f8"', '"|O8"', '"notes"', '"n_points"', '"number"', '"parts"', '"numbers"', "[0]", "{}", "[[{}],{}]"),
        is_own=True,
    ),
    "lock": Target("", _lock, ("process", "host", "since", "started", "job", "Infinity", "[", "{}", "\x1b"), is_own=True),
    "results": Target(".h5", _results, ("OHDR", "TREE", "SNOD", "HEAP", "FRHP", "format", "levels", "joint", "mu")),
}
