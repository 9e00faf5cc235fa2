"""Show the drives of a subcommand in a browser during the drive (--page), with a separate page process."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import print_message
from baqueano.diagnostics import note
from baqueano.errors import UsageError
from baqueano.messages.language import process_environment

if TYPE_CHECKING:
    from baqueano.cli.page.drive_door import DriveDoor
    from baqueano.vehicle_file.file import VehicleFile

START_TIMEOUT_S = 30.0  # a busy laptop starts Python
CONNECT_TIMEOUT_S = 5.0  # a browser, if a tab was opened
END_TIMEOUT_S = 3.0  # the page, once its drives are over

page_flag = click.option(
    "--page", "show_page", is_flag=True, help="Show both runs in a browser, side by side."
)
page = options.combine_options(
    click.option("--page", "show_page", is_flag=True, help="Show the drive in a browser while it happens."),
    click.option(
        "--pace", type=numbers.pace, default=1.0, show_default=True,
        help="Simulated seconds per real second (with --page).",
    ),
)  # fmt: skip


class LivePage:
    """A page process, and the door that sends the drives to it."""

    def __init__(self, door: "DriveDoor", program: "subprocess.Popen[bytes]") -> None:
        self.door, self._program = door, program

    @property
    def is_running(self) -> bool:
        """Return True while the page process runs."""
        return self._program.poll() is None

    def wait_for_hand(self) -> None:
        """Wait until a person takes the lease on the page and begins to drive."""
        print_message(note("cli.page-waits"))
        self.door.wait_for_hand(lambda: self.is_running)


@contextmanager
def live_page(
    show_page: bool, robot: str, file: "VehicleFile", folder: str, pace: float = 1.0, is_manual: bool = False
) -> Iterator[LivePage | None]:
    """Open a page for the drives of a subcommand, and yield it; None if `show_page` is False.

    With a display, first wait up to CONNECT_TIMEOUT_S for a browser. The page always ends with the verb.
    """
    if not show_page:
        yield None
        return
    require_websockets()
    from baqueano.cli.page.drive_door import DriveDoor
    from baqueano.web.share import has_display

    kind = robot.partition(":")[0]
    Path(folder).mkdir(parents=True, exist_ok=True)
    door = DriveDoor(
        file, kind if kind in ("simulated", "emulated") else "real", Path(folder), pace, is_manual
    )
    program = subprocess.Popen(
        [sys.executable, "-m", "baqueano.cli.page.attached", folder], stdin=subprocess.PIPE,
        stdout=subprocess.PIPE, start_new_session=True,  # Ctrl-C is for the verb
        env=process_environment(),
    )  # fmt: skip
    try:
        _join(door, program)
        _wait(door.listens.is_set, START_TIMEOUT_S, program)
        if program.poll() is not None:
            print_message(note("cli.page-ended"))
        elif has_display():
            _wait(door.visited.is_set, CONNECT_TIMEOUT_S, program)
        yield LivePage(door, program)
    finally:
        door.close(note("cli.page-drive-ended", folder=folder))
        _end(program)


def show_both(run: Path, ghost: Path | None, folder: str) -> None:
    """Show a run, with another run as its ghost, until the last tab is closed or until Ctrl-C."""
    require_websockets()
    import asyncio

    from baqueano.web.run import PageOptions, show_runs

    names = tuple(str(path.resolve()) for path in (run, ghost) if path is not None)
    print_message(note("cli.page-replayed"))
    asyncio.run(show_runs(names, PageOptions(Path(folder)), print_message, lasting=False))


def require_websockets() -> None:
    """Raise UsageError if the library of the page, websockets, is missing."""
    if find_spec("websockets") is None:
        raise UsageError.of("web.no-websockets", "pip install websockets")


def _join(door: "DriveDoor", program: "subprocess.Popen[bytes]") -> None:
    from baqueano.door.pipes import forward_bytes

    assert program.stdin is not None
    assert program.stdout is not None
    own_socket, page_socket = socket.socketpair()
    threading.Thread(
        target=forward_bytes, args=(own_socket, program.stdout, program.stdin), name="page", daemon=True
    ).start()
    door.welcome(page_socket)


def _wait(condition: Callable[[], bool], timeout_s: float, program: "subprocess.Popen[bytes]") -> None:
    end_s = time.monotonic() + timeout_s
    while not condition() and program.poll() is None and time.monotonic() < end_s:
        time.sleep(0.02)


def _end(program: "subprocess.Popen[bytes]") -> None:
    """Wait until the process of the page ends. Kill it after END_TIMEOUT_S, or on Ctrl-C."""
    try:
        program.wait(END_TIMEOUT_S)
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        program.kill()
        program.wait()
    for pipe in (program.stdin, program.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
