"""baqueano new."""

from importlib.resources import files
from pathlib import Path

import click

from baqueano.cli.terminal import talk, tell

BLOCKS = ("my_estimator.py", "my_controller.py")


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
        raise UsageError(f"{folder} exists and is not empty. Choose another name: baqueano new {name}-2")
    file = load(vehicle)
    folder.mkdir(parents=True, exist_ok=True)
    file.save(folder / "vehicle.toml")
    for block in BLOCKS:
        text = files("baqueano.cli.project").joinpath(block).read_text(encoding="utf-8")
        (folder / block).write_text(text, encoding="utf-8", newline="\n")
    tell(f"{folder}: vehicle.toml, {', '.join(BLOCKS)}")
    talk(f"next: cd {name}, then baqueano experiment")
