"""Read, change and store the settings of a vehicle in the EEPROM of an Uno, under readable names.

    name            firmware                            values
    bridge          Settings.driver                     l298n, tb6612, l293d
    left-motor …    one bit of Settings.wiring each     straight, reversed or swapped; high, low over the tape
    dead-zone …     Settings.ways, by wheel and direction   shares of full duty: 0.11 is 110 ‰

frames.py defines the ranges, which the firmware also checks.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from baqueano.diagnostics import fault
from baqueano.errors import AnswerNo, UsageError
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.robot.uno.frames import FIELDS, Driver, Encoders, Settings, Way, Wiring

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow
    from baqueano.robot.uno.link import Uno

KINDS: dict[str, tuple[str, type[IntEnum]]] = {
    "bridge": ("driver", Driver),
    "encoders": ("encoders", Encoders),
}
PLUGS = {  # the flag of a reversed plug, and the names of both states
    "left-motor": (Wiring.LEFT_MOTOR_REVERSED, ("straight", "reversed")),
    "right-motor": (Wiring.RIGHT_MOTOR_REVERSED, ("straight", "reversed")),
    "motors": (Wiring.MOTORS_SWAPPED, ("straight", "swapped")),
    "left-encoder": (Wiring.LEFT_ENCODER_REVERSED, ("straight", "reversed")),
    "right-encoder": (Wiring.RIGHT_ENCODER_REVERSED, ("straight", "reversed")),
    "encoder-plugs": (Wiring.ENCODERS_SWAPPED, ("straight", "swapped")),
    "mark": (Wiring.MARK_ACTIVE_LOW, ("high", "low")),
}
NUMBERS = {  # field, and the number of units of the wire in one unit of the option
    "battery-ratio": ("battery_permille", 1000),
    "kick-ms": ("kick_ms", 1),
    "dither": ("dither_permille", 1000),
    "dither-ms": ("dither_ms", 1),
}
OF_WAYS = {"dead-zone": "dead_zone_permille", "slope": "slope_permille", "kick": "kick_permille"}
WAYS = ("left-forwards", "left-backwards", "right-forwards", "right-backwards")
TELEMETRY_S = 0.5  # an Uno sends telemetry within this time
LOOK_S = 0.1
Wait = Callable[[float], object]


@dataclass(frozen=True)
class StoredSettings:
    """The stored settings of an Uno."""

    settings: Settings

    @property
    def verdict(self) -> str:
        """Return DEFAULT if the settings are the firmware's defaults, else SET."""
        return "DEFAULT" if self.settings == Settings() else "SET"

    def rows(self) -> list["TableRow"]:
        """Return a row for the whole Uno, then a row for each wheel and direction; duties are shares of full duty."""
        s, whole = self.settings, {}
        for name, (field, kind) in KINDS.items():
            whole[name] = kind(getattr(s, field)).name.lower()
        for name, (flag, words) in PLUGS.items():
            whole[name] = words[bool(s.wiring & flag)]
        for name, (field, unit) in NUMBERS.items():
            whole[name] = getattr(s, field) / unit
        ways = [
            {"wheel": wheel} | {name: getattr(way, field) / 1000 for name, field in OF_WAYS.items()}
            for wheel, way in zip(WAYS, s.ways, strict=True)
        ]
        return [{key.replace("-", "_"): value for key, value in row.items()} for row in (whole, *ways)]

    @classmethod
    def of(cls, rows: list["TableRow"]) -> "StoredSettings":
        """Return the settings from rows in JSON: the inverse of `rows`."""
        return cls(apply_changes(Settings(), _as_text(rows)))

    def table(self) -> str:
        """Return the settings as a table of text, with the names of the options."""
        whole, *ways = self.rows()
        unit_texts = {
            "battery-ratio": _("V for 1 V at A0"), "kick-ms": "ms", "dither": _("of full duty, forward and back"),
            "dither-ms": "ms", "mark": _("over the tape"),
        }  # fmt: skip
        lines = []
        for name in (*KINDS, *PLUGS, *NUMBERS):
            value = whole[name.replace("-", "_")]
            text = f"{number(value):g}" if isinstance(value, float) else value
            lines.append(f"{name:15} {text} {unit_texts.get(name, '')}".rstrip())
        lines.append(f"{'':15} dead-zone  slope   kick")
        for way in ways:
            zone, slope, kick = (way[name.replace("-", "_")] for name in OF_WAYS)
            lines.append(f"{way['wheel']:15} {number(zone):9.3f}  {number(slope):5.3f}  {number(kick):5.3f}")
        origin = _("initial value of the firmware") if self.verdict == "DEFAULT" else _("stored in the Uno")
        return "\n".join([*lines, f"{_(self.verdict)}: {origin}"])


def _as_text(rows: list["TableRow"]) -> dict[str, list[str]]:
    """Return the texts to type for each option, from the `rows` of a StoredSettings."""
    whole, *ways = rows
    texts = {name: [str(whole[name.replace("-", "_")])] for name in (*KINDS, *PLUGS, *NUMBERS)}
    for name in OF_WAYS:
        texts[name] = [f"{way['wheel']}={way[name.replace('-', '_')]}" for way in ways]
    return texts


def as_typed(settings: Settings) -> str:
    """Return the command line that stores `settings` in an Uno, independent of its former settings.

    >>> as_typed(Settings(driver=Driver.TB6612))
    'baqueano robot settings --defaults --bridge=tb6612'
    """
    default, texts = _as_text(StoredSettings(Settings()).rows()), _as_text(StoredSettings(settings).rows())
    words = [f"--{name}={text}" for name in texts for text in texts[name] if text not in default[name]]
    return " ".join(["baqueano robot settings --defaults", *words])


def apply_changes(settings: Settings, changes: Mapping[str, Sequence[str]]) -> Settings:
    """Return `settings` with the changes typed for each option. Raise UsageError for an invalid word or number.

    >>> apply_changes(Settings(), {"bridge": ["tb6612"], "dead-zone": ["all=0.1", "left-forwards=0.12"]}).ways[0]
    Way(dead_zone_permille=120, slope_permille=1000, kick_permille=0)
    """
    for name, texts in changes.items():
        for text in texts:
            settings = _with(settings, name, text)
    return settings


def _with(settings: Settings, name: str, text: str) -> Settings:
    if name in KINDS:
        field, kind = KINDS[name]
        word = _word(name, text, [member.name.lower() for member in kind])
        return settings._replace(**{field: kind[word.upper()]})
    if name in PLUGS:
        flag, words = PLUGS[name]
        is_reversed = words.index(_word(name, text, list(words)))
        return settings._replace(wiring=settings.wiring & ~flag | flag * is_reversed)
    if name in NUMBERS:
        field, unit = NUMBERS[name]
        return settings._replace(**{field: _number(name, text, text, Settings, field, unit)})
    wheel, equals, size = text.partition("=")
    if not equals or wheel not in (*WAYS, "all"):
        raise UsageError(fault("settings.way", option=name, found=text, known=WAYS))
    number = _number(name, text, size, Way, OF_WAYS[name], 1000)
    ways = [
        way._replace(**{OF_WAYS[name]: number}) if wheel in (at, "all") else way
        for at, way in zip(WAYS, settings.ways, strict=True)
    ]
    return settings._replace(ways=tuple(ways))


def _word(name: str, text: str, words: list[str]) -> str:
    if text.lower() not in words:
        raise UsageError(fault("settings.word", option=name, found=text, known=words))
    return text.lower()


def _number(name: str, text: str, size: str, layout: type, field: str, unit: int) -> int:
    """Return a typed number in units of the wire. Raise UsageError outside the range of the firmware."""
    (least, most), *_rest = (f.within for f in FIELDS[layout] if f.path == field)
    try:
        value = float(size)
    except ValueError:
        value = float("nan")
    if not least <= value * unit <= most:
        raise UsageError(
            fault("settings.number", option=name, found=text, least=least / unit, most=most / unit)
        )
    return round(value * unit)


def store(uno: "Uno", change: Callable[[Settings], Settings], wait: Wait = time.sleep) -> StoredSettings:
    """Change the settings stored in the Uno by `change`, and return the settings read back from it.

    Raise AnswerNo while a motor runs.
    """
    before = uno.settings(wait)
    settings = change(before)
    if settings != before:
        _at_rest(uno, wait)
        uno.disarm()
        wait(0.05)
        uno.keep(settings, wait)
    return StoredSettings(uno.settings(wait))


def _at_rest(uno: "Uno", wait: Wait) -> None:
    uno.receive()
    wait(TELEMETRY_S)
    telemetry_read = uno.receive()
    if any(duty for telemetry in telemetry_read[-1:] for duty in telemetry.applied):
        left, right = telemetry_read[-1].applied
        raise AnswerNo(fault("settings.motor-runs", left=left, right=right))


def watch(uno: "Uno", seconds: float, notify: Callable[[str], object], wait: Wait = time.sleep) -> None:
    """Report battery, encoder counts and marks by `notify` when the counts or marks change, for `seconds` [s]."""
    before = None
    for _look in range(round(seconds / LOOK_S)):
        wait(LOOK_S)
        for newest in uno.receive()[-1:]:
            if (newest.counts, newest.marks) != before:
                before = (newest.counts, newest.marks)
                notify(
                    _(
                        "battery {battery_v:.2f} V, counts left {left}, right {right}, marks {marks}",
                        battery_v=newest.battery_v,
                        left=newest.counts[0],
                        right=newest.counts[1],
                        marks=newest.marks,
                    )
                )
