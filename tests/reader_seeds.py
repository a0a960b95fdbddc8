"""A few small files for every reader, as written by programs: the seeds of fuzzers."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp
from box_meshes import box
from full_results import LEVELS, boxes_in_contact, fields
from matrix_files import WRITERS
from plain_model import bdf, cdb, ds_dat, exodus, inp, plain, unv
from scene_files import GOOD
from synthetic_results import branch, write

from microslip.continuation.checkpoint import over
from microslip.formats.matrices.file_matrix import DofMap
from microslip.formats.via_meshio import load_meshio
from microslip.mesh.data import ContactPairs
from microslip.restart.branch_files import of_point
from microslip.restart.records import checksum_of, pack
from microslip.restart.structure_arrays import numbers_of
from microslip.results.fields import RunRecord, StageRecord, store_fields

ROOT = Path(__file__).parents[1]
N = 6  # rows of the matrices
A = np.diag(np.full(N, 4.0)) - np.diag(np.full(N - 1, 1.0), 1) - np.diag(np.full(N - 1, 1.0), -1)
DOFS = DofMap(np.repeat([1, 2], 3), np.tile([1, 2, 3], 2))
DATA = ROOT / "tests" / "data" / "matrices"


def _gmsh(folder: Path) -> list[bytes]:
    """Return both versions, as text and binary, with groups and a view."""
    points, rows = box("tet4", (1, 1, 1))
    tags = {"gmsh:physical": [np.full(len(rows), 3)], "gmsh:geometrical": [np.full(len(rows), 1)]}
    mesh = load_meshio().Mesh(
        points, [("tetra", rows)], cell_data=tags, field_data={"bar": np.array([3, 3])}, point_data={"gap": points[:, 0]}
    )
    values = []
    for form in ("gmsh22", "gmsh"):
        for is_binary in (False, True):
            mesh.write(folder / "seed.msh", file_format=form, binary=is_binary)
            values.append((folder / "seed.msh").read_bytes())
    return values


def _by_meshio(ending: str, forms: tuple[dict, ...]) -> Callable[[Path], list[bytes]]:
    def write(folder: Path) -> list[bytes]:
        points, rows = box("hex8", (1, 1, 1))
        values = []
        for options in forms:
            mesh = load_meshio().Mesh(
                points, [("hexahedron", rows)], point_data={"gap": points[:, 0]}, cell_data={"part": [np.array([2])]}
            )
            mesh.write(folder / f"seed{ending}", **options)
            values.append((folder / f"seed{ending}").read_bytes())
        return values

    return write


def _exodus(folder: Path) -> list[bytes]:
    values = []
    for is_hdf5 in (False, True):
        exodus(plain("tet4"), folder / "seed.e", is_hdf5)
        values.append((folder / "seed.e").read_bytes())
    return values


def _matrix(*endings: str) -> Callable[[Path], list[bytes]]:
    def write(folder: Path) -> list[bytes]:
        values = []
        for ending in endings:
            path = folder / f"seed.{ending}"
            WRITERS[ending][0](path, sp.csr_matrix(A), DOFS)
            values.append(path.read_bytes())
        return values

    return write


def _with_data(write: Callable[[Path], list[bytes]], *names: str) -> Callable[[Path], list[bytes]]:
    return lambda folder: write(folder) + [(DATA / name).read_bytes() for name in names]


def _mtx(folder: Path) -> list[bytes]:
    array = io.BytesIO()
    scipy.io.mmwrite(array, A, precision=5)
    return [*_matrix("mtx", "abaqus.mtx")(folder), array.getvalue()]


def _npz(folder: Path) -> list[bytes]:
    values = []
    for save in (
        lambda file: np.savez(file, K=A),
        lambda file: np.savez_compressed(file, K=A, M=A),
        lambda file: sp.save_npz(file, sp.csr_matrix(A), compressed=False),
        lambda file: sp.save_npz(file, sp.coo_matrix(A), compressed=False),
    ):
        file = io.BytesIO()
        save(file)
        values.append(file.getvalue())
    return values


def _mat(folder: Path) -> list[bytes]:
    values = []
    for options in ({"format": "4"}, {"format": "5"}, {"format": "5", "do_compression": True}):
        file = io.BytesIO()
        scipy.io.savemat(file, {"K": sp.csc_matrix(A), "n": np.arange(3)}, **options)
        values.append(file.getvalue())
    return [*values, *_matrix("v73.mat")(folder)]


def _petsc(folder: Path) -> list[bytes]:
    """Return compressed rows and a dense matrix in PETSc's layout."""
    rows = sp.csr_matrix(A)
    head = np.array([1211216, N, N, rows.nnz, *np.diff(rows.indptr), *rows.indices], dtype=">i4")
    dense = np.array([1211216, N, N, -1], dtype=">i4")
    return [head.tobytes() + rows.data.astype(">f8").tobytes(), dense.tobytes() + A.astype(">f8").tobytes()]


def _scenes(folder: Path) -> list[bytes]:
    """Return the scenes of the jobs, with empty files for those that they name."""
    texts = [GOOD, *(path.read_text() for path in sorted((ROOT / "jobs").glob("*.toml")))]
    texts = [re.sub(r'"[^"\n]*/([\w.]+)"', r'"\1"', text) for text in texts]
    for text in texts:
        for name in re.findall(r'"(\w+\.[a-z]{3})"', text):
            (folder / name).touch()
    return [text.encode() for text in texts]


def _results(folder: Path) -> list[bytes]:
    (folder / "seed").mkdir(exist_ok=True)
    pairs = boxes_in_contact()
    path = write(
        folder / "seed",
        [branch(level, pairs, n_outputs=2, n_points=2) for level in LEVELS],
        pairs,
        outputs=("tip", "root"),
        linear=False,
    )
    store_fields(path, fields(), RunRecord((StageRecord("modes", 1.5, 200.0),), ("a note",)))
    return [Path(path).read_bytes()]


def _restart(folder: Path) -> list[bytes]:
    """Return a journal of points, its end, a state with a part, an identity, columns and a set-up, with few numbers each."""
    pairs = boxes_in_contact()
    points = [pack(*of_point(point)) for point in branch(LEVELS[1], pairs, n_points=2).points]
    numbers = {"level": 1.0, "n_points": 2, "failure": None, "is_linear": False, "closes_to": 1e-6, "odd": False}
    part = pack({"U": np.zeros((2, 3, 3)), "harmonics": np.arange(2)})
    counts = {"n_points": np.array(2), "number": np.array(3), "sums": np.array([checksum_of(part)])}
    state = pack({"step": np.zeros(4), **counts}, {"parts": ["now"]})
    identity = {
        "scene": {"response": {"levels": [1.0]}},
        "files": {"mesh a.msh": "ab"},
        "program": {"microslip": "1"},
        "options": [],
    }
    columns = pack({"pairs": np.array([1]), "columns": np.zeros((6, 3))})
    return [
        b"".join(points),
        pack({}, numbers) + b"".join(points),
        state + part,
        pack({}, identity),
        columns,
        pack(*_set_up(pairs)),
    ]


def _set_up(pairs: ContactPairs) -> tuple[dict[str, np.ndarray], dict]:
    """Return arrays and texts of a set-up."""
    n, seen = 3 * pairs.n_pairs, {"omega_n": np.ones(2), "b": np.ones((2, 1)), "o": np.ones((1, 2))}
    statics = {"du_static": np.ones((n, 1)), "out_static": np.ones((1, 1)), "out_R": np.ones((1, n)), "row_sums": np.ones(n)}
    statics |= {"load_static": np.ones((1, 1)), "outputs_static": np.ones(1)}
    arrays = over("pairs", numbers_of(pairs)) | over("group/0/seen", {**seen, "R_phi": np.ones((n, 2))})
    arrays |= over("group/0/statics", statics) | {"group/0/n_modes": np.array(2), "group/0/n_proved": np.array(2)}
    arrays |= {"n_dof": np.array(9), "has_mesh": np.array(True)}
    texts = {"joint": list(pairs.joint), "laws": list(pairs.laws), "modes": "modes-1", "extent": [2, 2, 0, 0]}
    return arrays, {**texts, "joints": [], "is_at_rest": False, "notes": []}


def _text(*texts: str) -> Callable[[Path], list[bytes]]:
    return lambda folder: [text.encode() for text in texts]


_CUBES = """*NODE, NSET=ALL
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
9, 0.5, 0.5, 2
*ELEMENT, TYPE=C3D8, ELSET=CUBE
1, 1, 2, 3, 4, 5, 6, 7, 8
*ELEMENT, TYPE=MASS, ELSET=LUMP
3, 9
*MASS, ELSET=LUMP
1.0
*ELEMENT, TYPE=SPRING1, ELSET=SPR
4, 3
*SPRING, ELSET=SPR
1,
1e6
*ELEMENT, TYPE=DASHPOTA, ELSET=DASH
5, 4, 5
*DASHPOT, ELSET=DASH

3.0
*NSET, NSET=SOME, GENERATE
1, 7, 2
*ELSET, ELSET=E
CUBE
*SURFACE, NAME=TOP
CUBE, S2
*SURFACE, NAME=BOTTOM
1, S1
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE, ADJUST=0.1
TOP, BOTTOM
*SURFACE INTERACTION, NAME=DRY
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
1e5, 3.
*FRICTION
0.3, 1e4
*COUPLING, CONSTRAINT NAME=C, REF NODE=9, SURFACE=TOP
*KINEMATIC
1, 6
*TRANSFORM, NSET=SOME, TYPE=C
0.3, 0.3, 0, 0.3, 0.3, 1
*EQUATION
2
2, 1, 1.0, 4, 1, -1.0
*MATERIAL, NAME=STEEL
*ELASTIC
210000., .3
*DENSITY
7.85e-9
*SOLID SECTION, ELSET=CUBE, MATERIAL=STEEL
*BOUNDARY
BOTTOMS, 1, 3
1, 1
*STEP
*STATIC
*CLOAD
BOTTOMS, 3, 2.
*DLOAD
CUBE, P2, 1.
CUBE, CENTRIF, 4., 0., 0., 0., 0., 0., 1.
*DSLOAD
TOP, P, 3.
*END STEP
*STEP, PERTURBATION
*FREQUENCY
5
*END STEP
"""

_GENERATED = """*NODE
1, 0, 0, 0
3, 2, 0, 0
*NGEN, NSET=EDGE
1, 3, 1
*NCOPY, CHANGE NUMBER=10, OLD SET=EDGE, NEW SET=BACK, SHIFT
0, 1, 0

*NCOPY, CHANGE NUMBER=100, OLD SET=EDGE, SHIFT
0, 0, 1

*NCOPY, CHANGE NUMBER=100, OLD SET=BACK, SHIFT
0, 0, 1

*ELEMENT, TYPE=C3D8R, ELSET=E
1, 1, 2, 12, 11, 101, 102, 112, 111
*ELGEN, ELSET=E
1, 2, 1, 1
*SURFACE, NAME=LEFT
1, S6
*SURFACE, NAME=RIGHT
2, S4
*TIE, NAME=T, CYCLIC SYMMETRY, POSITION TOLERANCE=0.5
LEFT, RIGHT
*CYCLIC SYMMETRY MODEL, N=6, TIE=T
0, 0, 0, 0, 0, 1
*ORIENTATION, NAME=O
1, 0, 0, 0, 1, 0
3, 30.
*MATERIAL, NAME=M
*ELASTIC, TYPE=ENGINEERING CONSTANTS
1e9, 2e9, 3e9, .1, .2, .3, 1e8, 2e8
3e8
*EXPANSION
1e-5
*DENSITY
1e-9
*SOLID SECTION, ELSET=E, MATERIAL=M, ORIENTATION=O
*INITIAL CONDITIONS, TYPE=TEMPERATURE
EDGE, 20.
*RIGID BODY, REF NODE=1, PIN NSET=BACK
*STEP
*STATIC
*TEMPERATURE
EDGE, 120.
BACK, 30.
*CHANGE FRICTION
*END STEP
*STEP, PERTURBATION
*FREQUENCY
5
*SELECT CYCLIC SYMMETRY MODES, NMIN=1, NMAX=2
*END STEP
"""

SEEDS: dict[str, Callable[[Path], list[bytes]]] = {
    "msh": _gmsh,
    "abaqus": lambda folder: [
        inp(plain("tet4")).encode(),
        inp(plain("hex8")).encode(),
        _CUBES.replace("BOTTOMS", "SOME").encode(),
        _GENERATED.encode(),
    ],
    "ansys": lambda folder: [
        cdb(plain("tet10")).encode(),
        cdb(plain("hex8"), ("CE,1,0,101,UX,1,102,UX,-1", "CP,2,UY,101,102", "CERIG,101,102,ALL", "MP,EX,1,2e11")).encode(),
    ],
    "nastran": lambda folder: [
        bdf(plain("tet4")).encode(),
        bdf(plain("hex8"), ("RBE2,900,101,123,102", "CONM2,901,101,,3.0", "MPC,5,101,1,1.0,102,1,-1.0")).encode(),
    ],
    "ansys_input": lambda folder: [ds_dat(plain("hex8")).encode(), ds_dat(plain("hex20")).encode()],
    "op2_model": lambda folder: [(ROOT / "tests" / "data" / "chexa20.op2").read_bytes()],
    "unv": lambda folder: [unv(plain("tet4")).encode(), unv(plain("hex20")).encode()],
    "exodus": _exodus,
    "vtu": _by_meshio(".vtu", ({"binary": False}, {"binary": True, "compression": None}, {"binary": True})),
    "vtk": _by_meshio(".vtk", ({"binary": False}, {"binary": True})),
    "fem": lambda folder: [bdf(plain("hex8")).encode()],
    "mtx": _with_data(_mtx, "model_STIF1.mtx"),
    "npz": _npz,
    "mat": _mat,
    "calculix": _matrix("sti"),
    "op4": _with_data(_matrix("text.op4", "op4"), "mat_t_s1.op4", "mat_b_s2.op4", "mat_b_dn.op4"),
    "op2": _with_data(_matrix("op2"), "mymatrix.op2"),
    "dmig": _with_data(_matrix("pch"), "dmig.pch"),
    "full": _matrix("full"),
    "sub": _matrix("sub"),
    "harwell_boeing": _matrix("rua"),
    "petsc": _petsc,
    "scene": _scenes,
    "pairs": _text("x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n0,1,2,3,4,5,0.3,1e3,0,1e7,2e7\n# a comment\n6,7,8,-1,-1,-1,0.3,1,0,1,1\n"),
    "forces": _text("node,fx,fy,fz\n1,0,0,1.5\n", "dof,value,imag\n3,1.0,0.5\n", "node,fx,fy,fz,fx_im\n2,1,0,0,3\n"),
    "recovery": _mtx,
    "temperatures": _text("node,temperature\n1,20\n2,30.5\n5,1e2\n"),
    "dofs": _text("node,direction\n1,1\n1,2\n1,3\n2,1\n2,2\n2,3\n"),
    "nodes": _text("node,x,y,z\n1,0,0,0\n2,1.0,0,0.5\n"),
    "node_pairs": _text("node1,node2,nx,ny,nz,area\n1,2,0,0,1,1e-6\n2,-1,0,0,1,1e-6\n"),
    "parameters": _text("node,friction,preload\n1,0.3,1e6\n2,0.4,2e6\n", "x,y,z,friction\n0,0,0,0.3\n"),
    "restart": _restart,
    "lock": _text('{"host": "here", "process": 1, "started": "a 1", "since": "2026-11-22 10:00:00", "job": ""}', "{}"),
    "results": _results,
}
