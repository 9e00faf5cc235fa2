"""Parse a fault as a person types it: `12 s: push 0.3 N s left`, `3-6 s: cut imu`.

  T s: push 0.3 N s ahead | back | left | right
  T s: tilt 2 deg, or 2 deg towards 90 deg            0 deg is x of the map, 90 deg is y
  T s: cut imu
  T s: drift imu[2] 0.05
  T s: spikes imu[0] 50, 1 %
  T s: slip left 30 %                                 left, right or all wheels push with 30 % of their force
  T s: sag 84 %                                       of the voltage
  T s: lose 30 %                                      of the frames

T is the time at which the fault begins, or a range such as 3-6 for its start and end.
"""

import re
from math import cos, radians, sin

from baqueano.contracts.values import JsonObject
from baqueano.errors import UsageError

NUMBER = r"([+-]?\d+(?:\.\d*)?(?:e[+-]?\d+)?)"
FAULT_TEXT = re.compile(rf"\s*{NUMBER}(?:\s*-\s*{NUMBER})?\s*s\s*:\s*(\w+)\s*(.*?)\s*")
DIRECTIONS = {"ahead": (1.0, 0.0), "back": (-1.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0)}
FORMS = {
    "push": (re.compile(rf"{NUMBER}\s*N\s*s\s+(ahead|back|left|right)"), "0.3 N s left"),
    "tilt": (re.compile(rf"{NUMBER}\s*deg(?:\s+towards\s+{NUMBER}\s*deg)?"), "2 deg towards 90 deg"),
    "cut": (re.compile(r"(\w+)"), "imu"),
    "drift": (re.compile(rf"(\w+\[\d+\])\s+{NUMBER}"), "imu[2] 0.05"),
    "spikes": (re.compile(rf"(\w+\[\d+\])\s+{NUMBER}\s*,\s*{NUMBER}\s*%"), "imu[0] 50, 1 %"),
    "slip": (re.compile(rf"(left|right|all)\s+{NUMBER}\s*%"), "left 30 %"),
    "sag": (re.compile(rf"{NUMBER}\s*%"), "84 %"),
    "lose": (re.compile(rf"{NUMBER}\s*%"), "30 %"),
}


def parse_fields(text: str) -> JsonObject:
    """Return the fields of the fault that a text describes. Raise UsageError for any other text."""
    match = FAULT_TEXT.fullmatch(text)
    form, example = FORMS.get(match[3] if match else "", (None, ""))
    if match is None or form is None:
        forms = ", ".join(f'"{kind} {form}"' for kind, (_, form) in FORMS.items())
        raise UsageError.of("shake.syntax", value=repr(text)[:80], valid=forms)
    form_match = form.fullmatch(match[4])
    if form_match is None:
        raise UsageError.of("shake.parts", value=repr(text)[:80], kind=match[3], example=example)
    begin, end = float(match[1]), None if match[2] is None else float(match[2])
    kind_fields = _kind_fields(match[3], form_match.groups())
    duration_s = None if end is None or match[3] == "push" else end - begin
    return {"kind": match[3], "start_s": begin, "duration_s": duration_s, **kind_fields}


def _kind_fields(kind: str, groups: tuple[str, ...]) -> JsonObject:
    match kind:
        case "push":
            x, y = DIRECTIONS[groups[1]]
            return {"x": x * float(groups[0]), "y": y * float(groups[0])}
        case "tilt":
            slope_rad, direction_rad = radians(float(groups[0])), radians(float(groups[1] or 0.0))
            return {"x": slope_rad * cos(direction_rad), "y": slope_rad * sin(direction_rad)}
        case "cut":
            return {"target": groups[0]}
        case "drift":
            return {"target": groups[0], "size": float(groups[1])}
        case "spikes":
            return {"target": groups[0], "size": float(groups[1]), "part": float(groups[2]) / 100.0}
        case "slip":
            return {"target": groups[0], "part": float(groups[1]) / 100.0}
    return {"part": float(groups[0]) / 100.0}
