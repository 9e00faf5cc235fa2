"""Options that several verbs share, and what they stand for."""

from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any

import click

from baqueano.cli.terminal import talk

OWN_FILE = Path("vehicle.toml")

as_json = click.option("--json", "as_json", is_flag=True, help="One JSON object with rows and a verdict.")
seed = click.option("--seed", default=0, show_default=True, help="All randomness of a simulation comes from it.")
backend = click.option(
    "--backend",
    type=click.Choice(["auto", "c", "python", "numpy"]),
    default="auto",
    show_default=True,
    help="How blocks are computed; 'numpy' runs them as they are written.",
)
runs_folder = click.option(
    "--runs", "folder", default="runs", show_default=True, help="The folder in which runs are numbered."
)
out = click.option("-o", "--out", type=click.Path(path_type=Path), help="Where to write; default: the next run.")
page = click.option("--report", "page", type=click.Path(path_type=Path), help="Also write an HTML report.")
update = click.option("--update", is_flag=True, help="Write the result into the vehicle file.")


def together(*options: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Several options as one decorator, in the order in which --help shows them."""
    return lambda command: reduce(lambda f, option: option(f), reversed(options), command)


vehicle = together(
    click.option(
        "--vehicle",
        "vehicle",
        metavar="FILE|NAME",
        help="A vehicle file, or one of the garage (case-study-1, small, car). Default: ./vehicle.toml, else small.",
    ),
    click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Win over the file: --set model.mass_kg=0.7"),
)
robot = click.option(
    "--robot",
    default="simulated",
    show_default=True,
    metavar="simulated[:FILE|NAME]",
    help="What is driven: a simulation of the vehicle file, or of another file as the truth.",
)


def load_vehicle(name: str | None, settings: tuple[str, ...]) -> Any:
    """The vehicle file that is meant, with what the command line changes; says what is in force."""
    from baqueano.vehicle_file import load, override

    if name is None:
        name = str(OWN_FILE) if OWN_FILE.exists() else "small"
        talk(f"vehicle: {name}" + ("" if OWN_FILE.exists() else " (of the garage; --vehicle names another)"))
    file = load(name)
    for setting in settings:
        talk(f"  set on the command line: {setting}")
    return override(file, settings) if settings else file


def load_truth(robot: str, vehicle: Any) -> Any:
    """The vehicle file of the robot that is driven."""
    from baqueano.errors import UsageError
    from baqueano.vehicle_file import load

    kind, _, truth = robot.partition(":")
    if kind != "simulated":
        raise UsageError(
            f"--robot {robot}: there is no way to reach such a robot yet; expected 'simulated', or "
            "'simulated:FILE' for the simulation of another vehicle file. Type: --robot simulated"
        )
    return load(truth) if truth else vehicle


def run_path(out: Path | None, folder: str, label: str) -> Path:
    """The file a new run goes to."""
    from baqueano.runs.folder import claim

    return out if out is not None else claim(folder, label)


def find_runs(names: tuple[str, ...], folder: str) -> list[Any]:
    """The runs of that name, number or path; `last` is the newest."""
    from baqueano.runs import read_run
    from baqueano.runs.folder import find

    found = [read_run(find(name, folder)) for name in names]
    for run in found:
        for note in run.notes:
            talk(f"{run.name}: {note}")
    return found


def kept(vehicle: Any, update: bool) -> None:
    """Save a changed vehicle file where it came from, or say how."""
    if not update:
        talk("To keep this in the vehicle file, add --update.")
        return
    path = vehicle.save(None if vehicle.path is not None else OWN_FILE)
    talk(f"written into {path}")
