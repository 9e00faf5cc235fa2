"""Define options that several subcommands share, and the functions that evaluate them."""

from collections.abc import Callable
from functools import reduce, wraps
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from baqueano.cli import numbers
from baqueano.cli.subcommands import BACKENDS
from baqueano.cli.terminal import print_message
from baqueano.contracts.names import STORED_ROUTES
from baqueano.diagnostics import StopReason, note
from baqueano.errors import FileError, Interruption, SafetyStop, UsageError
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.guides.route import Route
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile

Decorator = Callable[[Any], Any]  # of a command or of its function
DEFAULT_FILE = Path("vehicle.toml")

as_json = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object with rows and a verdict."
)
seed = click.option(
    "--seed", type=numbers.count_or_none, default=0, show_default=True,
    help="Seed of the random numbers.",
)  # fmt: skip


def seeds(default: int, help: str) -> Decorator:
    """Return the option for the number of seeds, which are counted from --seed."""
    return click.option(
        "--seeds", "seed_count", type=numbers.count, default=default, show_default=True, help=help
    )


seconds = click.option(
    "--seconds", type=numbers.seconds, default=60.0, show_default=True, help="Duration of a drive [s]."
)
rest = click.option(
    "--rest", "rest_s", type=numbers.time_s,
    help="Time at rest before the drive, to measure the bias of the gyro [s]; by default 2, or 0 without a gyro.",
)  # fmt: skip
backend = click.option(
    "--backend",
    type=click.Choice(BACKENDS),
    default="auto",
    show_default=True,
    help="How blocks are computed: compiled with C, with Python, or as they are written ('numpy').",
)
runs_folder = click.option(
    "--runs",
    "folder",
    default="runs",
    metavar="FOLDER",
    show_default=True,
    help="Folder of the numbered runs.",
)
out = click.option(
    "-o", "--out", type=click.Path(path_type=Path), help="File to write; default: the next run."
)
shake = click.option(
    "--shake",
    multiple=True,
    metavar="WHEN: WHAT",
    help=(
        'A fault of the simulation: "12 s: push 0.3 N s left" or "3-6 s: cut imu". Repeat the '
        "option for more faults."
    ),
)
align = click.option(
    "--align", type=click.Choice(["none", "start", "rigid"]), default="none", show_default=True,
    help="Alignment of the estimated path with the true path.",
)  # fmt: skip
estimator = click.option(
    "--estimator", metavar="FILE:CLASS", help="Estimator that replaces the estimator of the vehicle file."
)
drives_folder = click.option(
    "--keep", "drives_folder", type=click.Path(path_type=Path, file_okay=False),
    help="Folder for finished drives: an interrupted command continues from it. Delete it after a change of the code.",
)  # fmt: skip
update = click.option("--update", is_flag=True, help="Write the result into the vehicle file.")


class GroupedCommand(click.Command):
    """A command whose help shows its options under headings; `groups` is {heading: names of options}."""

    def __init__(self, *args: Any, groups: dict[str, tuple[str, ...]], **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.groups = groups

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of each heading; the options without a group are last."""
        shown_options = [option for option in self.get_params(ctx) if isinstance(option, click.Option)]
        records = {
            option.name: record
            for option in shown_options
            if (record := option.get_help_record(ctx)) is not None
        }
        ungrouped_names = tuple(
            name for name in records if not any(name in names for names in self.groups.values())
        )
        for heading, names in {**self.groups, _("Other options"): ungrouped_names}.items():
            with formatter.section(_(heading)):
                formatter.write_dl([records[name] for name in names])


def combine_options(*options: Decorator) -> Decorator:
    """Return one decorator that adds several options, in the order in which --help shows them."""
    return lambda command: reduce(lambda f, option: option(f), reversed(options), command)


def collect(argument: str, make: Callable[..., object]) -> Decorator:
    """Return a decorator below all options of a command: the parameters of `make` reach the command as one object."""
    names = signature(make).parameters

    def decorate(command: Callable[..., object]) -> Callable[..., object]:
        @wraps(command)
        def wrapper(*args: object, **values: object) -> object:
            own_values = {name: values.pop(name) for name in names if name in values}
            return command(*args, **{argument: make(**own_values)}, **values)

        return wrapper

    return decorate


settings = click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE",
    help="Value that replaces a value of the vehicle file: --set model.mass_kg=0.7",
)  # fmt: skip


def _vehicle_file_options(help: str) -> Decorator:
    """Return the options of a vehicle file and of its values, with this help of --vehicle."""
    return combine_options(click.option("--vehicle", "vehicle", metavar="FILE|NAME", help=help), settings)


vehicle = _vehicle_file_options(
    help="A vehicle file, or a name of the garage (case-study-1, small, car). Default: vehicle.toml, else small."
)
run_vehicle_option = _vehicle_file_options(
    help="A vehicle file, or a name of the garage (case-study-1, small, car). Default: the file stored in the run."
)
speed_and_size = combine_options(
    click.option(
        "--speed", "speed_m_s", type=numbers.speed, default=0.25, show_default=True,
        help="Speed along a shape [m/s].",
    ),
    click.option(
        "--size", "size_m", type=numbers.length, default=1.0, show_default=True,
        help="Radius of a circle, or half the length of another shape [m].",
    ),
)  # fmt: skip
robot = click.option(
    "--robot",
    default="simulated",
    show_default=True,
    metavar="simulated[:FILE|NAME]|emulated|HOST|here",
    help=(
        "Vehicle: a simulation of this or of another vehicle file, its firmware on an emulated board, a "
        "vehicle by ssh, or this computer (here)."
    ),
)


def refuse_together(name: str, *names: str) -> None:
    """Raise UsageError if one of these parameters was typed, because it has no effect together with `name`."""
    for option in _typed_options(names):
        raise UsageError.of("cli.options-together", option=option, second_option=name)


def refuse_without(required_name: str, *names: str) -> None:
    """Raise UsageError if one of these parameters was typed, because it has no effect without `required_name`."""
    for option in _typed_options(names):
        raise UsageError.of("cli.option-needs", option=option, second_option=required_name)


def _typed_options(names: tuple[str, ...]) -> list[str]:
    """Return the options of this command line that belong to these parameters, in the order of the help."""
    context = click.get_current_context()
    typed_sources = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
    return [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in names and context.get_parameter_source(parameter.name) in typed_sources
    ]


def load_vehicle(name: str | None, settings: tuple[str, ...]) -> "VehicleFile":
    """Return the vehicle file `name`, or the default file, with its changes. Print a default name and the changes."""
    from baqueano.vehicle_file import load

    if name is None:
        name = str(DEFAULT_FILE) if DEFAULT_FILE.exists() else "small"
        print_message(note("cli.vehicle" if DEFAULT_FILE.exists() else "cli.vehicle-of-garage", name=name))
    vehicle_file = load(name)
    for setting in settings:
        print_message(note("cli.set", setting=setting))
    if not settings:
        return vehicle_file
    from baqueano.vehicle_file import override

    return override(vehicle_file, settings)


def is_measured(vehicle_file: "VehicleFile", robot: str) -> bool:
    """Return True if the model was fitted, or if it is a vehicle of the garage in its own simulation."""
    return not vehicle_file.is_guess or (vehicle_file.path is None and robot in ("simulated", "emulated"))


def advise_to_measure(vehicle_file: "VehicleFile", robot: str = "simulated") -> None:
    """Print the commands to type first if the model was not measured.

    In a simulation, a vehicle of the garage is its own truth, so this advice is not printed.
    """
    if is_measured(vehicle_file, robot):
        return
    vehicle_options = vehicle_and_runs_options(vehicle_file)
    robot_options = [] if robot == "simulated" else ["--robot", robot]
    print_message(
        note(
            "cli.measure-first",
            vehicle=vehicle_file.label,
            experiment=baqueano_command("experiment", *vehicle_options, *robot_options),
            identify=baqueano_command("identify", "last", *vehicle_options, "--update"),
        )
    )


def vehicle_and_runs_options(vehicle_file: "VehicleFile", folder: str = "runs") -> list[str]:
    """Return the options with which the next command uses the same vehicle and the same folder of runs."""
    name = vehicle_file.layers[0].removeprefix("garage: ")
    if vehicle_file.path is not None:
        name = str(
            vehicle_file.path.relative_to(cwd)
            if vehicle_file.path.is_relative_to(cwd := Path.cwd())
            else vehicle_file.path
        )
    vehicle = [] if name == (str(DEFAULT_FILE) if DEFAULT_FILE.exists() else "small") else ["--vehicle", name]
    return vehicle + runs_option(folder)


def runs_option(folder: str) -> list[str]:
    """Return the option of a folder of runs; [] for the usual one."""
    return [] if folder == "runs" else ["--runs", folder]


def load_truth(robot: str, vehicle_file: "VehicleFile") -> "VehicleFile":
    """Return the vehicle file of the simulated or emulated robot: FILE of "simulated:FILE", or the truth of
    `vehicle_file`."""
    from baqueano.vehicle_file import load

    _, _, truth_path = robot.partition(":")
    return vehicle_file.simulation_truth(load(truth_path)) if truth_path else vehicle_file.truth


def run_path(out: Path | None, folder: str, label: str) -> Path:
    """Return the file for a new run.

    Without `out`, a numbered name in `folder` is reserved: call this function last, after all checks. Raise FileError
    if `out` exists.
    """
    from baqueano.runs.folder import path_of_run, release_path, reserve_path

    if out is not None:
        if out.is_file():
            raise FileError.of("cli.file-exists", "-o FILE", path=out)
        return path_of_run(out, label)
    path = reserve_path(folder, label)
    click.get_current_context().call_on_close(lambda: release_path(path))
    return path


def find_route(name: str) -> "Route":
    """Return the stored route: `lab` is routes/lab.csv; a name with a file extension is a path.

    Raise FileError if it is missing.
    """
    from baqueano.runs.route_file import absent_route, read_route

    path = route_path(name)
    if not path.is_file():
        raise FileError(absent_route(name, path, *_vehicle_argument()))
    if b"\0" in path.read_bytes()[:1000]:
        raise FileError.of("cli.route-not-text", baqueano_command("teach", path.stem), path=path)
    return read_route(path)


def _vehicle_argument() -> tuple[str, ...]:
    """Return the option --vehicle of the present command, if the user gave it."""
    vehicle = click.get_current_context().params.get("vehicle")
    return ("--vehicle", str(vehicle)) if vehicle else ()


def route_path(name: str) -> Path:
    """Return the path of a route: `lab` is routes/lab.csv; a name with a file extension is a path.

    Raise UsageError for a vehicle file.
    """
    if Path(name).suffix == ".toml":
        raise UsageError.of("route.ending", path=name)
    return Path(name) if Path(name).suffix else STORED_ROUTES / f"{name}.csv"


def block_kind(vehicle_file: "VehicleFile | None", role: str, kind: str | None) -> str | None:
    """Return `kind` of --estimator, --guide or --controller. Raise FileError if it cannot be loaded.

    `vehicle_file` is None without a vehicle file.
    """
    from baqueano.blocks import check_step, resolve

    if kind is not None:
        try:
            block_class = resolve(
                role,
                kind,
                vehicle_file.path.parent
                if vehicle_file is not None and vehicle_file.path is not None
                else None,
            )
        except FileError as error:
            is_own = ":" in kind
            if is_own and "suggestion" in error.diagnostic.figures:
                raise FileError.of("cli.own-name", role=role, kind=kind, cause=error.diagnostic) from error
            code, fix = ("cli.own-file", ("check", kind)) if is_own else ("cli.own-block", ("ls",))
            command = baqueano_command("blocks", *fix)
            raise FileError.of(code, command, role=role, kind=kind, cause=error.diagnostic) from error
        check_step(role, block_class, lambda owner: f"--{owner} {kind}")
    return kind


def raise_stop(run: "Run", path: Path, are_warnings_printed: bool = False) -> None:
    """Raise SafetyStop, or Interruption after Ctrl-C, for a stopped drive, whose run is stored at `path`.
    Return if the drive was not stopped. Print the warnings of the run, if its table has not printed them.
    """
    from baqueano.drive import drive_stop_reason

    if not are_warnings_printed:
        print_warnings(run)
    stop_reason = drive_stop_reason(run)
    if stop_reason is None:
        return
    if stop_reason.code == StopReason.INTERRUPTED:
        raise Interruption.of("cli.drive-interrupted", path=path, duration_s=run.duration_s)
    raise SafetyStop.of("cli.stopped", baqueano_command("runs", "show", path), cause=stop_reason, path=path)


def print_warnings(run: "Run") -> None:
    """Print the warnings of a run about its model and noise, and about degraded sensors."""
    for event in run.events:
        if event.source in ("drive", "model", "sensors") and event.level == "warning":
            print_message(note("cli.warning", cause=event.diagnostic or event.text))


def find_runs(names: tuple[str, ...], folder: str) -> "list[Run]":
    """Return the runs of these names, numbers or paths; `last` is the newest run.
    `3-28` and `trial*` select several runs; a run that several names select is returned once.
    Raise FileError if a name does not select a run.
    """
    from baqueano.runs import read_run
    from baqueano.runs.folder import find_all

    paths = {path.resolve(): path for name in names for path in find_all(name, folder)}
    loaded_runs = [read_run(path) for path in paths.values()]
    for run in loaded_runs:
        for cause in run.notes:
            print_message(note("cli.run-note", run=run.name, cause=cause))
    return loaded_runs


def save_update(vehicle_file: "VehicleFile", update: bool, *next_words: str) -> None:
    """Save a changed vehicle file to its path, or print the option that saves it. `next_words`: the next command."""
    if not update:
        print_message(note("cli.update-advice"))
        return
    path = vehicle_file.save(None if vehicle_file.path is not None else DEFAULT_FILE)
    print_message(note("cli.written", path=path))
    if next_words:
        vehicle = [] if vehicle_file.path is None else vehicle_and_runs_options(vehicle_file)
        print_message(note("cli.next-command", fix=baqueano_command(*next_words, *vehicle)))
