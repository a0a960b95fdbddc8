"""Every format of model files gives the response of the same model given as a mesh and a scene."""

import shutil
import sys
from pathlib import Path
from types import ModuleType

import mapdl_archive
import meshio
import numpy as np
import pytest
from in_process import in_process
from mpi4py import MPI
from plain_model import DENSITY, POISSON, SCENE, YOUNG, bdf, cdb, ds_dat, exodus, inp, plain, tables, unv, write_vtk

import microslip
from microslip.parallel.agree import on_root
from microslip.scene.read import scene_of

comm = MPI.COMM_WORLD
DATA = Path(__file__).parents[1] / "data"
STEEL = {"young": YOUNG, "poisson": POISSON, "density": DENSITY}
WRITERS = {
    ".cdb": lambda path: path.write_text(cdb(plain())),
    ".inp": lambda path: path.write_text(inp(plain())),
    ".bdf": lambda path: path.write_text(bdf(plain())),
    ".fem": lambda path: path.write_text(bdf(plain())),
    ".dat": lambda path: path.write_text(ds_dat(plain())),
    ".vtu": lambda path: write_vtk(plain(), path),
    ".vtk": lambda path: write_vtk(plain(), path),
    ".unv": lambda path: path.write_text(unv(plain())),
    ".exo": lambda path: exodus(plain(), path),
    ".e": lambda path: exodus(plain(), path, hdf5=True),
}
ON_RANKS = (".inp", ".e")  # a text file and an HDF5 file
SURFACES = {  # formats in which sets have other names
    **dict.fromkeys((".bdf", ".fem"), ("SET 1", "SET 2")),
    ".dat": ("CONTA174 real 3", "TARGE170 real 3"),
    **dict.fromkeys((".vtu", ".vtk"), ("BAR_BOTTOM=1", "PLATE_TOP=1")),
}
MESH_ONLY = (".unv", ".exo", ".e", ".vtu", ".vtk")  # the scene states materials, bodies and supports


def by_scene(bar="bar", plate="plate", support="PLATE_BASE"):
    """Return the tables that a scene states for a file with only a mesh; the names are those of its groups."""
    return {
        "materials": {"steel": STEEL},
        "bodies": {name: {"group": group, "material": "steel"} for name, group in (("bar", bar), ("plate", plate))},
        "supports": ({"group": support, "fix": ("x", "y", "z")},),
    }


BY_VALUES = by_scene("part=1", "part=2", "PLATE_BASE=1")  # groups of VTK files are values of their arrays


def response_of(scene):
    structure = microslip.build(scene, comm)
    response = microslip.respond(structure)
    return structure.modes.omega_n.copy(), response["corner"].frequency, response["corner"].amplitude


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder that all ranks share."""
    return comm.bcast(tmp_path_factory.mktemp("formats"))


@pytest.fixture(scope="module")
def expected(folder):
    """Return the response of the model as a plain mesh."""
    model = plain()

    def write():
        cells = [("hexahedron", block) for block in model.elements] + [
            ("vertex", nodes[:, None]) for nodes in model.sets.values()
        ]
        names = {name: np.array([k, 0 if k > 2 else 3]) for k, name in enumerate(["bar", "plate", *model.sets], 1)}
        tags = [np.full(len(block), k) for k, (_, block) in enumerate(cells, 1)]
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        mesh = meshio.Mesh(model.points, cells, cell_data=data, field_data=names)
        meshio.write(folder / "plain.msh", mesh, file_format="gmsh22", binary=False)

    on_root(comm, write)
    return response_of(scene_of({"model": {"mesh": "plain.msh"}, **by_scene(), **SCENE}, folder / "plain.toml"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "ending", [pytest.param(ending, marks=() if ending in ON_RANKS else pytest.mark.ranks(1)) for ending in WRITERS]
)
def test_a_model_file_gives_the_response_of_mesh_and_scene(expected, folder, ending):
    on_root(comm, lambda: (WRITERS[ending](folder / f"model{ending}"), None)[1])
    by_scene_tables = BY_VALUES if ending.startswith(".vt") else by_scene()
    stated = {**tables(f"model{ending}"), **(by_scene_tables if ending in MESH_ONLY else {})}
    if ending in SURFACES:
        stated["joints"] = ({**stated["joints"][0], "surfaces": SURFACES[ending]},)
    omega, frequency, amplitude = response_of(scene_of(stated, folder / f"model{ending}.toml"))
    np.testing.assert_allclose(omega, expected[0], rtol=1e-8)
    np.testing.assert_allclose(frequency, expected[1], rtol=1e-8)
    np.testing.assert_allclose(amplitude, expected[2], rtol=1e-6)


@pytest.mark.slow
def test_geometry_of_nastran_output_gives_the_curve_of_its_bulk_data(folder):
    """A brick from an .op2 file of MSC Nastran and from its bulk data; friction on ground replaces the supports of the file."""
    on_root(comm, lambda: [shutil.copy(DATA / f"chexa20.{ending}", folder) for ending in ("op2", "bdf")] and None)
    curves = []
    for ending, of_apex in (("op2", ()), ("bdf", ("ABSNMVS", "ABSTRCT", "MDLPRM"))):
        scene = {
            "model": {"mesh": f"chexa20.{ending}", "take": ("materials", "bodies"), "ignore": of_apex},
            "joints": ({**SCENE["joints"][0], "surfaces": ("SPC xyz",), "against": "ground"},),
            "loads": ({"node": 7, "direction": (1.0, 0.3, 0.2)},),
            "outputs": ({"name": "corner", "node": 7, "direction": (1.0, 0.0, 0.0)},),
            "response": {**SCENE["response"], "levels": (0.1,)},
        }
        curves.append(response_of(scene_of({**SCENE, **scene}, folder / f"chexa20_{ending}.toml")))
    for of_op2, of_bulk_data in zip(*curves, strict=True):
        np.testing.assert_allclose(of_op2, of_bulk_data, rtol=1e-5)


class Result:
    """A result of ansys.mapdl.reader, with the model of the archive in the same folder."""

    def __init__(self, path, parse_vtk):
        self.mesh = mapdl_archive.Archive(path.replace(".rst", ".cdb"), parse_vtk=False)
        self.materials = {number: {"EX": YOUNG, "NUXY": POISSON, "DENS": DENSITY} for number in (1, 2)}
        keys = {number: dict(pairs) for number, pairs in self.mesh.key_option.items()}
        self._element_table = {"keyopts": {n: [options.get(i, 0) for i in range(1, 12)] for n, options in keys.items()}}

    def nodal_boundary_conditions(self, number):
        supported = plain().numbers[plain().sets["PLATE_BASE"]]
        return np.repeat(supported, 3), np.tile([1, 2, 3], len(supported)), np.zeros(3 * len(supported))

    def result_dof(self, number):
        return ["UX", "UY", "UZ"]


@pytest.mark.slow
def test_a_results_file_gives_the_response_of_mesh_and_scene(expected, folder, monkeypatch):
    in_process(monkeypatch)
    for name in ("ansys", "ansys.mapdl", "ansys.mapdl.reader"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setattr(sys.modules["ansys.mapdl.reader"], "read_binary", Result, raising=False)
    on_root(comm, lambda: [(folder / f"result.{ending}").write_text(cdb(plain())) for ending in ("rst", "cdb")])
    omega, frequency, amplitude = response_of(scene_of(tables("result.rst"), folder / "rst.toml"))
    np.testing.assert_allclose(omega, expected[0], rtol=1e-8)
    np.testing.assert_allclose(frequency, expected[1], rtol=1e-8)
    np.testing.assert_allclose(amplitude, expected[2], rtol=1e-6)


def test_a_loaded_step_before_the_vibration_equals_the_statics_of_a_scene(folder):
    """A normal and a tangential load, of the file or of the scene, give the same preloads and modes; without load they differ."""
    model, n = plain(), len(plain().sets["BAR_BOTTOM"])
    step = ("*Step", "*Static", "*Cload", "BAR_BOTTOM, 3, -2000.", "BAR_BOTTOM, 1, 30.", "*End Step")
    on_root(comm, lambda: (folder / "loaded.inp").write_text(inp(model, step)))
    stated = {"forces": ({"group": "BAR_BOTTOM", "force": (30.0 * n, 0.0, -2000.0 * n)},), "deformed_shape": True}
    joints = ({**SCENE["joints"][0], "preload": "static"},)
    values = []
    for more in ({"joints": joints}, {"joints": joints, "statics": stated}, {}):
        ignore = () if more else ("*STEP, PERTURBATION",)
        scene = scene_of({**tables("loaded.inp", ignore=ignore), **more}, folder / "loaded.toml")
        with microslip.build(scene, comm) as structure:
            values.append((structure.modes.omega_n.copy(), structure.pairs.N0.copy()))
    assert values[0][0] == pytest.approx(values[1][0], rel=1e-10) and values[0][1] == pytest.approx(values[1][1], rel=1e-9)
    assert values[0][1].sum() == pytest.approx(2000.0 * n, rel=1e-6)
    assert abs(values[0][0][0] / values[2][0][0] - 1.0) > 1e-6
