"""Bad matrices, tables of their rows, pairs and forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp

from .case import NOISE, Case, Spoil, all_of, cut, edited, made_a_folder, removed, written

RUN = "run chain.toml --out out"
BLOCKS = "run blocks/scene.toml --out out"


def chain(name: str, spoil: Spoil, *words: str) -> Case:
    """Return the scene of the chain of masses with a spoiled file."""
    return Case(name, RUN, words, spoil)


def blocks(name: str, spoil: Spoil, *words: str) -> Case:
    """Return the scene of the blocks, whose rows belong to nodes, with a spoiled file."""
    return Case(name, BLOCKS, words, spoil)


def stated(old: str, new: str) -> Spoil:
    return edited("chain.toml", old, new)


def changed(file: str, change) -> Spoil:
    """Return a function that replaces the matrix A of a file by ``change(A)``, written as general matrix."""

    def spoil(folder: Path) -> None:
        A = change(np.asarray(sp.csr_matrix(scipy.io.mmread(folder / file)).todense()))
        scipy.io.mmwrite(folder / file, np.asarray(A), precision=17, symmetry="general")

    return spoil


def entry(i: int, j: int, value: float):
    """Return a function that changes an entry."""

    def change(A):
        A = A.copy()
        A[i, j] = value
        return A

    return change


def into(ending: str, write) -> Spoil:
    """Return a function that writes the stiffness to another file by ``write(path, A)`` and names it in the scene."""

    def spoil(folder: Path) -> None:
        A = np.asarray(sp.csr_matrix(scipy.io.mmread(folder / "K.mtx")).todense())
        write(folder / f"K.{ending}", A)
        stated('"K.mtx"', f'"K.{ending}"')(folder)

    return spoil


def invalid_file(ending: str, content: bytes = NOISE) -> Spoil:
    """Return a function that names a file of another format for the stiffness, with invalid content."""
    return all_of(stated('"K.mtx"', f'"K.{ending}"'), written(f"K.{ending}", content))


MATRICES = [
    chain("matrix missing", removed("K.mtx"), '[model] stiffness = "K.mtx": there is no such file'),
    chain("matrix is a folder", made_a_folder("K.mtx"), '[model] stiffness = "K.mtx": that is a folder'),
    chain("matrix empty", written("K.mtx", ""), "K.mtx"),
    chain("matrix of noise", written("K.mtx", NOISE), "K.mtx"),
    chain("matrix cut", cut("K.mtx"), "K.mtx", "its header states 45 numbers, and it has 22"),
    chain("matrix of an unknown format", stated('"K.mtx"', '"K.csv"'), "K.csv"),
    chain("matrix not symmetric", changed("K.mtx", entry(0, 1, 1e9)), "K.mtx", "not symmetric"),
    chain("mass not symmetric", changed("M.mtx", entry(0, 1, 1.0)), "M.mtx", "not symmetric"),
    chain("matrix of nan", changed("K.mtx", entry(2, 2, np.nan)), "K.mtx", "not a finite number"),
    chain("matrix of inf", changed("M.mtx", entry(2, 2, np.inf)), "M.mtx", "not a finite number"),
    chain("matrix not square", changed("K.mtx", lambda A: A[:, :-1]), "K.mtx", "square"),
    chain(
        "matrices of two sizes", changed("M.mtx", lambda A: A[:-1, :-1]), "M.mtx: [model] mass is 8 x 8, but the stiffness 9 x 9"
    ),
    Case("check of matrices of two sizes", "check chain.toml", ("mass is 8 x 8",), changed("M.mtx", lambda A: A[:-1, :-1])),
    chain("complex matrix", changed("K.mtx", lambda A: A * (1.0 + 0.1j)), "K.mtx", "complex"),
    chain("matrix of no entries", changed("M.mtx", lambda A: 0.0 * A), "M.mtx"),
    chain("negative mass", changed("M.mtx", lambda A: -A), "M.mtx"),
    chain("one negative mass", changed("M.mtx", entry(0, 0, -1.0)), "M.mtx"),
    chain(
        "stiffness and mass interchanged",
        stated('"K.mtx"\nmass = "M.mtx"', '"M.mtx"\nmass = "K.mtx"'),
        "chain.toml: [response] starts at",
        "far above the highest of the 9 modes",
    ),
    chain("words in a matrix", edited("K.mtx", "\n9 9\n", "\n9 9\none\n"), "K.mtx"),
    chain("size and entries differ", edited("K.mtx", "matrix array", "matrix coordinate"), "K.mtx"),
    chain(
        "damping matrix and [damping]",
        stated('mass = "M.mtx"', 'mass = "M.mtx"\ndamping = "M.mtx"'),
        "[damping]: the model also has a damping matrix",
    ),
    chain(
        "damping that feeds energy",
        all_of(
            changed("M.mtx", lambda A: A),
            stated('mass = "M.mtx"\n[damping]\nratio = 0.02', 'mass = "M.mtx"\ndamping = "C.mtx"'),
            lambda folder: scipy.io.mmwrite(folder / "C.mtx", -np.eye(9)),
        ),
        "chain.toml: [model] damping",
        "feeds energy in",
    ),
    chain(".npz of noise", invalid_file("npz"), "K.npz"),
    chain(".npz of objects", into("npz", lambda path, A: np.savez(path, K=np.array([{}], dtype=object))), "K.npz"),
    chain(".npz of two matrices", into("npz", lambda path, A: np.savez(path, A=A, B=A)), "K.npz", "A, B"),
    chain(".mat of noise", invalid_file("mat"), "K.mat"),
    chain(
        ".mat of no such name",
        all_of(into("mat", lambda path, A: scipy.io.savemat(path, {"KAA": A})), stated("K.mat", "K.mat:KGG")),
        "K.mat",
        "KGG",
        "KAA",
    ),
    chain(".op4 of noise", invalid_file("op4"), "K.op4"),
    chain(".op2 of noise", invalid_file("op2"), "K.op2"),
    chain(".full of noise", invalid_file("full"), "K.full"),
    chain(".petsc of noise", invalid_file("petsc"), "K.petsc"),
    chain(
        ".petsc of a billion rows", invalid_file("petsc", np.array([1211216, 10**9, 10**9, 10**9], ">i4").tobytes()), "K.petsc"
    ),
    chain(".rua of noise", invalid_file("rua"), "K.rua"),
    chain(".pch of noise", invalid_file("pch"), "K.pch"),
    chain(".sub of Ansys", invalid_file("sub"), "K.sub"),
]

HEADER = "x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n"


def pairs(name: str, row: str, *words: str) -> Case:
    """Return the chain with another row of pairs."""
    return chain(name, written("pairs.csv", HEADER + row + "\n"), "pairs.csv", *words)


PAIRS = [
    chain("pairs missing", removed("pairs.csv"), '[[joints]] 1 ("joint") pairs = "pairs.csv": there is no such file'),
    chain("pairs empty", written("pairs.csv", ""), "pairs.csv", "the file is empty"),
    chain("pairs of noise", written("pairs.csv", NOISE), "pairs.csv", "not a text file"),
    chain(
        "pairs without a header",
        written("pairs.csv", "0,1,2,3,4,5,0.3,60.0,0.0,5e5,8e5\n"),
        "pairs.csv, line 1: the header must name",
    ),
    chain("pairs: a column misspelled", edited("pairs.csv", "mu,", "mue,"), "pairs.csv, line 1", 'nearest is "mu"'),
    chain("pairs: no row", written("pairs.csv", HEADER), "pairs.csv: there is no pair after the header"),
    pairs("pairs: a value too few", "0,1,2,3,4,5,0.3,60.0,0.0,5e5", "line 2: 10 values; 11 are needed"),
    pairs("pairs: a value too many", "0,1,2,3,4,5,0.3,60.0,0.0,5e5,8e5,1", "line 2: 12 values; 11 are needed"),
    pairs("pairs: nan", "0,1,2,3,4,5,nan,60.0,0.0,5e5,8e5", "line 2: mu = nan is not a finite number"),
    pairs("pairs: a word", "0,1,2,3,4,5,much,60.0,0.0,5e5,8e5", '"much" is not a number'),
    pairs("pairs: no such DOF", "0,1,2,3,4,500,0.3,60.0,0.0,5e5,8e5", "line 2: z2 = 500 is not a DOF number; they go from 0 to"),
    pairs("pairs: half a DOF", "0.5,1,2,3,4,5,0.3,60.0,0.0,5e5,8e5", "line 2: x1 = 0.5 is not a DOF number"),
    pairs("pairs: a DOF with itself", "0,1,2,0,4,5,0.3,60.0,0.0,5e5,8e5", "x1 and x2 are both DOF 0"),
    pairs("pairs: ground with ground", "-1,-1,-1,-1,-1,-1,0.3,60.0,0.0,5e5,8e5", "all six DOFs are -1"),
    pairs("pairs: negative friction", "0,1,2,3,4,5,-0.3,60.0,0.0,5e5,8e5", "mu = -0.3 must not be negative"),
    pairs("pairs: negative stiffness", "0,1,2,3,4,5,0.3,60.0,0.0,-5e5,8e5", "kt = -500000 must not be negative"),
    pairs("pairs: gap with preload", "0,1,2,3,4,5,0.3,60.0,1e-3,5e5,8e5", "an open pair carries no preload"),
    pairs("pairs: gap on no stiffness", "0,1,2,3,4,5,0.3,0.0,1e-3,5e5,0", "kn must be above 0"),
    pairs("pairs: never in contact", "0,1,-1,3,4,-1,0.3,0.0,0.0,5e5,8e5", "n0 must be above 0"),
]

SCENES = [
    chain("load on no DOF", stated("dof = 6\nscale", "dof = 600\nscale"), "[[loads]] 5", "600"),
    chain("output at no DOF", stated('name = "6"\ndof = 6', 'name = "6"\ndof = 7000'), "7000"),
    chain(
        "load at a node of no nodes",
        stated("dof = 6\nscale = 0.2", "node = 6\ndirection = [1.0, 0.0, 0.0]"),
        "[[loads]] 5",
        "has no nodes",
    ),
    chain(
        "direction of a DOF",
        stated("dof = 6\nscale = 0.2", "dof = 6\ndirection = [1.0, 0.0, 0.0]"),
        "[[loads]] 5",
        "direction belongs to a node",
    ),
    chain(
        "supports of matrices",
        stated("[response]", '[[supports]]\ngroup = "x"\nfix = ["x"]\n[response]'),
        "[[supports]]: belongs to a mesh",
    ),
    chain(
        "surfaces of matrices",
        stated(
            'pairs = "pairs.csv"',
            'surfaces = ["a", "b"]\nfriction = 0.1\ntangential_stiffness = 1.0\nnormal_stiffness = 1.0\npreload = 1.0',
        ),
        "surfaces: belongs to a mesh",
    ),
    chain("units of matrices", stated('mass = "M.mtx"', 'mass = "M.mtx"\nunits = "mm-t-s"'), "units belongs to a mesh"),
    chain(
        "statics of matrices",
        stated("[response]", "[statics]\n[[statics.forces]]\nnode = 1\nforce = [1.0, 0.0, 0.0]\n[response]"),
        "[statics]",
    ),
    chain(
        "stress of matrices",
        stated("dof = 6\n[response]", 'node = 6\nquantity = "stress"\ncomponent = "xx"\n[response]'),
        "has no elements",
    ),
    chain("more modes than rows", stated("harmonics = 1", "modes = 500"), "[solver] modes = 500: the structure has only"),
    chain(
        "forces missing", stated("dof = 6\nscale = 0.2", 'forces = "forces.csv"'), 'forces = "forces.csv": there is no such file'
    ),
    chain(
        "forces of nan",
        all_of(stated("dof = 6\nscale = 0.2", 'forces = "forces.csv"'), written("forces.csv", "dof,value\n1,nan\n")),
        "forces.csv, line 2",
        "not a finite number",
    ),
    chain(
        "forces on no DOF",
        all_of(stated("dof = 6\nscale = 0.2", 'forces = "forces.csv"'), written("forces.csv", "dof,value\n1000,1.0\n")),
        "forces.csv",
        "1000",
    ),
    chain(
        "free mass",
        all_of(changed("K.mtx", lambda A: 0.0 * A), written("pairs.csv", HEADER + "0,1,2,3,4,5,0.3,60.0,0.0,5e5,8e5\n")),
        "chain.toml",
        "K_L is not positive definite",
    ),
    blocks(
        "rows of no table",
        edited("blocks/scene.toml", 'dofs = "dofs.csv"\n', ""),
        "node_pairs: the matrices have no nodes; state [model] dofs",
    ),
    blocks("table of too few rows", cut("blocks/dofs.csv"), "dofs.csv"),
    blocks("table of a row twice", edited("blocks/dofs.csv", "\n5,2\n", "\n5,1\n"), "dofs.csv"),
    blocks("table of no direction", edited("blocks/dofs.csv", "\n5,2\n", "\n5,9\n"), "dofs.csv"),
    blocks("table of words", edited("blocks/dofs.csv", "\n5,2\n", "\n5,y\n"), "dofs.csv", '"y" is not a number'),
    blocks(
        ".dof of CalculiX cut",
        all_of(edited("blocks/scene.toml", "K.mtx", "calculix_blocks.sti"), cut("blocks/calculix_blocks.dof")),
        "calculix_blocks.dof",
    ),
    blocks("pair of no node", edited("blocks/pairs.csv", "\n11,5", "\n11,500"), "pairs.csv", "500"),
    blocks("pair of no normal", edited("blocks/pairs.csv", "11,5,0,0,2", "11,5,0,0,0"), "pairs.csv", "normal"),
    blocks("pair of no area", edited("blocks/pairs.csv", "0.0025", "0"), "pairs.csv", "area"),
    blocks(
        "load at a node without rows", edited("blocks/scene.toml", "node = 17", "node = 1700"), "scene.toml: [[loads]] 1", "1700"
    ),
    blocks(
        "places of no nodes",
        edited("blocks/scene.toml", 'dofs = "dofs.csv"', 'dofs = "dofs.csv"\nnodes = "none.csv"'),
        '[model] nodes = "none.csv": there is no such file',
    ),
    blocks(
        "places of nan",
        all_of(
            edited("blocks/scene.toml", 'dofs = "dofs.csv"', 'dofs = "dofs.csv"\nnodes = "nodes.csv"'),
            written("blocks/nodes.csv", "node,x,y,z\n5,nan,0,0\n"),
        ),
        "nodes.csv, line 2",
        "not a finite number",
    ),
    blocks(
        "recovery of no rows",
        edited("blocks/scene.toml", 'dofs = "dofs.csv"', 'dofs = "dofs.csv"\nrecovery = "K.mtx"'),
        "recovery",
    ),
]

CASES = [*MATRICES, *PAIRS, *SCENES]
