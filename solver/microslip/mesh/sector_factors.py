"""Differences of the sectors of a disc: factors of friction, preload, gap, stiffness, density, load; pairs of all sectors.

docs/theory.md, section 17.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..contact.laws import ELASTIC_COULOMB
from ..formats.csv_table import read_table
from ..messages.errors import CaseError
from ..tables.cyclic import QUANTITIES, Cyclic
from .cyclic import rotation, turned_about
from .data import ContactPairs

_POSITIVE = ("contact_stiffness", "stiffness", "density")
_OF_PAIRS = ("friction", "preload", "gap", "contact_stiffness")


@dataclass(frozen=True, eq=False)
class SectorFactors:
    """The values of each sector relative to the model, (n_sectors,) each."""

    friction: np.ndarray
    preload: np.ndarray
    gap: np.ndarray
    contact_stiffness: np.ndarray
    stiffness: np.ndarray  # of the blade: Young's modulus
    density: np.ndarray  # of the blade
    load: np.ndarray

    @property
    def contact_that_differs(self) -> str:
        """The first quantity of the contact that differs, in words; "" where nothing does."""
        return next((name.replace("_", " ") for name in _OF_PAIRS if (getattr(self, name) != 1.0).any()), "")

    @property
    def changes_blades(self) -> bool:
        """Whether stiffness or density of the blades differs."""
        return bool((self.stiffness != 1.0).any() or (self.density != 1.0).any())


def factors_of(cyclic: Cyclic, path: Path) -> SectorFactors:
    """Return the factors of all sectors, 1 by default.  Local; random scatter is drawn with the stated seed.

    Raises
    ------
    CaseError : a table with too few sectors or invalid factors, a scatter that makes a value negative
    """
    values = {name: np.ones(cyclic.sectors) for name in QUANTITIES}
    for sector in cyclic.sector:
        for name in QUANTITIES:
            values[name][sector.number] = getattr(sector, name)
    if (file := cyclic.file_of("table")) is not None:
        values |= _from_file(cyclic.sectors, file)
    if cyclic.scatter is not None:
        random = np.random.default_rng(cyclic.scatter.seed).standard_normal((len(QUANTITIES), cyclic.sectors))
        values = {name: 1.0 + getattr(cyclic.scatter, name) * each for name, each in zip(QUANTITIES, random)}
        for name in QUANTITIES[:-1]:
            _check(
                name, values[name], f"{path}: [cyclic] scatter: {name} = {getattr(cyclic.scatter, name):g}", "state a smaller one"
            )
    return SectorFactors(**values)


def notes_on_sectors(cyclic: Cyclic | None, path: Path) -> list[str]:
    """Return notes on the differences of the sectors of a disc; none for equal sectors.  Local.

    Raises
    ------
    CaseError : as in :func:`factors_of`
    """
    if cyclic is None or not cyclic.differs:
        return []
    factors = vars(factors_of(cyclic, path))
    ranges = [f"{name.replace('_', ' ')} {f.min():.4g} to {f.max():.4g}" for name, f in factors.items() if (f != 1.0).any()]
    return [f"cyclic: sectors differ by factors: {', '.join(ranges) or 'none, all are 1'}"]


def _from_file(n_sectors: int, file: Path) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file in the order of the sectors, (n_sectors,) each.  Local."""
    table, lines = read_table(file, ("sector",), QUANTITIES, "sector")
    number = table.pop("sector")
    wanted = np.arange(n_sectors)
    if not np.array_equal(np.sort(number), wanted):
        missing, unknown = np.setdiff1d(wanted, number), np.setdiff1d(number, wanted)
        if len(unknown):
            line = lines[int(np.flatnonzero(number == unknown[0])[0])]
            raise CaseError(
                f"{file}, line {line}: sector {unknown[0]:g}; {n_sectors} sectors have the numbers 0 to {n_sectors - 1}"
            )
        twice = next((s for s in wanted if (number == s).sum() > 1), None)
        which = [f"sector {twice} has two rows"] if twice is not None else []
        which += [f"sector {missing[0]} has no row ({len(missing)} in all)"] if len(missing) else []
        raise CaseError(f"{file}: {' and '.join(which)}; each of the {n_sectors} sectors of [cyclic] needs one")
    order = np.argsort(number)
    for name, values in table.items():
        if name != "load":
            _check(name, values[order], str(file), "a factor multiplies the value of the model")
    return {name: values[order] for name, values in table.items()}


def _check(name: str, factors: np.ndarray, where: str, advice: str) -> None:
    """Raise CaseError for a factor below 0, or for 0 if it must be positive.  Local."""
    worst = int(np.argmin(factors))
    if factors[worst] < 0.0 or (name in _POSITIVE and factors[worst] == 0.0):
        least = "above 0" if name in _POSITIVE else "at least 0"
        raise CaseError(
            f"{where} makes {name.replace('_', ' ')} of sector {worst} {factors[worst]:.3g} times that of the model; it must be "
            f"{least}: {advice}"
        )


def pairs_of_all_sectors(pairs: ContactPairs, n_nodes: int, cyclic: Cyclic, factors: SectorFactors, path: Path) -> ContactPairs:
    """Return the pairs of all sectors, sector after sector, at turned positions and with the values of the sector.  Local.

    Nodes are numbered as in :func:`~microslip.results.whole_disc.whole_mesh`, ``n_nodes`` per sector.

    Raises
    ------
    CaseError : a factor of a quantity that follows from the parameters of a law
    """
    N, n = cyclic.sectors, pairs.n_pairs
    of_pair = {name: np.repeat(getattr(factors, name), n) for name in _OF_PAIRS}
    other = [law for law in np.unique(pairs.laws) if law != ELASTIC_COULOMB]
    changed = [name for name in _OF_PAIRS if (of_pair[name] != 1.0).any()]
    if other and changed:
        raise CaseError(
            f"{path}: [cyclic]: sectors differ in {changed[0].replace('_', ' ')}, which follows from the parameters of "
            f'law = "{other[0]}"; take law = "{ELASTIC_COULOMB}", or factors of stiffness, density and load'
        )
    tiled: dict[str, Any] = {
        name: np.tile(values, (N,) + (1,) * (values.ndim - 1))
        for name in ContactPairs.__dataclass_fields__
        if isinstance(values := getattr(pairs, name), np.ndarray)
    }
    sector = np.repeat(np.arange(N), n)
    of_side_2 = (sector + tiled["next_sector"]) % N
    tiled["node1"] = np.where(tiled["node1"] < 0, -1, tiled["node1"] + n_nodes * sector)
    tiled["node2"] = np.where(tiled["node2"] < 0, -1, tiled["node2"] + n_nodes * of_side_2)
    turns = [rotation(cyclic.axis, s * cyclic.angle) for s in range(N)]
    tiled["position"] = np.concatenate([turned_about(pairs.position, turn, cyclic.axis_point) for turn in turns])
    tiled["frame"] = np.concatenate([pairs.frame @ turn.T for turn in turns])
    tiled["cells"] = np.concatenate([turned_about(pairs.cells, turn, cyclic.axis_point) for turn in turns])
    tiled["mu"] = tiled["mu"] * of_pair["friction"]
    stiffer = of_pair["contact_stiffness"]
    tiled["N0"] = tiled["N0"] * np.where(tiled["N0"] < 0.0, of_pair["gap"] * stiffer, of_pair["preload"])
    tiled |= {name: tiled[name] * stiffer for name in ("k_t", "k_n")}
    by_y = {"mu_y": of_pair["friction"], "k_ty": stiffer}
    columns = {name: np.tile(values, N) * by_y.get(name, 1.0) for name, values in pairs.law_columns.items()}
    lead = cyclic.wave_number * cyclic.angle * sector  # phase of the wave: equal sectors start as in a single-sector model
    columns["start"] = np.nan_to_num(columns.get("start", np.zeros(N * n))) - lead
    faces = tuple(face + s * n for s in range(N) for face in pairs.faces)
    return replace(pairs, joint=pairs.joint * N, faces=faces, weights1=None, weights2=None, law_columns=columns, **tiled)
