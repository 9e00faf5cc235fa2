"""Read, change and store the settings of a vehicle in the EEPROM of an Uno, under readable names.

    name            firmware                            values
    bridge          Settings.driver                     l298n, tb6612, l293d
    left-motor …    one bit of Settings.wiring each     straight, reversed or swapped; high, low over the tape
    dead-zone …     Settings.curves                     shares of full duty, by wheel and direction: 0.11 is 110 ‰

frames.py defines the ranges, which the firmware also checks.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from baqueano.contracts.values import TableRow
from baqueano.errors import AnswerNo, UsageError
from baqueano.messages.language import number, translate as _
from baqueano.robot.uno.frames import LAYOUT_FIELDS, Driver, EncoderKind, Settings, WheelCurve, Wiring

if TYPE_CHECKING:
    from baqueano.robot.uno.link import Uno

NAMED_OPTIONS: dict[str, tuple[str, type[IntEnum]]] = {
    "bridge": ("driver", Driver),
    "encoders": ("encoders", EncoderKind),
}
PLUG_FLAGS = {  # the flag of a reversed plug, and the names of both states
    "left-motor": (Wiring.LEFT_MOTOR_REVERSED, ("straight", "reversed")),
    "right-motor": (Wiring.RIGHT_MOTOR_REVERSED, ("straight", "reversed")),
    "motors": (Wiring.MOTORS_SWAPPED, ("straight", "swapped")),
    "left-encoder": (Wiring.LEFT_ENCODER_REVERSED, ("straight", "reversed")),
    "right-encoder": (Wiring.RIGHT_ENCODER_REVERSED, ("straight", "reversed")),
    "encoder-plugs": (Wiring.ENCODERS_SWAPPED, ("straight", "swapped")),
    "mark": (Wiring.MARK_ACTIVE_LOW, ("high", "low")),
}
NUMBER_OPTIONS = {  # field, and the number of encoded units in one unit of the option
    "battery-ratio": ("battery_permille", 1000),
    "kick-ms": ("kick_ms", 1),
    "dither": ("dither_permille", 1000),
    "dither-ms": ("dither_ms", 1),
}
CURVE_OPTIONS = {"dead-zone": "dead_zone_permille", "slope": "slope_permille", "kick": "kick_permille"}
WHEEL_DIRECTIONS = ("left-forwards", "left-backwards", "right-forwards", "right-backwards")
TELEMETRY_TIMEOUT_S = 0.5  # an Uno sends telemetry within this time
POLL_PERIOD_S = 0.1


@dataclass(frozen=True)
class StoredSettings:
    """The stored settings of an Uno."""

    settings: Settings

    @property
    def verdict(self) -> str:
        """Return DEFAULT if the settings are the firmware's defaults, else SET."""
        return "DEFAULT" if self.settings == Settings() else "SET"

    def rows(self) -> list[TableRow]:
        """Return a row for the whole Uno, then a row for each wheel and direction; duties are shares of full duty."""
        s, uno = self.settings, {}
        for name, (field, kind) in NAMED_OPTIONS.items():
            uno[name] = kind(getattr(s, field)).name.lower()
        for name, (flag, plug_names) in PLUG_FLAGS.items():
            uno[name] = plug_names[bool(s.wiring & flag)]
        for name, (field, unit) in NUMBER_OPTIONS.items():
            uno[name] = getattr(s, field) / unit
        wheel_rows = [
            {"wheel": wheel} | {name: getattr(curve, field) / 1000 for name, field in CURVE_OPTIONS.items()}
            for wheel, curve in zip(WHEEL_DIRECTIONS, s.curves, strict=True)
        ]
        return [{key.replace("-", "_"): value for key, value in row.items()} for row in (uno, *wheel_rows)]

    @classmethod
    def from_rows(cls, rows: list[TableRow]) -> "StoredSettings":
        """Return the settings from rows in JSON, the inverse of `rows`."""
        return cls(apply_changes(Settings(), _option_texts(rows)))

    def table(self) -> str:
        """Return the settings as a table of text, with the names of the options."""
        row, *wheel_rows = self.rows()
        unit_texts = {
            "battery-ratio": _("V at the battery for 1 V at A0"), "kick-ms": "ms",
            "dither": _("of full duty, forward and back"),
            "dither-ms": "ms", "mark": _("over the tape"),
        }  # fmt: skip
        lines = []
        for name in (*NAMED_OPTIONS, *PLUG_FLAGS, *NUMBER_OPTIONS):
            value = row[name.replace("-", "_")]
            text = f"{number(value):g}" if isinstance(value, float) else value
            lines.append(f"{name:15} {text} {unit_texts.get(name, '')}".rstrip())
        lines.append(f"{'':15} dead-zone  slope   kick")
        for wheel_row in wheel_rows:
            zone, slope, kick = (wheel_row[name.replace("-", "_")] for name in CURVE_OPTIONS)
            lines.append(
                f"{wheel_row['wheel']:15} {number(zone):9.3f}  {number(slope):5.3f}  {number(kick):5.3f}"
            )
        origin = _("initial value of the firmware") if self.verdict == "DEFAULT" else _("stored in the Uno")
        return "\n".join([*lines, f"{_(self.verdict)}: {origin}"])


def _option_texts(rows: list[TableRow]) -> dict[str, list[str]]:
    """Return the texts to type for each option, from the `rows` of a StoredSettings."""
    row, *wheel_rows = rows
    texts = {
        name: [str(row[name.replace("-", "_")])] for name in (*NAMED_OPTIONS, *PLUG_FLAGS, *NUMBER_OPTIONS)
    }
    for name in CURVE_OPTIONS:
        texts[name] = [
            f"{wheel_row['wheel']}={wheel_row[name.replace('-', '_')]}" for wheel_row in wheel_rows
        ]
    return texts


def settings_command(settings: Settings) -> str:
    """Return the command line that stores `settings` in an Uno, independent of its former settings.

    >>> settings_command(Settings(driver=Driver.TB6612))
    'baqueano robot settings --defaults --bridge=tb6612'
    """
    default = _option_texts(StoredSettings(Settings()).rows())
    texts = _option_texts(StoredSettings(settings).rows())
    arguments = [f"--{name}={text}" for name in texts for text in texts[name] if text not in default[name]]
    return " ".join(["baqueano robot settings --defaults", *arguments])


def apply_changes(settings: Settings, changes: Mapping[str, Sequence[str]]) -> Settings:
    """Return `settings` with the changes typed for each option. Raise UsageError for an invalid word or number.

    >>> apply_changes(Settings(), {"bridge": ["tb6612"], "dead-zone": ["left-forwards=0.12"]}).curves[0]
    WheelCurve(dead_zone_permille=120, slope_permille=1000, kick_permille=0)
    """
    for name, texts in changes.items():
        for text in texts:
            settings = _with_setting(settings, name, text)
    return settings


def _with_setting(settings: Settings, name: str, text: str) -> Settings:
    if name in NAMED_OPTIONS:
        field, kind = NAMED_OPTIONS[name]
        value_name = _checked_word(name, text, [member.name.lower() for member in kind])
        return settings._replace(**{field: kind[value_name.upper()]})
    if name in PLUG_FLAGS:
        flag, plug_names = PLUG_FLAGS[name]
        is_reversed = plug_names.index(_checked_word(name, text, list(plug_names)))
        return settings._replace(wiring=settings.wiring & ~flag | flag * is_reversed)
    if name in NUMBER_OPTIONS:
        field, unit = NUMBER_OPTIONS[name]
        return settings._replace(**{field: _checked_number(name, text, text, Settings, field, unit)})
    wheel, equals, number_text = text.partition("=")
    if not equals or wheel not in (*WHEEL_DIRECTIONS, "all"):
        raise UsageError.of("settings.wheel-direction", option=name, value=text, valid=WHEEL_DIRECTIONS)
    number = _checked_number(name, text, number_text, WheelCurve, CURVE_OPTIONS[name], 1000)
    wheel_rows = [
        curve._replace(**{CURVE_OPTIONS[name]: number}) if wheel in (direction_name, "all") else curve
        for direction_name, curve in zip(WHEEL_DIRECTIONS, settings.curves, strict=True)
    ]
    return settings._replace(curves=tuple(wheel_rows))


def _checked_word(name: str, text: str, valid_words: list[str]) -> str:
    if text.lower() not in valid_words:
        raise UsageError.of("settings.choice", option=name, value=text, valid=valid_words)
    return text.lower()


def _checked_number(name: str, text: str, number_text: str, layout: type, field: str, unit: int) -> int:
    """Return a typed number in encoded units. Raise UsageError if it is outside the range of the firmware."""
    (low, high), *_rest = (f.value_range for f in LAYOUT_FIELDS[layout] if f.path == field)
    try:
        value = float(number_text)
    except ValueError:
        value = float("nan")
    if not low <= value * unit <= high:
        raise UsageError.of(
            "settings.number", option=name, value=text, minimum=low / unit, maximum=high / unit
        )
    return round(value * unit)


def store(uno: "Uno", change: Callable[[Settings], Settings]) -> StoredSettings:
    """Replace the settings stored in the Uno by the result of `change`, and return the settings read back.

    Raise AnswerNo while a motor runs, and RobotUnreachable if the Uno does not answer.
    """
    previous = uno.settings()
    settings = change(previous)
    if settings != previous:
        _check_at_rest(uno)
        uno.disarm()
        time.sleep(0.05)
        uno.store_settings(settings)
    return StoredSettings(uno.settings())


def _check_at_rest(uno: "Uno") -> None:
    uno.receive()
    time.sleep(TELEMETRY_TIMEOUT_S)
    telemetry_frames = uno.receive()
    if any(duty for telemetry in telemetry_frames[-1:] for duty in telemetry.applied_duty):
        left, right = telemetry_frames[-1].applied_duty
        raise AnswerNo.of("settings.motor-runs", left=left, right=right)


def show_counts(uno: "Uno", seconds: float, notify: Callable[[str], object]) -> None:
    """Pass battery, encoder counts and marks to `notify` whenever counts or marks change, for `seconds` [s]."""
    previous = None
    for _poll in range(round(seconds / POLL_PERIOD_S)):
        time.sleep(POLL_PERIOD_S)
        for newest_telemetry in uno.receive()[-1:]:
            if (newest_telemetry.counts, newest_telemetry.marks) != previous:
                previous = (newest_telemetry.counts, newest_telemetry.marks)
                notify(
                    _(
                        "battery {battery_v:.2f} V, counts left {left}, right {right}, marks {marks}",
                        battery_v=newest_telemetry.battery_v,
                        left=newest_telemetry.counts[0],
                        right=newest_telemetry.counts[1],
                        marks=newest_telemetry.marks,
                    )
                )
