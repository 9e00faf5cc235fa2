"""An emulated MPU-6050 on the bus: registers, FIFO, filter, clock, and faults.

Plain Python without the package and NumPy, because umockdev runs it in the interpreter of the system. Written from the
register map (RM-MPU-6000A 4.2) and not from the driver, so both contain the common numbers.

Time advances by `run_until(t_ns)`, or before each transfer if `now_ns` is given. The chip runs at 1 kHz of its clock.
Each channel passes a first-order lag and a pure delay with the total delay of the table in the map. The lag has the
width of the filter if this width permits the delay, otherwise the largest time constant that the delay permits.

These properties of the real chip cause errors in drivers:
- for 100 ms after a reset, writes are lost; for 30 ms after waking, the gyro is wrong;
- FIFO_RESET works only while FIFO_EN is 0; FIFO_R_W does not move the pointer; an empty FIFO repeats its last byte;
- a full FIFO loses its oldest bytes, and 1024 is not a multiple of 14;
- data registers change only between transfers; reading the high byte of FIFO_COUNT freezes it.
"""

import errno
import math
import random
from collections import deque
from collections.abc import Callable

STANDARD_GRAVITY = 9.80665
GYRO_LSB = (131.0, 65.5, 32.8, 16.4)
FILTERS = {  # setting: accel Hz, accel delay ms, gyro Hz, gyro delay ms
    0: (260, 0.0, 256, 0.98),
    1: (184, 2.0, 188, 1.9),
    2: (94, 3.0, 98, 2.8),
    3: (44, 4.9, 42, 4.8),
    4: (21, 8.5, 20, 8.3),
    5: (10, 13.8, 10, 13.4),
    6: (5, 19.0, 5, 18.6),
    7: (260, 0.0, 256, 0.98),
}
FILTERS_6500 = {
    0: (460, 1.0, 250, 0.97),
    1: (218.1, 1.88, 184, 2.9),
    2: (99, 2.88, 92, 3.9),
    3: (44.8, 4.88, 41, 5.9),
    4: (21.2, 8.87, 20, 9.9),
    5: (10.2, 16.83, 10, 17.85),
    6: (5.05, 32.48, 5, 33.48),
    7: (420, 1.0, 250, 0.97),
}
CLONES = {  # WHO_AM_I: (of the 6500's family, LSB per °C, °C at 0, bytes of FIFO)
    0x68: (False, 340.0, 36.53, 1024),
    0x70: (True, 333.87, 21.0, 512),
    0x98: (True, 326.8, 25.0, 512),
    0x72: (True, 333.87, 21.0, 512),
    0x75: (True, 333.87, 21.0, 512),
}
REST = ((0.0, 0.0, STANDARD_GRAVITY), (0.0, 0.0, 0.0))
# 400 µg/√Hz and 0.005 °/s/√Hz over the 500 Hz that 1 kHz shows
ACCEL_STD = 400e-6 * STANDARD_GRAVITY * math.sqrt(500.0)
GYRO_STD = math.radians(0.005) * math.sqrt(500.0)
Motion = Callable[[int], tuple[tuple[float, float, float], tuple[float, float, float]]]

SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG, ACCEL_CONFIG_2 = 0x19, 0x1A, 0x1B, 0x1C, 0x1D
FIFO_EN, INT_PIN_CFG, INT_ENABLE, INT_STATUS, DATA = 0x23, 0x37, 0x38, 0x3A, 0x3B
USER_CTRL, PWR_MGMT_1, PWR_MGMT_2, FIFO_COUNT, FIFO_R_W, WHO_AM_I = 0x6A, 0x6B, 0x6C, 0x72, 0x74, 0x75
READ_ONLY = {INT_STATUS, *range(DATA, 0x49), FIFO_COUNT, FIFO_COUNT + 1, WHO_AM_I}
RESET_NS, SETTLE_NS = 100_000_000, 30_000_000


class Channel:
    """One sensor axis behind the low-pass filter, at 1 kHz."""

    def __init__(self) -> None:
        self.y: float | None = None
        self.late: deque[float] = deque()
        self.set(256.0, 1.0)

    def set(self, width_hz: float, delay_ms: float) -> None:
        """Set a filter with this width and this delay at low frequencies."""
        lag_ms = min(1e3 / (2.0 * math.pi * width_hz), delay_ms)
        # y ← y + α (x - y) is late by (1 - α) / α steps at low frequencies
        self.alpha = 1.0 / (1.0 + lag_ms)
        rest_ms = delay_ms - lag_ms
        self.whole = int(rest_ms)
        self.part = rest_ms - self.whole
        self.late = deque(self.late, maxlen=self.whole + 2)  # newest first; a longer delay fills gradually

    def step(self, x: float) -> float:
        """Return the output of the filter 1 ms later."""
        delay, total, y = self.late, self.whole, self.y
        self.y = y = x if y is None else y + self.alpha * (x - y)
        delay.appendleft(y)
        if len(delay) < total + 2:
            return delay[-1]
        newer = delay[total]
        return newer + self.part * (delay[total + 1] - newer)


class MpuEmulator:
    """The emulated chip. `motion(t_ns)` returns specific force (3,) [m/s²] and rate (3,) [rad/s] in the axes of the
    chip."""

    def __init__(
        self,
        motion: Motion | None = None,
        *,
        who_am_i: int = 0x68,
        clock_ppm: float = 0.0,
        seed: int = 1,
        noise: float = 1.0,
        accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
        gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
        gyro_bias_per_c: float = 0.0,
        ambient_c: float = 25.0,
        self_test_error: float = 0.05,
        start_ns: int = 0,
        now_ns: Callable[[], int] | None = None,
    ) -> None:
        self.motion = motion or (lambda t_ns: REST)
        self.who_am_i = who_am_i
        self.is_6500, self.t_lsb, self.t_zero, self.fifo_bytes = CLONES.get(who_am_i, CLONES[0x70])
        self.period_ns = 1e6 / (1.0 + clock_ppm * 1e-6)
        self.noise = noise
        self.accel_bias, self.gyro_bias = accel_bias, gyro_bias
        self.gyro_bias_per_c, self.ambient_c = gyro_bias_per_c, ambient_c
        self.self_test_error = self_test_error
        self.now_ns = now_ns
        self.t_ns = start_ns
        self.next_ns = float(start_ns)
        self.random = random.Random(seed)
        self.taken: list[int] = []  # when each sample was taken, ns; a test's truth
        self.is_frozen = False
        self.saturated: dict[int, int] = {}  # channel 0..5 → raw value
        self.lost_writes = 0
        self.power_on()

    # set by a test

    def power_on(self) -> None:
        """Set the state after power-on: default registers, asleep."""
        self.regs = bytearray(128)
        self.regs[PWR_MGMT_1] = 0x40
        self.regs[WHO_AM_I] = self.who_am_i
        self._trim()
        self.fifo: deque[int] = deque()
        self.last_byte = 0
        self.pointer = 0
        self.count_latch = 0
        self.divided = 0
        self.on_since = self.t_ns
        self.awake_since: int | None = None
        self.busy_until = 0
        self.channels = [Channel() for _ in range(6)]
        self._set_filters()

    brown_out = power_on

    def freeze(self, on: bool = True) -> None:
        """Repeat the last values of the sensors; bus, clock and FIFO continue."""
        self.is_frozen = on

    def saturate(self, channel: int, raw: int = 32767) -> None:
        """Set a channel constant at `raw`: 0 to 2 are the accelerometer, 3 to 5 the gyro."""
        self.saturated[channel] = raw

    def feel(self, force: list[float], rate: list[float]) -> None:
        """Feel this specific force (3,) [m/s²] and rate (3,) [rad/s] from now on."""
        self.motion = lambda t_ns: (force, rate)

    @property
    def temperature_c(self) -> float:
        """Return the temperature: the chip warms by 6 °C above the air within 40 s."""
        return self.ambient_c + 6.0 * (1.0 - math.exp(-(self.t_ns - self.on_since) / 40e9))

    # the bus

    def transfer(self, messages: list[tuple[bool, bytes | int]]) -> list[bytes]:
        """Perform the messages of one combined transfer, (False, bytes written) or (True, byte count); return the
        bytes read."""
        if self.now_ns is not None:
            self.run_until(self.now_ns())
        answers = []
        for reads, payload in messages:
            if reads:
                answers.append(bytes(self._read() for _ in range(int(payload))))
            else:
                data = bytes(payload)  # type: ignore[arg-type]
                if data:
                    self.pointer = data[0] & 0x7F
                    for value in data[1:]:
                        self._write(value)
        return answers

    def _read(self) -> int:
        register = self.pointer
        if register == FIFO_R_W:
            if self.fifo:
                self.last_byte = self.fifo.popleft()
            return self.last_byte
        self.pointer = (register + 1) & 0x7F
        if register == FIFO_COUNT:
            self.count_latch = len(self.fifo)
            return self.count_latch >> 8
        if register == FIFO_COUNT + 1:
            return self.count_latch & 0xFF
        value = self.regs[register]
        if register == INT_STATUS or self.regs[INT_PIN_CFG] & 0x10:
            self.regs[INT_STATUS] = 0
        return value

    def _write(self, value: int) -> None:
        register = self.pointer
        if register != FIFO_R_W:
            self.pointer = (register + 1) & 0x7F
        if self.t_ns < self.busy_until:
            self.lost_writes += 1
            return
        if register in READ_ONLY or register <= 0x0C:
            return
        if register == PWR_MGMT_1 and value & 0x80:
            self.power_on()
            self.busy_until = self.t_ns + RESET_NS
            return
        if register == PWR_MGMT_1:
            was_asleep, sleeps = self.regs[PWR_MGMT_1] & 0x40, value & 0x40
            if was_asleep and not sleeps:
                self.awake_since = self.t_ns
        if register == USER_CTRL:
            if value & 0x04 and not value & 0x40:
                self.fifo.clear()
            value &= ~0x07
        self.regs[register] = value
        if register in (CONFIG, ACCEL_CONFIG_2):
            self._set_filters()

    def _set_filters(self) -> None:
        gyro = (FILTERS_6500 if self.is_6500 else FILTERS)[self.regs[CONFIG] & 7]
        accel = FILTERS_6500[self.regs[ACCEL_CONFIG_2] & 7] if self.is_6500 else gyro
        for number, channel in enumerate(self.channels):
            channel.set(*(accel[:2] if number < 3 else gyro[2:]))

    # the inside

    @property
    def interrupt(self) -> bool:
        """Return the level of the INT pin: high after an enabled event that has not been read."""
        return bool(self.regs[INT_STATUS] & self.regs[INT_ENABLE])

    def run_until(self, t_ns: int) -> None:
        """Advance to this time; a time in the past raises no error."""
        while self.next_ns <= t_ns:
            self.t_ns = int(self.next_ns)
            self.next_ns += self.period_ns
            if not self.regs[PWR_MGMT_1] & 0x40:
                self._millisecond()
        self.t_ns = max(self.t_ns, t_ns)

    def _millisecond(self) -> None:
        (a, b, c), (p, q, r) = self.motion(self.t_ns)
        (a_0, b_0, c_0), (p_0, q_0, r_0) = self.accel_bias, self.gyro_bias
        shift = self.gyro_bias_per_c and self.gyro_bias_per_c * (self.temperature_c - 25.0)
        if self.awake_since is not None and self.t_ns - self.awake_since < SETTLE_NS:
            shift += 0.35
        values = [a + a_0, b + b_0, c + c_0, p + p_0 + shift, q + q_0 + shift, r + r_0 + shift]
        if self.noise:
            accel_std, gyro_std = self.noise * ACCEL_STD, self.noise * GYRO_STD
            stds = (accel_std, accel_std, accel_std, gyro_std, gyro_std, gyro_std)
            values = [v + std * z for v, std, z in zip(values, stds, self._normal_numbers(), strict=True)]
        if self.regs[ACCEL_CONFIG] >> 5 | self.regs[GYRO_CONFIG] >> 5:
            values = [v + response for v, response in zip(values, self._self_test(), strict=True)]
        values = [channel.step(v) for channel, v in zip(self.channels, values, strict=True)]
        self.divided += 1
        if self.divided > self.regs[SMPLRT_DIV]:
            self.divided = 0
            self._sample(values)

    def _normal_numbers(self) -> list[float]:
        """Return six numbers, as `random.gauss` draws them in twice the time."""
        draw, numbers = self.random.random, []
        for _ in range(3):
            angle, radius = 2.0 * math.pi * draw(), math.sqrt(-2.0 * math.log(1.0 - draw()))
            numbers += [math.cos(angle) * radius, math.sin(angle) * radius]
        return numbers

    def _sample(self, values: list[float]) -> None:
        accel_lsb = 16384 >> (self.regs[ACCEL_CONFIG] >> 3 & 3)
        gyro_lsb = GYRO_LSB[self.regs[GYRO_CONFIG] >> 3 & 3]
        raw = [a / STANDARD_GRAVITY * accel_lsb for a in values[:3]]
        raw += [math.degrees(w) * gyro_lsb for w in values[3:]]
        words = [max(-32768, min(32767, round(x))) for x in raw]
        for channel, value in self.saturated.items():
            words[channel] = value
        words.insert(3, round((self.temperature_c - self.t_zero) * self.t_lsb))
        data = b"".join(word.to_bytes(2, "big", signed=True) for word in words)
        if not self.is_frozen:
            self.regs[DATA : DATA + 14] = data
        self.taken.append(self.t_ns)
        self.regs[INT_STATUS] |= 0x01
        if self.regs[USER_CTRL] & 0x40:
            self._push(bytes(self.regs[DATA : DATA + 14]))

    def _push(self, data: bytes) -> None:
        enabled_bits = self.regs[FIFO_EN]
        parts = [data[0:6] if enabled_bits & 0x08 else b"", data[6:8] if enabled_bits & 0x80 else b""]
        parts += [data[8 + 2 * n : 10 + 2 * n] if enabled_bits & (0x40 >> n) else b"" for n in range(3)]
        for byte in b"".join(parts):
            if len(self.fifo) >= self.fifo_bytes:
                self.fifo.popleft()
                self.regs[INT_STATUS] |= 0x10
            self.fifo.append(byte)

    # self-test

    def _trim(self) -> None:
        """Return the factory codes: XA 15, YA 16, ZA 14 and XG 17, YG 12, ZG 20, or 120 + n for the 6500 family."""
        self.codes = [120 + n for n in range(6)] if self.is_6500 else [15, 16, 14, 17, 12, 20]
        if self.is_6500:
            self.regs[0x0D:0x10] = bytes(self.codes[:3])
            self.regs[0x00:0x03] = bytes(self.codes[3:])
            return
        a, g = self.codes[:3], self.codes[3:]
        for n in range(3):
            self.regs[0x0D + n] = a[n] >> 2 << 5 | g[n]
        self.regs[0x10] = (a[0] & 3) << 4 | (a[1] & 3) << 2 | (a[2] & 3)

    def _self_test(self) -> list[float]:
        """Return the response of the test bits in m/s² and rad/s: the factory response times 1 + `self_test_error`."""
        accel_bits, gyro_bits = self.regs[ACCEL_CONFIG] >> 5, self.regs[GYRO_CONFIG] >> 5
        shifts = []
        for n in range(6):
            on = (accel_bits if n < 3 else gyro_bits) & (4 >> n % 3)
            shifts.append(self._response(n) * (1.0 + self.self_test_error) if on else 0.0)
        return shifts

    def _response(self, n: int) -> float:
        code = self.codes[n]
        if self.is_6500:
            lsb = 2620.0 * 1.01 ** (code - 1)
            return lsb / 16384.0 * STANDARD_GRAVITY if n < 3 else math.radians(lsb / 131.0)
        if n < 3:
            return 0.34 * (0.92 / 0.34) ** ((code - 1) / 30.0) * STANDARD_GRAVITY
        return math.radians(25.0 * 1.046 ** (code - 1)) * (-1.0 if n == 4 else 1.0)


class EmulatedBus:
    """/dev/i2c-N: an adapter with the rules of the Raspberry Pi, its devices, and its own faults."""

    def __init__(self, devices: dict[int, MpuEmulator], spend: Callable[[int], None] | None = None) -> None:
        self.devices = devices
        self.spend = spend  # receives the ns of each transfer, for a simulated clock
        self.bus_hz = 400_000.0
        self.timeout_ns = 1_000_000_000  # default of the kernel, until I2C_TIMEOUT
        self.sda_low = False  # SDA held low
        self.faults: deque[int] = deque()  # errno of the next transfers; 0 means success
        self.cut: int | None = None  # the next read ends with an error after so many bytes
        self.transfers = 0
        self.opened = 0

    def fail(self, code: int, times: int = 1) -> None:
        """Let the next `times` transfers fail with this errno: EREMOTEIO is a NACK on the Pi, EIO a stretched clock."""
        self.faults.extend([code] * times)

    def transfer(self, address: int, messages: list[tuple[bool, bytes | int]]) -> list[bytes]:
        """Return the bytes that one combined transfer reads; raise OSError like the kernel."""
        self.transfers += 1
        if any(reads for reads, _ in messages[:-1]):
            raise OSError(errno.EOPNOTSUPP, "i2c-bcm2835: only one read message, and that one last")
        if self.sda_low:
            self._spend(self.timeout_ns)
            raise OSError(errno.ETIMEDOUT, "Connection timed out")
        bytes_sent = sum(1 + (int(data) if reads else len(data)) for reads, data in messages)  # type: ignore[arg-type]
        fault = self.faults.popleft() if self.faults else 0
        if fault:
            self._spend(self.timeout_ns if fault == errno.ETIMEDOUT else int(9e9 / self.bus_hz))
            raise OSError(fault, "injected")
        if address not in self.devices:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        if self.cut is not None and messages[-1][0]:
            reads = (True, min(self.cut, int(messages[-1][1])))
            self.cut = None
            self.devices[address].transfer([*messages[:-1], reads])
            raise OSError(errno.EIO, "injected in the middle")
        answers = self.devices[address].transfer(messages)
        self._spend(int(9e9 * bytes_sent / self.bus_hz))
        return answers

    def control(self, request: int, value: int) -> None:
        """Accept I2C_TIMEOUT in units of 10 ms; other requests without data have no effect."""
        if request == 0x0702:
            self.timeout_ns = value * 10_000_000

    def _spend(self, ns: int) -> None:
        if self.spend is not None:
            self.spend(ns)
