"""Run a command at a vehicle, and end it after Ctrl-C, a lost connection, or a failure of the user's laptop.

  ssh ends      only the command's stdin ends: without a terminal no signal arrives                             (1)
  Wi-Fi ends    sshd can wait for hours, so a heartbeat is written to the command's stdin each HEARTBEAT_PERIOD_S   (2)
  HUP, TERM     the terminal has hung up, or the machine is switched off                                        (3)

(1) applies only to a pipe or a socket, because /dev/null, a file or a terminal cannot be closed from the other end. (2)
applies after the first heartbeat. Each of (1) to (3) interrupts the command once, as Ctrl-C does, so that it can clean
up.
"""

import os
import select
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from baqueano.door.ssh import print_streams, read_limited
from baqueano.messages.language import translate as _

HEARTBEAT_PERIOD_S = 0.5
MAX_SILENCE_S = 2.0  # Wi-Fi is sometimes interrupted for half a second
POLL_PERIOD_S = 0.1
EXIT_TIMEOUT_S = 15.0  # time for the other end to clean up
STDIN = 0


def command_output(command: list[str]) -> tuple[bytes, int]:
    """Run a program, and return its stdout and its exit code; show its stderr as it arrives.

    During this time heartbeats are written to its stdin. Ctrl-C ends the heartbeats and waits up to EXIT_TIMEOUT_S
    for the program, so that its last messages are shown. A second Ctrl-C ends the wait.
    """
    program = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0,
        preexec_fn=_ignore_ctrl_c if os.name == "posix" else None,
    )  # fmt: skip
    assert program.stdin is not None
    assert program.stdout is not None
    assert program.stderr is not None
    is_over, beats = threading.Event(), program.stdin

    def beat() -> None:
        with suppress(OSError):
            while not is_over.wait(HEARTBEAT_PERIOD_S):
                beats.write(b"\n")

    beat_thread = threading.Thread(target=beat, name="sign of life", daemon=True)
    beat_thread.start()
    with program, print_streams((program.stderr, sys.stderr)):
        try:
            return read_limited(program.stdout), program.wait()
        except KeyboardInterrupt:
            is_over.set()
            beat_thread.join()
            beats.close()
            with suppress(subprocess.TimeoutExpired):
                program.wait(EXIT_TIMEOUT_S)
            raise
        finally:
            is_over.set()
            beat_thread.join()
            program.kill()
            program.wait()


def _ignore_ctrl_c() -> None:
    """Ignore Ctrl-C in the child process; otherwise ssh ends at once, and the remote command cannot clean up."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def interrupt_on_hangup(notify: Callable[[str], object]) -> Iterator[None]:
    """Raise KeyboardInterrupt in the body once the connection to the user is lost; only in the main thread, on Unix."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "SIGHUP"):
        yield
        return
    is_over = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        for signal_number in previous_handlers:
            signal.signal(signal_number, signal.SIG_IGN)
        raise KeyboardInterrupt

    def poll() -> None:
        if _is_silent(is_over):
            notify(_("the connection to the user was lost: this command ends"))
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGHUP)

    previous_handlers = {
        number: signal.signal(number, interrupt) for number in (signal.SIGHUP, signal.SIGTERM)
    }
    poll_thread = threading.Thread(target=poll, name="requester", daemon=True)
    poll_thread.start()
    try:
        yield
    finally:
        is_over.set()
        poll_thread.join()
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)


def _is_silent(is_over: threading.Event) -> bool:
    """Wait until stdin or its heartbeats end, and return True; return False if `is_over` is set first.  (1), (2)

    Return False at once if stdin cannot be closed from its other end.
    """
    try:
        mode = os.fstat(STDIN).st_mode
    except OSError:
        return False
    if not stat.S_ISFIFO(mode) and not stat.S_ISSOCK(mode):
        return False
    last_beat_s = float("inf")
    while not is_over.is_set():
        if select.select([STDIN], [], [], POLL_PERIOD_S)[0]:
            if not os.read(STDIN, 4096):
                return True
            last_beat_s = time.monotonic()
        elif time.monotonic() - last_beat_s > MAX_SILENCE_S:
            return True
    return False
