"""The palette for colour-blind users: necessary distinctions remain by colour, or by dash or shape.

Colour vision by Machado, Oliveira and Fernandes (2009), table 1 at severity 1.0, on linear RGB. Distance: CIEDE2000
by Sharma, Wu and Dalal (2005), with their test data below.
"""

import re
from pathlib import Path

import numpy as np
import pytest

STATIC = Path(__file__).parents[2] / "src" / "baqueano" / "web" / "static"
EYES = {
    "full": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
D65 = np.array([0.95047, 1.0, 1.08883])
APART = 10.0  # ΔE00 of two thin lines; 1 is just seen side by side
FROM_CARD = 15.0
BY_COLOUR = [  # only the colour distinguishes these
    ("measured", "model"),  # two lines of a strip
    ("model", "sim"),  # a bar that is good, and one that is poor
    ("model", "alarm"),  # the NIS in its band, and above it
    ("quiet", "middle"), ("middle", "loud"),  # the path by its information
    ("route", "model"),
]  # fmt: skip
DASHES = {  # at least one of two lines is dashed: the file, and its notation
    ("model", "ghost"): ("map.js", r'ghost: \{ colour: "ghost", width: [\d.]+, dash: \[\d'),
    ("model", "ink"): ("map.js", r'truth: \{ colour: "ink", width: [\d.]+, dash: \[\d'),
    ("ink", "ghost"): ("strips.js", r'requested: \{ colour: "ghost", width: [\d.]+, dash: \[\d'),
    ("measured", "ghost"): ("strips.js", r'ghost: \{ colour: "ghost", width: [\d.]+, dash: \[\d'),
    ("alarm", "sim"): ("replay.js", r"grave \? \[\] : \[\d"),
}


def palette(theme: str) -> dict[str, str]:
    style = (STATIC / "page.css").read_text(encoding="utf-8")
    pattern = r":root \{(.*?)\}" if theme == "light" else r':root\[data-theme="dark"\] \{(.*?)\}'
    palette_rules = re.search(pattern, style, re.DOTALL)
    assert palette_rules
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", palette_rules[1]))


def lab(colour: str, eye: str) -> np.ndarray:
    """Return L*, a*, b* of a colour for this type of colour vision."""
    c = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    x = XYZ @ np.clip(EYES[eye] @ linear, 0.0, 1.0) / D65
    f = np.where(x > (6 / 29) ** 3, np.cbrt(x), x / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def distance(first: np.ndarray, two: np.ndarray) -> float:
    """Return ΔE00 of two colours in L*, a*, b*."""
    (l1, a1, b1), (l2, a2, b2) = first, two
    c = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    g = 1.5 - 0.5 * np.sqrt(c**7 / (c**7 + 25.0**7))
    c1, c2 = np.hypot(g * a1, b1), np.hypot(g * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, g * a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    turn = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0.0
    middle = (h1 + turn / 2) % 360 if c1 * c2 else h1 + h2
    big_h = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2))
    l, c = (l1 + l2) / 2, (c1 + c2) / 2
    t = (
        1
        - 0.17 * np.cos(np.radians(middle - 30))
        + 0.24 * np.cos(np.radians(2 * middle))
        + 0.32 * np.cos(np.radians(3 * middle + 6))
        - 0.20 * np.cos(np.radians(4 * middle - 63))
    )
    s_l = 1 + 0.015 * (l - 50) ** 2 / np.sqrt(20 + (l - 50) ** 2)
    s_c, s_h = 1 + 0.045 * c, 1 + 0.015 * c * t
    lean = 60 * np.exp(-(((middle - 275) / 25) ** 2))
    r = -2 * np.sqrt(c**7 / (c**7 + 25.0**7)) * np.sin(np.radians(lean))
    dl, dc, dh = (l2 - l1) / s_l, (c2 - c1) / s_c, big_h / s_h
    return float(np.sqrt(dl**2 + dc**2 + dh**2 + r * dc * dh))


@pytest.mark.parametrize(
    ("first", "two", "expected"),
    [  # Sharma, Wu and Dalal (2005), table 1: rows 1, 7, 14, 17, 25 and 33
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, 0, 0), (50, -1, 2), 2.3669),
        ((50, -0.001, 2.49), (50, 0.0011, -2.49), 4.7461),
        ((50, 2.5, 0), (73, 25, -18), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((6.7747, -0.2908, -2.4247), (5.8714, -0.0985, -2.2286), 0.6377),
    ],
)
def test_the_colour_distance_equals_the_values_of_the_paper(first, two, expected):
    assert distance(np.array(first), np.array(two)) == pytest.approx(expected, abs=1e-4)


def test_in_simulated_deuteranopia_red_and_green_look_similar():
    """A red and a green of equal lightness look similar; otherwise the simulation of colour vision would prove
    nothing."""
    red, green = "#c4201f", "#5c6a00"
    assert distance(lab(red, "deuteranopia"), lab(green, "deuteranopia")) < 0.4 * distance(
        lab(red, "full"), lab(green, "full")
    )


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_that_are_the_only_difference_are_far_apart(theme, eye):
    colours = palette(theme)
    similar_pairs = {
        pair: round(difference, 1)
        for pair in BY_COLOUR
        if (difference := distance(*(lab(colours[name], eye) for name in pair))) < APART
    }
    assert not similar_pairs


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_line_has_contrast_with_its_card(theme, eye):
    colours = palette(theme)
    lines = ("measured", "model", "ghost", "alarm", "sim", "ink", "route", "quiet", "middle", "loud")
    faint = {
        name: round(difference, 1)
        for name in lines
        if (difference := distance(lab(colours[name], eye), lab(colours["card"], eye))) < FROM_CARD
    }
    assert not faint


@pytest.mark.parametrize("pair", DASHES, ids=" ".join)
def test_lines_of_similar_colour_differ_by_their_dash(pair):
    file, dash = DASHES[pair]
    assert re.search(dash, (STATIC / file).read_text(encoding="utf-8"))
