"""Format names of arguments in messages, as a Python argument or as an option of the command line.

{arg[per_run]}  →  --per-run        {arg[use]:gps}  →  --use gps        {arg[use]:…}  →  --use SENSOR
"""

import shlex
from dataclasses import dataclass

PLACEHOLDER = "…"  # in the place of a value that the user chooses
OPTIONS = {  # argument of `identify` → option, and the name of its value
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


@dataclass(frozen=True, slots=True)
class Option:
    """An argument in the form in which a user types it; an argument that is not in OPTIONS keeps its name."""

    name: str

    def __format__(self, value: str) -> str:
        option, value_name = OPTIONS.get(self.name, (f"--{self.name.replace('_', '-')}", "VALUE"))
        value_text = value_name if value == PLACEHOLDER else shlex.quote(value) if value else ""
        return f"{option} {value_text}".rstrip()
