"""baqueano new."""

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import click

from baqueano.cli.terminal import talk, tell
from baqueano.command_line import typed
from baqueano.diagnostics import fault, note

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

BLOCKS = ("my_estimator.py", "my_controller.py")
GUESSES = """{text}

# Nobody measured your vehicle yet. `baqueano identify last --update` writes what it measures below this table.
[provenance.model]
run = "baqueano new, from {name}"
verdict = "GUESS"
"""


@click.command(help="Make the project folder NAME: vehicle file, an estimator and a controller of your own.")
@click.argument("name")
@click.option(
    "--vehicle",
    default="small",
    show_default=True,
    help="The file to begin with: a path, or one of the garage.",
)
def command(name: str, vehicle: str) -> None:
    from baqueano.errors import UsageError
    from baqueano.vehicle_file import load

    folder = Path(name)
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(fault("cli.folder-not-empty", typed("new", f"{name}-2"), folder=folder))
    file = as_guess(load(vehicle))
    folder.mkdir(parents=True, exist_ok=True)
    file.save(folder / "vehicle.toml")
    for block in BLOCKS:
        text = files("baqueano.cli.project").joinpath(block).read_text(encoding="utf-8")
        (folder / block).write_text(text, encoding="utf-8", newline="\n")
    tell(note("cli.new", folder=folder, blocks=BLOCKS))
    if file.guessed:
        talk(note("cli.guesses"))
    talk(note("cli.next-new", name=name))


def as_guess(file: "VehicleFile") -> "VehicleFile":
    """The file, and in it that the numbers of its model are guesses; one with numbers of a fit as it is."""
    from baqueano.vehicle_file import parse

    if not file.guessed or "model" in file.provenance:
        return file
    text = file.text
    text = GUESSES.format(text=text.rstrip("\n"), name=file.name)
    return parse(text, file.label, file.path, file.layers, file.on_disk)
