"""Write a file that appears complete or not at all: a new file, or one that replaces an older file.

The content is written to a temporary file in the same folder. Its name is unique, so that two programs can write one
file at the same time; the last of them prevails.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from baqueano.errors import FileError


@contextmanager
def temporary_file(path: Path) -> Iterator[Path]:
    """Yield a unique path in the folder of `path`; a file that still has this name at the end is removed."""
    temporary_path = path.with_name(f".{uuid4().hex}.part")
    try:
        yield temporary_path
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(temporary_path)):  # None: of a write
            error.filename = str(path)  # the path that the user typed
        raise
    finally:
        with suppress(OSError):
            temporary_path.unlink(missing_ok=True)


@contextmanager
def write_then_appear(path: Path) -> Iterator[BinaryIO]:
    """Yield a stream to a temporary file, which is named `path` at the end. Raise FileError if `path` exists."""
    _refuse_existing(path)
    with temporary_file(path) as temporary_path:
        with temporary_path.open("xb") as file:
            yield file
        give_new_name(temporary_path, path)


def replace_file(path: Path, content: bytes | str) -> Path:
    """Write a file, text as UTF-8, and return its path. An older file is replaced, and its permissions are kept."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary_file(path) as temporary_path:
        with temporary_path.open("xb") as file:
            file.write(content.encode("utf-8") if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            os.chmod(temporary_path, path.stat().st_mode & 0o777)
        os.replace(temporary_path, path)
    return path


def give_new_name(temporary_path: Path, path: Path) -> None:
    """Give `temporary_path` the name `path` by a link, which fails if `path` exists. Without links on the file system,
    rename it."""
    try:
        os.link(temporary_path, path)
    except FileExistsError:
        _refuse_existing(path)
    except OSError:
        _refuse_existing(path)
        os.rename(temporary_path, path)


def _refuse_existing(path: Path) -> None:
    if os.path.lexists(path):
        raise FileError.of("runs.file-there", f"mv {path} ELSEWHERE", path=path)
