"""Send the runs in the folder of a service to its clients."""

import base64
import threading
import time
from collections.abc import Callable
from pathlib import Path

from baqueano.contracts.values import JsonObject
from baqueano.door.clients import DoorClient
from baqueano.door.wire import encode
from baqueano.errors import Invalid
from baqueano.runs.folder import is_run_name

CHUNK_BYTES = 48 << 10  # bytes of a run in one message
LIST_LIFETIME_S = 0.2  # the list of runs is not read again within this time
MAX_FETCHES = 8  # transfers at the same time
FULL_QUEUE_PAUSE_S = 0.01


class RunFiles:
    """A sender of the runs in `folder`. Only the door's thread is allowed to call the methods; `ring` wakes it."""

    def __init__(self, folder: Path, ring: Callable[[], object]) -> None:
        self.folder, self._ring = folder, ring
        self._open_run: str | None = None  # the run that is being written
        self._list = b""
        self._last_check_s = float("-inf")
        self._fetches = threading.BoundedSemaphore(MAX_FETCHES)

    def invalidate(self, written_run: str | None) -> None:
        """Read the folder again at the next request; `written_run` names the run that is being written."""
        self._open_run, self._last_check_s = written_run, float("-inf")

    def list(self) -> bytes:
        """Return the names of the complete runs as an encoded message, which is at most LIST_LIFETIME_S old."""
        if time.monotonic() - self._last_check_s > LIST_LIFETIME_S:
            paths = (p.name for p in self.folder.glob("*.mcap") if not p.is_symlink())
            names = sorted(name for name in paths if is_run_name(name) and name != self._open_run)
            self._list, self._last_check_s = encode({"type": "runs", "runs": names}), time.monotonic()
        return self._list

    def head(self, name: str) -> JsonObject:
        """Return the first chunk of a run as a message. Raise Invalid if the run does not exist."""
        path = self._path(name)
        with path.open("rb") as run_file:
            data = run_file.read(CHUNK_BYTES)
            return _chunk(name, data, path.stat().st_size - len(data))

    def fetch(self, client: DoorClient, name: str, is_connected: Callable[[DoorClient], bool]) -> None:
        """Send a run in chunks to a client while `is_connected` returns True for it; the last chunk has `left` 0.

        A thread sends each chunk once few bytes wait for the client. Raise Invalid if the run does not exist, or if too
        many transfers are in progress. Raise OSError if the file cannot be opened.
        """
        path = self._path(name)
        if not self._fetches.acquire(blocking=False):
            raise Invalid.of("door.many-fetches", maximum=MAX_FETCHES)
        try:
            run_file = path.open("rb")
        except OSError:
            self._fetches.release()
            raise

        def pieces() -> None:
            with run_file:
                remaining_bytes, is_last = path.stat().st_size, False
                while not is_last and is_connected(client):
                    if client.pending_bytes > 4 * CHUNK_BYTES:
                        time.sleep(FULL_QUEUE_PAUSE_S)
                        continue
                    data = run_file.read(min(CHUNK_BYTES, remaining_bytes))
                    remaining_bytes = remaining_bytes - len(data) if data else 0
                    is_last = remaining_bytes == 0
                    client.enqueue(_chunk(name, data, remaining_bytes))
                    self._ring()

        def work() -> None:
            try:
                pieces()
            finally:
                self._fetches.release()

        threading.Thread(target=work, name="fetch", daemon=True).start()

    def _path(self, name: str) -> Path:
        """Return the path of a run. Raise Invalid if the run does not exist."""
        path = self.folder / name
        if not is_run_name(name) or path.is_symlink() or not path.is_file():
            raise Invalid.of("door.no-run", run=repr(name))
        return path


def _chunk(name: str, data: bytes, remaining_bytes: int) -> JsonObject:
    return {"type": "file", "run": name, "data": base64.b64encode(data).decode(), "left": remaining_bytes}
