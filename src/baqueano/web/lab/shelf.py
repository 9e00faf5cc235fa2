"""The runs of a folder for browsers: by words that only who may look has been given, never by a path.

A word is a keyed hash of the file's name: it cannot be guessed from outside, and holds as long as the process.
"""

import hashlib
import secrets
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from baqueano.errors import BaqueanoError
from baqueano.web.http import REPORT_POLICY, TYPES, Content
from baqueano.web.lab.handle import Lab

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

NEWEST = 200  # runs of a list


class Shelf:
    """A folder of runs, and those that were named beside it. The list is read, and reports are written, by a
    worker of its own, so that a run opens meanwhile."""

    def __init__(self, folder: Path, beside: tuple[Path, ...] = ()) -> None:
        self.folder, self._extra_runs = folder, beside
        self._key = secrets.token_bytes(32)
        self._lines: dict[str, JsonObject] = {}  # what is known of a run, by word
        self._press, self._pages = Lab(), TemporaryDirectory(prefix="baqueano-page-")

    def word(self, path: Path) -> str:
        """Return the word of a run."""
        return hashlib.blake2b(
            str(path).encode("utf-8", "surrogateescape"), key=self._key, digest_size=12
        ).hexdigest()

    def paths(self) -> dict[str, Path]:
        """Return the runs that are there, newest first, by word. Links lead nowhere."""
        candidates = [p for p in self.folder.glob("*.mcap") if p.is_file() and not p.is_symlink()]
        candidates = [p.resolve() for p in candidates if not p.name.startswith(".")]
        candidates.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        files = dict.fromkeys([*self._extra_runs, *candidates[:NEWEST]])
        return {self.word(path): path for path in files if path.is_file()}

    def runs(self) -> "list[JsonObject]":
        """Return a line for each run, as far as it is known."""
        return [self.line(path) for path in self.paths().values()]

    def line(self, path: Path) -> "JsonObject":
        """Return the line of a run, as far as it is known."""
        unread = {"kind": None, "when": None, "seconds": None, "laps": None, "report": True}
        word = self.word(path)
        return {"id": word, "name": path.stem} | unread | self._lines.get(word, {})

    async def read(self) -> "list[JsonObject]":
        """Return all lines, once the worker has read the runs."""
        paths = self.paths()
        reply, _ = await self._press.ask("runs", paths=[str(path) for path in paths.values()])
        self._lines = dict(zip(paths, reply["runs"], strict=True))
        return [self.line(path) for path in paths.values()]  # a run of meanwhile comes with the next list

    async def body(self, path: str) -> Content | None:
        """Return what stands at /run/WORD or /report/WORD; None where nothing does."""
        kind, _, word = path.removeprefix("/").partition("/")
        run_path = self.paths().get(word) if kind in ("run", "report") else None
        if run_path is None:
            return None
        if kind == "run":
            plain = (
                "".join(c for c in run_path.name if c.isascii() and (c.isalnum() or c in "._-")) or "run.mcap"
            )
            return Content(TYPES[".mcap"], run_path, download=plain)
        page = Path(self._pages.name) / f"{word}-{run_path.stat().st_mtime_ns}.html"
        if not page.exists():
            try:
                await self._press.ask("report", path=str(run_path), to=str(page))
            except BaqueanoError:
                return None
        return Content(TYPES[".html"], page, REPORT_POLICY)

    async def close(self) -> None:
        """End the worker, and remove the reports."""
        await self._press.close()
        self._pages.cleanup()
