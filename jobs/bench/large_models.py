"""Two blocks on each other as a model file of any format and size, for large_files.py.

The upper block stands on the lower one, node on node; the bottom of the lower one is fixed.  Whole arrays are formatted at a
time.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
import scipy.io

YOUNG, POISSON, DENSITY = 2.1e11, 0.3, 7800.0
PITCH = 1e-3  # m, of the nodes
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))


@dataclass(frozen=True)
class Blocks:
    """Bodies "lower" and "upper" of hexahedra; numbers of nodes and elements count from 1."""

    points: np.ndarray  # (n_nodes, 3) m
    elements: dict[str, np.ndarray]  # by body: (n_elements, 8) node numbers
    faces: dict[str, np.ndarray]  # by group: (n_faces, 4) node numbers: LOWER_TOP, UPPER_BOTTOM, HELD

    @property
    def sets(self) -> dict[str, np.ndarray]:
        """Node numbers of the faces' groups."""
        return {name: np.unique(faces) for name, faces in self.faces.items()}

    @property
    def n_elements(self) -> int:
        return sum(map(len, self.elements.values()))


def blocks(n_nodes: int, n_pairs: int) -> Blocks:
    """Return blocks of at least ``n_nodes`` nodes in all that meet in about ``n_pairs`` pairs."""
    n = round(n_pairs**0.5)
    shape = (n, n, max(2, -(-n_nodes // (2 * n * n))))
    lower = 1 + np.arange(np.prod(shape)).reshape(shape)
    upper = lower + lower.size
    at = PITCH * np.argwhere(lower > 0)
    points = np.concatenate([at, at + [0.0, 0.0, (shape[2] - 1) * PITCH]])
    faces = {"LOWER_TOP": _quads(lower[:, :, -1]), "UPPER_BOTTOM": _quads(upper[:, :, 0]), "HELD": _quads(lower[:, :, 0])}
    return Blocks(points, {"lower": _hexahedra(lower), "upper": _hexahedra(upper)}, faces)


def _hexahedra(numbers: np.ndarray) -> np.ndarray:
    cells = np.subtract(numbers.shape, 1)
    return np.stack([numbers[tuple(slice(i, i + n) for i, n in zip(at, cells))].ravel() for at in _CORNERS], axis=1)


def _quads(layer: np.ndarray) -> np.ndarray:
    return np.stack([layer[:-1, :-1].ravel(), layer[1:, :-1].ravel(), layer[1:, 1:].ravel(), layer[:-1, 1:].ravel()], axis=1)


def scene(file: str, model: Blocks) -> str:
    """Return the scene of a file, with what the format cannot express."""
    top = [round(float(x), 6) for x in model.points[-1]]
    ending = file.rpartition(".")[2]
    lower, upper, held, lower_top, upper_bottom = _GROUPS.get(ending, ("lower", "upper", "HELD", "LOWER_TOP", "UPPER_BOTTOM"))
    stated = (
        f"[materials.steel]\nyoung = {YOUNG}\npoisson = {POISSON}\ndensity = {DENSITY}\n"
        f'[bodies.lower]\ngroup = "{lower}"\nmaterial = "steel"\n[bodies.upper]\ngroup = "{upper}"\nmaterial = "steel"\n'
        f'[[supports]]\ngroup = "{held}"\nfix = ["x", "y", "z"]\n'
    )
    return (
        f'[model]\nmesh = "{file}"\n{"" if ending in _WHOLE else stated}'
        f'[[joints]]\nname = "between"\nsurfaces = ["{upper_bottom}", "{lower_top}"]\nfriction = 0.3\n'
        "tangential_stiffness = 1e13\nnormal_stiffness = 1e13\npreload = 1e6\n"
        f"[[loads]]\nposition = {top}\ndirection = [1.0, 0.0, 0.0]\n"
        f'[[outputs]]\nname = "corner"\nposition = {top}\ndirection = [1.0, 0.0, 0.0]\n'
        "[damping]\nratio = 0.01\n[response]\nlevels = [1.0]\nfrequencies = [100.0, 200.0]\n"
    )


_WHOLE = ("inp", "cdb", "bdf")  # formats with materials and supports
_GROUPS = {  # lower, upper, held, lower_top, upper_bottom
    "bdf": ("1", "2", "SPC xyz", "SET 1", "SET 2"),
    "vtu": ("body=1", "body=2", "surface=3", "surface=1", "surface=2"),
}


def _lines(file: IO[str], form: str, *columns: np.ndarray) -> None:
    """Write one line per row of the columns; ``form`` formats the numbers of a row."""
    np.savetxt(file, np.column_stack(columns), fmt=form)


def _rows(file: IO[str], values: np.ndarray, form: str, width: int, comma: str = "") -> None:
    """Write numbers, ``width`` on a line."""
    whole = len(values) // width * width
    if whole:
        np.savetxt(file, values[:whole].reshape(-1, width), fmt=comma.join([form] * width))
    if whole < len(values):
        file.write(comma.join(form % value for value in values[whole:]) + "\n")


def _numbered(model: Blocks):
    """Yield name, element numbers and nodes of every body."""
    first = 1
    for name, nodes in model.elements.items():
        yield name, first + np.arange(len(nodes)), nodes
        first += len(nodes)


def write_inp(model: Blocks, path: Path) -> None:
    """Write an input file of Abaqus."""
    with open(path, "w") as file:
        file.write("*NODE\n")
        _lines(file, "%d, %.9e, %.9e, %.9e", 1 + np.arange(len(model.points)), model.points)
        for name, numbers, nodes in _numbered(model):
            file.write(f"*ELEMENT, TYPE=C3D8I, ELSET={name}\n")
            _lines(file, "%d, " + ", ".join(["%d"] * 8), numbers, nodes)
            file.write(f"*SOLID SECTION, ELSET={name}, MATERIAL=STEEL\n")
        for name, nodes in model.sets.items():
            file.write(f"*NSET, NSET={name}\n")
            _rows(file, nodes, "%d", 12, ", ")
        file.write(f"*MATERIAL, NAME=STEEL\n*ELASTIC\n{YOUNG}, {POISSON}\n*DENSITY\n{DENSITY}\n*BOUNDARY\nHELD, 1, 3\n")


def write_cdb(model: Blocks, path: Path) -> None:
    """Write an archive of Ansys."""
    with open(path, "w") as file:
        file.write("/PREP7\nET,1,185\nKEYOP,1,2,2\n")
        file.write(f"NBLOCK,6,SOLID,{len(model.points)},{len(model.points)}\n(3i9,6e21.13e3)\n")
        _lines(file, "%9d        0        0%21.13E%21.13E%21.13E", 1 + np.arange(len(model.points)), model.points)
        file.write(f"N,R5.3,LOC,       -1,\nEBLOCK,19,SOLID,{model.n_elements},{model.n_elements}\n(19i9)\n")
        for i, (_, numbers, nodes) in enumerate(_numbered(model), 1):
            _lines(file, f"{i:9d}" + "        1" * 3 + "        0" * 4 + "        8        0" + "%9d" * 9, numbers, nodes)
        file.write("       -1\n")
        for name, nodes in model.sets.items():
            file.write(f"CMBLOCK,{name},NODE,{len(nodes):8d}\n(8i10)\n")
            _rows(file, nodes, "%10d", 8)
        for i in (1, 2):
            for label, value in (("EX", YOUNG), ("NUXY", POISSON), ("DENS", DENSITY)):
                file.write(f"MPTEMP,R5.0, 1, 1,  0.00000000    ,\nMPDATA,R5.0, 1,{label}, {i}, 1, {value:.9E},\n")
        for label in ("UX", "UY", "UZ"):
            _lines(file, f"D,%d,{label},0.0,0.0", model.sets["HELD"])
        file.write("FINISH\n")


def write_msh(model: Blocks, path: Path) -> None:
    """Write a binary file of Gmsh, version 4.1."""
    names = [(2, name) for name in model.faces] + [(3, name) for name in model.elements]
    tag = {name: i for i, (_, name) in enumerate(names, 1)}
    with open(path, "wb") as file:
        file.write(b"$MeshFormat\n4.1 1 8\n" + np.int32(1).tobytes() + b"\n$EndMeshFormat\n$PhysicalNames\n%d\n" % len(names))
        file.write("".join(f'{dim} {tag[name]} "{name}"\n' for dim, name in names).encode())
        file.write(b"$EndPhysicalNames\n$Entities\n" + np.array([0, 0, len(model.faces), len(model.elements)]).tobytes())
        for _, name in names:
            file.write(np.int32(tag[name]).tobytes() + np.zeros(6).tobytes() + np.int64(1).tobytes())
            file.write(np.int32(tag[name]).tobytes() + np.int64(0).tobytes())
        n = len(model.points)
        file.write(b"\n$EndEntities\n$Nodes\n" + np.array([1, n, 1, n]).tobytes())
        file.write(np.array([3, tag["lower"], 0], dtype=np.int32).tobytes() + np.int64(n).tobytes())
        file.write((1 + np.arange(n)).tobytes() + model.points.tobytes())
        parts = [(2, 3, name, nodes) for name, nodes in model.faces.items()]
        parts += [(3, 5, name, nodes) for name, nodes in model.elements.items()]
        n_elements, first = sum(len(nodes) for *_, nodes in parts), 1
        file.write(b"\n$EndNodes\n$Elements\n" + np.array([len(parts), n_elements, 1, n_elements]).tobytes())
        for dim, kind, name, nodes in parts:
            file.write(np.array([dim, tag[name], kind], dtype=np.int32).tobytes() + np.int64(len(nodes)).tobytes())
            file.write(np.column_stack([first + np.arange(len(nodes)), nodes]).tobytes())
            first += len(nodes)
        file.write(b"\n$EndElements\n")


def write_vtu(model: Blocks, path: Path) -> None:
    """Write a file of VTK, as meshio does: packed; bodies and surfaces are integers."""
    import meshio

    surface = np.zeros(len(model.points), dtype=np.int32)
    for i, nodes in enumerate(model.sets.values(), 1):
        surface[nodes - 1] = i
    cells = np.concatenate(list(model.elements.values())) - 1
    body = np.repeat(np.arange(1, 3, dtype=np.int32), [len(nodes) for nodes in model.elements.values()])
    meshio.Mesh(model.points, [("hexahedron", cells)], {"surface": surface}, {"body": [body]}).write(path)


def write_bdf(model: Blocks, path: Path) -> None:
    """Write bulk data of Nastran with its case control, in free fields."""
    with open(path, "w") as file:
        file.write("SOL 103\nCEND\nSPC = 1\n")
        for i, nodes in enumerate(model.sets.values(), 1):
            file.write(f"SET {i} = ")
            _rows(file, nodes[:-1], "%d,", 6)
            file.write(f"{nodes[-1]}\n")
        file.write("BEGIN BULK\n")
        _lines(file, "GRID*   %16d                %16.9E%16.9E\n*       %16.9E", 1 + np.arange(len(model.points)), model.points)
        for i, (_, numbers, nodes) in enumerate(_numbered(model), 1):
            _lines(file, f"CHEXA   %8d{i:8d}" + "%8d" * 6 + "\n        %8d%8d", numbers, nodes)
            file.write(f"PSOLID,{i},{i}\nMAT1,{i},2.1+11,,{POISSON},{DENSITY}\n")
        for node in model.sets["HELD"]:
            file.write(f"SPC1,1,123,{node}\n")
        file.write("ENDDATA\n")


def write_unv(model: Blocks, path: Path) -> None:
    """Write a universal file."""
    with open(path, "w") as file:
        file.write("    -1\n  2411\n")
        _lines(file, "%10d         1         1        11\n%25.16E%25.16E%25.16E", 1 + np.arange(len(model.points)), model.points)
        file.write("    -1\n    -1\n  2412\n")
        for _, numbers, nodes in _numbered(model):
            _lines(file, "%10d       115         1         1         7         8\n" + "%10d" * 8, numbers, nodes)
        file.write("    -1\n    -1\n  2467\n")
        held = [(name, 8, numbers) for name, numbers, _ in _numbered(model)]
        for i, (name, code, numbers) in enumerate([*held, *((name, 7, nodes) for name, nodes in model.sets.items())], 1):
            file.write(f"{i:10d}" + "         0" * 6 + f"{len(numbers):10d}\n{name}\n")
            entries = np.column_stack([np.full(len(numbers), code), numbers, np.zeros((len(numbers), 2), dtype=int)])
            _rows(file, entries.ravel(), "%10d", 8)
        file.write("    -1\n")


def write_exo(model: Blocks, path: Path) -> None:
    """Write an Exodus file, of classic NetCDF."""
    arrays = {f"coord{axis}": model.points[:, k] for k, axis in enumerate("xyz")}
    arrays["eb_names"], arrays["ns_names"] = _letters(list(model.elements)), _letters(list(model.faces))
    arrays |= {f"connect{i}": nodes.astype(np.int32) for i, nodes in enumerate(model.elements.values(), 1)}
    arrays |= {f"node_ns{i}": nodes.astype(np.int32) for i, nodes in enumerate(model.sets.values(), 1)}
    with scipy.io.netcdf_file(path, "w") as file:
        for name, array in arrays.items():
            for k, size in enumerate(array.shape):
                file.createDimension(f"{name}_{k}", size)
            code = "c" if array.dtype.kind == "S" else array.dtype.char
            one = file.createVariable(name, code, [f"{name}_{k}" for k in range(array.ndim)])
            one[:] = array
            if name.startswith("connect"):
                one.elem_type = "HEX8"


def _letters(names: list[str]) -> np.ndarray:
    return np.array([list(name.ljust(33, "\0")) for name in names], dtype="S1")


WRITERS = {
    "inp": write_inp,
    "cdb": write_cdb,
    "msh": write_msh,
    "vtu": write_vtu,
    "exo": write_exo,
    "unv": write_unv,
    "bdf": write_bdf,
}
