"""The arrays of an export with names, units and meanings, the same in model.npz and model.mat."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...contact.laws import ELASTIC_COULOMB, sliders_of
from ...library.build import Structure
from ...library.settings import band, excitation, units_of
from ...mesh.data import ContactPairs, Mesh
from ...points.band import frequency_band
from ...reduction.reduction import Reduction
from ...scene.schema import Scene
from .interface_model import InterfaceModel


@dataclass(frozen=True, eq=False)
class Entry:
    """One array of the files."""

    values: np.ndarray
    shape: str
    unit: str
    meaning: str


def contents(
    scene: Scene, structure: Structure, reduction: Reduction, model: InterfaceModel, K_J: np.ndarray
) -> dict[str, Entry]:
    """Return the arrays of an export by their names.  Local."""
    entries = {**_matrices(model, K_J), **_pairs(structure.pairs)}
    entries |= _loads(scene, model) | _outputs(scene, reduction, model) | _settings(scene, structure)
    return entries


def _matrices(model: InterfaceModel, K_J: np.ndarray) -> dict[str, Entry]:
    none = np.zeros((0, 0))
    return {
        "M": Entry(model.M, "(n, n)", "kg", "mass"),
        "C": Entry(model.C, "(n, n)", "N s/m", "viscous damping"),
        "K": Entry(model.K, "(n, n)", "N/m", "stiffness, without the springs of the contact pairs"),
        "S": Entry(
            none if model.S is None else model.S, "(n, n) or empty", "N/m", "structural damping: i S in harmonics above 0"
        ),
        "R": Entry(model.R, "(3 n_pairs, n)", "-", "relative displacements du = R q: x, y, z of pair 1, of pair 2, ...; z opens"),
        "K_J": Entry(
            K_J, "(3 n_pairs,)", "N/m", "springs of the pairs while they stick; K + R^T diag(K_J) R is the stuck structure"
        ),
        "independent": Entry(model.independent, "(n_b,)", "-", "rows of R, from 0, that are the coordinates q[0] to q[n_b - 1]"),
    }


def _pairs(pairs: ContactPairs) -> dict[str, Entry]:
    k_ty = pairs.law_columns.get("k_ty", np.full(pairs.n_pairs, np.nan))
    mu_y = pairs.law_columns.get("mu_y", np.full(pairs.n_pairs, np.nan))
    each = "(n_pairs,)"
    entries = {
        "mu": Entry(pairs.mu, each, "-", "friction coefficient"),
        "mu_y": Entry(np.where(np.isnan(mu_y), pairs.mu, mu_y), each, "-", "the same along y"),
        "k_t": Entry(pairs.k_t, each, "N/m", "tangential stiffness"),
        "k_ty": Entry(np.where(np.isnan(k_ty), pairs.k_t, k_ty), each, "N/m", "the same along y"),
        "k_n": Entry(pairs.k_n, each, "N/m", "normal stiffness"),
        "N0": Entry(pairs.N0, each, "N", "normal preload; negative: open at rest by the gap -N0 / k_n"),
        "T0": Entry(pairs.T0, "(n_pairs, 2)", "N", "friction force at rest"),
        "separate": Entry(
            pairs.separate.astype(float), each, "-", "1: each tangential direction has its own friction limit; 0: a circle"
        ),
        "area": Entry(pairs.area, each, "m2", "tributary area"),
        "position": Entry(pairs.position, "(n_pairs, 3)", "m", "of the pair, where there is a mesh"),
        "frame": Entry(pairs.frame, "(n_pairs, 3, 3)", "-", "rows: the pair's x, y, z in the model's axes"),
        "joint": Entry(np.array(pairs.joint, dtype=str), each, "", "name of the joint"),
        "law": Entry(np.array(pairs.laws, dtype=str), each, "", f'contact law; the scripts support "{ELASTIC_COULOMB}"'),
    }
    others = {name: values for name, values in pairs.law_columns.items() if name not in ("k_ty", "mu_y")}
    entries |= {
        f"law_{name}": Entry(values, each, "SI", "of a law other than that; nan: not of this pair")
        for name, values in others.items()
    }
    sliders = sliders_of(pairs.laws, pairs.columns)
    return entries | {f"slider_{name}": Entry(values, *_SLIDERS[name]) for name, values in sliders.items()}


_SLIDERS = {  # shape, unit and meaning
    "k_t": (
        "(n_pairs, m)",
        "N/m",
        "tangential stiffness of each slider of pairs of other laws; nan: the pair has fewer, or none",
    ),
    "limit": ("(n_pairs, m)", "N", "friction limit of each at rest; negative: it is open by -limit / rate"),
    "rate": ("(n_pairs, m)", "N/m", "by which that falls with du_z"),
    "w0": ("(n_pairs, m, 2)", "m", "where each starts, along x and y"),
}


def _loads(scene: Scene, model: InterfaceModel) -> dict[str, Entry]:
    meaning = "load at unit level: mean, cos 1, sin 1, cos 2, ... of the coordinates"
    return {"load": Entry(model.F @ excitation(scene).coefficients, "(n, 2 H + 1)", "1", meaning)}


def _outputs(scene: Scene, reduction: Reduction, model: InterfaceModel) -> dict[str, Entry]:
    n, observed, units = len(model.outputs), reduction.structure.observed, units_of(scene).outputs
    order = np.zeros(n) if observed is None else observed.order.astype(float)
    of_p = np.zeros((n, len(model.R))) if observed is None else observed.of_p
    f = excitation(scene).coefficients
    base = np.zeros((n, f.shape[1])) if observed is None else observed.of_base @ f
    return {
        "outputs": Entry(model.outputs, "(n_outputs, n)", "1", "rows o of the outputs"),
        "output_order": Entry(
            order, "(n_outputs,)", "-", "derivatives of o q by time: 0 displacement, 1 velocity, 2 acceleration"
        ),
        "output_p": Entry(of_p, "(n_outputs, 3 n_pairs)", "-", "of contact forces: what p = f_nl - K_J du adds"),
        "output_base": Entry(base, "(n_outputs, 2 H + 1)", "m/s2", "of absolute motion: acceleration of the base at unit level"),
        "output_name": Entry(np.array([output.name for output in scene.outputs], dtype=str), "(n_outputs,)", "", "names"),
        "output_unit": Entry(np.array(units, dtype=str), "(n_outputs,)", "", "units"),
    }


def _settings(scene: Scene, structure: Structure) -> dict[str, Entry]:
    omega_n, response = structure.modes.omega_n, scene.response
    low, high = frequency_band(band(scene), omega_n)
    grid = np.linspace(low, high, response.points)
    return {
        "omega_n": Entry(omega_n, "(n_modes,)", "rad/s", "lowest natural frequencies of the stuck structure, not reduced"),
        "levels": Entry(np.array(response.levels), "(n_levels,)", "N", "levels of the load"),
        "frequency": Entry(
            grid if response.direction == "up" else grid[::-1], "(n,)", "Hz", "where the scripts solve, in this order"
        ),
        "harmonics": Entry(np.array(scene.harmonics), "()", "-", "H, the highest harmonic"),
        "samples": Entry(np.array(scene.solver.samples), "()", "-", "time samples a period"),
    }


def recovery(parts: Sequence[np.ndarray], mesh: Mesh | None) -> dict[str, Entry]:
    """Return the map from the coordinates to full fields, from rows of all ranks.  Local, rank 0."""
    u = np.concatenate(parts)
    if mesh is None:
        return {"recovery": Entry(u, "(n_dof, n)", "-", "displacement of each row of the scene's matrices: u = recovery q")}
    return {
        "recovery": Entry(u, "(n_nodes, 3, n)", "-", "displacement of each node along the model's axes: u = recovery q"),
        "node": Entry(mesh.numbers, "(n_nodes,)", "-", "node numbers of the mesh file"),
        "points": Entry(mesh.points, "(n_nodes, 3)", "m", "coordinates of the nodes"),
    }
