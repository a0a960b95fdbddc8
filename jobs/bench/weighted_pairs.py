"""What interpolation weights cost in the columns of G_static: the same pairs on nodes, and averaged over the faces around them.

    python jobs/bench/weighted_pairs.py [SCENE] [--times 3]

Needs the mesh of the scene, jobs/fan_paper.toml unless told.  The pairs of a joint whose meshes match follow one node on each side.
Here each is also made to follow all nodes of the contact faces around its node, on the second side, as nodes projected on facets do,
and on both, as cells do: some twenty nodes in place of one, more than a real point has.  Prints a line each: entries of R, and the
processor time of all columns R K_L^-1 R^T, the least of so many times, taken in turn.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

from microslip.parallel.petsc import initialise

initialise()

import microslip
from microslip.assembly.assemble import assemble
from microslip.assembly.maps import pair_map
from microslip.linear.joint_springs import Linearised, linearise
from microslip.mesh.data import ContactPairs, Mesh
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.modes.constraint import static_columns

SCENE = Path(__file__).parents[1] / "fan_paper.toml"


def averaged(mesh: Mesh, groups: list[str], nodes: np.ndarray) -> sp.csr_matrix:
    """Return the mean over the nodes of all faces that have a node, (n_pairs, n_nodes), for each of ``nodes``."""
    n = len(mesh.points)
    faces = [faces.nodes for faces in mesh.faces if faces.group in groups]
    together = sum(
        sp.csr_matrix((np.ones(own.size), (np.repeat(np.arange(len(own)), own.shape[1]), own.ravel())), (len(own), n)).T
        @ sp.csr_matrix((np.ones(own.size), (np.repeat(np.arange(len(own)), own.shape[1]), own.ravel())), (len(own), n))
        for own in faces
    )
    around = (sp.csr_matrix(together)[nodes] > 0).astype(float)
    return sp.csr_matrix(sp.diags(1.0 / np.asarray(around.sum(axis=1)).ravel()) @ around)


def variants(mesh: Mesh, pairs: ContactPairs, groups: list[str]) -> dict[str, ContactPairs]:
    """Return the pairs on nodes and with weights."""
    first, second = (averaged(mesh, groups, nodes) for nodes in (pairs.node1, pairs.node2))
    return {
        "a node on each side": pairs,
        "weights on one": replace(pairs, weights2=second),
        "weights on both": replace(pairs, weights1=first, weights2=second),
    }


def seconds(linearised: Linearised) -> float:
    """Return the processor time of all columns of G_static [s]."""
    R, start = linearised.system.R, time.process_time()
    G = static_columns(linearised, R, R.T.tocsc())
    taken = time.process_time() - start
    assert np.allclose(G, G.T, atol=1e-9 * np.abs(G).max()), "R K_L^-1 R^T is symmetric"
    return taken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--times", type=int, default=3)
    given = parser.parse_args()
    settings, comm = microslip.read(given.scene), MPI.COMM_SELF
    mesh = read_mesh(settings)
    pairs = pair_contacts(mesh, settings.joints)
    system = assemble(distribute(mesh, settings, comm), mesh, pairs, settings)
    assert system.dof is not None, "it has a mesh"
    groups = [name for joint in settings.joints for name in joint.surfaces]
    stuck = {
        name: linearise(replace(system, R=pair_map(own, system.dof, system.n_dof)), own)
        for name, own in variants(mesh, pairs, groups).items()
    }
    found = [{name: seconds(one) for name, one in stuck.items()} for _ in range(given.times)]
    print(f"{system.n_dof} DOF, {pairs.n_pairs} pairs\n\n| pairs follow | entries of a row of R | columns of G_static [s] |")
    print("| --- | --- | --- |")
    for name, one in stuck.items():
        R = one.system.R
        print(f"| {name} | {R.nnz / R.shape[0]:.1f} | {min(each[name] for each in found):.2f} |")


if __name__ == "__main__":
    main()
