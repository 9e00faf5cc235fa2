"""An emulated `pinctrl` of Raspberry Pi OS, on two lines with a chip that was interrupted in mid-byte.

Written from its source (raspberrypi/utils, pinctrl.c and gpiochip_bcm2835.c), not from its callers: refusals, output
and exit codes. `set` exits with 0 even after a failure. An output receives its function before its level. A BCM2837
does not report pull and drive. The lines are stored in a file, named by PINCTRL_LINES. One recovery calls the program
25 times, so it imports only modules of the interpreter itself:

    bits      the bits that the chip sends at the next clocks; at a 0 it holds SDA. After the last it releases SDA
    is_scl_low  a chip holds SCL
    fault     the fault at some calls of a verb: "root" (refuses), "crash", "hang", "deaf" (does nothing and exits
              with 0)

A falling SCL moves the chip to its next bit; a START or STOP (SDA moves while SCL is high) ends its byte.
"""

import marshal
import os
import sys
import time

GPIO, NAMES = (2, 3), {"a0": {2: "SDA1", 3: "SCL1"}, "ip": "input", "op": "output"}
FUNCTIONS, LEVELS, PULLS = ("ip", "op", "a0", "a1", "a2", "a3", "a4", "a5"), ("dl", "dh"), ("pu", "pd", "pn")


def new(bits: list[int], is_scl_low: bool = False) -> dict:
    """Return the lines as the driver of the kernel leaves them."""
    return {
        "function": {"2": "a0", "3": "a0"}, "level": {"2": 0, "3": 0}, "bits": bits, "is_scl_low": is_scl_low,
        "fault": None, "clocks": 0, "calls": [], "driven_high": 0, "starts": 0, "stops": 0,
    }  # fmt: skip


def levels(lines: dict) -> tuple[int, int]:
    """SDA and SCL: high if neither side pulls the line low."""
    low_sides = [lines["function"][pin] == "op" and not lines["level"][pin] for pin in ("2", "3")]
    chip = [bool(lines["bits"]) and not lines["bits"][0], lines["is_scl_low"]]
    return int(not (low_sides[0] or chip[0])), int(not (low_sides[1] or chip[1]))


def change(lines: dict, pin: str, key: str, value: object) -> None:
    """Write one register and let the chip react to the changed lines."""
    sda, scl = levels(lines)
    lines[key][pin] = value
    lines["driven_high"] += any(lines["function"][p] == "op" and lines["level"][p] for p in ("2", "3"))
    now_sda, now_scl = levels(lines)
    if scl and now_scl and sda != now_sda:
        lines["bits"] = []
        lines["stops" if now_sda else "starts"] += 1
    if scl and not now_scl:
        lines["clocks"] += 1
        lines["bits"] = lines["bits"][1:]


def main(lines: dict, words: list[str]) -> int:
    """Run the command with these words and return its exit code."""
    verb, pins, *options = [*words, "", ""][: max(2, len(words))]
    fault, number = lines["fault"], sum(call[0] == verb for call in lines["calls"])
    if fault and fault["verb"] == verb and fault["after"] < number <= fault["after"] + fault["times"]:
        if fault["kind"] == "root":
            print("Must be root")
            return 255
        if fault["kind"] == "crash":
            os.abort()
        if fault["kind"] == "hang":
            time.sleep(600.0)
        return 0
    if verb not in ("get", "set"):
        print(f'Unknown command "{verb}"')
        return 1
    if not all(part.isdigit() for part in pins.split(",")):
        print("Need GPIO number to set" if verb == "set" and not pins else f'Unknown GPIO "{pins}"')
        return 1
    numbers = sorted({int(n) for n in pins.split(",")} & set(GPIO))
    if verb == "get":
        for n in numbers:
            print_states(lines, n)
        return 0
    if not options or not options[0]:
        print("Need a function or pull to set")
        return 1
    for option in options:
        if option not in (*FUNCTIONS, *LEVELS, *PULLS):
            print(f'Unknown argument "{option}"')
            return 1
    for n in numbers:
        put_pin(lines, str(n), options)
    return 0


def print_states(lines: dict, n: int) -> None:
    """Print the line of `get`."""
    function = lines["function"][str(n)]
    name = NAMES.get(function, "-")
    level = "hi" if levels(lines)[n - 2] else "lo"
    drive = "--" if function == "op" else "  "
    print(
        f"{n:2d}: {function:>2} {drive} -- | {level} // GPIO{n} = {name if isinstance(name, str) else name[n]}"
    )


def put_pin(lines: dict, pin: str, options: list[str]) -> None:
    """Set function, then level, as do_gpio_set does; pulls are weaker than a chip and have no effect here."""
    for option in options:
        if option in FUNCTIONS:
            change(lines, pin, "function", option)
    for option in options:
        if option in LEVELS:
            if lines["function"][pin] == "op":
                change(lines, pin, "level", LEVELS.index(option))
            else:
                print("Can't set pin value, not an output")


class Lines:
    """The two lines, for a test: an emulated bus is `held` as long as the object is true."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __bool__(self) -> bool:
        lines = self.read()
        return set(lines["function"].values()) != {"a0"} or levels(lines) != (1, 1)

    def read(self) -> dict:
        with open(self.path, "rb") as file:
            return marshal.load(file)

    def write(self, lines: dict) -> None:
        with open(part := f"{self.path}.part", "wb") as file:
            marshal.dump(lines, file)
        os.replace(part, self.path)

    def put(self, **values) -> None:
        """Change the lines from outside."""
        self.write({**self.read(), **values})

    def fails(self, kind: str, verb: str = "set", after: int = 0, times: int = 1) -> None:
        """Let this number of calls of the verb fail after `after` good calls."""
        self.put(fault={"kind": kind, "verb": verb, "after": after, "times": times})

    @property
    def given_back(self) -> bool:
        return set(self.read()["function"].values()) == {"a0"}


def on_path(folder, patches, bits: list[int], is_scl_low: bool = False) -> Lines:
    """Return two lines, and put a `pinctrl` that works on them in front of the path."""
    lines = Lines(str(folder / "lines"))
    lines.write(new(bits, is_scl_low))
    (folder / "bin").mkdir()
    program = folder / "bin" / "pinctrl"
    program.write_text(f'#!/bin/sh\nPINCTRL_LINES={lines.path} exec {sys.executable} -I -S {__file__} "$@"\n')
    program.chmod(0o755)
    patches.setenv("PATH", f"{folder / 'bin'}:{os.environ['PATH']}")
    return lines


if __name__ == "__main__":
    pin_file = Lines(os.environ["PINCTRL_LINES"])
    state = pin_file.read()
    state["calls"].append(sys.argv[1:])
    pin_file.write(state)
    code = main(state, sys.argv[1:])
    pin_file.write(state)
    sys.exit(code)
