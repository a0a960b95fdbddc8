"""Page headers of a listing: lines that Ansys prints at the top of each page, also within blocks.

1

 *** ANSYS - ENGINEERING ANALYSIS SYSTEM  RELEASE 2021 R2          21.2     ***
 Ansys Mechanical Enterprise
 00000000  VERSION=LINUX x64     10:52:24  SEP 13, 2021 CP=      1.766

 title of the model

Releases differ: MAPDL for ANSYS, a blank line after the product, "Elapsed Time=" for "CP=" (2026).
"""

import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial, wraps

from ...messages.errors import MeshError
from ...messages.words import counted, verb
from ..model import FileModel

# Every part is bounded: the time for a file is proportional to its size, for any content.
_BLANK, _LINE = rb"[ \t\f]{0,150}\r?\n", rb"[^\n]{0,150}\n"
_PAGE = re.compile(
    rb"^(?:\f?1?%(blank)s(?:%(blank)s){0,3})?"
    rb" {0,8}\*{3,9} [^\n]{0,60}\b(?:RELEASE|BUILD)\b[^\n*]{0,60}\*{3,9}%(blank)s"
    rb"(?:%(line)s){1,2}?[^\n]{0,60}\bVERSION=[^\n]{0,90}\b(?:CP|Elapsed Time) ?=%(line)s"
    rb"(?:(?:%(blank)s){1,3}%(line)s%(blank)s)?(?:%(blank)s){0,9}" % {b"blank": _BLANK, b"line": _LINE},
    re.MULTILINE,
)


def without_pages(read: Callable[[str], FileModel]) -> Callable[[str], FileModel]:
    """Return a reader that reads a file, or a copy of it without the page headers of a listing.  Local.

    The reader raises MeshError as ``read`` does; if there were headers, the message adds that lines are counted without them.
    """
    return wraps(read)(partial(_read_plain, read=read))


def _read_plain(path: str, read: Callable[[str], FileModel]) -> FileModel:
    """Return the result of ``read`` on a file without its page headers."""
    with open(path, "rb") as file:
        content = file.read()
    plain, n_pages = _PAGE.subn(b"", content) if b"VERSION=" in content else (content, 0)
    if not n_pages:
        return read(path)
    left_out = f"{counted(n_pages, 'page header')} of a listing {verb(n_pages, 'are')} left out, lines are counted without them"
    with tempfile.TemporaryDirectory() as folder:
        copy = os.path.join(folder, "copy" + os.path.splitext(path)[1])
        with open(copy, "wb") as file:
            file.write(plain)
        try:
            model = read(copy)
        except MeshError as problem:
            raise MeshError(f"{problem} ({left_out})") from None
    return replace(model, facts=(*model.facts, left_out))
