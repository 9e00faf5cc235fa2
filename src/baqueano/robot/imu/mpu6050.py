"""Read the MPU-6050 and the chips sold under its name, for a loop that must not wait.

    failure                    reaction                                            event
    transfer fails             repeated once, at once; not after a timeout         (counted)
    three calls fail           bus opened again, chip started again                restart
    chip lost its registers    detected within 1 s; started again                  forgot
    no data for 0.5 s          chip started again, then each second; one event     silent, back
    words repeat for 0.1 s     withheld, chip started again                        frozen
    axis saturated for 0.1 s   event                                               saturated
    FIFO full or out of step   emptied; its content is lost                        overflow
    bus held low               clocked free while the vehicle rests (`free_bus`)   held
    chip runs again                                                                started

The class `Mpu6050` describes timestamps and axes.
"""

import struct
import time
from collections.abc import Callable, Iterator

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import BaqueanoError, RobotUnreachable
from baqueano.messages.language import mark as N_
from baqueano.robot.imu.bus_recovery import BusRecovery, RecoveryOutcome, recover_bus
from baqueano.robot.imu.chips import Chip, accel_scale, gyro_scale, lookup_chip
from baqueano.robot.imu.i2c import I2cDevice, is_stuck_low
from baqueano.robot.imu.sample_clock import SampleClock
from baqueano.robot.imu.settings import MILLISECOND, SECOND, Counts, ImuEvent, ImuSettings, OpenedImu
from baqueano.robot.imu.watch import ImuWatch, Row
from baqueano.worlds.robot import Sample

SMPLRT_DIV, FIFO_EN, INT_PIN_CFG = 0x19, 0x23, 0x37
USER_CTRL, PWR_MGMT_1, FIFO_COUNT, FIFO_R_W, WHO_AM_I = 0x6A, 0x6B, 0x72, 0x74, 0x75
RESET, PLL_X, ALL_SENSORS, FIFO_ON, FIFO_RESET = 0x80, 0x01, 0xF8, 0x40, 0x04
RESET_MS, START_MS, RETRY_MS = 100, 60, 100
SAMPLE_BYTES = 14  # bytes of a sample: accelerometer, temperature, gyro
MAX_SAMPLES_PER_TRANSFER = 16  # samples in one transfer: 5 ms at 400 kHz
FIFO_MARGIN = 3  # samples; a FIFO with less free space than this might have lost samples
MAX_FAILURES = 3
MAX_MISSING_SAMPLES = 5  # missing samples after which the registers of the chip are checked
Batch = tuple[list[Row], list[int]]  # raw words and their times
EMPTY_BATCH: Batch = ([], [])
SAMPLE_LAYOUT = struct.Struct(">7h")


class Mpu6050:
    """A running IMU, made by `driver.open_imu`. `now_ns` is the host's clock, which all timestamps use.

    `read()` returns the samples since the last call without waiting. It makes a few short transfers, each within the
    timeout of i2c.py, and returns after a transfer that timed out. The chip is started step by step: a step that must
    wait is continued at a later call.

    The chip stores the samples in its FIFO, and their timestamps follow the chip's period (sample_clock.py). The INT
    pin is not needed; it pulses for each sample, for an oscilloscope.

    A timestamp is the time at which the chip sampled the output of its filter; the motion is older by `delay_s`. The
    samples are rotated by `ImuSettings.axes` from the chip's axes to body axes (x forward, y left, z up). The
    accelerometer measures the specific force: at rest on a level floor +g on z.
    """

    def __init__(
        self,
        device: I2cDevice,
        chip: Chip,
        settings: ImuSettings,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.device, self.chip, self.settings = device, chip, settings
        self.counts = Counts()
        self.identity: OpenedImu | None = None  # the findings of `driver.open_imu`
        self.clock = SampleClock(SECOND / settings.rate_hz)
        self._now_ns = now_ns
        chip_from_body = settings.body_from_chip().T
        self._accel = chip_from_body * accel_scale(settings.accel_range_g)
        self._gyro = chip_from_body * gyro_scale(settings.gyro_range_dps)
        self._watch = ImuWatch(settings, self.counts, now_ns())
        self._recovery = BusRecovery(device.path)
        self._steps: Iterator[int] | None = self._start_steps()
        self._closed = False
        self._start_reported = False  # the restart was reported, but not yet its end
        self._wait_until = 0
        self._check_at = 0
        self._failures = 0
        self._index = 0  # samples read since the FIFO was emptied
        self._residue = 0  # bytes in the FIFO before a read that failed
        self._incomplete_count = 0  # consecutive calls that found an incomplete sample

    @property
    def delay_s(self) -> tuple[float, float]:
        """Return the delays [s] of the filter: (accelerometer, gyro)."""
        band = self.chip.filter_bands[self.settings.filter]
        return band.accel_delay_s, band.gyro_delay_s

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate [Hz], measured by the host's clock."""
        return self.clock.rate_hz

    @property
    def is_running(self) -> bool:
        """Return True if the chip runs, False during a start or restart."""
        return self._steps is None

    @property
    def is_silent(self) -> bool:
        """Return True after 0.5 s without data; the motors must then stop."""
        return self._watch.silent

    @property
    def is_bus_stuck(self) -> bool:
        """Return True if the bus was stuck low at the last transfer."""
        return self._watch.bus_stuck

    @property
    def notes(self) -> tuple[Diagnostic | str, ...]:
        """Return the name of the chip and its warnings as messages for the beginning of a run, () if unknown."""
        identity = self.identity
        if identity is None:
            return ()
        return (
            note("imu.chip", chip=identity.chip, who_am_i=f"0x{identity.who_am_i:02X}"),
            *identity.warnings,
        )

    def events(self) -> list[ImuEvent]:
        """Return the events since the last call, in order."""
        return self._watch.pop_events()

    def free_bus(self) -> RecoveryOutcome | None:
        """Begin a recovery if the bus is stuck and data are missing. Return the outcome of the last recovery once.

        The vehicle must be at rest. A second thread executes the recovery. `read` returns an empty list meanwhile, and
        afterwards starts the chip.
        """
        if self.is_silent and self.is_bus_stuck:
            self._recovery.begin(self._now_ns())
        return self._recovery.pop_outcome()

    def start_again(self) -> None:
        """Start the chip again during the following reads; call this after a change of its registers."""
        self._restart(self._now_ns())

    def close(self) -> None:
        """Put the chip to sleep if it answers, and close the bus."""
        self._closed = True
        self._recovery.wait()
        try:
            self.device.write(PWR_MGMT_1, 0x40)
        except OSError:
            pass
        finally:
            self.device.close()

    def read(self) -> list[Sample]:
        """Return the samples since the last call, oldest first. Errors of the bus are counted and not raised."""
        if self._closed or self._recovery.is_running:
            return []
        now_ns = self._now_ns()
        rows, times = EMPTY_BATCH
        try:
            if self._advance_start(now_ns):
                rows, times = self._new_batch(now_ns)
                self._failures = 0
        except OSError as error:
            self._note_failure(now_ns, error)
        is_kept, is_broken = self._watch.check_rows(now_ns, rows)
        if is_broken and self._steps is None:
            self._restart(now_ns, is_quiet=self._watch.rounds > 1)
        return self._samples(rows, times, is_kept)

    def _samples(self, rows: list[Row], times: list[int], is_kept: list[bool]) -> list[Sample]:
        """Convert the raw words of the rows that `is_kept` selects, and return samples in SI units and body axes."""
        if not rows:
            return []
        raw_rows = np.array(rows, dtype=float)
        accel, gyro = raw_rows[:, :3] @ self._accel, raw_rows[:, 4:] @ self._gyro
        celsius = self.chip.celsius
        return [
            Sample(times[i], accel[i], gyro[i], celsius(row[3])) for i, row in enumerate(rows) if is_kept[i]
        ]

    def _new_batch(self, now_ns: int) -> Batch:
        """Return the new samples; try once more after an error, but not if the bus is stuck."""
        try:
            return self._check_and_read(now_ns)
        except OSError as error:
            if is_stuck_low(error):
                raise
            self.counts.retries += 1
            return self._check_and_read(now_ns)

    def _check_and_read(self, now_ns: int) -> Batch:
        """Return the new samples; once per second, check the registers of the chip first."""
        if now_ns >= self._check_at:
            if not self._has_settings(now_ns):
                return EMPTY_BATCH
            self._check_at = now_ns + SECOND
        return self._read_fifo(now_ns)

    def _read_fifo(self, now_ns: int) -> Batch:
        """Return at most `MAX_SAMPLES_PER_TRANSFER` samples from the FIFO; empty the FIFO if it is full or out of
        step."""
        before_ns = self._now_ns()
        count = int.from_bytes(self.device.read(FIFO_COUNT, 2), "big")
        after_ns = self._now_ns()
        sample_count, residue = divmod(count, SAMPLE_BYTES)
        self._incomplete_count = self._incomplete_count + 1 if residue else 0
        is_full = count > self.chip.fifo_bytes - FIFO_MARGIN * SAMPLE_BYTES
        is_misaligned = self._residue and (count < self._residue or (count - self._residue) % SAMPLE_BYTES)
        if is_full or is_misaligned or self._incomplete_count >= MAX_FAILURES:
            self._clear_fifo()
            self.counts.overflows += 1
            self._watch.record_event(
                now_ns, "imu.overflow", state=N_("full") if is_full else N_("out of step"), count=count
            )
            return EMPTY_BATCH
        if residue:
            return EMPTY_BATCH
        self.clock.add_reading(self._index + sample_count, before_ns, after_ns)
        if not sample_count:
            return self._empty_batch()
        read_count = min(sample_count, MAX_SAMPLES_PER_TRANSFER)
        self._residue = count
        data = self.device.read(FIFO_R_W, read_count * SAMPLE_BYTES)
        self._residue = 0
        times = self.clock.stamps(self._index + 1, read_count)
        self._index += read_count
        return list(SAMPLE_LAYOUT.iter_unpack(data)), times

    def _empty_batch(self) -> Batch:
        """Return an empty batch; after a long time without samples, let the next call check the registers."""
        self._check_at = min(
            self._check_at, self._watch.last_ns + MAX_MISSING_SAMPLES * SECOND // self.settings.rate_hz
        )
        return EMPTY_BATCH

    def _registers(self) -> tuple[int, ...]:
        """Return the expected contents of SMPLRT_DIV and of the following registers."""
        s = self.settings
        accel_filter = (s.filter,) if self.chip.has_own_accel_filter else ()
        return (s.divider, s.filter, s.gyro_bits, s.accel_bits, *accel_filter)

    def _has_settings(self, now_ns: int) -> bool:
        """Return True if the chip still has its settings; otherwise report the loss and restart the chip."""
        target = bytes(self._registers())
        registers = self.device.read(SMPLRT_DIV, len(target))
        control, power = self.device.read(USER_CTRL, 2)
        if registers == target and power == PLL_X and control & FIFO_ON:
            return True
        code = "imu.lost-supply" if power & 0x40 else "imu.lost-settings"
        self._watch.record_event(now_ns, code, power=power, value=registers.hex(), expected=target.hex())
        self._restart(now_ns, is_quiet=True)
        self._start_reported = True
        return False

    def _start_steps(self, reopen: bool = False) -> Iterator[int]:
        """Start the chip from any state; after each step, yield the time [ms] to wait before the next step."""
        if reopen:
            self.device.open()
            yield 0
        write = self.device.write
        write(PWR_MGMT_1, RESET)
        yield RESET_MS
        write(PWR_MGMT_1, PLL_X)
        yield 1
        write(SMPLRT_DIV, *self._registers())
        yield 0
        write(INT_PIN_CFG, 0x00, 0x01)  # a pulse on INT for each sample
        yield 0
        write(FIFO_EN, ALL_SENSORS)
        yield START_MS
        registers, target = self.device.read(SMPLRT_DIV, len(self._registers())), bytes(self._registers())
        if registers != target:
            raise RobotUnreachable.of("imu.settings-not-stored", value=registers.hex(), expected=target.hex())
        yield 0
        self._clear_fifo()

    def _clear_fifo(self) -> None:
        """Empty the FIFO and count samples from 0 again. FIFO_RESET is ignored while the FIFO is on."""
        self.device.write(USER_CTRL, FIFO_RESET)
        self.device.write(USER_CTRL, FIFO_ON)
        self.clock.restart()
        self._index = self._incomplete_count = self._residue = 0

    def _advance_start(self, now_ns: int) -> bool:
        """Return True if the chip runs; otherwise take a step of its start. After an error, plan a new start."""
        if self._steps is None:
            return True
        if now_ns < self._wait_until:
            return False
        try:
            wait_ms = next(self._steps)
            self._wait_until = self._now_ns() + wait_ms * MILLISECOND
        except StopIteration:
            self._steps, self._failures = None, 0
            if self._start_reported:
                self._watch.record_event(now_ns, "imu.started")
            self._start_reported = False
            self._check_at = now_ns + SECOND
        except (OSError, BaqueanoError) as error:
            self._steps = self._start_steps(reopen=True)
            self._wait_until = now_ns + RETRY_MS * MILLISECOND
            self._watch.record_failure(now_ns, error)
        return False

    def _note_failure(self, now_ns: int, error: OSError) -> None:
        """Count a failed call; after `MAX_FAILURES` in a row, restart the chip."""
        self.counts.failures += 1
        self._failures += 1
        self._watch.record_failure(now_ns, error)
        if self._failures >= MAX_FAILURES:
            self._restart(now_ns)

    def _restart(self, now_ns: int, is_quiet: bool = False) -> None:
        """Plan a restart: the following reads open the bus and start the chip step by step.

        `is_quiet` suppresses the event.
        """
        self.counts.restarts += 1
        self._steps = self._start_steps(reopen=True)
        self._wait_until = now_ns
        if not is_quiet:
            self._start_reported = True
            self._watch.record_event(now_ns, "imu.restart")


def find_chip(path: str, addresses: tuple[int, ...]) -> tuple[I2cDevice, int, tuple[str, ...]]:
    """Return the device that answers WHO_AM_I, its answer, and a sentence about the recovery of a stuck bus, if any.

    Raise RobotUnreachable if no device answers, even after a recovery.
    """
    outcome: RecoveryOutcome | None = None
    device, is_bus_stuck = _first_answer(path, addresses)
    if device is None and is_bus_stuck:
        outcome = recover_bus(path)
        if outcome.is_free:
            device, is_bus_stuck = _first_answer(path, addresses)
    if device is not None:
        return *device, () if outcome is None else (outcome.text,)
    if is_bus_stuck and outcome is not None:
        raise RobotUnreachable(note("imu.bus-unusable", Severity.ERROR, path=path, cause=outcome.message))
    addresses_text = " and ".join(f"0x{address:02X}" for address in addresses)
    raise RobotUnreachable.of("imu.no-answer", address_range=addresses_text, path=path)


def _first_answer(path: str, addresses: tuple[int, ...]) -> tuple[tuple[I2cDevice, int] | None, bool]:
    """Return (device, answer) of the first device that answers WHO_AM_I, or None; and True if the bus was stuck."""
    is_bus_stuck = False
    for address in addresses:
        device = I2cDevice(path, address)
        device.open()
        for _ in range(2):
            try:
                return (device, device.read(WHO_AM_I, 1)[0]), is_bus_stuck
            except OSError as error:
                is_bus_stuck = is_bus_stuck or is_stuck_low(error)
        device.close()
    return None, is_bus_stuck


def detect_chip(device: I2cDevice, who_am_i: int) -> Chip:
    """Return the chip with this answer in WHO_AM_I.

    Raise RobotUnreachable for 0x00 and 0xFF, which mean a bus without a chip.
    """
    if who_am_i in (0x00, 0xFF):
        raise RobotUnreachable.of("imu.no-chip", address=device.address, path=device.path, who_am_i=who_am_i)
    return lookup_chip(who_am_i)
