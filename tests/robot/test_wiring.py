"""The drawn wiring matches the firmware and is readable: no wire overlaps another wire or runs under a part."""

import importlib
import re
import sys
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]
BOARD_H = (ROOT / "firmware/uno/board.h").read_text(encoding="utf-8")
BOARD_C = (ROOT / "firmware/uno/board.c").read_text(encoding="utf-8")


def load_wiring():
    """Return the module docs/wiring.py, which belongs to no package."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        return importlib.import_module("wiring")
    finally:
        sys.path.pop(0)


WIRING = load_wiring()
EITHER = pytest.mark.parametrize("bridge", WIRING.BRIDGES, ids=lambda bridge: bridge.title)
MACROS = {"pwm": "PWM", "direction 1": "INPUT1", "direction 2": "INPUT2", "standby": "STANDBY", "lamp": "LAMP",
          "mark": "MARK"}  # fmt: skip


def arduino(port_pin):
    """Return the name on the board: B1 → D9."""
    port, bit = port_pin[0], int(port_pin[1])
    return {"B": f"D{bit + 8}", "C": f"A{bit}", "D": f"D{bit}"}[port]


def of(name, channel=0):
    """Return the pin of the macro in board.c; if the macro chooses by the channel, channel 1 comes first."""
    line = re.search(rf"#define {MACROS[name]}\b(.*)", BOARD_C)[1]
    pins = [arduino(name) for name in re.findall(r"P([BCD]\d)\b", line)][::-1]
    assert len(pins) == (2 if "channel" in line else 1), line
    return pins[channel]


def drawing_of(bridge):
    """Return (kind, from, to, points) of each wire in the file."""
    tree = ElementTree.parse(ROOT / "docs" / bridge.file)
    for path in tree.iter("{http://www.w3.org/2000/svg}path"):
        if path.get("class") == "wire":
            numbers = [float(x) for x in re.findall(r"[\d.]+", path.get("d"))]
            points = list(zip(numbers[::2], numbers[1::2], strict=True))
            yield path.get("data-kind"), path.get("data-from"), path.get("data-to"), points


def ends_by_net(bridge):
    """Return the connections from each pin of the Uno, without resistors and supply."""
    pairs = [(a, b) for kind, a, b, _ in drawing_of(bridge) if kind not in {"ground", "five", "usb"}]
    return {a.removeprefix("Uno "): b for a, b in pairs if a.startswith("Uno ") and "10k" not in b}


@EITHER
def test_the_wiring_drawing_is_current(bridge):
    """To renew the drawings run python docs/wiring.py and look at both."""
    assert (ROOT / "docs" / bridge.file).read_text(encoding="utf-8") == WIRING.drawing(
        WIRING.pins(BOARD_H), bridge
    )


@EITHER
def test_the_motors_are_wired_to_the_firmware_pins(bridge):
    ends = ends_by_net(bridge)
    assert [ends[of("pwm", k)] for k in (0, 1)] == [f"bridge {name}" for name in bridge.pwm]
    inputs = [of(f"direction {pin_number}", channel) for channel in (0, 1) for pin_number in (1, 2)]
    assert [ends[pin] for pin in inputs] == [f"bridge {name}" for name in bridge.direction]
    assert ends.get(of("standby")) == (f"bridge {bridge.standby}" if bridge.standby else None)


@EITHER
def test_encoders_and_mark_sensor_are_wired_to_the_firmware_pins(bridge):
    ends = ends_by_net(bridge)
    order = re.search(r"A left, A right, B left, B right from (.*)\.", BOARD_C)[1].split(", ")
    assert [ends[pin] for pin in order] == [f"encoder, {s} {c}" for c in "AB" for s in ("left", "right")]
    assert ends[of("mark")] == "lap mark sensor OUT"


def test_the_pin_table_of_the_header_matches_the_firmware_code():
    pins = WIRING.pins(BOARD_H)
    assert pins.pwm == (of("pwm"), of("pwm", 1))
    assert pins.direction == tuple(
        of(f"direction {pin_number}", channel) for channel in (0, 1) for pin_number in (1, 2)
    )
    assert (pins.standby, pins.lamp, pins.mark) == (of("standby"), of("lamp"), of("mark"))
    channel = re.search(r"DIDR0 = _BV\(ADC(\d)D\)", BOARD_C)[1]
    assert pins.battery == f"A{channel}"


@EITHER
def test_fw3_pull_down_resistors_set_all_motor_pins_low_at_start(bridge):
    low_pins = {a for _, a, b, _ in drawing_of(bridge) if b.startswith("10k of")}
    assert low_pins == {
        f"Uno {pin}"
        for pin in (of("pwm"), of("pwm", 1), of("standby"))
        if bridge.standby or pin != of("standby")
    }


def test_a_firmware_header_without_its_pin_table_is_refused():
    with pytest.raises(ValueError, match=r"its table of pins has nothing like"):
        WIRING.pins(BOARD_H.replace("lap mark", "mark"))


def stretches(bridge):
    """Return the straight parts of all wires, each with the number of its wire."""
    for number, (_, _, _, points) in enumerate(drawing_of(bridge)):
        for a, b in pairwise(points):
            yield number, min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1])


@EITHER
def test_no_wire_overlaps_another_wire(bridge):
    """Wires may cross at right angles but not run along each other."""
    parts = list(stretches(bridge))
    for number, x0, y0, x1, y1 in parts:
        for second, u0, v0, u1, v1 in parts:
            distance = min(x1, u1) - max(x0, u0) + min(y1, v1) - max(y0, v0)
            same_line = (x0 == x1 == u0 == u1) or (y0 == y1 == v0 == v1)
            assert number == second or not same_line or distance <= 0.0, (x0, y0, x1, y1, u0, v0, u1, v1)


@EITHER
def test_no_wire_runs_under_a_part(bridge):
    tree = ElementTree.parse(ROOT / "docs" / bridge.file)
    rectangles = [
        tuple(float(part.get(key)) for key in ("x", "y", "width", "height"))
        for part in tree.iter("{http://www.w3.org/2000/svg}rect")
        if part.get("class") == "part" and float(part.get("width")) > 100
    ]
    assert len(rectangles) >= 8
    for _, x0, y0, x1, y1 in stretches(bridge):
        for x, y, w, h in rectangles:
            over = x0 < x + w - 1 and x1 > x + 1 and y0 < y + h - 1 and y1 > y + 1
            assert not over, (x0, y0, x1, y1, x, y, w, h)


@EITHER
def test_wire_labels_do_not_overlap(bridge):
    tree = ElementTree.parse(ROOT / "docs" / bridge.file)
    boxes = []
    for group in tree.iter("{http://www.w3.org/2000/svg}g"):
        rectangle = group.find("{http://www.w3.org/2000/svg}rect")
        if rectangle is not None:
            x, y, w, h = (float(rectangle.get(key)) for key in ("x", "y", "width", "height"))
            if group.get("transform"):
                x, y, w, h = x + w / 2 - h / 2, y + h / 2 - w / 2, h, w
            boxes.append((x, y, x + w, y + h))
    assert len(boxes) >= 20
    for k, (x0, y0, x1, y1) in enumerate(boxes):
        for u0, v0, u1, v1 in boxes[k + 1 :]:
            assert x0 >= u1 or u0 >= x1 or y0 >= v1 or v0 >= y1
