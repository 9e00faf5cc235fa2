"""Define `baqueano new`: create a project folder."""

import click

from baqueano.cli.terminal import print_message, print_result
from baqueano.diagnostics import note
from baqueano.messages.printable import baqueano_command, shell_command


@click.command(help="Make the project folder NAME: vehicle file, blocks of your own, and a notebook.")
@click.argument("name")
@click.option(
    "--vehicle",
    metavar="FILE|NAME",
    default="small",
    show_default=True,
    help="Vehicle file to copy: a path, or a name of the garage.",
)
def command(name: str, vehicle: str) -> None:
    from baqueano.project import new
    from baqueano.project.folder import BLOCKS, NOTEBOOK
    from baqueano.vehicle_file import load

    folder = new(name, vehicle)
    print_result(note("cli.new", folder=folder, blocks=(*BLOCKS, NOTEBOOK)))
    if load(folder / "vehicle.toml").is_guess:
        print_message(note("cli.guesses"))
    print_message(note("cli.next-new", cd=shell_command("cd", name), fix=baqueano_command("experiment")))
