"""Draws the wiring of the vehicle: `python docs/wiring.py` writes docs/wiring-l298n.svg and docs/wiring-tb6612.svg.

The pins of the Uno are read from the table at the head of firmware/uno/board.h; both sides of the Uno have their pins
in the order of the board, USB up.
"""

import re
from pathlib import Path
from typing import NamedTuple

from wiring_sheet import KINDS, Point, Sheet

ROOT = Path(__file__).parents[1]
RIGHT_EDGE = ("GND", *(f"D{n}" for n in range(13, -1, -1)))
LEFT_EDGE = ("IOREF", "RESET", "3.3V", "5V", "GND", "GND", "VIN", "", "A0", "A1", "A2", "A3", "A4", "A5")


class Pins(NamedTuple):
    """Pins of the Uno, as Arduino calls them; pairs are left, right."""

    pwm: tuple[str, str]
    direction: tuple[str, str, str, str]
    encoder: tuple[str, str, str, str]  # left A, B, right A, B
    standby: str
    battery: str
    mark: str
    lamp: str


class Bridge(NamedTuple):
    """The texts beside the pins of a module."""

    file: str
    title: str
    pwm: tuple[str, str]
    direction: tuple[str, str, str, str]
    outputs: tuple[str, str, str, str]
    supply: str
    standby: str = ""
    logic: str = ""
    notes: tuple[str, ...] = ()


BRIDGES = (
    Bridge(
        "wiring-l298n.svg", "L298N module", ("ENA", "ENB"), ("IN1", "IN2", "IN3", "IN4"),
        ("OUT1", "OUT2", "OUT3", "OUT4"), "12V",
        notes=(
            "Take the jumpers off ENA and ENB: they tie them to 5 V.",
            "Leave the jumper of its 5 V regulator on; nothing is",
            "wired to its 5V terminal, least of all the Pi.",
        ),
    ),
    Bridge(
        "wiring-tb6612.svg", "TB6612FNG module", ("PWMA", "PWMB"), ("AIN1", "AIN2", "BIN1", "BIN2"),
        ("AO1", "AO2", "BO1", "BO2"), "VM", "STBY", "VCC",
        notes=(
            "VCC is the logic's 5 V, VM the motors': swapped, the",
            "battery is on the Uno's 5 V, and both boards are lost.",
            "Wire every GND of the module.",
        ),
    ),
)  # fmt: skip


def pins(header: str) -> Pins:
    """The table of board.h; ValueError where it cannot be read."""
    rows = {}
    for name in ("PWM / enable", "direction 1, 2", "encoder A, B"):
        rows[name] = re.findall(r"\b[AD]\d+", _first_match(re.escape(name) + r"(.*)", header))
    single = (r"TB6612 (A\d)", r"divider (A\d)", r"lap mark (D\d+)", r"lamp (D\d+)")
    return Pins(
        *(tuple(row) for row in rows.values()), *(_first_match(pattern, header) for pattern in single)
    )


def _first_match(pattern: str, text: str) -> str:
    match = re.search(pattern, text)
    if match is None:
        raise ValueError(f"firmware/uno/board.h: its table of pins has nothing like {pattern!r}")
    return match[1]


UNO_LEFT, UNO_RIGHT = 640.0, 820.0
BRIDGE_TOP, BRIDGE_BOTTOM, BRIDGE_RIGHT = 640.0, 800.0, 950.0
SENSORS_X = 1130.0
PLUS_Y, GROUND_Y = 850.0, 950.0


def right_y(pin: str) -> float:
    """Return the height of a pin of the right edge of the Uno."""
    return 130.0 + 24.0 * RIGHT_EDGE.index(pin)


def left_y(pin: str) -> float:
    """Return the height of a pin of the left edge; of two equal names, the second pin."""
    return 154.0 + 24.0 * (len(LEFT_EDGE) - 1 - LEFT_EDGE[::-1].index(pin))


def drawing(p: Pins, bridge: Bridge) -> str:
    """The whole sheet."""
    s = Sheet()
    title = f"Wiring with an {bridge.title}" if bridge.title[0] == "L" else f"Wiring with a {bridge.title}"
    s.text(40, 40, title, 22, "start", font_weight="bold")
    pins_used = {
        *p.pwm,
        *p.direction,
        *p.encoder,
        p.battery,
        p.mark,
        p.lamp,
        *([p.standby] if bridge.standby else []),
    }
    uno(s, pins_used | {"GND", "5V"}, p)
    computer(s)
    supply(s, p, bridge)
    the_bridge(s, p, bridge)
    sensors(s, p)
    legend(s, bridge)
    return s.svg(title)


def uno(s: Sheet, pins_used: set[str], p: Pins) -> None:
    """Pins that are not used are grey."""
    s.box(UNO_LEFT, 90, UNO_RIGHT - UNO_LEFT, 400, "#d9eef2")
    s.box(700, 78, 60, 40, "#c9c9c9")
    s.text(730, 103, "USB", 12)
    s.text(730, 215, "Arduino", 16, font_weight="bold")
    s.text(730, 236, "Uno", 16, font_weight="bold")
    s.text(730, 262, "(D9 is printed", 11)
    s.text(730, 277, "9 or ~9)", 11)
    edges = ((UNO_LEFT, LEFT_EDGE, 154.0, 10, "start"), (UNO_RIGHT, RIGHT_EDGE, 130.0, -10, "end"))
    for x, names, top, shift, anchor in edges:
        for row, name in enumerate(names):
            if name:
                s.pin(x, top + 24 * row)
                label = f"lamp {name}" if name == p.lamp else name
                fill = "#000" if name in pins_used else "#999"
                s.text(x + shift, top + 24 * row + 4.5, label, 13, anchor, fill=fill)


def computer(s: Sheet) -> None:
    """The Pi, and the IMU below it."""
    s.box(60, 90, 220, 180, "#dff0d8")
    s.text(170, 130, "Raspberry Pi 3", 16, font_weight="bold")
    s.text(170, 150, "pins of its 40-pin header;", 11)
    s.text(170, 165, "pin 1 is next to the SD card", 11)
    s.box(255, 176, 36, 34, "#c9c9c9")
    s.text(273, 197, "USB", 11)
    s.box(50, 176, 44, 34, "#c9c9c9")
    s.text(72, 197, "PWR", 11)
    usb = [(291.0, 193.0), (330.0, 193.0), (330.0, 60.0), (730.0, 60.0), (730.0, 78.0)]
    s.wire("usb", ("Pi USB", "Uno USB"), usb, (530, 60), "USB cable A-B: data, and 5 V for the Uno")
    s.box(60, 430, 220, 88, "#e6e0f4")
    s.text(170, 480, "IMU module", 16, font_weight="bold")
    s.text(170, 497, "MPU-6050; AD0, INT, XDA, XCL", 11)
    s.text(170, 511, "stay free", 11)
    rows = (("three", "1", "3V3", "VCC", "3.3 V"), ("i2c", "3", "SDA", "SDA", "SDA"),
            ("i2c", "5", "SCL", "SCL", "SCL"), ("ground", "6", "GND", "GND", "GND"))  # fmt: skip
    for place, (kind, number, name, imu_pin, label) in enumerate(rows):
        x = 84.0 + 57.0 * place
        s.wire(kind, (f"Pi {number}", f"IMU {imu_pin}"), [(x, 270), (x, 430)], (x, 350), label, upright=True)
        s.pin(x, 270)
        s.pin(x, 430)
        s.text(x, 246, number, 13, font_weight="bold")
        s.text(x, 261, name, 12)
        s.text(x, 450, imu_pin, 12)


def supply(s: Sheet, p: Pins, bridge: Bridge) -> None:
    """Battery, fuse, switch, the 5 V converter, both strips, and the divider."""
    s.box(60, 640, 200, 100, "#fbe9d0")
    s.text(150, 672, "5 V converter", 16, font_weight="bold")
    s.text(155, 692, "(buck, ≥ 3 A)", 11)
    s.text(150, 728, "set to 5.1 V, then join", 11)
    cable = [(60.0, 690.0), (24.0, 690.0), (24.0, 193.0), (50.0, 193.0)]
    s.wire("usb", ("converter OUT", "Pi PWR"), cable, (24, 570), "5 V, 3 A", upright=True)
    s.box(40, 880, 150, 96, "#f6d5d5")
    s.text(105, 912, "Battery", 16, font_weight="bold")
    s.text(105, 931, "2 Li-ion cells,", 11)
    s.text(105, 945, "6.0 to 8.4 V", 11)
    plus: list[Point] = [(190, 900), (330, 900), (330, PLUS_Y)]
    s.wire("battery", ("battery +", "plus strip"), plus)
    s.resistor(228, 900, "5 A fuse")
    s.box(268, 888, 52, 24, "#eee")
    s.text(294, 904.5, "switch", 12)
    s.wire("ground", ("battery -", "ground strip"), [(190, 950), (346, GROUND_Y)], (268, 950), "GND")
    s.wire("battery", ("plus strip", "converter IN+"), [(290, PLUS_Y), (290, 720), (260, 720)], (290, 778),
           "battery +", upright=True)  # fmt: skip
    s.wire(
        "battery", ("plus strip", "20k"), [(320, PLUS_Y), (320, 460)], (320, 575), "battery +", upright=True
    )
    y, ground = left_y(p.battery), left_y("GND")
    s.wire("sense", ("20k", f"Uno {p.battery}"), [(320, 460), (320, y), (UNO_LEFT, y)], (585, y), p.battery)
    s.resistor(320, 430, "20 kΩ", upright=True)
    s.wire("ground", ("converter IN-", "ground strip"), [(260, 660), (352, 660), (352, GROUND_Y)], (352, 735),
           "GND", upright=True)  # fmt: skip
    s.wire("ground", ("Uno GND", "ground strip"), [(UNO_LEFT, ground), (378, ground), (378, GROUND_Y)],
           (378, 575), "common ground", upright=True)  # fmt: skip
    s.wire("sense", (f"Uno {p.battery}", "10k"), [(510, y), (510, y - 12)])
    s.wire("ground", ("10k", "Uno GND"), [(510, ground + 12), (510, ground)])
    s.resistor(510, (y + ground) / 2, "10 kΩ", upright=True)
    s.dot(510, y)
    s.dot(510, ground)
    for x, y, label in ((260, 660, "IN−"), (260, 720, "IN+"), (190, 900, "+"), (190, 950, "−")):
        s.pin(x, y)
        s.text(x - 8, y + 4.5, label, 12, "end")
    s.pin(60, 690)
    s.text(68, 694.5, "OUT", 12, "start")
    strips(s, bridge)


def strips(s: Sheet, bridge: Bridge) -> None:
    """Both terminal strips, and the way from them to the bridge."""
    s.wire("battery", ("plus strip", f"bridge {bridge.supply}"),
           [(340, PLUS_Y), (470, PLUS_Y), (470, BRIDGE_BOTTOM)], (425, PLUS_Y), "battery +")  # fmt: skip
    s.wire("ground", ("ground strip", "bridge GND"), [(545, GROUND_Y), (545, BRIDGE_BOTTOM)], (545, 905), "GND",
           upright=True)  # fmt: skip
    s.wire("battery", ("1000 µF +", f"bridge {bridge.supply}"), [(470, 826), (504, 826)])
    s.wire("ground", ("1000 µF -", "bridge GND"), [(510, 826), (545, 826)])
    s.capacitor(507, 826, upright=False)
    s.dot(470, 826)
    s.dot(545, 826)
    s.text(492, 874, "1000 µF, 16 V", 11)
    s.text(492, 887, "stripe (−) to GND", 11)
    for x, y, w, colour in ((282, PLUS_Y, 62, "#c40000"), (340, GROUND_Y, 215, "#000")):
        s.parts.append(f'<rect x="{x:g}" y="{y - 6:g}" width="{w:g}" height="12" rx="3" fill="{colour}"/>')
    s.text(276, PLUS_Y + 4.5, "plus strip", 12, "end")
    s.text(450, 974, "ground strip: one terminal block", 12)


def the_bridge(s: Sheet, p: Pins, bridge: Bridge) -> None:
    """Inputs on top, motors on the right, supply below."""
    s.box(394, BRIDGE_TOP, BRIDGE_RIGHT - 394, BRIDGE_BOTTOM - BRIDGE_TOP, "#f5f0d0")
    s.text(655, 725, bridge.title, 18, font_weight="bold")
    lanes = [452.0, 492.0, 532.0, 572.0]
    for x, pin, name in zip(lanes, p.direction, bridge.direction, strict=True):
        path: list[Point] = [(UNO_LEFT, left_y(pin)), (x, left_y(pin)), (x, BRIDGE_TOP)]
        s.wire(
            "direction", (f"Uno {pin}", f"bridge {name}"), path, (x, 570), f"{pin} to {name}", upright=True
        )
        bridge_pin(s, x, name)
    for kind, pin, name, x in (
        ("standby", p.standby, bridge.standby, 612.0),
        ("five", "5V", bridge.logic, 414.0),
    ):
        if name:
            path = [(UNO_LEFT, left_y(pin)), (x, left_y(pin)), (x, BRIDGE_TOP)]
            label = f"{pin} to {name}"
            s.wire(kind, (f"Uno {pin}", f"bridge {name}"), path, (x, 570), label, upright=True)
            bridge_pin(s, x, name)
    if bridge.standby:
        pull_down(s, "standby", p.standby, 612, 618, 700)
    for x, pin, name, end, y in zip((850, 894), p.pwm, bridge.pwm, (762, 982), (590, 590), strict=True):
        path = [(UNO_RIGHT, right_y(pin)), (x, right_y(pin)), (x, BRIDGE_TOP)]
        s.wire("pwm", (f"Uno {pin}", f"bridge {name}"), path, (x, 530), f"{pin} to {name}", upright=True)
        bridge_pin(s, x, name)
        pull_down(s, "pwm", pin, x, y, end)
    for x, name in ((470, bridge.supply), (545, "GND")):
        s.pin(x, BRIDGE_BOTTOM)
        s.text(x, BRIDGE_BOTTOM - 10, name, 13)
    motors(s, bridge)


def motors(s: Sheet, bridge: Bridge) -> None:
    """Both, with what keeps their sparks off the other wires."""
    for y, name, side in zip(
        (675, 705, 755, 785), bridge.outputs, ("left", "left", "right", "right"), strict=True
    ):
        ends = f"bridge {name}", f"{side} motor"
        s.wire("motor", ends, [(BRIDGE_RIGHT, y), (SENSORS_X, y)], (1026, y), f"{side} motor")
        s.pin(BRIDGE_RIGHT, y)
        s.text(BRIDGE_RIGHT - 10, y + 4.5, name, 13, "end")
    for y, side in ((655, "Left motor"), (735, "Right motor")):
        s.wire("motor", (f"{side} 1", "100 nF"), [(1100, y + 20), (1100, y + 32)])
        s.wire("motor", ("100 nF", f"{side} 2"), [(1100, y + 38), (1100, y + 50)])
        s.capacitor(1100, y + 35, upright=True)
        s.box(SENSORS_X, y, 240, 70, "#e8e8e8")
        s.pin(SENSORS_X, y + 20)
        s.pin(SENSORS_X, y + 50)
        s.text(1255, y + 26, side, 16, font_weight="bold")
        s.text(1255, y + 44, "either way round: calibrate finds out;", 10.5)
        s.text(1255, y + 58, "solder the 100 nF to its terminals", 10.5)


def bridge_pin(s: Sheet, x: float, name: str) -> None:
    """A pin of its upper edge."""
    s.pin(x, BRIDGE_TOP)
    s.text(x, BRIDGE_TOP + 20, name, 12)


def pull_down(s: Sheet, kind: str, pin: str, x: float, y: float, end: float) -> None:
    """10 kΩ from a lane to ground."""
    s.wire(kind, (f"Uno {pin}", f"10k of {pin}"), [(x, y), ((x + end) / 2, y)])
    s.wire("ground", (f"10k of {pin}", "GND"), [((x + end) / 2, y), (end, y), (end, y + 8)])
    s.resistor((x + end) / 2, y, "10 kΩ")
    s.dot(x, y)
    s.to_ground(end, y + 8)


def sensors(s: Sheet, p: Pins) -> None:
    """Lap mark and encoders; their supply as signs, so that the sheet stays readable."""
    left_a, left_b, right_a, right_b = p.encoder
    rows = (
        ("mark", "Lap mark sensor", "may be left out", 90.0, ((p.mark, "OUT", 950.0),)),
        (
            "encoder",
            "Encoder, right",
            "may be left out",
            225.0,
            ((right_b, "B", 990.0), (right_a, "A", 1010.0)),
        ),
        (
            "encoder",
            "Encoder, left",
            "one channel: A alone",
            400.0,
            ((left_b, "B", 1030.0), (left_a, "A", 970.0)),
        ),
    )
    for kind, title, note, top, signals in rows:
        high = 56.0 + 26 * (1 + len(signals)) - 10
        s.box(SENSORS_X, top, 240, high, "#f0f0f0", optional=True)
        s.text(1270, top + 40, title, 16, font_weight="bold")
        s.text(1270, top + 58, note, 11)
        y = top + 24
        for pin, name, lane in signals:
            path = [(UNO_RIGHT, right_y(pin)), (lane, right_y(pin)), (lane, y), (SENSORS_X, y)]
            place = f"{title.lower()} {name}"
            s.wire(kind, (f"Uno {pin}", place), path, (1086, y), pin)
            s.pin(SENSORS_X, y)
            s.text(SENSORS_X + 10, y + 4.5, name, 13, "start")
            y += 26
        s.wire("five", ("Uno 5V", f"{title.lower()} VCC"), [(SENSORS_X, y), (1106, y)])
        s.parts.append(
            f'<circle cx="1100" cy="{y:g}" r="5" fill="#fff" stroke="#e57700" stroke-width="2.6"/>'
        )
        s.text(1090, y + 4.5, "5 V", 12, "end")
        s.pin(SENSORS_X, y)
        s.text(SENSORS_X + 10, y + 4.5, "VCC", 13, "start")
        y += 26
        s.wire("ground", (f"{title.lower()} GND", "ground strip"), [(SENSORS_X, y), (1100, y), (1100, y + 8)])
        s.to_ground(1100, y + 8)
        s.pin(SENSORS_X, y)
        s.text(SENSORS_X + 10, y + 4.5, "GND", 13, "start")


def legend(s: Sheet, bridge: Bridge) -> None:
    """Wires on the left, what must not be forgotten on the right."""
    s.parts.append('<rect x="590" y="822" width="790" height="176" rx="7" fill="#fafafa" stroke="#999"/>')
    kinds = [k for k in KINDS if k != "standby" or bridge.standby]
    for row, name in enumerate(kinds):
        k, y = KINDS[name], 835 + 12.6 * row
        dashes = f' stroke-dasharray="{k.dashes}"' if k.dashes else ""
        s.parts.append(
            f'<path d="M602 {y:g}h44" stroke="{k.colour}" stroke-width="{min(k.width, 6):g}"{dashes}/>'
        )
        s.text(656, y + 4, k.meaning, 11, "start")
    lines = (
        "●  joined. Wires that cross without ● are not joined.",
        "Ground sign: a wire to the ground strip.",
        "○ 5 V: a wire to the Uno's 5V pin (a strip of its own).",
        "Every 10 kΩ at the bridge keeps the motors off while the",
        "Uno starts and its pins float: none may be left out.",
        "D0 and D1 stay free. Without the divider: A0 to GND.",
        *bridge.notes,
    )
    for row, line in enumerate(lines):
        s.text(1030, 843 + 17.5 * row, line, 11.5, "start")


def main() -> None:
    """Writes both."""
    pins_of = pins((ROOT / "firmware/uno/board.h").read_text(encoding="utf-8"))
    for bridge in BRIDGES:
        (ROOT / "docs" / bridge.file).write_text(drawing(pins_of, bridge), encoding="utf-8")


if __name__ == "__main__":
    main()
