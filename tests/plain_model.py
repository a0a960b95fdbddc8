"""One small model, a bar on a plate, for the files of every program: one writer per format, and their common scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import h5py
import numpy as np
import scipy.io
from box_meshes import box

from microslip.formats.via_meshio import load_meshio

YOUNG, POISSON, DENSITY = 2.1e11, 0.3, 7800.0
OFFSET = 100  # node numbers start after it, with a gap in the middle
SCENE = {
    "joints": (
        {
            "name": "joint",
            "surfaces": ("BAR_BOTTOM", "PLATE_TOP"),
            "friction": 0.3,
            "tangential_stiffness": 1e12,
            "normal_stiffness": 2e12,
            "preload": 2e7,
        },
    ),
    "loads": ({"position": (0.05, 0.01, 0.025), "direction": (1.0, 0.3, 0.2)},),
    "outputs": ({"name": "corner", "position": (0.0, 0.0, 0.025), "direction": (1.0, 0.0, 0.0)},),
    "damping": {"ratio": 0.01},
    "response": {"levels": (30.0,), "mode": 1, "span": (0.95, 1.02), "points": 6},
    "solver": {"modes": 6, "error_bars": False},
}
# one element for tests of input files of Abaqus and CalculiX
CUBE = """*NODE, NSET=ALL
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
*ELEMENT, TYPE=C3D8, ELSET=CUBE
1, 1, 2, 3, 4, 5, 6, 7, 8
"""


@dataclass(frozen=True)
class Plain:
    """Two bodies of one material, "bar" and "plate", and sets of nodes."""

    points: np.ndarray  # (n, 3) m
    kinds: tuple[str, str]
    elements: tuple[np.ndarray, np.ndarray]  # of bar and plate
    sets: dict[str, np.ndarray]  # positions in points

    @property
    def numbers(self) -> np.ndarray:
        """Return the node numbers, with a gap."""
        n = np.arange(len(self.points))
        return OFFSET + 1 + n + 1000 * (n > len(n) // 2)


def plain(kind: str = "hex8", plate: str | None = None) -> Plain:
    """Return the model: a bar of 0.05 x 0.01 x 0.02 m on a plate of 0.005 m."""
    plate = plate or kind
    upper, bar = box(kind, (3, 1, 1), (0.05, 0.01, 0.02), (0.0, 0.0, 0.005))
    lower, ground = box(plate, (3, 1, 1), (0.05, 0.01, 0.005))
    points, is_upper = np.concatenate([upper, lower]), np.arange(len(upper) + len(lower)) < len(upper)
    z = points[:, 2]
    sets = {
        "BAR_BOTTOM": np.flatnonzero(is_upper & np.isclose(z, 0.005)),
        "PLATE_TOP": np.flatnonzero(~is_upper & np.isclose(z, 0.005)),
        "PLATE_BASE": np.flatnonzero(~is_upper & np.isclose(z, 0.0)),
    }
    return Plain(points, (kind, plate), (bar, ground + len(upper)), sets)


def tables(file: str, **model) -> dict:
    """Return the scene of a model file that has materials, bodies and supports."""
    return {"model": {"mesh": file, **model}, **SCENE}


def cdb(model: Plain, more: tuple[str, ...] = ()) -> str:
    """Return an Ansys archive; ``more`` are further commands before the end."""
    lines = ["/COM,written for a test", "/PREP7", "/TITLE,bar on a plate"]
    of_kind = {"hex8": 185, "hex20": 186, "tet10": 187, "wedge6": 185, "wedge15": 186, "pyramid5": 185, "pyramid13": 186}
    for i, kind in enumerate(model.kinds, 1):
        lines += [f"ET,{i},{of_kind[kind]}", f"KEYOP,{i},2,{ {'hex8': 2, 'hex20': 1}.get(kind, 0) }"]
    lines += [f"NBLOCK,6,SOLID,{model.numbers[-1]},{len(model.points)}", "(3i9,6e21.13e3)"]
    for number, (x, y, z) in zip(model.numbers, model.points):
        lines.append(f"{number:9d}{0:9d}{0:9d}{x:21.13E}{y:21.13E}{z:21.13E}")
    lines.append("N,R5.3,LOC,       -1,")
    rows = [(i, _of_ansys(kind, nodes)) for i, (kind, block) in enumerate(zip(model.kinds, model.elements), 1) for nodes in block]
    lines += [f"EBLOCK,19,SOLID,{len(rows)},{len(rows)}", "(19i9)"]
    for number, (i, nodes) in enumerate(rows, 1):
        fields = [i, i, 1, 1, 0, 0, 0, 0, len(nodes), 0, number, *model.numbers[list(nodes)]]
        lines += ["".join(f"{value:9d}" for value in part) for part in (fields[:19], fields[19:]) if part]
    lines.append(f"{-1:9d}")
    for name, nodes in model.sets.items():
        lines += [f"CMBLOCK,{name:8s},NODE,{len(nodes):8d}", "(8i10)"]
        lines += ["".join(f"{value:10d}" for value in model.numbers[nodes[k : k + 8]]) for k in range(0, len(nodes), 8)]
    for i in (1, 2):
        lines += ["MPTEMP,R5.0, 1, 1,  0.00000000    ,", f"MPDATA,R5.0, 1,EX  , {i}, 1, {YOUNG:.9E},"]
        lines += [f"MPDATA,R5.0, 1,NUXY, {i}, 1, {POISSON},", f"MPDATA,R5.0, 1,DENS, {i}, 1, {DENSITY},"]
    lines += [f"D,{number},{label},0.0,0.0" for number in model.numbers[model.sets["PLATE_BASE"]] for label in ("UX", "UY", "UZ")]
    return "\n".join([*lines, *more, "FINISH", ""])


def cdb_with_contact(model: Plain, behaviour: int = 5) -> str:
    """Return an archive with a contact of real constants 5: on the bar's bottom, with targets on the plate's top.

    ``behaviour`` is its KEYOPT(12), 5: bonded.
    """
    x = np.linspace(0.0, 0.05, 4)
    corners = [((a, 0.0), (b, 0.0), (b, 0.01), (a, 0.01)) for a, b in zip(x, x[1:])]
    top, bottom = (_numbers_at(model, name) for name in ("PLATE_TOP", "BAR_BOTTOM"))
    rows = [[2, 7, 5, 1, 0, 0, 0, 0, 4, 0, 901 + i, *map(top, of)] for i, of in enumerate(corners)]
    rows += [[1, 8, 5, 1, 0, 0, 0, 0, 4, 0, 951 + i, *map(bottom, of[::-1])] for i, of in enumerate(corners)]
    lines = cdb(model, ("ET,7,170", "ET,8,174", f"KEYOPT,8,12,{behaviour}", "R,5")).splitlines()
    end = lines.index(f"{-1:9d}")
    lines[end:end] = ["".join(f"{value:9d}" for value in row) for row in rows]
    return "\n".join(lines).replace("EBLOCK,19,SOLID,6,6", "EBLOCK,19,SOLID,12,12")


def ds_dat(model: Plain, more: tuple[str, ...] = ()) -> str:
    """Return an input file in the style of Workbench, with the contact of :func:`cdb_with_contact`; of hex8 or hex20."""
    of_kind = {"hex8": (185, 3), "hex20": (186, 1)}
    lines = ["/batch", "*get,_wallstrt,active,,time,wall", "/title,bar on a plate--Modal (A5)", "_dir(1) = 'C:\\x'", "/units,MKS"]
    lines += ["/prep7", "etcon,set", f"nblock, 3, {len(model.points) + 9}, ! nodes", "(1i9,3e20.9e3)"]
    lines += [f"{n:9d}{x:20.9E}{y:20.9E}{z:20.9E}" for n, (x, y, z) in zip(model.numbers, model.points)] + ["-1"]
    element = 0
    for i, (kind, block) in enumerate(zip(model.kinds, model.elements), 1):
        lines += [f"et,{i},{of_kind[kind][0]}", f"keyo,{i},2,{of_kind[kind][1]}", f"eblock,19,solid,,{len(block)}", "(19i9)"]
        for nodes in block:
            element += 1
            fields = [i, i, 1, 1, 0, 0, 0, 0, len(nodes), 0, element, *model.numbers[nodes]]
            lines += ["".join(f"{value:9d}" for value in part) for part in (fields[:19], fields[19:]) if part]
        lines.append("-1")
    lines += [
        f"MP,{label},{i},{value!r},\t! units"
        for i in (1, 2)
        for label, value in (("DENS", DENSITY), ("EX", YOUNG), ("NUXY", POISSON))
    ]
    for name, nodes in {**model.sets, "_FIXEDSU": model.sets["PLATE_BASE"]}.items():
        lines += [f"CMBLOCK,{name},NODE,{len(nodes):9d}", "(8i10)"]
        lines += ["".join(f"{value:10d}" for value in model.numbers[nodes[k : k + 8]]) for k in range(0, len(nodes), 8)]
    lines += [
        '/com,*********** Create Contact "Bonded" ***********',
        "*set,tid,4",
        "*set,cid,3",
        "r,tid",
        "r,cid",
        "et,tid,170",
        "et,cid,174",
    ]
    lines += ["keyo,cid,12,5              ! Bonded Contact", "rmod,cid,3,10.", "type,cid"]
    x, contacts, targets = np.linspace(0.0, 0.05, 4), [], []
    top, bottom = (_numbers_at(model, name) for name in ("PLATE_TOP", "BAR_BOTTOM"))
    for i, (a, b) in enumerate(zip(x, x[1:])):
        of = [(a, 0.0), (b, 0.0), (b, 0.01), (a, 0.01)]
        of += [((a + b) / 2, 0.0), (b, 0.005), ((a + b) / 2, 0.01), (a, 0.005)] if model.kinds[0] == "hex20" else []
        targets.append([901 + i, 4, 3, 4, 0, *map(top, of)])
        contacts.append([951 + i, 3, 3, 3, 0, *(map(bottom, [of[k] for k in (3, 2, 1, 0, 6, 5, 4, 7)[: len(of)]]))])
    for rows in (contacts, targets):
        lines += ["eblock,10,,,3", "(15i9)", *("".join(f"{value:9d}" for value in row) for row in rows), "-1"]
    lines += [
        "cmsel,s,_FIXEDSU",
        "d,all,all",
        "nsel,all",
        *more,
        "fini",
        "/solu",
        "antype,2",
        "modop,lanb,6",
        "mxpa,6,,,yes",
        "solve",
    ]
    return "\n".join([*lines, "xmlo,parm", "*get,_walldone,active,,time,wall", "/wb,file,end", ""])


def _numbers_at(model: Plain, name: str) -> Callable[[tuple[float, float]], int]:
    """Return a function from (x, y) to the number of the node of a set at that position."""
    nodes = model.sets[name]
    return lambda at: int(model.numbers[nodes[np.argmin(np.hypot(*(model.points[nodes, :2] - at).T))]])


_ANSYS = {  # this program's order of nodes in degenerate hexahedra of Ansys
    "wedge6": [0, 1, 2, 2, 3, 4, 5, 5],
    "wedge15": [0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 2, 8, 9, 10, 5, 11, 12, 13, 14, 14],
    "pyramid5": [0, 1, 2, 3, 4, 4, 4, 4],
    "pyramid13": [0, 1, 2, 3, 4, 4, 4, 4, 5, 6, 7, 8, 4, 4, 4, 4, 9, 10, 11, 12],
}


def _of_ansys(kind: str, nodes: np.ndarray) -> np.ndarray:
    return nodes[_ANSYS[kind]] if kind in _ANSYS else nodes


def bdf(model: Plain, more: tuple[str, ...] = (), case: tuple[str, ...] = ()) -> str:
    """Return Nastran bulk data with its case control; ``more`` are further cards, ``case`` further lines before them."""
    lines = ["SOL 103", "CEND", "SPC = 1", *case]
    for i, nodes in enumerate(model.sets.values(), 1):
        numbers = [str(number) for number in model.numbers[nodes]]
        rows = [",".join(numbers[k : k + 6]) for k in range(0, len(numbers), 6)]
        lines += [f"SET {i} = {rows[0]}{',' if len(rows) > 1 else ''}"]
        lines += [row + ("," if row is not rows[-1] else "") for row in rows[1:]]
    lines.append("BEGIN BULK")
    lines += [f"GRID*,{n},,{x:.9E},{y:.9E}\n*,{z:.9E}" for n, (x, y, z) in zip(model.numbers, model.points)]
    number = 0
    for i, (kind, block) in enumerate(zip(model.kinds, model.elements), 1):
        card = {"hex": "CHEXA", "wedge": "CPENTA", "tet": "CTETRA", "pyramid": "CPYRAM"}[kind.rstrip("0123456789")]
        for nodes in block:
            number += 1
            fields = [number, i, *model.numbers[nodes[_NASTRAN.get(kind, range(len(nodes)))]]]
            rows = [fields[k : k + 8] for k in range(0, len(fields), 8)]
            lines += [",".join(map(str, [card if k == 0 else "", *row])) for k, row in enumerate(rows)]
    for i in (1, 2):
        lines += [f"PSOLID,{i},{i}", f"MAT1,{i},{YOUNG:.6E},,{POISSON},{DENSITY}".replace("E+", "+")]
    held = ["SPC1,1,123", *map(str, model.numbers[model.sets["PLATE_BASE"]])]
    lines += [",".join(held[:7]), *(",".join(["", *held[k : k + 8]]) for k in range(7, len(held), 8))]
    return "\n".join([*lines, *more, "ENDDATA", ""])


_NASTRAN = {  # Nastran's mid-sides of vertical edges come before those of the top
    "hex20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15],
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
}


def unv(model: Plain) -> str:
    """Return a universal file: nodes, elements, groups of elements and of nodes."""
    lines = ["    -1", "  2411"]
    for number, point in zip(model.numbers, model.points):
        lines += [f"{number:10d}{1:10d}{1:10d}{11:10d}", "".join(f"{x:25.16E}" for x in point).replace("E", "D")]
    lines += ["    -1", "    -1", "  2412"]
    descriptors = {"tet4": 111, "tet10": 118, "wedge6": 112, "wedge15": 113, "hex8": 115, "hex20": 116, "pyramid5": 101}
    number, of_body = 0, []
    for kind, block in zip(model.kinds, model.elements):
        of_body.append([])
        for nodes in block:
            number += 1
            of_body[-1].append((8, number))
            own = model.numbers[nodes[np.argsort(_ROUND[kind])] if kind in _ROUND else nodes]
            lines.append("".join(f"{value:10d}" for value in (number, descriptors[kind], 1, 1, 7, len(own))))
            lines += ["".join(f"{value:10d}" for value in own[k : k + 8]) for k in range(0, len(own), 8)]
    lines += ["    -1", "    -1", "  2467"]
    sets = [(name, [(7, value) for value in model.numbers[nodes]]) for name, nodes in model.sets.items()]
    for i, (name, entries) in enumerate([("bar", of_body[0]), ("plate", of_body[1]), *sets], 1):
        lines += ["".join(f"{value:10d}" for value in (i, 0, 0, 0, 0, 0, 0, len(entries))), name]
        rows = ["".join(f"{value:10d}" for value in (code, tag, 0, 0)) for code, tag in entries]
        lines += ["".join(rows[k : k + 2]) for k in range(0, len(rows), 2)]
    return "\n".join([*lines, "    -1", ""])


_ROUND = {  # positions of I-deas' nodes, ordered around a face, in this program's order
    "tet10": [0, 2, 4, 9, 1, 3, 5, 6, 7, 8],
    "wedge15": [0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8],
    "hex20": [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11],
}


def exodus(model: Plain, path, hdf5: bool = False) -> None:
    """Write an Exodus file, of classic NetCDF or of HDF5."""
    words = {"hex": "HEX", "tet": "TETRA", "wedge": "WEDGE", "pyramid": "PYRAMID"}
    arrays = {f"coord{axis}": model.points[:, k] for k, axis in enumerate("xyz")}
    arrays["node_num_map"] = model.numbers.astype(np.int32)
    arrays["elem_num_map"] = np.arange(1, sum(map(len, model.elements)) + 1, dtype=np.int32)
    arrays["eb_names"] = _letters(["bar", "plate"])
    arrays["ns_names"] = _letters(list(model.sets))
    for i, (kind, block) in enumerate(zip(model.kinds, model.elements), 1):
        arrays[f"connect{i}"] = (block[:, _NASTRAN.get(kind, range(block.shape[1]))] + 1).astype(np.int32)
    for i, nodes in enumerate(model.sets.values(), 1):
        arrays[f"node_ns{i}"] = (nodes + 1).astype(np.int32)
    kinds = {f"connect{i}": f"{words[kind.rstrip('0123456789')]}{kind[-1]}" for i, kind in enumerate(model.kinds, 1)}
    if model.kinds[0].startswith("hex"):
        arrays["elem_ss1"], arrays["side_ss1"] = np.array([1, 2, 3], dtype=np.int32), np.array([5, 5, 5], dtype=np.int32)
    if hdf5:
        with h5py.File(path, "w") as file:
            for name, array in arrays.items():
                file[name] = array
                if name in kinds:
                    file[name].attrs["elem_type"] = np.bytes_(kinds[name])
        return
    with scipy.io.netcdf_file(path, "w") as file:
        for name, array in arrays.items():
            for k, size in enumerate(array.shape):
                file.createDimension(f"{name}_{k}", size)
            one = file.createVariable(
                name, array.dtype.char if array.dtype.kind != "S" else "c", [f"{name}_{k}" for k in range(array.ndim)]
            )
            one[:] = array
            if name in kinds:
                one.elem_type = kinds[name]


def write_vtk(model: Plain, path) -> None:
    """Write a file .vtu or .vtk: the bodies as an array of the cells, the sets as arrays of the points."""
    cells = [("hexahedron", block) for block in model.elements]
    parts = [np.full(len(block), k) for k, block in enumerate(model.elements, 1)]
    sets = {name: np.isin(np.arange(len(model.points)), nodes).astype(int) for name, nodes in model.sets.items()}
    load_meshio().Mesh(model.points, cells, cell_data={"part": parts}, point_data=sets).write(path)


def _letters(names: list[str]) -> np.ndarray:
    return np.array([list(name.ljust(33, "\0")) for name in names], dtype="S1")


def inp(model: Plain, more: tuple[str, ...] = ()) -> str:
    """Return an Abaqus input file of two parts, the first translated and rotated; ``more`` are further cards before the step."""
    of_kind = {"hex8": "C3D8I", "hex20": "C3D20", "tet4": "C3D4", "tet10": "C3D10", "wedge6": "C3D6", "wedge15": "C3D15"}
    lines, assembly = ["*Heading", "bar on a plate"], ["*Assembly, name=Assembly"]
    for name, kind, block in zip(("BAR", "PLATE"), model.kinds, model.elements, strict=True):
        used = np.unique(block)
        own = {int(node): i for i, node in enumerate(used, 1)}
        x, y, z = model.points[used].T
        points = np.column_stack([y, -x + 1.0, z]) if name == "BAR" else model.points[used]
        lines += [f"*Part, name={name}", "*Node"]
        lines += [f"{i}, {x:.15e}, {y:.15e}, {z:.15e}" for i, (x, y, z) in enumerate(points, 1)]
        lines.append(f"*Element, type={of_kind[kind]}, elset=ALL")
        for number, nodes in enumerate(block, 1):
            fields = [number, *(own[int(node)] for node in nodes)]
            rows = [fields[k : k + 16] for k in range(0, len(fields), 16)]
            lines += [", ".join(map(str, row)) + "," * (row is not rows[-1]) for row in rows]
        lines += ["*Solid Section, elset=ALL, material=Steel", ",", "*End Part"]
        assembly.append(f"*Instance, name={name}-1, part={name}")
        if name == "BAR":
            assembly += ["0., 0., 0.", "0.5, 0.5, 0., 0.5, 0.5, 1., 90."]
        assembly.append("*End Instance")
        for set_name, nodes in model.sets.items():
            if np.isin(nodes, used).all():
                assembly += [f"*Nset, nset={set_name}, instance={name}-1", *(f"{own[int(node)]}," for node in nodes)]
    lines += [*assembly, "*End Assembly", "*Material, name=Steel", "*Density", f"{DENSITY},", "*Elastic", f"{YOUNG}, {POISSON}"]
    lines += ["*Boundary", "PLATE_BASE, PINNED", *more, "*Step, perturbation", "*Frequency", "6,", "*End Step", ""]
    return "\n".join(lines)
