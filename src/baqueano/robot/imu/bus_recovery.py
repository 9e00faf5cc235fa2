"""Free an I2C bus: a chip that was cut off in the middle of a byte holds SDA low until it receives the missing clocks.

    at most nine times, until SDA is high:  SCL low, SCL released, with SDA released                    (1)
    STOP:  SCL low, SDA low, SCL released, SDA released                                                 (2)

Source: UM10204 (the I2C specification) 3.1.16. SDA is also high if the chip sends a 1: then (2) fails and (1)
continues. At the ninth clock the host does not acknowledge, because SDA is released. That ends a read of every chip.

The kernel's driver of a Raspberry Pi (i2c-bcm2835) cannot do this. The command `pinctrl` of Raspberry Pi OS (package
raspi-utils) can do it, and the group gpio is allowed to use this command. The lines are open drain: each is driven low
or released, never driven high. (`pinctrl` makes a pin an output before it sets the level. The old level therefore stays
for less than a microsecond.) A recovery puts both pins back into I2C mode; if that fails, the next recovery repeats it.
A recovery takes some tenths of a second, so it must run only while the vehicle is at rest.
"""

import os
import re
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import RobotUnreachable
from baqueano.messages import text
from baqueano.messages.language import translate as _

BUS_NAME = "i2c-1"  # on the pins 3 and 5 of every Raspberry Pi
SDA, SCL, BOTH = "2", "3", "2,3"  # GPIO
I2C, OUTPUT_STATE = "a0", ("ip", "op")
LOW_STATE, RELEASED_STATE = ("op", "dl"), ("ip", "pu")
CLOCK_PULSES = 9
CALL_S, ALL_S = 1.0, 2.0  # time limits of one call, and of all calls before the pins return to I2C mode
RETRY_PERIOD_NS = 5_000_000_000
LINE_PATTERN = re.compile(r"^ *([23]): (\S\S) .*\| (hi|lo)\b", re.MULTILINE)


class RecoveryOutcome(NamedTuple):
    """The result of a recovery: `is_free` is True if the bus is free again, and `message` describes the outcome."""

    is_free: bool
    message: Diagnostic

    @property
    def text(self) -> str:
        """Return the message as a sentence in the current language."""
        return text(self.message)


class BusLine(NamedTuple):
    """The state of SDA or SCL: the function of its pin, and `is_high`, True if its level is high."""

    function: str
    is_high: bool


class BusRecovery:
    """A starter of bus recoveries at `path`: each runs in a separate thread, at least 5 s after the last start."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._thread: threading.Thread | None = None
        self._outcome: RecoveryOutcome | None = None
        self._next_ns = -(1 << 62)

    @property
    def is_running(self) -> bool:
        """Return True while a recovery runs. The pins might then not be in I2C mode, so a transfer must not begin."""
        return self._thread is not None and self._thread.is_alive()

    def begin(self, now_ns: int) -> None:
        """Begin a recovery, unless a recovery runs, or the last recovery began less than 5 s ago."""
        if not self.is_running and now_ns >= self._next_ns:
            self._next_ns = now_ns + RETRY_PERIOD_NS
            self._thread = threading.Thread(target=self._work, name="bus recovery")
            self._thread.start()

    def pop_outcome(self) -> RecoveryOutcome | None:
        """Return the outcome of the last recovery, once; None while a recovery runs, or without a new outcome."""
        if self.is_running:
            return None
        outcome, self._outcome = self._outcome, None
        return outcome

    def wait(self) -> None:
        """Wait until the running recovery, if any, has ended."""
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        # only this thread loses the real-time priority, which the service's ticks need
        with suppress(AttributeError, OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        self._outcome = recover_bus(self._path)


def recover_bus(path: str) -> RecoveryOutcome:
    """Free the bus at `path` with clock pulses if a chip holds SDA low, and return the outcome.

    A free bus is not clocked. Errors of the bus are part of the outcome and are not raised.
    """
    try:
        pins = _pins(path)
        sda, scl = pins.read_pins()
        foreign_mode = {sda.function, scl.function} != {I2C}
        if foreign_mode:
            pins.restore()
            sda, scl = pins.read_pins()
        if not scl.is_high:
            return RecoveryOutcome(is_free=False, message=note("bus.scl-held", Severity.WARNING))
        if sda.is_high and foreign_mode:
            return RecoveryOutcome(is_free=True, message=note("bus.pins-restored", Severity.WARNING))
        if sda.is_high:
            return RecoveryOutcome(is_free=False, message=note("bus.free", Severity.WARNING))
        try:
            return _send_clocks(pins)
        finally:
            pins.restore()
    except RobotUnreachable as error:
        return RecoveryOutcome(is_free=False, message=error.diagnostic)


def check_bus_recovery(path: str, model: Path) -> tuple[str, str, str]:
    """Check if this machine could clock the bus at `path` free; the file `model` contains the name of the machine.

    Return a verdict, a result and a remedy as text, as in doctor.py.
    """
    if not model.exists() or "Raspberry Pi" not in model.read_text(encoding="utf-8"):
        return "unknown", _("this machine is not a Raspberry Pi"), ""
    try:
        sda, scl = _pins(path).read_pins()
    except RobotUnreachable as error:
        return "warn", _("a blocked bus could not be freed with clock pulses"), str(error)
    levels = _(
        "SDA {sda}, SCL {scl}",
        sda=_("high") if sda.is_high else _("low"),
        scl=_("high") if scl.is_high else _("low"),
    )
    if sda.function != I2C or scl.function != I2C:
        figure_text = _(
            "GPIO 2 is {sda} and GPIO 3 {scl}, expected {i2c}; {levels}",
            sda=sda.function,
            scl=scl.function,
            i2c=I2C,
            levels=levels,
        )
        return "warn", figure_text, _("Type: pinctrl set {both} {i2c}", both=BOTH, i2c=I2C)
    return "ok", _("pinctrl reaches GPIO 2 and 3; {levels}", levels=levels), ""


class _Pins:
    """The pins of SDA and SCL, set and read by calls of `program`.

    All methods raise RobotUnreachable if a call fails, or if the time limit of the whole recovery has passed.
    """

    def __init__(self, program: str) -> None:
        self._program, self._end_s = program, time.monotonic() + ALL_S

    def read_pins(self) -> tuple[BusLine, BusLine]:
        """Return the states of SDA and SCL."""
        reply = self._run_program("get", BOTH)
        lines = {
            number: BusLine(function, level == "hi")
            for number, function, level in LINE_PATTERN.findall(reply)
        }
        if len(lines) != 2:
            raise RobotUnreachable.of("bus.pinctrl-answer", pins=BOTH, value=repr(reply))
        return lines[SDA], lines[SCL]

    def set(self, pin: str, *options: str) -> None:
        """Set function, pull and level of a pin. Raise RobotUnreachable if `pinctrl` refuses the options."""
        # `pinctrl` reports a refusal as a message, and still exits with 0
        if refusal := self._run_program("set", pin, *options):
            raise RobotUnreachable.of(
                "bus.pinctrl-refused", pin=pin, options=" ".join(options), reply=refusal
            )

    def restore(self) -> None:
        """Put both pins back into I2C mode, in at most two attempts and without the time limit.

        Raise RobotUnreachable if both attempts fail.
        """
        self._end_s = float("inf")
        cause_text = ""
        for _try in range(2):
            try:
                self.set(BOTH, I2C)
                if all(line.function == I2C for line in self.read_pins()):
                    return
            except RobotUnreachable as error:
                cause_text = f" ({error})"
        raise RobotUnreachable.of("bus.pins-not-restored", f"pinctrl set {BOTH} {I2C}", cause=cause_text)

    def _run_program(self, *words: str) -> str:
        import subprocess  # imported here for a fast start of the service: a bus is rarely held

        command = " ".join(("pinctrl", *words))
        if time.monotonic() > self._end_s:
            raise RobotUnreachable.of("bus.too-late", f"pinctrl get {BOTH}", command=command, limit_s=ALL_S)
        try:
            process = subprocess.run(
                [self._program, *words], stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8",
                errors="replace", timeout=CALL_S
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise RobotUnreachable.of("bus.call-failed", command=command, error=error) from None
        if process.returncode:
            raise RobotUnreachable.of(
                "bus.call-refused",
                command=command,
                exit=process.returncode,
                reply=(process.stdout + process.stderr).strip(),
            )
        return process.stdout.strip("\n")


def _pins(path: str) -> _Pins:
    """Return the pins of the bus at `path`.

    Raise RobotUnreachable for another bus, if `pinctrl` is not installed, or if the pins have another function.
    """
    if Path(path).name != BUS_NAME:
        raise RobotUnreachable.of("bus.other-bus", path=path, bus=BUS_NAME)
    import shutil

    program = shutil.which("pinctrl")
    if program is None:
        raise RobotUnreachable(note("bus.no-pinctrl", Severity.ERROR, "sudo apt install raspi-utils"))
    pins = _Pins(program)
    sda, scl = pins.read_pins()
    if not {sda.function, scl.function} <= {I2C, *OUTPUT_STATE}:
        raise RobotUnreachable.of("bus.other-pins", sda=sda.function, scl=scl.function, expected=I2C)
    return pins


def _send_clocks(pins: _Pins) -> RecoveryOutcome:
    """Run (1) and (2), and return the outcome; the caller puts the pins back into I2C mode."""
    pins.set(BOTH, *RELEASED_STATE)
    for clock in range(1, CLOCK_PULSES + 1):
        pins.set(SCL, *LOW_STATE)
        pins.set(SCL, *RELEASED_STATE)
        sda, scl = pins.read_pins()
        if not scl.is_high:
            return RecoveryOutcome(
                is_free=False, message=note("bus.scl-held-later", Severity.WARNING, clocks=clock)
            )
        if sda.is_high and _send_stop(pins):
            code = "bus.freed-at-once" if clock == 1 else "bus.freed"
            return RecoveryOutcome(is_free=True, message=note(code, Severity.WARNING, clocks=clock))
    return RecoveryOutcome(is_free=False, message=note("bus.sda-held", Severity.WARNING, clocks=CLOCK_PULSES))


def _send_stop(pins: _Pins) -> bool:
    """Send the STOP and return True if SDA rose.  (2)"""
    pins.set(SCL, *LOW_STATE)
    pins.set(SDA, *LOW_STATE)
    pins.set(SCL, *RELEASED_STATE)
    pins.set(SDA, *RELEASED_STATE)
    return pins.read_pins()[0].is_high
