"""A file that appears whole, over no other: another one, and a link of that name, stay as they are."""

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
    """Gives what is to be written, under a name of its own until it is whole. FileError where `path` is taken."""
    part = path.with_name(f".{uuid4().hex}.part")
    _free(path)
    try:
        with part.open("xb") as file:
            yield file
        _give_name(part, path)
    finally:
        part.unlink(missing_ok=True)


def _give_name(part: Path, path: Path) -> None:
    """A link of its name, which as no rename fails where anything is; a file system without links has the rename."""
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
