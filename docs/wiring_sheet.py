"""The sheet on which wiring.py draws: boxes, wires with names, resistors, capacitors, as SVG.

A wire carries what it joins (data-from, data-to), so that a test can ask for it. Lengths are in units of the sheet,
x to the right, y down.
"""

from html import escape
from typing import NamedTuple

WIDE, HIGH = 1400, 1010
FONT = "DejaVu Sans, Verdana, Arial, sans-serif"
Point = tuple[float, float]


class Kind(NamedTuple):
    """The style of a wire."""

    colour: str
    width: float
    dashes: str
    meaning: str


KINDS = {
    "battery": Kind("#c40000", 4, "", "battery +, behind fuse and switch: thick wire, 0.75 mm²"),
    "ground": Kind("#000000", 4, "", "ground (GND): every one ends at the ground strip"),
    "motor": Kind("#6b3a00", 4, "", "motor, two wires twisted: 0.5 mm²"),
    "usb": Kind("#8c8c8c", 8, "", "USB cable"),
    "five": Kind("#e57700", 2.6, "", "5 V of the Uno"),
    "three": Kind("#e0569c", 2.6, "", "3.3 V of the Pi"),
    "pwm": Kind("#078a35", 2.6, "", "PWM: how much"),
    "direction": Kind("#1d5bd0", 2.6, "", "direction: which way"),
    "standby": Kind("#7b35b5", 2.6, "", "standby"),
    "sense": Kind("#a08000", 2.6, "", "a third of the battery's voltage"),
    "i2c": Kind("#00838f", 2.6, "", "I2C"),
    "encoder": Kind("#8f5a14", 2.6, "9 4", "encoder (may be left out)"),
    "mark": Kind("#b8006e", 2.6, "9 4", "lap mark (may be left out)"),
}


class Sheet:
    """Wires below, boxes on top of them, names on top of all."""

    def __init__(self) -> None:
        self.wires: list[str] = []
        self.parts: list[str] = []
        self.names: list[str] = []

    def text(
        self, x: float, y: float, label: str, size: float = 13, anchor: str = "middle", **svg_values: str
    ) -> None:
        """A line of text; y is its base line."""
        attributes = "".join(f' {key.replace("_", "-")}="{value}"' for key, value in svg_values.items())
        self.names.append(
            f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" text-anchor="{anchor}"{attributes}>{escape(label)}</text>'
        )

    def box(self, x: float, y: float, w: float, h: float, fill: str, optional: bool = False) -> None:
        """A board or a part."""
        dashes = ' stroke-dasharray="7 4"' if optional else ""
        self.parts.append(
            f'<rect class="part" x="{x:g}" y="{y:g}" width="{w:g}" height="{h:g}" rx="7" fill="{fill}" '
            f'stroke="#333" stroke-width="1.8"{dashes}/>'
        )

    def wire(self, kind: str, ends: tuple[str, str], points: list[Point], middle: Point | None = None, label: str = "",
             upright: bool = False) -> None:  # fmt: skip
        """A wire along `points`, named `label` at the point `middle`."""
        k = KINDS[kind]
        path = "M" + " L".join(f"{x:g} {y:g}" for x, y in points)
        dashes = f' stroke-dasharray="{k.dashes}"' if k.dashes else ""
        self.wires += [
            f'<path d="{path}" stroke="#fff" stroke-width="{k.width + 6:g}"/>',
            f'<path class="wire" data-kind="{kind}" data-from="{escape(ends[0])}" data-to="{escape(ends[1])}" '
            f'd="{path}" stroke="{k.colour}" stroke-width="{k.width:g}"{dashes}/>',
        ]
        if middle is not None:
            self.name(middle, label, k.colour, upright)

    def name(self, middle: Point, label: str, colour: str, upright: bool = False) -> None:
        """The name of a wire, written across it."""
        (x, y), half = middle, 4 + 3.7 * len(label)
        rotation = f' transform="rotate(-90 {x:g} {y:g})"' if upright else ""
        self.names.append(
            f'<g{rotation}><rect x="{x - half:g}" y="{y - 9:g}" width="{2 * half:g}" height="18" rx="4" fill="#fff" '
            f'stroke="{colour}"/><text x="{x:g}" y="{y + 4.2:g}" font-size="12" text-anchor="middle">'
            f"{escape(label)}</text></g>"
        )

    def dot(self, x: float, y: float) -> None:
        """Here wires are joined; where they cross without one they are not."""
        self.parts.append(f'<circle cx="{x:g}" cy="{y:g}" r="5.5"/>')

    def pin(self, x: float, y: float) -> None:
        """A pin at the edge of a box."""
        self.parts.append(
            f'<circle cx="{x:g}" cy="{y:g}" r="4" fill="#fff" stroke="#333" stroke-width="1.6"/>'
        )

    def resistor(self, x: float, y: float, label: str, upright: bool = False) -> None:
        """A resistor around a point of a wire."""
        w, h = (20, 58) if upright else (58, 20)
        rotation = {"transform": f"rotate(-90 {x:g} {y:g})"} if upright else {}
        self.parts.append(
            f'<rect x="{x - w / 2:g}" y="{y - h / 2:g}" width="{w}" height="{h}" fill="#f3e3bd" stroke="#333" '
            'stroke-width="1.6"/>'
        )
        self.text(x, y + 4.5, label, 12, **rotation)

    def capacitor(self, x: float, y: float, upright: bool) -> None:
        """Two plates around a point of a wire."""
        dx, dy = (0, 3) if upright else (3, 0)
        lines = "".join(
            f"M{x + s * dx - 4 * dy:g} {y + s * dy - 4 * dx:g}L{x + s * dx + 4 * dy:g} {y + s * dy + 4 * dx:g}"
            for s in (-1, 1)
        )
        self.parts.append(f'<path d="{lines}" stroke="#000" stroke-width="3"/>')

    def to_ground(self, x: float, y: float) -> None:
        """A sign instead of a wire: it hangs below the point."""
        bars = "".join(f"M{x - w} {y + d}h{2 * w}" for w, d in ((11, 0), (7, 5), (3, 10)))
        self.parts.append(f'<path d="{bars}" stroke="#000" stroke-width="2.4"/>')

    def svg(self, title: str) -> str:
        """The file."""
        return "\n".join((
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {HIGH}" font-family="{FONT}">',
            f"<title>{escape(title)}</title>",
            f'<rect width="{WIDE}" height="{HIGH}" fill="#fff"/>',
            '<g fill="none" stroke-linejoin="round">', *self.wires, "</g>", *self.parts, *self.names, "</svg>\n",
        ))  # fmt: skip
