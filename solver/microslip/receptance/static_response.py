"""The static response between pairs, outputs and loads: docs/theory.md, section 4."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .static_columns import StaticColumns


@dataclass(frozen=True, eq=False)
class StaticResponse:
    """K_L^-1 between pairs, outputs and loads; replicated, except ``G_static`` with the static columns."""

    G_static: StaticColumns  # of R K_L^-1 R^T, solved for on demand; rows of this rank's pairs
    du_static: np.ndarray  # (3 n_pairs, n_loads) R K_L^-1 f
    out_static: np.ndarray  # (n_outputs, n_loads) o K_L^-1 f
    out_R: np.ndarray  # (n_outputs, 3 n_pairs) o K_L^-1 R^T
    load_static: np.ndarray  # (n_loads, n_loads) f^T K_L^-1 f
    outputs_static: np.ndarray  # (n_outputs,) o K_L^-1 o^T of each output
    row_sums: np.ndarray | None = None  # (3 n_pairs,) of G_static with random signs [m/N]; None if not computed by solves

    def conjugated(self) -> StaticResponse:
        """Return the response of the complex conjugate stiffness; ``G_static`` is a view.  Local."""
        return StaticResponse(
            G_static=self.G_static.conjugated(),
            du_static=self.du_static.conj(),
            out_static=self.out_static.conj(),
            out_R=self.out_R.conj(),
            load_static=self.load_static.conj(),
            outputs_static=self.outputs_static.conj(),
            row_sums=None if self.row_sums is None else self.row_sums.conj(),
        )
