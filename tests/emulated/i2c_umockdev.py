"""The kernel's side of /dev/i2c-1 for other processes: umockdev hands their ioctl calls to an emulated bus.

Runs in the Python of the system, which has the bindings (python3-gi), so it does not use the package. It prints the
root of the test bed as one line of JSON. Then it executes lines of its input, each a JSON list of a verb and arguments:

    ["fail", errno, times]  ["hold", true]  ["feel", [force, 3], [rate, 3]]  ["quit"]
    ["timeout"]  ["taken"]     asked; the answer is a line of JSON

A client sees the device when it is started with UMOCKDEV_DIR=<root> and LD_PRELOAD=libumockdev-preload.so.0.
"""

import errno
import json
import struct
import sys
import time
from pathlib import Path

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))
from mpu import EmulatedBus, MpuEmulator  # noqa: E402

I2C_RETRIES, I2C_TIMEOUT, I2C_SLAVE, I2C_SLAVE_FORCE, I2C_FUNCS = 0x701, 0x702, 0x703, 0x706, 0x705
I2C_RDWR, I2C_SMBUS = 0x707, 0x720
FUNC_I2C_AND_SMBUS = 0x0EFF0009
MESSAGE = struct.Struct("@HHH2xP")  # i2c_msg: address, flags, length, pointer
READS = 1


class Kernel:
    """Answer the ioctl calls of the clients."""

    def __init__(self, bus: EmulatedBus) -> None:
        self.bus = bus
        self.slave = 0x68

    def handle(self, _handler, client) -> bool:
        """Answer one call; an OSError of the emulator is sent to the client as its errno."""
        request, arg, count = client.get_request(), client.get_arg(), 0
        try:
            if request == I2C_FUNCS:
                arg.resolve(0, 8).update(0, struct.pack("@L", FUNC_I2C_AND_SMBUS))
            elif request in (I2C_SLAVE, I2C_SLAVE_FORCE):
                self.slave = word(arg)
            elif request in (I2C_RETRIES, I2C_TIMEOUT):
                self.bus.control(request, word(arg))
            elif request == I2C_RDWR:
                count = self.combined(arg)
            elif request == I2C_SMBUS:
                self.smbus(arg)
            else:
                raise OSError(errno.ENOTTY, "not emulated")
        except OSError as error:
            if error.errno == errno.ETIMEDOUT:
                time.sleep(self.bus.timeout_ns * 1e-9)
            client.complete(-1, error.errno)
            return True
        client.complete(count, 0)
        return True

    def combined(self, arg) -> int:
        """Perform I2C_RDWR and return the number of messages."""
        head = arg.resolve(0, 16)
        _, count = struct.unpack("@PI4x", bytes(head.retrieve()))
        array = head.resolve(0, MESSAGE.size * count)
        table = bytes(array.retrieve())
        messages, buffers, address = [], [], 0
        for n in range(count):
            address, flags, length, _ = MESSAGE.unpack_from(table, n * MESSAGE.size)
            data = array.resolve(n * MESSAGE.size + 8, length)
            if flags & READS:
                messages.append((True, length))
                buffers.append(data)
            else:
                messages.append((False, bytes(data.retrieve())))
        for buffer, answer in zip(buffers, self.bus.transfer(address, messages), strict=True):
            buffer.update(0, answer)
        return count

    def smbus(self, arg) -> None:
        """Perform I2C_SMBUS: quick (0), byte (1), byte data (2), I2C block (8)."""
        head = arg.resolve(0, 16)
        reads, command, size = struct.unpack_from("@BB2xI", bytes(head.retrieve()))
        if size == 0:
            self.bus.transfer(self.slave, [(False, b"")])
            return
        if size == 1 and not reads:
            self.bus.transfer(self.slave, [(False, bytes([command]))])
            return
        data = head.resolve(8, 34)
        word = bytes(data.retrieve())
        if size in (1, 2) and reads:
            messages = [(False, bytes([command])), (True, 1)] if size == 2 else [(True, 1)]
            data.update(0, self.bus.transfer(self.slave, messages)[0])
        elif size == 2:
            self.bus.transfer(self.slave, [(False, bytes([command, word[0]]))])
        elif size == 8 and reads:
            data.update(1, self.bus.transfer(self.slave, [(False, bytes([command])), (True, word[0])])[0])
        else:
            raise OSError(errno.EOPNOTSUPP, "not emulated")


def word(arg) -> int:
    """Return an argument that is a number and not a pointer."""
    return struct.unpack("@L", bytes(arg.retrieve()))[0]


def obey(loop, bus: EmulatedBus, chip: MpuEmulator, line: str) -> None:
    """Perform one order of the test and answer with one line."""
    verb, *values = json.loads(line)
    answer = None
    if verb == "quit":
        loop.quit()
    elif verb == "fail":
        bus.fail(*values)
    elif verb == "hold":
        bus.sda_low = values[0]
    elif verb == "timeout":
        answer = bus.timeout_ns
    elif verb == "taken":
        chip.run_until(time.monotonic_ns())
        answer = chip.taken
    elif verb == "feel":
        chip.run_until(time.monotonic_ns())
        chip.feel(*values)
    print(json.dumps(answer), flush=True)


def main() -> None:
    options = json.loads(sys.argv[1]) if len(sys.argv) > 1 else {}
    chip = MpuEmulator(now_ns=time.monotonic_ns, start_ns=time.monotonic_ns(), **options)
    bus = EmulatedBus({0x68: chip})
    bed = UMockdev.Testbed.new()
    bed.add_from_string(
        "P: /devices/i2c-1\nN: i2c-1\nE: DEVNAME=/dev/i2c-1\nE: SUBSYSTEM=i2c-dev\nE: MAJOR=89\nE: MINOR=1\n"
    )
    handler = UMockdev.IoctlBase()
    kernel = Kernel(bus)
    handler.connect("handle-ioctl", kernel.handle)
    bed.attach_ioctl("/dev/i2c-1", handler)
    loop = GLib.MainLoop()

    def order(channel, _condition) -> bool:
        line = sys.stdin.readline()
        if not line:
            loop.quit()
            return False
        obey(loop, bus, chip, line)
        return True

    GLib.io_add_watch(
        sys.stdin.fileno(), GLib.PRIORITY_DEFAULT, GLib.IOCondition.IN | GLib.IOCondition.HUP, order
    )
    print(json.dumps({"root": bed.get_root_dir()}), flush=True)
    loop.run()


if __name__ == "__main__":
    main()
