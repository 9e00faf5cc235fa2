"""An Arduino Uno with the real firmware and its own clock: time advances only in `run_until`.

Times are true seconds since its power-up. With `ppm` its resonator has this error: the firmware then counts 16 MHz · (1
+ ppm·10⁻⁶) a second, and its baud rate has the same error.

simavr needs eleven bit times for a byte, the real chip ten, so bytes towards the firmware are 10 % late. A byte from
the firmware is available one byte time after it was written.
"""

import math
import random
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from baqueano.robot.uno.codec import Decoder, ReceivedFrame, encode
from baqueano.robot.uno.frames import (
    BAUD,
    AskInfo,
    Drive,
    DriveFlag,
    Driver,
    Frame,
    Info,
    ResetCause,
    Settings,
    State,
)
from tests.emulated.rig import Built

HZ = 16_000_000
BYTE_S = 11 / BAUD
BYTE, PIN, ADC_MV = range(3)
PORT_D = 3 << 3
ENCODER_PINS = ((2, 4), (3, 7))  # A, B of each plug
MARK_PIN = 5
DIVIDER = 3.0
TCCR0B = 0x45  # timer 0 runs from when it is set: the clock of the firmware
FLASH = 0x8000
IDLE_LOOP = 0x7000  # in flash that the firmware does not use
GRAY = (0b00, 0b01, 0b11, 0b10)  # B A, as a wheel turns forwards


class Terminal(NamedTuple):
    """The state of one motor output of the bridge."""

    state: str  # "drive", "brake", "coast"
    duty: float  # share of the supply, + for input 1


class Output(NamedTuple):
    """The state of the motor pins of both channels from `t_s` on."""

    t_s: float
    pwm: tuple[float, float]
    inputs: tuple[tuple[int, int], tuple[int, int]]
    standby: int

    def terminal(self, channel: int, driver: Driver) -> Terminal:
        """Return the motor output by the truth table of the driver; the pins are pulled down while the firmware does
        not drive them."""
        pwm, (in1, in2) = self.pwm[channel], self.inputs[channel]
        if driver == Driver.TB6612:
            if not self.standby:
                return Terminal("coast", 0.0)
            if in1 and in2:
                return Terminal("brake", 0.0)
            if in1 == in2:
                return Terminal("coast", 0.0)
            return Terminal("drive", (in1 - in2) * pwm) if pwm else Terminal("brake", 0.0)
        if not pwm:
            return Terminal("coast", 0.0)
        return Terminal("brake", 0.0) if in1 == in2 else Terminal("drive", (in1 - in2) * pwm)


class EmulatedUno:
    """One Uno.

    Args:
        built: what `rig.build` gave.
        ppm: how far its clock is off.
        battery_v: voltage before the divider.
        eeprom: the 1024 bytes it starts with; erased where none.
        driver: the bridge that is wired to it, for `duty`.
        boot_loader: an Intel hex file; a reset then goes to where it begins.
        flashed: False leaves the flash empty but for the boot-loader.

    Attributes:
        clock_began_s: when the clock of the firmware was 0, of the first boot.
    """

    def __init__(
        self,
        build: Built,
        *,
        ppm: float = 0.0,
        battery_v: float = 7.4,
        eeprom: bytes | None = None,
        driver: Driver = Driver.L298N,
        boot_loader: Path | None = None,
        flashed: bool = True,
    ) -> None:
        self.lib = build.library
        self.rig = self.lib.rig_new(None if boot_loader else str(build.elf).encode())
        assert self.rig, f"simavr does not read {build.elf}"
        self.hz = HZ * (1 + ppm * 1e-6)
        self.driver = driver
        self.seq = 0
        self.decoder = Decoder()
        self.transcript: list[tuple[float, ReceivedFrame]] = []
        self._line_free_s = 0.0
        self._read = 0
        self._gray = [0, 0]
        self.lib.rig_eeprom(self.rig, 0, eeprom or b"\xff" * 1024, 1024)
        self.set_battery(battery_v)
        self.clock_began_s = 0.0
        if boot_loader:
            chunks = [(place, data) for place, data in hex_chunks(boot_loader) if place + len(data) <= FLASH]
            program = hex_chunks(build.hex) if flashed else ()
            for place, data in (*program, *chunks):
                self.lib.rig_flash(self.rig, place, data, len(data))
            self.lib.rig_start_at(self.rig, min(place for place, _ in chunks))
            self.reset()
        else:
            while not self.ram(TCCR0B, 1)[0]:
                self.run(2e-6)
            self.clock_began_s = self.t_s
            self.run(1e-4)
            for plug in range(2):
                for pin in ENCODER_PINS[plug]:
                    self._put(PIN, PORT_D | pin, 0, self.t_s)
            self.set_mark(False)
            self.run_until(2e-3)

    def close(self) -> None:
        """Free the core. Nothing else may be called afterwards."""
        self.lib.rig_free(self.rig)

    # Time

    @property
    def t_s(self) -> float:
        return self.lib.rig_cycle(self.rig) / self.hz

    def run_until(self, t_s: float) -> None:
        """Run the core until this time; it ends at most one instruction later and never earlier."""
        end_code = self.lib.rig_run_until(self.rig, max(0, math.ceil(t_s * self.hz - 1e-6)))
        assert not end_code, f"the core stopped at {self.t_s:.6f} s, pc 0x{self.lib.rig_pc(self.rig):04x}"

    def run(self, dt_s: float) -> None:
        self.run_until(self.t_s + dt_s)

    # Bytes

    def write(self, data: bytes, at_s: float | None = None) -> float:
        """Put bytes on the wire from `at_s` (now) on, after earlier bytes; return the time at which the last byte
        arrives."""
        t_s = max(self._line_free_s, self.t_s if at_s is None else at_s)
        for byte in data:
            self._put(BYTE, 0, byte, t_s)
            t_s += BYTE_S
        self._line_free_s = t_s
        return t_s

    def read(self) -> bytes:
        """Return the bytes that arrived at the host and were not read yet."""
        return bytes(byte for _, byte in self.read_stamped())

    def read_stamped(self) -> list[tuple[float, int]]:
        """Return these bytes with the times at which they arrived."""
        n = self.lib.rig_outs(self.rig)
        if not n:
            return []
        out, now, frames = self.lib.rig_out(self.rig), self.t_s, []
        while self._read < n:
            arrival_s = out[self._read].cycle / self.hz + BYTE_S
            if arrival_s > now:
                return frames
            frames.append((arrival_s, out[self._read].byte))
            self._read += 1
        self.lib.rig_clear_out(self.rig)
        self._read = 0
        return frames

    # Frames

    def send(self, frame: Frame, seq: int | None = None, at_s: float | None = None) -> float:
        """Send a frame as the host does and return the time of its arrival."""
        if seq is None:
            self.seq = seq = (self.seq + 1) & 0xFF
        return self.write(encode(frame, seq), at_s)

    def frames(self) -> list[Frame]:
        """Return the frames that the firmware sent since the last call."""
        new: list[tuple[float, ReceivedFrame]] = []
        for t_s, byte in self.read_stamped():
            new += [(t_s, frame_received) for frame_received in self.decoder.feed(bytes([byte]))]
        self.transcript += new
        return [frame_received.frame for _, frame_received in new]

    def next_frame(self, kind: type, within_s: float = 0.05) -> Frame:
        """Run until the firmware sends a frame of this kind."""
        end = self.t_s + within_s
        while self.t_s < end:
            self.run(1e-3)
            for frame in reversed(self.frames()):
                if isinstance(frame, kind):
                    return frame
        raise AssertionError(f"no {kind.__name__} within {within_s} s")

    def store(self, **settings) -> None:
        """Store settings, and wait until the firmware confirms them."""
        self.send(Settings(**settings))
        assert self.next_frame(Settings, 0.5) == Settings(**settings)

    def state(self) -> State:
        """Return telemetry that was made after this call."""
        now = self.t_s
        while True:
            frame = self.next_frame(State, 0.3)
            if self.transcript[-1][0] > now + 46 * BYTE_S:
                return frame  # pyright: ignore[reportReturnType]

    def info(self) -> Info:
        """Request the Info frame now and return the answer."""
        self.run_until(self._line_free_s + 0.01)
        self.frames()
        self.send(AskInfo())
        return self.next_frame(Info)  # pyright: ignore[reportReturnType]

    def drive(self, left: int, right: int, flags: int = DriveFlag.ARM, ttl_10ms: int = 0, **send) -> float:
        """Send a command with the nonce of this session; the pins are read at once."""
        return self.send(Drive(self.nonce(), left, right, flags, ttl_10ms), **send)

    def nonce(self) -> int:
        if not any(isinstance(r.frame, State) for _, r in self.transcript):
            self.next_frame(State, 0.3)
        return next(r.frame.nonce for _, r in reversed(self.transcript) if isinstance(r.frame, State))

    def arm(self) -> None:
        self.next_frame(State, 0.3)
        self.run_until(self.drive(0, 0) + 1e-3)

    def hold(self, left: int, right: int, seconds: float, period_s: float = 0.02) -> None:
        """Arm with a zero command, then repeat a command."""
        self.arm()
        self.keep(left, right, seconds, period_s)

    def keep(self, left: int, right: int, seconds: float, period_s: float = 0.02) -> None:
        """Send one command again and again, as a host that computes it each time."""
        end = self.t_s + seconds
        while end - self.t_s > 1e-6:
            self.drive(left, right)
            self.run_until(min(self.t_s + period_s, end))

    # Pins

    def outputs(self) -> list[Output]:
        """Return all states of the motor pins since `forget_outputs`; the first entry is the state at that time."""
        n, levels = self.lib.rig_n_levels(self.rig), self.lib.rig_levels(self.rig)
        return [
            Output(
                level.cycle / self.hz,
                (level.pwm[0], level.pwm[1]) if level.driven else (0.0, 0.0),
                ((level.inputs[0][0], level.inputs[0][1]), (level.inputs[1][0], level.inputs[1][1])),
                level.standby,
            )
            for level in levels[:n]
        ]

    def forget_outputs(self) -> None:
        self.lib.rig_clear_levels(self.rig)

    def output(self) -> Output:
        """Return the present state of the motor pins."""
        n, levels = self.lib.rig_n_levels(self.rig), self.lib.rig_levels(self.rig)
        level = levels[n - 1]
        inputs = ((level.inputs[0][0], level.inputs[0][1]), (level.inputs[1][0], level.inputs[1][1]))
        return Output(
            level.cycle / self.hz,
            (level.pwm[0], level.pwm[1]) if level.driven else (0.0, 0.0),
            inputs,
            level.standby,
        )

    def duty(self, channel: int) -> float:
        """Return the present share of the supply at one motor."""
        return self.duties()[channel]

    def duties(self) -> list[float]:
        """Return the present shares of the supply at the two motors, by the truth table of the driver."""
        output = self.output()
        return [output.terminal(channel, self.driver).duty for channel in range(2)]

    @property
    def moving(self) -> bool:
        return any(self.duties())

    def first_time(self, condition: Callable[[Output], bool], after_s: float = 0.0) -> float | None:
        """Return the first time at which the outputs satisfy the condition."""
        return next((out.t_s for out in self.outputs() if out.t_s >= after_s and condition(out)), None)

    def off_since(self) -> float:
        """Return the time since which neither motor is driven."""
        assert not self.moving
        start_s = self.t_s
        for out in reversed(self.outputs()):
            if any(out.terminal(channel, self.driver).duty for channel in range(2)):
                return start_s
            start_s = out.t_s
        return start_s

    def set_battery(self, volts: float) -> None:
        self._put(ADC_MV, 0, round(volts / DIVIDER * 1000), self.t_s)

    def set_mark(self, high: bool, at_s: float | None = None) -> None:
        self._put(PIN, PORT_D | MARK_PIN, int(high), at_s)

    def encoder(self, plug: int, counts: int, start_s: float, end_s: float) -> None:
        """Simulate this number of quadrature counts (negative: backwards), evenly between two times."""
        for k in range(1, abs(counts) + 1):
            self._gray[plug] = (self._gray[plug] + (1 if counts > 0 else -1)) % 4
            now = GRAY[self._gray[plug]]
            at_s = start_s + k * (end_s - start_s) / abs(counts)
            for bit, pin in enumerate(ENCODER_PINS[plug]):
                self._put(PIN, PORT_D | pin, now >> bit & 1, at_s)

    def slots(self, plug: int, edges: int, start_s: float, end_s: float) -> None:
        """Simulate this number of edges of a slot disc on channel A, evenly between two times."""
        for k in range(1, edges + 1):
            self._gray[plug] ^= 1
            self._put(
                PIN, PORT_D | ENCODER_PINS[plug][0], self._gray[plug], start_s + k * (end_s - start_s) / edges
            )

    # Accidents

    def reset(self, cause: ResetCause = ResetCause.EXTERNAL) -> None:
        """Pull the reset pin or trigger the brown-out detector: RAM is preserved."""
        self.lib.rig_reset(self.rig, cause)

    def power_cycle(self, seed: int = 0) -> None:
        """Switch the supply off and on: RAM contains noise afterwards."""
        chance = random.Random(seed)
        self.lib.rig_ram(self.rig, 0x100, chance.randbytes(2048), 2048)
        self.lib.rig_reset(self.rig, ResetCause.POWER)

    def hang(self, interrupts: bool = True) -> None:
        """Set the program counter into an endless loop."""
        self.lib.rig_flash(self.rig, IDLE_LOOP, b"\0\0\xfe\xcf", 4)  # nop, and back to it
        if not interrupts:
            self.lib.rig_interrupts_off(self.rig)
        self.lib.rig_jump(self.rig, IDLE_LOOP)

    @property
    def resets(self) -> int:
        return self.lib.rig_resets(self.rig)

    def eeprom(self) -> bytes:
        memory = bytes(1024)
        self.lib.rig_eeprom_read(self.rig, 0, memory, 1024)
        return memory

    def flash(self, address: int, n: int) -> bytes:
        memory = bytes(n)
        self.lib.rig_flash_read(self.rig, address, memory, n)
        return memory

    def ram(self, address: int, n: int) -> bytes:
        memory = bytes(n)
        self.lib.rig_ram_read(self.rig, address, memory, n)
        return memory

    def _put(self, kind: int, place: int, value: int, at_s: float | None) -> None:
        cycle = round((self.t_s if at_s is None else at_s) * self.hz)
        self.lib.rig_put(self.rig, cycle, kind, place, value)


def hex_chunks(path: Path) -> Iterator[tuple[int, bytes]]:
    """Return (address, bytes) of each data record of an Intel hex file below 64 kB."""
    for line in path.read_text(encoding="ascii").split():
        record = bytes.fromhex(line[1:])
        assert sum(record) & 0xFF == 0, f"{path}: the sum of {line} is wrong"
        if record[3] == 0:
            yield int.from_bytes(record[1:3], "big"), record[4:-1]


def states(frames: Iterable[Frame]) -> list[State]:
    """Return the telemetry among these frames."""
    return [frame for frame in frames if isinstance(frame, State)]
