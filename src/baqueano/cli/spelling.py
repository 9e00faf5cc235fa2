"""One text for two readers: an error names an argument as Python does, and the command line spells its option.

    clocks = "gps"      →  --clock gps          use=(…)  →  --use SENSOR          segment_s  →  --segment

Only names that are no words of English are changed where nothing follows them. What is found (notes of a fit, the
report) is spelt as it is typed from the beginning.
"""

import re
import shlex

OPTIONS = {  # argument of `identify` → option, and what is to be put for a value that is left open
    "free": ("--free", "KEY"),
    "fixed": ("--fix", "KEY"),
    "bounds": ("--bound", "KEY=LOW,HIGH"),
    "use": ("--use", "SENSOR"),
    "per_run": ("--per-run", "KEY"),
    "clocks": ("--clock", "SENSOR"),
    "segment_s": ("--segment", "SECONDS"),
    "cost": ("--cost", "simulation"),
    "speed_noise": ("--speed-noise", ""),
    "measured": ("--measured", '"TIME: LENGTH, ANGLE"'),
    "tolerance": ("--tolerance", "KEY=PART"),
    "start": ("--set", "KEY=VALUE"),
}
_NAMES = "|".join(OPTIONS)
_GIVEN = re.compile(rf"\b({_NAMES}) ?= ?(?:\"([^\"]*)\"|(-?[\d.]+(?:e-?\d+)?)(?![\w]))")
_OPEN = re.compile(rf"\b({_NAMES})=(?:\(…\)|\[…\]|\{{…\}}|…)")
_SPOKEN = re.compile(r"(?<!-)\b(measured)(?= \")")
_BARE = re.compile(rf"\b({'|'.join(name for name in OPTIONS if '_' in name)})\b")


def as_typed(text: str) -> str:
    """The text of an error, with options in the place of Python's arguments."""
    text = _GIVEN.sub(lambda m: f"{OPTIONS[m[1]][0]} {shlex.quote(m[2]) if m[2] is not None else m[3]}", text)
    text = _OPEN.sub(lambda m: " ".join(OPTIONS[m[1]]).rstrip(), text)
    return _BARE.sub(lambda m: OPTIONS[m[1]][0], _SPOKEN.sub(lambda m: OPTIONS[m[1]][0], text))
