"""Define `baqueano robot settings`: show and set the settings that the Uno stores, here or at a HOST over ssh."""

from collections.abc import Mapping
from typing import Any

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import print_answer, print_message

WATCH_S = 20.0
REVERSED_HELP, SWAPPED = "straight|reversed", "straight|swapped"
NAMES = {  # option: its values, help; names and ranges as in robot/uno/settings.py
    "bridge": ("l298n|tb6612|l293d", "Type of the motors' bridge."),
    "encoders": ("none|single|quadrature", "Type of the encoders at D2, D4 (left) and D3, D7 (right)."),
    "left-motor": (REVERSED_HELP, "Polarity of the two wires of this motor."),
    "right-motor": (REVERSED_HELP, "Polarity of the two wires of this motor."),
    "motors": (SWAPPED, "Left and right motor: as wired, or swapped."),
    "left-encoder": (REVERSED_HELP, "Order of the wires A and B of this encoder."),
    "right-encoder": (REVERSED_HELP, "Order of the wires A and B of this encoder."),
    "encoder-plugs": (SWAPPED, "Left and right encoder: as plugged in, or swapped."),
    "mark": ("high|low", "Level at the output of the lap-mark sensor when it is over the tape."),
    "battery-ratio": ("RATIO", "Voltage of the battery divided by that of A0: 3 for 20 kΩ and 10 kΩ."),
    "kick-ms": ("MS", "Shortest duration of the kick of a wheel that starts [ms]."),
    "dither": ("FRACTION", "Dither: duty that is alternately added and subtracted, against stiction."),
    "dither-ms": ("MS", "Time after which the dither changes its sign [ms]."),
}
WHEEL_SETTINGS = {
    "dead-zone": (
        "Duty below which this wheel does not turn in this direction; calibrate motors measures it."
    ),
    "slope": "Duty beyond the dead zone for a command of 1; calibrate motors measures it.",
    "kick": "Smallest duty while a wheel starts, for --kick-ms.",
}
choices = options.combine_options(
    *(click.option(f"--{name}", metavar=metavar, help=text) for name, (metavar, text) in NAMES.items()),
    *(
        click.option(f"--{name}", multiple=True, metavar="DIRECTION=FRACTION", help=text)
        for name, text in WHEEL_SETTINGS.items()
    ),
)


@click.command(
    help=(
        "Show or set the settings stored in the Uno: bridge, encoders, lap mark, polarity, and dead zone "
        "and slope of each wheel. Without options, the settings are shown. DIRECTION is left-forwards, "
        "left-backwards, right-forwards, right-backwards or all."
    )
)
@click.argument("host", default="here")
@choices
@click.option("--defaults", is_flag=True, help="Restore the default values of the firmware first.")
@click.option("--watch", "watch_s", type=numbers.seconds, is_flag=False, flag_value=WATCH_S, metavar="[SECONDS]",
              help=("Show battery, counts and marks while they change (turn a wheel by hand); "
                   "default: 20 s."))  # fmt: skip
@options.vehicle
@options.as_json
def settings(
    host: str, defaults: bool, watch_s: float | None, vehicle: str | None, settings: tuple[str, ...],
    as_json: bool, **new_values: Any,
) -> None:  # fmt: skip
    from baqueano.robot.uno import settings as uno_settings
    from baqueano.robot.uno.frames import Settings
    from baqueano.robot.uno.serial_port import open_uno
    from baqueano.robot.workshop.exclusive_hardware import fetch_result, stopped_service

    changes = option_values(new_values)
    uno_settings.apply_changes(Settings(), changes)  # a wrong value is reported before the hardware is opened
    if host == "here":
        vehicle_file = options.load_vehicle(vehicle, settings)
        with stopped_service(print_message), open_uno(vehicle_file.robot.port) as uno:
            stored_settings = uno_settings.store(
                uno,
                lambda stored_settings: uno_settings.apply_changes(
                    Settings() if defaults else stored_settings, changes
                ),
            )
            if watch_s is not None:
                uno_settings.show_counts(uno, watch_s, print_message)
    else:
        arguments = [f"--{name}={text}" for name, texts in changes.items() for text in texts]
        arguments += ["--defaults"] if defaults else []
        arguments += [] if watch_s is None else [f"--watch={watch_s:g}"]
        verb = ("robot", "settings", *arguments)
        stored_settings = fetch_result(uno_settings.StoredSettings.from_rows, host, *verb)
    print_answer(stored_settings, as_json)


def option_values(typed_values: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return option name → typed values, without omitted options."""
    changes: dict[str, list[str]] = {}
    for name in (*NAMES, *WHEEL_SETTINGS):
        value = typed_values[name.replace("-", "_")]
        if value is not None and value != ():
            changes[name] = list(value) if name in WHEEL_SETTINGS else [value]
    return changes
