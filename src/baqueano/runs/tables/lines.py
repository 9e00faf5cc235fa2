"""Read the lines of an external text file one at a time: UTF-8 with or without BOM, UTF-16 with BOM, gzip.

The size of the data must not exceed `memory_limit.limit_bytes`, so a packed file that would fill the memory is refused
early.
"""

import gzip
import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from baqueano.errors import FileError
from baqueano.runs.container import memory_limit

MAX_LINE_LETTERS = 2**20  # characters of a line
# bytes of memory of a cell in addition to its text, and of a row: numbers, times and derived data
CELL_BYTES, ROW_BYTES = 32, 64


class Lines:
    """The lines of a file from first to last; `number` is the number of the last line that was read."""

    def __init__(self, path: Path, encoding: str | None, label: str) -> None:
        self.path, self.encoding, self.label = path, encoding, label
        self.number = self.reserved_bytes = 0
        self.is_compressed = False

    def __iter__(self) -> Iterator[str]:
        try:
            with self.path.open("rb") as stream:
                self.max_bytes = memory_limit.limit_bytes(self.path.stat().st_size)
                self.is_compressed = stream.read(2) == b"\x1f\x8b"
                stream.seek(0)
                yield from self._decode(gzip.GzipFile(fileobj=stream) if self.is_compressed else stream)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise FileError.of("table.gzip", file=self.label, error=error) from error
        except OSError as error:
            raise FileError.of("table.not-read", file=self.label, error=error.strerror or error) from error

    def reserve_memory(self, size: int) -> None:
        """Add `size` bytes of memory. Raise FileError if the sum exceeds the limit of the file."""
        self.reserved_bytes += size
        if self.reserved_bytes > self.max_bytes:
            code, fix = (
                ("too-large", f"gunzip -k {self.path.name}") if self.is_compressed else ("too-long", "")
            )
            on_disk, size_text, limit_text = map(
                memory_limit.format_size, (self.path.stat().st_size, self.reserved_bytes, self.max_bytes)
            )
            raise FileError.of(
                f"table.{code}",
                fix,
                file=self.label,
                size=on_disk,
                memory=size_text,
                line=self.number,
                maximum=limit_text,
            )

    def _decode(self, stream: Any) -> Iterator[str]:
        encoding = self.encoding or self._format_name(stream.read(2000))
        stream.seek(0)
        buffer = io.BufferedReader(stream)
        try:
            text = io.TextIOWrapper(buffer, encoding)
        except LookupError:
            raise FileError.of("table.encoding", file=self.label, encoding=encoding) from None
        with text:
            try:
                while line := text.readline(MAX_LINE_LETTERS + 1):
                    self.number += 1
                    self._check(line)
                    yield line.removesuffix("\n")
            except UnicodeDecodeError as error:
                position = buffer.tell() - len(error.object) + error.start
                raise FileError.of(
                    "table.not-encoded", file=self.label, byte=position, encoding=encoding
                ) from None

    def _format_name(self, start: bytes) -> str:
        """Return the encoding of a file from its first bytes.
        Raise FileError if it is not text, or if its encoding is ambiguous.
        """
        zeros = start.count(0)
        if not start:
            raise FileError.of("table.empty", file=self.label)
        if start.startswith(b"PK\x03\x04"):
            raise FileError.of("table.zip", file=self.label)
        if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
            return "utf-16"
        if zeros and zeros < 200 and len(start) > 1000:
            raise FileError.of("table.zero-bytes", file=self.label)
        even_zeros, odd_zeros = start[::2].count(0), start[1::2].count(0)
        if max(even_zeros, odd_zeros) < 0.2 * len(start) or min(even_zeros, odd_zeros) > 0.1 * max(
            even_zeros, odd_zeros
        ):
            return "utf-8-sig"  # a line with zero bytes is reported later
        raise FileError.of(
            "table.utf-16", file=self.label, encoding="utf-16-le" if odd_zeros > even_zeros else "utf-16-be"
        )

    def _check(self, line: str) -> None:
        if "\0" in line:
            raise FileError.of("table.zero-bytes-in-line", file=self.label, line=self.number)
        if len(line) > MAX_LINE_LETTERS:
            raise FileError.of("table.long-line", file=self.label, line=self.number, maximum=MAX_LINE_LETTERS)
        self.reserve_memory(ROW_BYTES + len(line if line.isascii() else line.encode("utf-8", "replace")))
