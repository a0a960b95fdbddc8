"""Measured tables replace the text between the markers of a page; the rest does not change."""

import pytest
from page_tables import put, table

PAGE = """# Title

Prose.

<!-- table: a -->
old
<!-- end -->

More prose.

<!-- table: b -->

| kept | 1 |

<!-- end -->
"""
MADE = """# Title

Prose.

<!-- table: a -->

| x | y |
| --- | ---: |
| \\1 | 2 |

<!-- end -->

More prose.

<!-- table: b -->

| kept | 1 |

<!-- end -->
"""


def test_a_table_replaces_the_text_between_its_markers(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    for _ in range(2):
        put(page, {"a": table(("x", "y"), [("\\1", "2")])})
        assert page.read_text() == MADE


def test_a_table_without_markers_is_rejected_and_nothing_is_written(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    with pytest.raises(ValueError, match="no markers <!-- table: c -->"):
        put(page, {"a": ["new"], "c": []})
    assert page.read_text() == PAGE


def test_without_a_page_only_the_tables_are_written(tmp_path):
    page = tmp_path / "docs" / "page.md"
    put(page, {"a": ["| 1 |"], "b": ["| 2 |"]})
    assert page.read_text().count("<!-- table: ") == 2 and "| 2 |" in page.read_text()
