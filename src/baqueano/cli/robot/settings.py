"""baqueano robot settings: what the Uno keeps of its vehicle, shown and set; at a HOST by ssh."""

from collections.abc import Mapping
from typing import Any

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import answer, talk

WATCH_S = 20.0
TURNED, SWAPPED = "straight|reversed", "straight|swapped"
NAMES = {  # option: what is typed behind it, help; names and ranges are those of robot/uno/settings.py
    "bridge": ("l298n|tb6612|l293d", "The motors' bridge."),
    "encoders": ("none|single|quadrature", "What is wired to D2, D4 (left) and D3, D7 (right)."),
    "left-motor": (TURNED, "How its two wires are plugged in."),
    "right-motor": (TURNED, "How its two wires are plugged in."),
    "motors": (SWAPPED, "Whether left and right changed places."),
    "left-encoder": (TURNED, "A and B of a quadrature encoder."),
    "right-encoder": (TURNED, "A and B of a quadrature encoder."),
    "encoder-plugs": (SWAPPED, "Whether left and right changed places."),
    "mark": ("high|low", "Output of the lap mark's sensor over the tape."),
    "battery-ratio": ("RATIO", "Battery over A0: 3 for 20 kΩ and 10 kΩ."),
    "kick-ms": ("MS", "How long a wheel that starts gets its kick at least."),
    "dither": ("SHARE", "Duty that is added and taken away in turn, against stiction."),
    "dither-ms": ("MS", "After which dither changes its sign."),
}
WAYS = {
    "dead-zone": "Duty below which this wheel stands in this direction; calibrate motors finds it.",
    "slope": "Duty beyond the dead zone at a request of 1; calibrate motors finds it.",
    "kick": "Least duty while a wheel starts, for --kick-ms.",
}
choices = options.together(
    *(click.option(f"--{name}", metavar=what, help=text) for name, (what, text) in NAMES.items()),
    *(
        click.option(f"--{name}", multiple=True, metavar="WAY=SHARE", help=text)
        for name, text in WAYS.items()
    ),
)


@click.command(
    help="What the Uno keeps of this vehicle: bridge, encoders, lap mark, polarity, and each wheel's dead zone and "
    "slope. Options change it; without one it is shown. WAY is left-forwards, left-backwards, right-forwards, "
    "right-backwards or all."
)
@click.argument("host", default="here")
@choices
@click.option("--defaults", is_flag=True, help="First back to what the firmware begins with.")
@click.option("--watch", "watch_s", type=numbers.seconds, is_flag=False, flag_value=WATCH_S, metavar="[SECONDS]",
              help="Tell battery, counts and marks as they change: turn a wheel by hand; default 20 s.")  # fmt: skip
@options.vehicle
@options.as_json
def settings(
    host: str, defaults: bool, watch_s: float | None, vehicle: str | None, settings: tuple[str, ...],
    as_json: bool, **given: Any,
) -> None:  # fmt: skip
    from baqueano.robot import VEHICLE
    from baqueano.robot.uno import settings as uno_settings
    from baqueano.robot.uno.frames import Settings
    from baqueano.robot.uno.serial_port import connected
    from baqueano.robot.workshop.exclusive_hardware import service_off, there

    wanted = typed(given)
    uno_settings.changed(Settings(), wanted)  # a wrong one is reported before anything is opened
    if host == "here":
        file = options.load_vehicle(vehicle, settings)
        with service_off(talk), connected(file.robot.port) as uno:
            kept = uno_settings.store(
                uno, lambda before: uno_settings.changed(Settings() if defaults else before, wanted)
            )
            if watch_s is not None:
                uno_settings.watch(uno, watch_s, talk)
    else:
        words = [f"--{name}={text}" for name, texts in wanted.items() for text in texts]
        words += ["--defaults"] if defaults else []
        words += [] if watch_s is None else [f"--watch={watch_s:g}"]
        kept = uno_settings.StoredSettings.of(there(host, "robot", "settings", "--vehicle", VEHICLE, *words))
    answer(kept, as_json)


def typed(given: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return the typed values by the name of their option, without those left out."""
    found: dict[str, list[str]] = {}
    for name in (*NAMES, *WAYS):
        said = given[name.replace("-", "_")]
        if said is not None and said != ():
            found[name] = list(said) if name in WAYS else [said]
    return found
