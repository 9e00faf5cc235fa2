"""Write a file that appears complete or not at all, and never replaces an existing file or link."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from baqueano.diagnostics import fault
from baqueano.errors import FileError


@contextmanager
def appearing(path: Path) -> Iterator[BinaryIO]:
    """Yield a stream to a temporary file that is named `path` when it is complete. Raise FileError if `path` exists."""
    part = path.with_name(f".{uuid4().hex}.part")
    _free(path)
    try:
        with part.open("xb") as file:
            yield file
        _give_name(part, path)
    finally:
        part.unlink(missing_ok=True)


def _give_name(part: Path, path: Path) -> None:
    """Give `part` the name `path` by a link, which fails if `path` exists. Without links on the file system,
    rename it."""
    try:
        os.link(part, path)
    except FileExistsError:
        _free(path)
    except OSError:
        _free(path)
        os.rename(part, path)


def _free(path: Path) -> None:
    if os.path.lexists(path):
        raise FileError(fault("runs.file-there", f"mv {path} ELSEWHERE", path=path))
