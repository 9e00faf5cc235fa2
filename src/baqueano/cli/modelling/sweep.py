"""Define `baqueano sweep`: compare blocks on the same drives or runs."""

import math
from collections.abc import Callable, Iterable
from functools import partial
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from baqueano.cli import numbers, options
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.terminal import print_answer, print_message, show_progress
from baqueano.contracts.names import GAINS_CHOICES
from baqueano.diagnostics import note
from baqueano.errors import BaqueanoError, Interruption, UsageError
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

MATCHES = f"{__name__}.matches"  # of a context: each name that a pattern gave, and if it can be used
LoadedT = TypeVar("LoadedT")

cluster = click.option(
    "--cluster", metavar="ADDRESS", help=("Dask scheduler to use instead of the processors of this computer.")
)


def matching_names(
    context: click.Context, option: click.Parameter, names: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the names, with a pattern such as */my_controller.py:MyController or */vehicle.toml replaced by the
    matching files.
    """
    all_names: list[str] = []
    for name in names:
        pattern, colon, class_name = name.rpartition(":") if ".py:" in name else (name, "", "")
        if "*" not in pattern:
            all_names.append(name)
            continue
        paths = [Path(path) for path in sorted(glob(pattern))]
        if not paths:
            raise UsageError.of("cli.no-match", value=pattern, folder=Path.cwd().name)
        matches = [f"{path.as_posix()}{colon}{class_name}" for path in paths]
        is_usable = {match: True for match in matches if match not in names}
        context.meta.setdefault(MATCHES, {}).update(is_usable)
        all_names += matches
    return tuple(all_names)


def load_usable(names: Iterable[str], load: Callable[[str], LoadedT]) -> dict[str, LoadedT]:
    """Return what `load` returns for each name. If it refuses a match of a pattern, print the error and omit the
    match: one wrong file of a class must not stop the others. Raise the error if no name is left.
    """
    values: dict[str, LoadedT] = {}
    errors: list[BaqueanoError] = []
    matches = click.get_current_context().meta.get(MATCHES, {})
    for name in names:
        try:
            values[name] = load(name)
        except BaqueanoError as error:
            if name not in matches:
                raise
            matches[name] = False
            errors.append(error)
    if errors and not values:
        raise errors[0]
    for error in errors:
        print_message(error.message)
    return values


def check_block(vehicle_file: "VehicleFile | None", gains: str, role: str, kind: str) -> None:
    """Load a block, and build it from the vehicle file if this needs no route."""
    from baqueano.sweep.gains import build_controller, find_gains

    if not (role == "controller" and kind.endswith(".toml")):
        options.block_kind(vehicle_file, role, kind)
    if role == "controller" and vehicle_file is not None:
        build_controller(vehicle_file, find_gains(vehicle_file, kind, gains))


def _advise_to_measure(files: "list[VehicleFile]") -> None:
    """Print the vehicle files whose model was not measured, with the command that measures the first of them."""
    if len(files) == 1:
        return options.advise_to_measure(files[0])
    if guesses := [file for file in files if not options.is_measured(file, "simulated")]:
        vehicle_options = "--vehicle", guesses[0].path or guesses[0].name
        fix = baqueano_command(
            "experiment", *vehicle_options, "--signal", "designed", "--rounds", "3", "--update"
        )
        print_message(note("sweep.guesses", fix=fix, names=[file.label for file in guesses]))


def print_omitted() -> None:
    """Print the matches of patterns that could not be used."""
    matches = click.get_current_context().meta.get(MATCHES, {})
    if names := [name for name, is_usable in matches.items() if not is_usable]:
        print_message(note("sweep.omitted", count=len(names), total=len(matches), names=names))


BLOCK_OPTIONS = [
    click.option(
        f"--{role}",
        f"{role}s",
        multiple=True,
        metavar="KIND",
        callback=matching_names,
        help=(
            'Block to compare: a name, "file.py:Class", or "*/file.py:Class" for all such files. Repeat the option for '
            'more. A controller "pd.toml" is that of this vehicle file, with its gains.'
            if role == "controller"
            else 'Block to compare: a name, "file.py:Class", or "*/file.py:Class" for all such files. Repeat the '
            "option for more."
        ),
    )
    for role in ("estimator", "controller", "guide")
]


@click.command(help="Compare blocks on the same simulated drives, or estimators on recorded RUNS.")
@click.argument("runs", nargs=-1)
@click.option(
    "--vehicle", "vehicles", multiple=True, metavar="FILE|NAME", callback=matching_names,
    help=(
        'Vehicle file, a name of the garage, or "*/vehicle.toml". Repeat it for more. Default: vehicle.toml, else '
        "small."
    ),
)  # fmt: skip
@options.settings
@options.combine_options(*BLOCK_OPTIONS)
@click.option(
    "--gains", type=click.Choice(GAINS_CHOICES), default=GAINS_CHOICES[0], show_default=True,
    help="Gains of a controller of a file: those of vehicle.toml in its folder (own), or of the driven vehicle.",
)  # fmt: skip
@click.option(
    "--route", "routes", multiple=True, metavar="SHAPE|NAME",
    help="Route: a shape, or a stored route. Repeat the option for more.",
)  # fmt: skip
@options.speed_and_size
@options.seed
@click.option(
    "--seeds",
    type=numbers.count,
    default=5,
    show_default=True,
    help=("Number of seeds, counted from --seed."),
)
@click.option(
    "--laps", type=numbers.count, default=1, show_default=True, help="Number of laps of each drive."
)
@click.option(
    "--offset", "offset_m", type=numbers.Number("m", low=-100.0), default=0.0, show_default=True,
    help="Distance to the left of the route at the start of the drive [m].",
)  # fmt: skip
@options.align
@click.option(
    "--reference",
    metavar="BLOCKS",
    help="Combination of blocks with which the others are compared; default: the first.",
)
@options.drives_folder
@cluster
@options.backend
@options.runs_folder
@report_options
@options.as_json
def command(
    runs: tuple[str, ...], vehicles: tuple[str, ...], settings: tuple[str, ...], estimators: tuple[str, ...],
    controllers: tuple[str, ...], guides: tuple[str, ...], gains: str, routes: tuple[str, ...], speed_m_s: float,
    size_m: float, seed: int, seeds: int, laps: int, offset_m: float, align: str, reference: str | None,
    drives_folder: Path | None, cluster: str | None, backend: str, folder: str, report: ReportFiles, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.cli.driving.teach import shape_or_route
    from baqueano.sweep import sweep

    run_sweep = partial(
        sweep,
        reference=reference,
        drives_folder=drives_folder,
        cluster=cluster,
        alignment=align,
        backend=backend,
    )
    if runs:
        for factor, values in (("controllers", controllers), ("guides", guides), ("routes", routes)):
            if values:
                raise UsageError.of("sweep.of-runs", factor=factor, recorded_runs=list(runs))
        options.refuse_together("RUNS", "seed", "seeds", "laps", "offset_m", "gains")
        if len(vehicles) > 1:
            raise UsageError.of("sweep.several-vehicles", value=list(vehicles))
        recorded_runs = options.find_runs(runs, folder)
        files = [options.load_vehicle(*vehicles or (None,), settings)] if vehicles or settings else []
        run_sweep = partial(run_sweep, recorded_runs, vehicle=next(iter(files), None))
        drive_count = len(recorded_runs)
    else:
        files = list(load_usable(vehicles, lambda name: options.load_vehicle(name, settings)).values())
        files = files or [options.load_vehicle(None, settings)]
        named_routes = {
            name: shape_or_route(name, speed_m_s, size_m) for name in routes or ("sinuous-circle",)
        }
        arguments = {
            "routes": named_routes,
            "seeds": range(seed, seed + seeds),
            "laps": laps,
            "start": (0.0, offset_m, 0.0),
            "gains": gains,
        }
        run_sweep = partial(run_sweep, files, **arguments)
        drive_count = len(files) * len(named_routes) * seeds
    _advise_to_measure(files)
    file = next(iter(files), None)
    block_kinds: dict[str, Any] = {
        f"{role}s": list(load_usable(kinds, partial(check_block, file, gains, role)))
        for role, kinds in (("estimator", estimators), ("controller", controllers), ("guide", guides))
    }
    count = drive_count * math.prod(max(len(kinds), 1) for kinds in block_kinds.values())
    with show_progress(note("cli.sweep", drives=count), count) as advance:
        result = run_sweep(**block_kinds, advance=advance)
    print_answer(result, as_json, combinations=result.combinations())
    print_omitted()
    report.write_page(result)
    if len(result.drives) < result.requested_drives:
        raise Interruption.of(
            "cli.study-interrupted", count=len(result.drives), total=result.requested_drives
        )
