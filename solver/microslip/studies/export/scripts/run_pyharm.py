"""Frequency response of model.npz by pyHarm (pip install pyHarm-os).

    python run_pyharm.py [MODEL_FOLDER]

Each pair is a node with three DOFs, x, y, z; all other coordinates are modes.  Pairs whose normal force is constant become
Jenkins elements, on a friction circle or one for each direction, all others Penalty3D.  Writes response_pyharm.csv.
"""

import logging
import sys
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)  # otherwise jax computes in single precision
from exported_model import follow, read_model, write
from pyHarm.Maestro import Maestro

logging.disable(logging.INFO)


def main(folder: Path) -> None:
    """Compute the curves of an exported model by pyHarm and write them into its folder."""
    model = read_model(folder, "pyHarm")
    refuse(model)
    place, matrices = at_nodes(model)
    rows, H = [], int(model["harmonics"])
    for level in model["levels"]:
        system = Maestro(described(model, place, matrices, level)).system
        order = positions(system.expl_dofs, len(model["mu"]), len(matrices["M"]), H)
        x = first(model, place, order, level, len(system.expl_dofs))

        def evaluate(x, omega, system=system):
            y = np.append(x, omega)
            return system.Residual(y), system.Jacobian(y)[0]

        size = np.linalg.norm(level * model["load"])
        rows += follow(model, level, evaluate, x, size, lambda x, order=order: x[order][place])
    write(model, folder / "response_pyharm.csv", rows)


def refuse(model) -> None:
    """Exit for properties that pyHarm lacks."""
    if model["T0"].any():
        sys.exit("friction forces at rest (T0): the elements start without any")
    if np.any(model["k_t"] != model["k_ty"]) or np.any(model["mu"] != model["mu_y"]):
        sys.exit("stiffness or friction of x and y differ: Penalty3D has one for both")
    dependent = np.setdiff1d(np.flatnonzero(model["R"].any(axis=1)), model["independent"])
    if len(dependent):
        sys.exit(f"relative displacement {dependent[0]} depends on others: this script takes a node's DOFs for a pair's")
    if np.any((model["N0"] <= 0.0) & moves(model)[:, 2]):
        sys.exit("a pair without preload, or with a gap, moves along its normal: Penalty3D has no friction for it")


def moves(model):
    """Return which relative displacements are not identically 0, (n_pairs, 3)."""
    return model["R"].any(axis=1).reshape(-1, 3)


def at_nodes(model):
    """Return the position of each coordinate among 3 DOFs per pair and the modes, and the matrices; others are fixed."""
    n_rows, n_b = len(model["R"]), len(model["independent"])
    place = np.concatenate([model["independent"], n_rows + np.arange(len(model["M"]) - n_b)]).astype(int)
    size, matrices = n_rows + len(model["M"]) - n_b, {}
    for name in ("M", "C", "K"):
        matrices[name] = np.zeros((size, size))
        matrices[name][np.ix_(place, place)] = model[name]
    held = np.setdiff1d(np.arange(n_rows), place)
    matrices["K"][held, held] = np.abs(np.diag(model["K"])).max()
    return place, matrices


def described(model, place, matrices, level):
    """Return the input of pyHarm: one substructure with all coordinates, one or two elements per pair, the loads."""
    n_pairs, size = len(model["mu"]), len(matrices["M"])
    body = {"matrix": matrices, "nnodes": n_pairs, "ndofs": 3, "nmodes": size - 3 * n_pairs}
    connectors: dict = {}
    for i in range(n_pairs):
        connectors |= contact(model, i)
    for coordinate, coefficients in zip(place, level * model["load"]):
        connectors |= forces(coordinate, coefficients, n_pairs)
    return {
        "analysis": {},
        "system": {"type": "Base", "nh": int(model["harmonics"]), "nti": int(model["samples"]), "adim": {"status": False}},
        "substructures": {"body": body},
        "connectors": connectors,
    }


def contact(model, i):
    """Return the elements of pair i."""
    mu, k_t, k_n, N0 = (float(model[name][i]) for name in ("mu", "k_t", "k_n", "N0"))
    at = {"connect": {"body": [i]}, "mu": mu, "N0": max(N0, 0.0)}
    x, y, z = moves(model)[i]
    if z:
        return {f"pair {i}": {**at, "type": "Penalty3D", "dirs": [2, 0, 1], "g": 0.0, "k_n": k_n, "k_t": k_t}}
    jenkins = {**at, "type": "Jenkins", "k": k_t}
    if x and y and not model["separate"][i]:
        return {f"pair {i}": {**jenkins, "dirs": [0, 1]}}
    return {f"pair {i} {axis}": {**jenkins, "dirs": [axis]} for axis in (0, 1) if (x, y)[axis]}


def forces(coordinate, coefficients, n_pairs):
    """Return the loads of one coordinate: one element per harmonic."""
    is_node = coordinate < 3 * n_pairs
    node, dirs = (coordinate // 3, [coordinate % 3]) if is_node else (n_pairs + coordinate - 3 * n_pairs, [-1])
    connectors = {}
    for n in range((len(coefficients) + 1) // 2):
        cos, sin = (coefficients[0], 0.0) if n == 0 else coefficients[2 * n - 1 : 2 * n + 1]
        if cos or sin:
            element = {"type": "GOForcing", "connect": {"body": [int(node)]}, "dirs": [int(d) for d in dirs], "dto": 0, "ho": n}
            connectors[f"load {coordinate} {n}"] = {
                **element,
                "amp": float(np.hypot(cos, sin)),
                "phi": float(np.arctan2(sin, cos)),
            }
            if n == 0:
                connectors[f"load {coordinate} {n}"]["amp"] = float(cos)
    return connectors


def positions(dofs, n_pairs, size, H):
    """Return the positions of mean, cos 1, sin 1, ... of each DOF in pyHarm's vector, (size, 2 H + 1)."""
    node, direction = dofs["node_num"].to_numpy(), dofs["dof_num"].to_numpy()
    row = np.where(node < n_pairs, 3 * node + direction, 2 * n_pairs + node)
    column = np.where(dofs["harm"] == 0, 0, 2 * dofs["harm"] - (dofs["cs"] == "c"))
    order = np.empty((size, 2 * H + 1), dtype=int)
    order[row, column] = dofs.index.to_numpy()
    return order


def first(model, place, order, level, n):
    """Return the response with every pair stuck at the first frequency."""
    omega, x = 2 * np.pi * model["frequency"][0], np.zeros(n)
    K_L = model["K"] + model["R"].T @ (model["K_J"][:, None] * model["R"])
    load = level * (model["load"][:, 1] - 1j * model["load"][:, 2])
    q = np.linalg.solve(K_L - omega**2 * model["M"] + 1j * omega * model["C"], load)
    x[order[place, 1]], x[order[place, 2]] = q.real, -q.imag
    return x


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
