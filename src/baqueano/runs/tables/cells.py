"""Store a column of text in as much memory as in its file: one cell after the other, each followed by a zero byte.
A list of strings would need ten times as much memory.
"""

from collections.abc import Iterable, Iterator
from typing import Any, overload

import numpy as np

BLOCK_CELLS = 4096  # cells that are text at the same time


class Cells:
    """An immutable sequence of cells.

    >>> cells = Cells.of(["0.1", "", "ñ"])
    >>> cells[2], cells[:2], list(cells.select(np.array([0, 2])))
    ('ñ', ['0.1', ''], ['0.1', 'ñ'])
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.ends = np.flatnonzero(np.frombuffer(data, np.uint8) == 0) + 1  # of each cell, its zero included

    @classmethod
    def of(cls, cells: Iterable[str]) -> "Cells":
        """Return `cells` as Cells; a cell must not contain a zero byte."""
        return cells if isinstance(cells, Cells) else cls(pack(cells))

    def __len__(self) -> int:
        return len(self.ends)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self._cell_texts(range(len(self))[index], 1)[:-1].decode()

    def __iter__(self) -> Iterator[str]:
        for _, block in self.blocks():
            yield from block.decode().split("\0")

    def blocks(self) -> Iterator[tuple[slice, bytes]]:
        """Yield the rows of each block, and the block's cells separated by a zero byte."""
        for start in range(0, len(self), BLOCK_CELLS):
            piece = self._cell_texts(start, BLOCK_CELLS)
            yield slice(start, min(start + BLOCK_CELLS, len(self))), piece[:-1]

    def select(self, rows: np.ndarray) -> "Cells":
        """Return the cells of these rows; the row indices must increase."""
        if not len(rows):
            return Cells(b"")
        first, count = int(rows[0]), int(rows[-1] - rows[0]) + 1
        piece = self._cell_texts(first, count)
        if len(rows) == count:
            return Cells(piece)
        is_kept = np.zeros(count, dtype=bool)
        is_kept[rows - first] = True
        size = np.diff(self.ends[first : first + count], prepend=self._start(first))
        return Cells(np.frombuffer(piece, np.uint8)[np.repeat(is_kept, size)].tobytes())

    def _cell_texts(self, first: int, count: int) -> bytes:
        last = min(first + count, len(self)) - 1
        return self.data[self._start(first) : int(self.ends[last])]

    def _start(self, row: int) -> int:
        return int(self.ends[row - 1]) if row else 0


def pack(cells: Iterable[str]) -> bytes:
    """Return the bytes of cells, each followed by a zero byte."""
    return "".join([cell + "\0" for cell in cells]).encode()
