"""Offer the runs of a folder to browsers by keys and not by paths. Only browsers with a role receive the keys.

A key is a keyed hash of the path of the file. A key cannot be guessed, and is valid while the process runs.
"""

import hashlib
import secrets
from pathlib import Path
from tempfile import TemporaryDirectory

from baqueano.contracts.values import JsonObject
from baqueano.errors import BaqueanoError
from baqueano.web.http import CONTENT_TYPES, REPORT_POLICY, Content
from baqueano.web.lab.worker_client import WorkerClient

MAX_LISTED_RUNS = 200  # maximum number of runs in a list


class RunList:
    """The runs of a folder, and extra runs.

    A separate worker reads the list and writes the reports, so that a run can be opened at the same time.
    """

    def __init__(self, folder: Path, extra_paths: tuple[Path, ...] = ()) -> None:
        self.folder, self._extra_runs = folder, extra_paths
        self._key = secrets.token_bytes(32)
        self._lines: dict[str, JsonObject] = {}  # list entries by key
        self._report_client, self._pages = WorkerClient(), TemporaryDirectory(prefix="baqueano-page-")

    def run_key(self, path: Path) -> str:
        """Return the key of a run."""
        return hashlib.blake2b(
            str(path).encode("utf-8", "surrogateescape"), key=self._key, digest_size=12
        ).hexdigest()

    def paths(self) -> dict[str, Path]:
        """Return the paths of the existing runs by key: the extra runs, then the runs of the folder, newest first.

        Of the folder, only the MAX_LISTED_RUNS newest runs are included, without symbolic links and hidden files.
        """
        candidates = [p for p in self.folder.glob("*.mcap") if p.is_file() and not p.is_symlink()]
        candidates = [p.resolve() for p in candidates if not p.name.startswith(".")]
        candidates.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        files = dict.fromkeys([*self._extra_runs, *candidates[:MAX_LISTED_RUNS]])
        return {self.run_key(path): path for path in files if path.is_file()}

    def entries(self) -> list[JsonObject]:
        """Return the list entry of each run, with None for fields not yet read."""
        return [self.list_entry(path) for path in self.paths().values()]

    def list_entry(self, path: Path) -> JsonObject:
        """Return the list entry of a run, with None for fields not yet read."""
        unread = {"kind": None, "when": None, "seconds": None, "laps": None, "report": True}
        name = self.run_key(path)
        return {"id": name, "name": path.stem} | unread | self._lines.get(name, {})

    async def read_entries(self) -> list[JsonObject]:
        """Let the worker read all runs, and return their list entries."""
        paths = self.paths()
        reply, _ = await self._report_client.request("runs", paths=[str(path) for path in paths.values()])
        self._lines = dict(zip(paths, reply["runs"], strict=True))
        return [self.list_entry(path) for path in paths.values()]  # a run written in the meantime is unread

    async def content_at(self, path: str) -> Content | None:
        """Return the content of /run/KEY or /report/KEY; None if the run does not exist or its report fails."""
        kind, _, key = path.removeprefix("/").partition("/")
        run_path = self.paths().get(key) if kind in ("run", "report") else None
        if run_path is None:
            return None
        if kind == "run":
            text_content = (
                "".join(c for c in run_path.name if c.isascii() and (c.isalnum() or c in "._-")) or "run.mcap"
            )
            return Content(CONTENT_TYPES[".mcap"], run_path, download=text_content)
        page = Path(self._pages.name) / f"{key}-{run_path.stat().st_mtime_ns}.html"
        if not page.exists():
            try:
                await self._report_client.request("report", path=str(run_path), to=str(page))
            except BaqueanoError:
                return None
        return Content(CONTENT_TYPES[".html"], page, REPORT_POLICY)

    async def close(self) -> None:
        """End the worker, and remove the reports."""
        await self._report_client.close()
        self._pages.cleanup()
