"""The files of an export: model.npz, model.mat, recovery, README.txt and the scripts.  Rank 0 only."""

import shutil
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.io

from ...contact.laws import ELASTIC_COULOMB, LAWS
from ...messages.errors import CaseError
from ...messages.words import counted, listed
from ...scene.schema import Scene
from ...system.files import atomic_write, make_folder
from .contents import Entry

SCRIPTS = ("run_nlvib.m", "nlvib_residual.m", "run_tmdsimpy.py", "run_pyharm.py", "exported_model.py")
LARGEST_MAT = 2**31 - 1  # bytes of an array in a .mat file of version 5


def write_export(
    arrays: Mapping[str, Entry], fields: Mapping[str, Entry] | None, method: str, note: str, scene: Scene, folder: str
) -> str:
    """Write all files into ``folder`` and return the text for the screen.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written, or an array is too large for a .mat file
    """
    make_folder(folder)
    _refuse_too_large(arrays)
    _write_arrays(f"{folder}/model", arrays)
    if fields is not None:
        _write_arrays(f"{folder}/recovery", fields, has_mat=_largest(fields) <= LARGEST_MAT)
    limits = what_differs(arrays, scene)
    with atomic_write(f"{folder}/README.txt") as path:
        Path(path).write_text(readme(arrays, fields, note, limits, str(scene.path)), encoding="utf-8")
    for name in SCRIPTS:
        with atomic_write(f"{folder}/{name}") as path:
            shutil.copyfile(Path(__file__).parent / "scripts" / name, path)
    return "\n".join([_size(arrays, method), *(f"  {line}" for line in limits)])


def _size(arrays: Mapping[str, Entry], method: str) -> str:
    n, n_b = len(arrays["M"].values), len(arrays["independent"].values)
    n_pairs, H = len(arrays["mu"].values), int(arrays["harmonics"].values)
    unknowns = f"{n * (2 * H + 1)} unknowns with H = {H}"
    return f"{method}: {counted(n, 'coordinate')}, {n_b} of them relative displacements of {counted(n_pairs, 'pair')}; {unknowns}"


def what_differs(arrays: Mapping[str, Entry], scene: Scene) -> list[str]:
    """Return the differences of the scripts and of the other programs' laws from this program; empty: none.  Local."""
    value = {name: entry.values for name, entry in arrays.items()}
    lines = []
    if scene.solver.between_samples == "path":
        lines.append(
            "the other programs evaluate the law at samples only; with [solver] between_samples = "
            '"return-map" this program does the same, otherwise the difference decreases with more samples'
        )
    others = sorted(set(value["law"]) - {ELASTIC_COULOMB})
    if others:
        lines.append(
            f"no script can run pairs of the law {listed(others)}: none of the programs has it; slider_k_t, slider_limit, "
            "slider_rate and slider_w0 state its parameters"
        )
    if value["S"].size:
        lines.append("no script can run structural damping (S)")
    if np.any(value["T0"] != 0.0):
        lines.append("friction forces at rest (T0): the scripts for NLvib and pyHarm refuse them")
    left_out = _not_displacements(value)
    if left_out:
        lines.append(f"the scripts leave out the outputs {listed(left_out)}: base motion and contact forces need more than o q")
    return lines + _of_laws(value)


def _not_displacements(value: Mapping[str, np.ndarray]) -> list[str]:
    needs_more = value["output_p"].any(axis=1) | value["output_base"].any(axis=1)
    return [str(name) for name in value["output_name"][needs_more]]


def _of_laws(value: Mapping[str, np.ndarray]) -> list[str]:
    """Return which programs have the law of these pairs and which have another one."""
    moves = np.abs(value["R"]).reshape(-1, 3, value["R"].shape[1]).max(axis=2, initial=0.0) > 0.0
    has_normal, in_plane = bool(moves[:, 2].any()), moves[:, :2].all(axis=1)
    on_circle = bool((in_plane & (value["separate"] == 0.0)).any())
    separate = bool((in_plane & (value["separate"] == 1.0)).any())
    lines = []
    if has_normal:
        lines.append("NLvib 1.3 has constant friction limits mu N0: a different law if the normal force varies")
        lines.append("pyHarm 1.2 retains friction and preload of a pair that opens: a different law if pairs open")
    if on_circle:
        lines.append(
            "NLvib 1.3 and TMDSimPy limit friction in each direction separately: a different law than the circle of these pairs"
        )
    if separate and has_normal:
        lines.append("pyHarm 1.2 has a friction circle: a different law than the separate limits of these pairs")
    return lines


def _refuse_too_large(arrays: Mapping[str, Entry]) -> None:
    if _largest(arrays) > LARGEST_MAT:
        n = len(arrays["M"].values)
        raise CaseError(
            f"export: {n} coordinates make matrices of {_largest(arrays) / 1e9:.3g} GB, and a .mat of version 5 holds 2.1 GB; "
            "use fewer modes or interface shapes, or another --method"
        )


def _largest(arrays: Mapping[str, Entry]) -> int:
    return max(entry.values.nbytes for entry in arrays.values())


def _write_arrays(path: str, arrays: Mapping[str, Entry], has_mat: bool = True) -> None:
    """Write the arrays as .npz and, unless they are too large, as .mat of version 5; text is text in both, never an object."""
    with atomic_write(f"{path}.npz") as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, entry in arrays.items():  # np.savez_compressed leaves the archive open on a full disk
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(entry.values), allow_pickle=False)
    if has_mat:
        with atomic_write(f"{path}.mat") as temporary, open(temporary, "wb") as file:
            scipy.io.savemat(file, {name: _as_mat(entry.values) for name, entry in arrays.items()}, oned_as="column")


def _as_mat(values: np.ndarray) -> np.ndarray:
    """Return an array for MATLAB: doubles, or a cell array of names."""
    if values.dtype.kind == "U":
        return np.array([*map(str, values)], dtype=object)
    return values.astype(float)


def readme(arrays: Mapping[str, Entry], fields: Mapping[str, Entry] | None, note: str, limits: Sequence[str], scene: str) -> str:
    """Return README.txt: the equation, signs, every array with shape and unit, the scripts, differences.  Local."""
    laws = "\n".join(_law(name, kind.exported) for name, kind in LAWS.items() if kind.exported)
    parts = [
        TEXT.format(scene=scene, note=note, laws=laws),
        "model.npz and model.mat\n-----------------------\n" + _table(arrays),
    ]
    if fields is not None:
        size = sum(entry.values.nbytes for entry in fields.values()) / 1e6
        mat = (
            "recovery.npz and recovery.mat"
            if _largest(fields) <= LARGEST_MAT
            else "recovery.npz (too large for a .mat of version 5)"
        )
        parts.append(f"{mat}, {size:.3g} MB\n{'-' * len(mat)}\n" + _table(fields))
    parts.append(SCRIPT_TEXT)
    parts.append("Differences\n-----------\n" + "\n".join(f"- {line}" for line in limits or ["none known"]))
    return "\n\n".join(parts) + "\n"


def _law(name: str, exported: str) -> str:
    """Return the lines of a law, with its name in front."""
    lines = exported.splitlines()
    return "\n".join(f"    {head:<10}{line}" for head, line in zip([f'"{name}"', *[""] * len(lines)], lines))


def _table(arrays: Mapping[str, Entry]) -> str:
    names = max(map(len, arrays))
    lines = []
    for name, entry in arrays.items():
        stands = "x".join(map(str, entry.values.shape)) or "a number"
        unit = f" [{entry.unit}]" if entry.unit not in ("", "-") else ""
        lines.append(f"{name:{names}}  {entry.shape}, here {stands}{unit}: {entry.meaning}")
    return "\n".join(lines)


TEXT = """\
Reduced model of {scene}
{note}.

Equation, in SI units, about the state of rest:

    M q'' + C q' + K q + R^T f_nl(R q) = level * load(t),      q = [du_b, xi]

du_b are relative displacements of the contact pairs, xi modes with all of them held (mass 1, no stiffness between them and du_b).
du = R q are the relative displacements of body 1 against body 2 of each pair, in its own axes x, y, z; z opens the pair.

    N(t) = max(0, N0 - k_n du_z)         normal force, compression positive
    f_nl,z = max(N0, 0) - N              measured from rest: the preload is in balance
    T = k_t (du_t - w), |T| <= mu N      friction force of a spring and a slider that starts at w0 = -T0 / k_t
    f_nl,t = T - T0

That is law "elastic-coulomb".  A pair of another law has sliders side by side (slider_k_t, _limit, _rate, _w0), each with

    T_j = k_j (du_t - w_j), |T_j| <= max(0, limit_j - rate_j du_z), w_j starting at w0_j       f_nl,t = sum of T_j + k_j w0_j

and a normal force of its own:

{laws}

While every pair sticks, f_nl = diag(K_J) du.  A load or motion a(t) has real coefficients mean, cos 1, sin 1, cos 2, sin 2, ...:
a(t) = a_0 + sum_n a_cn cos(n omega t) + a_sn sin(n omega t)."""

SCRIPT_TEXT = """\
Scripts
-------
Each reads the model in its folder, solves at the frequencies of the model one after the other, and writes response_PROGRAM.csv:
level_N, frequency_Hz, seconds, then mean, cos 1, sin 1, ... of each output.  None of the programs comes with this folder.

    octave-cli run_nlvib.m SRC           NLvib 1.3 (github.com/maltekrack/NLvib), SRC being its folder SRC; Octave or MATLAB
    python run_tmdsimpy.py FOLDER        TMDSimPy (github.com/tmd-lab/tmdsimpy), FOLDER being where it was cloned; needs jax
    python run_pyharm.py                 pyHarm 1.2 (pip install pyHarm-os)"""
