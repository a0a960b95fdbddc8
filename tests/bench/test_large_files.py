"""The files of the benchmark of large files are read as the intended model."""

import numpy as np
import pytest
from large_models import WRITERS, blocks, scene

from microslip.formats.read import read_model
from microslip.library.complete import complete
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.read import read_mesh
from microslip.scene.read import read_scene

PACKAGES = {"cdb": "mapdl_archive", "bdf": "pyNastran", "vtu": "meshio"}


@pytest.mark.parametrize("ending", WRITERS)
def test_every_format_has_the_same_two_blocks(tmp_path, ending):
    pytest.importorskip(PACKAGES.get(ending, "numpy"))
    model, path = blocks(200, 25), tmp_path / f"large.{ending}"
    WRITERS[ending](model, path)
    (tmp_path / "large.toml").write_text(scene(path.name, model))
    file = read_model(path)
    whole, _ = complete(read_scene(tmp_path / "large.toml"), file)
    mesh = read_mesh(whole, file)
    np.testing.assert_allclose(mesh.points, model.points, atol=1e-12)
    nodes = np.concatenate([block.nodes for block in mesh.elements])
    np.testing.assert_array_equal(nodes + 1, np.concatenate(list(model.elements.values())))
    assert pair_contacts(mesh, whole.joints).n_pairs == 25
    assert [support.fix for support in whole.supports] == [("x", "y", "z")]
