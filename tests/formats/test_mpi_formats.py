"""Every model file that states materials, bodies and supports gives the response of the same model as a mesh with a scene."""

import sys
from types import ModuleType

import mapdl_archive
import meshio
import numpy as np
import pytest
from mpi4py import MPI
from plain_model import DENSITY, POISSON, SCENE, YOUNG, bdf, cdb, exodus, inp, plain, tables, unv

import microslip
from microslip.parallel.agree import on_root
from microslip.scene.read import scene_of

comm = MPI.COMM_WORLD
STEEL = {"young": YOUNG, "poisson": POISSON, "density": DENSITY}
WRITERS = {
    ".cdb": lambda path: path.write_text(cdb(plain())),
    ".inp": lambda path: path.write_text(inp(plain())),
    ".bdf": lambda path: path.write_text(bdf(plain())),
    ".unv": lambda path: path.write_text(unv(plain())),
    ".exo": lambda path: exodus(plain(), path),
    ".e": lambda path: exodus(plain(), path, hdf5=True),
}
SURFACES = {".bdf": ("SET 1", "SET 2")}  # where names of sets are numbers
MESH_ALONE = (".unv", ".exo", ".e")  # the scene states the rest
BY_SCENE = {
    "materials": {"steel": STEEL},
    "bodies": {name: {"group": name, "material": "steel"} for name in ("bar", "plate")},
    "supports": ({"group": "PLATE_BASE", "fix": ("x", "y", "z")},),
}


def response_of(scene):
    structure = microslip.build(scene, comm)
    response = microslip.respond(structure)
    return structure.modes.omega_n.copy(), response["corner"].frequency, response["corner"].amplitude


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder that all ranks share."""
    return comm.bcast(tmp_path_factory.mktemp("formats"))


@pytest.fixture(scope="module")
def expected(folder):
    """The response of the model as a plain mesh."""
    model = plain()

    def write():
        cells = [("hexahedron", block) for block in model.elements] + [("vertex", own[:, None]) for own in model.sets.values()]
        names = {name: np.array([k, 0 if k > 2 else 3]) for k, name in enumerate(["bar", "plate", *model.sets], 1)}
        tags = [np.full(len(block), k) for k, (_, block) in enumerate(cells, 1)]
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        mesh = meshio.Mesh(model.points, cells, cell_data=data, field_data=names)
        meshio.write(folder / "plain.msh", mesh, file_format="gmsh22", binary=False)

    on_root(comm, write)
    return response_of(scene_of({"model": {"mesh": "plain.msh"}, **BY_SCENE, **SCENE}, folder / "plain.toml"))


@pytest.mark.slow
@pytest.mark.parametrize("ending", WRITERS)
def test_a_model_file_gives_the_response_of_mesh_and_scene(expected, folder, ending):
    on_root(comm, lambda: (WRITERS[ending](folder / f"model{ending}"), None)[1])
    stated = {**tables(f"model{ending}"), **(BY_SCENE if ending in MESH_ALONE else {})}
    if ending in SURFACES:
        stated["joints"] = ({**stated["joints"][0], "surfaces": SURFACES[ending]},)
    omega, frequency, amplitude = response_of(scene_of(stated, folder / f"model{ending}.toml"))
    np.testing.assert_allclose(omega, expected[0], rtol=1e-8)
    np.testing.assert_allclose(frequency, expected[1], rtol=1e-8)
    np.testing.assert_allclose(amplitude, expected[2], rtol=1e-6)


class Result:
    """A results file of Ansys as ansys.mapdl.reader reads it, of the model that the archive beside it holds."""

    def __init__(self, path, parse_vtk):
        self.mesh = mapdl_archive.Archive(path.replace(".rst", ".cdb"), parse_vtk=False)
        self.materials = {number: {"EX": YOUNG, "NUXY": POISSON, "DENS": DENSITY} for number in (1, 2)}
        keys = {number: dict(pairs) for number, pairs in self.mesh.key_option.items()}
        self._element_table = {"keyopts": {n: [own.get(i, 0) for i in range(1, 12)] for n, own in keys.items()}}

    def nodal_boundary_conditions(self, number):
        held = plain().numbers[plain().sets["PLATE_BASE"]]
        return np.repeat(held, 3), np.tile([1, 2, 3], len(held)), np.zeros(3 * len(held))

    def result_dof(self, number):
        return ["UX", "UY", "UZ"]


@pytest.mark.slow
def test_a_results_file_gives_the_response_of_mesh_and_scene(expected, folder, monkeypatch):
    for name in ("ansys", "ansys.mapdl", "ansys.mapdl.reader"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setattr(sys.modules["ansys.mapdl.reader"], "read_binary", Result, raising=False)
    on_root(comm, lambda: [(folder / f"result.{ending}").write_text(cdb(plain())) for ending in ("rst", "cdb")])
    omega, frequency, amplitude = response_of(scene_of(tables("result.rst"), folder / "rst.toml"))
    np.testing.assert_allclose(omega, expected[0], rtol=1e-8)
    np.testing.assert_allclose(frequency, expected[1], rtol=1e-8)
    np.testing.assert_allclose(amplitude, expected[2], rtol=1e-6)


def test_a_loaded_step_before_the_vibration_is_the_statics_of_a_scene(folder):
    """Pressed down and pulled along, by the file or by the scene: the same joint at rest and the same modes, others than without."""
    model, n = plain(), len(plain().sets["BAR_BOTTOM"])
    step = ("*Step", "*Static", "*Cload", "BAR_BOTTOM, 3, -2000.", "BAR_BOTTOM, 1, 30.", "*End Step")
    on_root(comm, lambda: (folder / "loaded.inp").write_text(inp(model, step)))
    stated = {"forces": ({"group": "BAR_BOTTOM", "force": (30.0 * n, 0.0, -2000.0 * n)},), "deformed_shape": True}
    joints = ({**SCENE["joints"][0], "preload": "static"},)
    found = []
    for more in ({"joints": joints}, {"joints": joints, "statics": stated}, {}):
        ignore = () if more else ("*STEP, PERTURBATION",)
        scene = scene_of({**tables("loaded.inp", ignore=ignore), **more}, folder / "loaded.toml")
        with microslip.build(scene, comm) as structure:
            found.append((structure.modes.omega_n.copy(), structure.pairs.N0.copy()))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-10) and found[0][1] == pytest.approx(found[1][1], rel=1e-9)
    assert found[0][1].sum() == pytest.approx(2000.0 * n, rel=1e-6)
    assert abs(found[0][0][0] / found[2][0][0] - 1.0) > 1e-6
