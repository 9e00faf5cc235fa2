"""Define `baqueano new`: make a project folder."""

import click

from baqueano.cli.terminal import talk, tell
from baqueano.diagnostics import note
from baqueano.printable import quoted, typed


@click.command(help="Make the project folder NAME: vehicle file, blocks of your own, and a notebook.")
@click.argument("name")
@click.option(
    "--vehicle",
    default="small",
    show_default=True,
    help="Vehicle file to copy: a path, or a name of the garage.",
)
def command(name: str, vehicle: str) -> None:
    from baqueano.project import new
    from baqueano.project.folder import BLOCKS, NOTEBOOK
    from baqueano.vehicle_file import load

    folder = new(name, vehicle)
    tell(note("cli.new", folder=folder, blocks=(*BLOCKS, NOTEBOOK)))
    if load(folder / "vehicle.toml").guessed:
        talk(note("cli.guesses"))
    talk(note("cli.next-new", cd=quoted("cd", name), fix=typed("experiment")))
