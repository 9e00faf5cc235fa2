"""The kernel's side of /dev/input/event* for other processes: umockdev hands their calls to emulated devices.

Runs in the Python of the system, which has the bindings (python3-gi), so it does not use the package. Its argument is
a JSON list of devices by their names in pad_kernel.py. It prints the root of the test bed as one line of JSON. Then it
executes lines of its input, each a JSON list, and answers each with a line of JSON:

    ["change", number, [kind, code, value], …]  ["plug", number, name]  ["unplug", number]  ["quit"]
    ["waiting", number]     number of events that were not read yet

A client sees the devices when it is started with UMOCKDEV_DIR=<root> and LD_PRELOAD=libumockdev-preload.so.0.
"""

import json
import sys
from pathlib import Path

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))
import pad_kernel  # noqa: E402


class Machine:
    """A machine with devices of evdev."""

    def __init__(self) -> None:
        self.bed, self.devices, self.handlers = UMockdev.Testbed.new(), {}, []

    def plug(self, number, name):
        """A device appears as /dev/input/eventN; a test bed takes each number once."""
        self.devices[number] = device = getattr(pad_kernel, name)()
        node = f"/dev/input/event{number}"
        self.bed.add_from_string(
            f"P: /devices/virtual/input/input{number}/event{number}\nN: input/event{number}\n"
            f"E: DEVNAME={node}\nE: SUBSYSTEM=input\nE: MAJOR=13\nE: MINOR={64 + number}\n"
        )
        handler = UMockdev.IoctlBase()
        handler.connect("handle-ioctl", answer_ioctl, lambda client: read_ioctl(device, client))
        handler.connect("handle-read", answer_ioctl, lambda client: read_device(device, client))
        self.bed.attach_ioctl(node, handler)
        self.handlers.append(handler)

    def unplug(self, number):
        """Unplug a device; a process that has it open receives ENODEV."""
        self.devices.pop(number).unplug()
        self.bed.detach_ioctl(f"/dev/input/event{number}")
        self.bed.remove_device(f"/sys/devices/virtual/input/input{number}/event{number}")
        Path(self.bed.get_root_dir(), "dev/input", f"event{number}").unlink()


def answer_ioctl(_handler, client, reply) -> bool:
    """One call; the emulator's OSError becomes the client's errno."""
    try:
        client.complete(reply(client), 0)
    except OSError as error:
        client.complete(-1, error.errno)
    return True


def read_ioctl(device, client) -> int:
    """An ioctl that reads."""
    size = client.get_request() >> 16 & 0x3FFF
    answer = device.ioctl(client.get_request())
    client.get_arg().resolve(0, size).update(0, answer)
    return len(answer)


def read_device(device, client) -> int:
    """A read."""
    room = client.get_arg()
    data = device.read(len(bytes(room.retrieve())))
    room.update(0, data)
    return len(data)


def main() -> None:
    machine, loop = Machine(), GLib.MainLoop()
    for number, name in enumerate(json.loads(sys.argv[1])):
        machine.plug(number, name)

    def order(_channel, _condition) -> bool:
        line = sys.stdin.readline()
        verb, *values = json.loads(line) if line else ["quit"]
        answer = None
        if verb == "quit":
            loop.quit()
        elif verb == "waiting":
            answer = len(machine.devices[values[0]].waiting)
        elif verb == "change":
            machine.devices[values[0]].change(*values[1:])
        else:
            getattr(machine, verb)(*values)
        print(json.dumps(answer), flush=True)
        return verb != "quit"

    GLib.io_add_watch(
        sys.stdin.fileno(), GLib.PRIORITY_DEFAULT, GLib.IOCondition.IN | GLib.IOCondition.HUP, order
    )
    print(json.dumps({"root": machine.bed.get_root_dir()}), flush=True)
    loop.run()


if __name__ == "__main__":
    main()
