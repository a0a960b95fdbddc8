"""Calls of a sandbox in this process, for tests that replace a library."""

import io

from microslip.messages.errors import MicroslipError
from microslip.system import plain_data, sandbox


def in_process(monkeypatch):
    """Let :func:`sandbox.call` call in this process; results are serialised as between processes."""

    def call(function, *arguments, returns=(), **limits):
        try:
            value = function(*arguments)
        except MicroslipError:
            raise
        except Exception as problem:
            raise sandbox.LibraryError(f"{type(problem).__name__}: {problem}") from problem
        file = io.BytesIO()
        plain_data.write(file, value)
        file.seek(0)
        return plain_data.read(file, returns)

    monkeypatch.setattr(sandbox, "call", call)
