"""The kernel's side of /dev/i2c-N inside one process: smbus2's own ioctl calls reach an emulated bus.

Serves I2C_FUNCS, I2C_RDWR, I2C_SMBUS (bytes and blocks), I2C_SLAVE, I2C_TIMEOUT on the structures that smbus2 makes.
The device file is an empty one; only its descriptor counts.
"""

import ctypes
import os
from pathlib import Path

from tests.emulated.mpu import EmulatedBus, MpuEmulator

I2C_RETRIES, I2C_TIMEOUT, I2C_SLAVE, I2C_FUNCS, I2C_RDWR, I2C_SMBUS = 0x701, 0x702, 0x703, 0x705, 0x707, 0x720
FUNC_I2C_AND_SMBUS = 0x0EFF0009
READS = 1


class Clock:
    """A clock that advances during each sleep and each transfer."""

    def __init__(self) -> None:
        self.now = 1_000_000_000

    def now_ns(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)

    def spend(self, ns: int) -> None:
        self.now += ns


class Bench:
    """An emulated chip on an emulated bus behind `path`, with a simulated clock."""

    def __init__(self, monkeypatch, folder: Path, **chip) -> None:
        self.clock = Clock()
        self.chip = MpuEmulator(now_ns=self.clock.now_ns, start_ns=self.clock.now, **chip)
        self.bus = EmulatedBus({0x68: self.chip}, self.clock.spend)
        self.path = str(folder / "i2c-1")
        Path(self.path).touch()
        connect(monkeypatch, {self.path: self.bus})


def connect(monkeypatch, buses: dict[str, EmulatedBus]) -> None:
    """Let these buses answer ioctl calls on these files until the end of the test; other files are unchanged."""
    import fcntl

    import smbus2.smbus2

    slaves: dict[int, int] = {}
    by_file = {os.stat(path).st_ino: bus for path, bus in buses.items()}
    before = fcntl.ioctl

    def ioctl(fd: int, request: int, arg=0, *rest):
        bus = by_file.get(os.fstat(fd).st_ino)
        if bus is None:
            return before(fd, request, arg, *rest)
        if request == I2C_FUNCS:
            arg.value = FUNC_I2C_AND_SMBUS
        elif request == I2C_SLAVE:
            slaves[fd] = arg
        elif request == I2C_RDWR:
            _combined(bus, [arg.msgs[i] for i in range(arg.nmsgs)])
        elif request == I2C_SMBUS:
            _smbus(bus, slaves[fd], arg)
        else:
            bus.control(request, arg)
        return 0

    monkeypatch.setattr(smbus2.smbus2, "ioctl", ioctl)
    monkeypatch.setattr(fcntl, "ioctl", ioctl)


def _combined(bus: EmulatedBus, messages: list) -> None:
    parts = [(True, m.len) if m.flags & READS else (False, ctypes.string_at(m.buf, m.len)) for m in messages]
    answers = iter(bus.transfer(messages[0].addr, parts))
    for message in messages:
        if message.flags & READS:
            ctypes.memmove(message.buf, next(answers), message.len)


def _smbus(bus: EmulatedBus, address: int, arg) -> None:
    """Answer byte data (2) and I2C block (8)."""
    data = arg.data.contents
    if arg.size == 2 and arg.read_write:
        data.byte = bus.transfer(address, [(False, bytes([arg.command])), (True, 1)])[0][0]
    elif arg.size == 2:
        bus.transfer(address, [(False, bytes([arg.command, data.byte]))])
    elif arg.size == 8 and arg.read_write:
        count = data.block[0]
        data_read = bus.transfer(address, [(False, bytes([arg.command])), (True, count)])[0]
        data.block[1 : 1 + count] = list(data_read)
    else:
        raise OSError(95, "not emulated")


def loop(bench: Bench, imu, seconds: float, period_s: float = 0.01) -> list:
    """Read the IMU at regular times, as the onboard loop does, and return all samples."""
    samples, due, end = [], bench.clock.now, bench.clock.now + round(seconds * 1e9)
    while due < end:
        due += round(period_s * 1e9)
        bench.clock.now = max(bench.clock.now, due)
        samples += imu.read()
    return samples


def start(bench: Bench, **settings):
    """Return the started IMU of the bench, with the clock of the bench and without messages."""
    from baqueano.robot.imu import driver as imu
    from baqueano.robot.imu.settings import ImuSettings

    bench.printed = []
    return imu.open_imu(
        bench.path,
        settings=ImuSettings(**settings),
        notify=bench.printed.append,
        now_ns=bench.clock.now_ns,
        sleep=bench.clock.sleep,
    )
