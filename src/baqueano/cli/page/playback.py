"""Play drives on a page after their simulation, while the work continues."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.cli.terminal import print_message
from baqueano.diagnostics import Diagnostic, note
from baqueano.messages.language import process_environment

if TYPE_CHECKING:
    from baqueano.tune import TuneResult

POINTS = 200  # of the curve of costs
SERVE_TIMEOUT_S = 20.0  # a busy laptop starts Python


class PlaybackPage:
    """A page process that shows the drives it receives. Data are dropped after the process has ended."""

    def __init__(self, program: "subprocess.Popen[bytes] | None") -> None:
        self._program = program

    def show(self, run: Path) -> None:
        """Show a run after the runs that were passed before."""
        self._send({"play": str(run.resolve())})

    def show_tuning(self, result: "TuneResult") -> None:
        """Show the decrease of the cost, and the gains before and after the tuning."""
        costs = list(accumulate(result.history[:, 1].tolist(), min))
        gains = [
            {"name": gain.name, "unit": gain.unit, "file_value": gain.file_value, "value": gain.value}
            for gain in result.gains
        ]
        costs_and_gains = {"cost": result.cost, "start_cost": result.cost_before, "gains": gains}
        self._send({"tuned": costs_and_gains | {"history": costs[:: max(1, len(costs) // POINTS)]}})

    def show_event(self, message: Diagnostic) -> None:
        """Show an event on the page."""
        self._send({"say": message.to_json()})

    def show_step(self, step: Diagnostic) -> None:
        """Show a step of the work on the page, until the next step and while no run is played."""
        self._send({"step": step.to_json()})

    def wait_until_served(self) -> None:
        """Wait until the page is served, or its process has ended, at most SERVE_TIMEOUT_S."""
        if self._program is not None and self._program.stdout is not None:
            reading = threading.Thread(target=self._program.stdout.readline, name="page", daemon=True)
            reading.start()
            reading.join(SERVE_TIMEOUT_S)

    def _send(self, word: dict[str, object]) -> None:
        if self._program is not None and self._program.stdin is not None:
            with suppress(OSError, ValueError):
                self._program.stdin.write(json.dumps(word).encode() + b"\n")
                self._program.stdin.flush()


@contextmanager
def run_with_page(folder: Path, show_page: bool | None, pace: float) -> Iterator[PlaybackPage]:
    """Open a page for the runs of `folder`, played at `pace`. At the end, wait until the viewers have seen them.

    With `show_page` None, the page opens if there is a display.
    """
    if show_page is None:
        show_page = _display()
    if not show_page:
        yield PlaybackPage(None)
        return
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "baqueano.web.lab.playback", str(folder), "--pace", str(pace)]
    program = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=process_environment()
    )
    try:
        yield PlaybackPage(program)
        assert program.stdin is not None
        program.stdin.close()
        if program.poll() is None:
            print_message(note("cli.motion"))
        with suppress(KeyboardInterrupt):
            program.wait()
    finally:
        with suppress(OSError):
            program.terminate()
        for pipe in (program.stdin, program.stdout):  # first, because the process reads its stdin to the end
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        program.wait()


def _display() -> bool:
    if find_spec("websockets") is None:
        return False
    from baqueano.web.share import has_display

    return has_display()
