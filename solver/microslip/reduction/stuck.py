"""What every method starts from: the stuck structure, its modes, and the static solutions that all of them share."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..assembly.system import System
from ..guards.memory import refuse_beyond
from ..linear.joint_springs import Linearised
from ..mesh.data import ContactPairs
from ..modes.constraint import RowSums, static_columns
from ..modes.eigen import Modes
from ..parallel.ownership import rows_of, split_evenly
from ..receptance.static_columns import BATCH, FROM_DISK, StaticColumns

_ASKED_FROM = 1e8  # bytes of columns from which memory is asked for before they are solved for
_FEWER = "fewer pairs slip at lower [response] levels; more ranks on more machines hold more of them"


@dataclass(frozen=True, eq=False)
class Statics:
    """The exact static response of pairs, outputs and loads; all but the last are attributes of a reduced structure."""

    pair_ranges: np.ndarray  # (size + 1,) rank r owns pairs pair_ranges[r]:pair_ranges[r + 1]
    G_static: StaticColumns  # of R K_L^-1 R^T, solved for on demand
    du_static: np.ndarray  # (3 n_pairs, n_loads) R K_L^-1 f
    out_static: np.ndarray  # (n_outputs, n_loads) o K_L^-1 f
    out_R: np.ndarray  # (n_outputs, 3 n_pairs) o K_L^-1 R^T
    load_static: np.ndarray  # (n_loads, n_loads) f^T K_L^-1 f
    outputs_static: np.ndarray  # (n_outputs,) o K_L^-1 o^T of each


@dataclass(frozen=True, eq=False)
class StuckStructure:
    """The structure with all pairs stuck, its lowest modes and its static response; ``kept`` is what was made of them."""

    linearised: Linearised
    pairs: ContactPairs
    statics: Statics
    modes: Modes
    kept: dict[Hashable, Any] = field(default_factory=dict, repr=False, kw_only=True)

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what ``make`` makes, made once for the same key.  Collective where ``make`` is."""
        if key not in self.kept:
            self.kept[key] = make()
        return self.kept[key]


def static_response(linearised: Linearised) -> Statics:
    """Return the static response: n_loads + n_outputs + 1 solves now, those of the pairs when they first leave sticking.

    Collective on the system's communicator.  The further solve is of random forces on all pairs: by it their columns are checked.
    """
    system = linearised.system
    n_rows, n_out, n_load = system.R.shape[0], system.outputs.shape[0], system.loads.shape[1]
    signs = np.random.default_rng(n_rows).choice([-1.0, 1.0], n_rows)
    forces = sp.hstack([system.loads, system.outputs.T, sp.csc_matrix(system.R.T @ signs).T], format="csc")
    static, of_signs = np.split(static_columns(linearised, seen_rows(system), forces), [n_load + n_out], axis=1)
    pair_ranges = split_evenly(n_rows // 3, system.comm.size)
    return Statics(
        pair_ranges=pair_ranges,
        G_static=pair_columns(linearised, pair_ranges, RowSums(signs, of_signs[:n_rows, 0])),
        du_static=static[:n_rows, :n_load].copy(),
        out_static=static[n_rows : n_rows + n_out, :n_load].copy(),
        out_R=static[:n_rows, n_load:].T.copy(),
        load_static=static[n_rows + n_out :, :n_load].copy(),
        outputs_static=np.diag(static[n_rows : n_rows + n_out, n_load:]).copy(),
    )


def seen_rows(system: System) -> sp.csr_matrix:
    """Return the rows that are seen of a motion: of pairs, outputs and loads."""
    return sp.vstack([system.R, system.outputs, system.loads.T], format="csr")


def pair_columns(linearised: Linearised, pair_ranges: np.ndarray, known: RowSums) -> StaticColumns:
    """Return the columns of R K_L^-1 R^T, to be solved for with the kept factor when they are needed.  Local.

    ``known`` are random sums of the rows of all of them.  Where there is no memory for them, that raises ResourceError on every
    rank.
    """
    R, comm = linearised.system.R, linearised.system.comm
    R_T, n_owned = R.T.tocsc(), int(pair_ranges[comm.rank + 1] - pair_ranges[comm.rank])

    def solve(pairs: np.ndarray) -> np.ndarray:
        chosen = rows_of(pairs)
        if 8.0 * len(chosen) * R.shape[0] > _ASKED_FROM:
            refuse_beyond(comm, 16.0 * len(chosen) * 3 * n_owned, f"static columns of {len(pairs)} more pairs", _FEWER)
        return static_columns(linearised, R, R_T[:, chosen], 3 * pair_ranges, known.of(chosen))

    batch = FROM_DISK if linearised.factor.info.get("out_of_core") else BATCH
    return StaticColumns(R.shape[0] // 3, n_owned, solve, batch)
