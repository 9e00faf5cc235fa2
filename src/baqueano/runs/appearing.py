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
def write_then_appear(path: Path) -> Iterator[BinaryIO]:
    """Yield a stream to a temporary file, which is named `path` at the end. Raise FileError if `path` exists."""
    temporary_path = path.with_name(f".{uuid4().hex}.part")
    _remove(path)
    try:
        with temporary_path.open("xb") as file:
            yield file
        _give_name(temporary_path, path)
    finally:
        temporary_path.unlink(missing_ok=True)


def _give_name(temporary_path: Path, path: Path) -> None:
    """Give `temporary_path` the name `path` by a link, which fails if `path` exists. Without links on the file system,
    rename it."""
    try:
        os.link(temporary_path, path)
    except FileExistsError:
        _remove(path)
    except OSError:
        _remove(path)
        os.rename(temporary_path, path)


def _remove(path: Path) -> None:
    if os.path.lexists(path):
        raise FileError(fault("runs.file-there", f"mv {path} ELSEWHERE", path=path))
