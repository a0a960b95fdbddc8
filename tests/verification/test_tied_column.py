"""The script of the errors of a tie: nested meshes are exact, others have the error of docs/validation.md at the tie alone."""

import pytest
from verification.tied_column import column, pulled

pytestmark = pytest.mark.ranks(1)


def test_nested_meshes_of_linear_elements_are_exact():
    assert max(map(abs, pulled(column("hex8", (2, 2, 1), "hex8", (4, 4, 2))))) < 1e-12


def test_other_meshes_have_an_error_in_the_row_at_the_tie():
    at_tie, beyond, longer = pulled(column("hex8", (2, 2, 1), "hex8", (3, 3, 2)))
    assert at_tie == pytest.approx(0.12, abs=0.005)
    assert beyond < 0.1 * at_tie and 0.0 < longer < 5e-3
