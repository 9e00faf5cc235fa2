"""An emulated Uno in real time, behind a pty: a program opens it as /dev/ttyACM0.

A real Uno needs no processor of this machine. The emulated Uno requests the highest priority that the machine
permits. While the machine does not run it, its time stops. So its behaviour in its own time is correct on a busy
machine too. `loss_s` is the duration of these stops, in which a host may have judged it silent.
"""

import contextlib
import os
import pty
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from baqueano.robot.uno.codec import Decoder
from baqueano.robot.uno.frames import Drive
from tests.emulated.rig import Built
from tests.emulated.uno import EmulatedUno

STEP_S = 0.001
LATE_S = 0.02  # longest time between two steps; more is lost


class OnPty:
    """One Uno, its line and the thread in which it runs. Access `uno` only under `lock`."""

    def __init__(self, build: Built, **options) -> None:
        self.loss_s, self._arrival_s, self._decoder = 0.0, 0.0, Decoder()
        self.uno, self.lock = EmulatedUno(build, **options), threading.Lock()
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.path, self._slave = os.ttyname(slave), slave  # kept open: else a pty discards data
        self._done, self._begun = threading.Event(), time.monotonic() - self.uno.t_s
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def now_s(self) -> float:
        """Return the time of the Uno."""
        with self.lock:
            return self.uno.t_s

    def moving(self) -> bool:
        """Return True if a motor is driven at present."""
        with self.lock:
            return self.uno.moving

    def off_since(self) -> float:
        """Return the seconds for which both motors have been off."""
        with self.lock:
            return self.uno.t_s - self.uno.off_since()

    def off_after_s(self) -> float:
        """Return the time from the last command sent to the Uno until its motors were off, in its own time."""
        with self.lock:
            return self.uno.off_since() - self._arrival_s

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        self.uno.close()
        for fd in (self.master, self._slave):
            with contextlib.suppress(OSError):
                os.close(fd)

    def _live(self) -> None:
        with contextlib.suppress(AttributeError, OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        before = time.monotonic()
        while not self._done.wait(STEP_S):
            late_s = max(0.0, time.monotonic() - before - LATE_S)
            before, self.loss_s = time.monotonic(), self.loss_s + late_s
            self._begun += late_s
            with contextlib.suppress(BlockingIOError, OSError):
                data = os.read(self.master, 4096)
                with self.lock:
                    arrived_s = self.uno.write(data)
                if any(isinstance(frame.frame, Drive) for frame in self._decoder.feed(data)):
                    self._arrival_s = arrived_s
            with self.lock:
                self.uno.run_until(time.monotonic() - self._begun)
                out = self.uno.read()
            if out:
                with contextlib.suppress(BlockingIOError, OSError):
                    os.write(self.master, out)


@contextmanager
def on_pty(build: Built, **options) -> Iterator[OnPty]:
    """Run an Uno until the end of the block."""
    live = OnPty(build, **options)
    try:
        yield live
    finally:
        live.close()
