"""The width of a figure, read from its file."""

import re
from pathlib import Path

from baqueano.report.page import DPI

INCH_MM = 25.4
POINTS = 72.0  # of an inch


def width_mm(path: Path) -> float:
    """Return the width of a figure as svg, pdf or png."""
    data = path.read_bytes()
    if path.suffix == ".png":
        assert data.startswith(b"\x89PNG")
        return int.from_bytes(data[16:20], "big") / DPI * INCH_MM
    begin, width = {
        ".svg": (b"<?xml", rb'<svg[^>]* width="([\d.]+)pt"'),
        ".pdf": (b"%PDF", rb"/MediaBox \[ 0 0 ([\d.]+) "),
    }[path.suffix]
    assert data.startswith(begin)
    width_match = re.search(width, data)
    assert width_match is not None
    return float(width_match[1]) / POINTS * INCH_MM
