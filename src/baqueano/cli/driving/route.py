"""Define `baqueano route`: draw, import, edit and check routes."""

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from baqueano.cli import numbers, options
from baqueano.cli.blocks import RowsResult
from baqueano.cli.driving.teach import shape_or_route
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.subcommands import SubcommandGroup
from baqueano.cli.terminal import print_answer, print_message
from baqueano.contracts.names import SHAPE_NAMES, STORED_ROUTES
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, Verdict, fault, nearest, note
from baqueano.errors import AnswerNo, FileError, UsageError
from baqueano.messages.language import number
from baqueano.messages.printable import baqueano_command, shell_command

if TYPE_CHECKING:
    from baqueano.guides.route import Route
    from baqueano.routes.examine import RouteReport
    from baqueano.routes.room import Room
    from baqueano.vehicle_file import VehicleFile

NAME = "NAME"  # of routes.path, which loads numpy
XY = (("x_m", "y_m"), ("x", "y"))  # columns of points


@click.group(
    cls=SubcommandGroup, help="Draw, import, smooth, cut, join, reverse, scale, speed up or check a route."
)
def command() -> None: ...


vehicle = options.vehicle
new_name = click.option(
    "-o",
    "--out",
    "name",
    metavar="NAME",
    help="Route to write; default: ROUTE and the name of this command, lap-smooth.",
)
room_option = click.option(
    "--room",
    metavar="WIDTHxHEIGHT",
    help="Size of the room [m]; the route begins in the middle, along x, or at --start.",
)
start_option = click.option(
    "--start", metavar="X,Y,DEG", help="Start of the route in the room, from its middle [m, m, degrees]."
)


@command.command("ls", help="List the stored routes, one per line.")
@options.as_json
def ls(as_json: bool) -> None:
    from baqueano.routes import examine

    rows = []
    for path in sorted(STORED_ROUTES.glob("*.csv"), key=lambda path: path.stem):
        try:
            row = examine(options.find_route(str(path))).rows()[0]
        except FileError as error:
            print_message(note("cli.warning", cause=error.diagnostic))
            continue
        if not as_json:
            row = {
                "route": path.stem,
                "length": f"{number(row['length_m']):.2f} m",
                "duration": f"{number(row['duration_s']):.1f} s",
                "speed": f"{number(row['max_speed_m_s']):.2f} m/s",
            }
        rows.append({"route": path.stem, **row})
    print_answer(RowsResult(rows), as_json)
    if not rows:
        print_message(note("route.none-stored"))


@command.command("check", help=("Check if the identified vehicle can drive ROUTE, and if it fits in a room."))
@click.argument("route")
@vehicle
@room_option
@start_option
@options.backend
@report_options
@options.as_json
def check(
    route: str, vehicle: str | None, settings: tuple[str, ...], room: str | None, start: str | None, backend: str,
    report: ReportFiles, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.routes import examine

    vehicle_file = options.load_vehicle(vehicle, settings)
    place = parse_room(vehicle_file, room, start)
    result = examine(options.find_route(route), vehicle_file, place, backend=backend)
    result = print_examined(result, route, as_json)
    report.write_page(result)
    for finding in result.findings:
        if finding.severity == Severity.ERROR:
            details = {"route": route, "cause": finding}
            raise AnswerNo(fault("cli.route-refused", finding.fix, **details) if finding.fix else finding)


@command.command("draw", help=f"Store a shape as route NAME; SHAPE: {', '.join(SHAPE_NAMES)}.")
@click.argument("shape", metavar="SHAPE")
@click.argument("name")
@options.speed_and_size
@options.as_json
def draw(shape: str, name: str, size_m: float, speed_m_s: float, as_json: bool) -> None:
    if shape not in SHAPE_NAMES:
        raise UsageError.of("shape.unknown", value=shape, suggestion=nearest(shape, SHAPE_NAMES))
    store_route(shape_or_route(shape, speed_m_s, size_m), name, as_json)


@command.command(
    "import", help="Store the path of a RUN, or the points of a CSV file with columns x and y [m]."
)
@click.argument("source")
@click.argument("name")
@click.option(
    "--speed", "speed_m_s", type=numbers.speed, default=0.25, show_default=True, help="Speed at the points [m/s]."
)  # fmt: skip
@click.option(
    "--closed/--open", default=None, help=("Close the route. Default: closed if its end is at its start.")
)
@options.runs_folder
@options.as_json
def import_(
    source: str, name: str, speed_m_s: float, closed: bool | None, folder: str, as_json: bool
) -> None:
    if source.lower().endswith(".csv"):
        route = read_point_route(Path(source), speed_m_s, closed=closed)
    else:
        from baqueano.drive import run_route
        from baqueano.routes.edit import has_close_ends

        options.refuse_together(source, "speed_m_s")

        (run,) = options.find_runs((source,), folder)
        route = run_route(run)
        route = run_route(run, closed=True) if closed or (closed is None and has_close_ends(route)) else route
    store_route(route, name, as_json)


@command.command("smooth", help="Remove short waves and stops from ROUTE, within a tolerance.")
@click.argument("route")
@click.option("--rms", "rms_m", type=numbers.length, help="Tolerance: rms distance from the old path [m].")
@click.option(
    "--max",
    "max_m",
    type=numbers.length,
    help=("Tolerance: largest distance from the old path [m]; default: 0.05."),
)
@new_name
@options.as_json
def smooth(route: str, rms_m: float | None, max_m: float | None, name: str | None, as_json: bool) -> None:
    from baqueano.routes import smooth

    if rms_m is not None and max_m is not None:
        raise UsageError.of("cli.two-tolerances")
    limit = (0.05 if max_m is None else max_m, "max") if rms_m is None else (rms_m, "rms")
    apply_edit(route, "smooth", name, as_json, lambda original: smooth(original, *limit))  # pyright: ignore[reportArgumentType]


@command.command("cut", help="Keep the part of ROUTE between two distances along it [m].")
@click.argument("route")
@click.option(
    "--from",
    "from_m",
    type=numbers.Number("m", excludes_low=False),
    default=0.0,
    show_default=True,
    help="Start of the part to keep [m].",
)
@click.option(
    "--to", "to_m", type=numbers.length, help=("End of the part to keep [m]; default: the end of the route.")
)
@new_name
@options.as_json
def cut(route: str, from_m: float, to_m: float | None, name: str | None, as_json: bool) -> None:
    from baqueano.routes import cut

    apply_edit(route, "cut", name, as_json, lambda original: cut(original, from_m, to_m))


@command.command("join", help="Join two routes: first ROUTE, then OTHER from the end of ROUTE.")
@click.argument("route")
@click.argument("other")
@new_name
@options.as_json
def join(route: str, other: str, name: str | None, as_json: bool) -> None:
    from baqueano.routes import join

    apply_edit(route, Path(other).stem, name, as_json, lambda first: join(first, options.find_route(other)))


@command.command("reverse", help="Reverse the direction of ROUTE.")
@click.argument("route")
@click.option("--backing", is_flag=True, help="Keep the poses, so that the vehicle drives backward.")
@new_name
@options.as_json
def reverse(route: str, backing: bool, name: str | None, as_json: bool) -> None:
    from baqueano.routes import reverse

    apply_edit(route, "reverse", name, as_json, lambda original: reverse(original, backing))


@command.command("scale", help="Make ROUTE larger or smaller at the same speed.")
@click.argument("route")
@click.argument("factor", type=numbers.Number("", high=1000.0))
@new_name
@options.as_json
def scale(route: str, factor: float, name: str | None, as_json: bool) -> None:
    from baqueano.routes import scale

    apply_edit(route, "scale", name, as_json, lambda original: scale(original, factor))


@command.command(
    "faster",
    help=("Give ROUTE the highest speeds that the identified vehicle can reach, or a constant speed."),
)
@click.argument("route")
@vehicle
@click.option(
    "--speed", "speed_m_s", type=numbers.speed, help="Constant speed instead of the highest speeds [m/s]."
)
@click.option(
    "--command-share",
    type=numbers.Number("", high=1.0),
    default=0.8,
    show_default=True,
    help="Fraction of the command to use; the rest stays for the controller.",
)
@click.option(
    "--lateral", "lateral_m_s2", type=numbers.Number("m/s²"), default=3.0, show_default=True,
    help="Largest lateral acceleration [m/s²].",
)  # fmt: skip
@new_name
@options.backend
@options.as_json
def faster(
    route: str, vehicle: str | None, settings: tuple[str, ...], speed_m_s: float | None, command_share: float,
    lateral_m_s2: float, name: str | None, backend: str, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.routes import at_speed

    if speed_m_s is not None:
        options.refuse_together("--speed", "command_share", "lateral_m_s2")
        return apply_edit(route, "speed", name, as_json, lambda original: at_speed(original, speed_m_s))
    vehicle_file = options.load_vehicle(vehicle, settings)
    limits: JsonObject = {"command_share": command_share, "lateral_m_s2": lateral_m_s2, "backend": backend}
    apply_edit(route, "fast", name, as_json, lambda x: fastest_route(x, route, vehicle_file, **limits))


def check_drivable(
    route: "Route", name: str, vehicle_file: "VehicleFile", room: "Room | None", robot: str, force: bool, backend: str,
) -> None:  # fmt: skip
    """Print the warnings about a route. Raise AnswerNo with the route's name if it may not be driven."""
    from baqueano.drive.safety.route_check import route_warnings

    conditions = {"measured": options.is_measured(vehicle_file, robot), "force": force, "backend": backend}
    try:
        warnings = route_warnings(route, vehicle_file, room, **conditions)
    except AnswerNo as error:
        raise AnswerNo(with_route_name(error.diagnostic, name)) from error
    for warning in warnings:
        print_message(note("cli.warning", cause=with_route_name(warning, name)))


def fastest_route(route: "Route", name: str, vehicle_file: "VehicleFile", **choices: Any) -> "Route":
    """Return the route at the highest speeds that the identified vehicle can drive; print if it then takes longer."""
    from baqueano.routes.profile import COMMAND_SHARE, fastest

    try:
        result = fastest(route, vehicle_file, **choices)
    except UsageError as error:
        raise UsageError(with_route_name(error.diagnostic, name)) from error
    figures: dict[str, Any] = {"former_duration_s": float(route.t_s[-1]), "duration_s": float(result.t_s[-1])}
    if figures["duration_s"] > figures["former_duration_s"]:
        figures["percent"] = 100.0 * (1.0 - choices.get("command_share", COMMAND_SHARE))
        figures["fix"] = baqueano_command("route", "faster", name, "--command-share", "1.0")
        print_message(note("cli.route-slower", **figures))
    return result


def repetition_start(route: "Route", stand: str | None) -> tuple[float, ...]:
    """Return the start pose in the map of a vehicle at "x,y,degrees" from the start of the route; () without `stand`.

    Raise UsageError for an invalid pose.
    """
    import numpy as np

    from baqueano.geometry import map_from_body

    if stand is None:
        return ()
    x, y, degrees = parse_pose(stand, "cli.pose-unreadable")
    start_pose = route.eta[0]
    xy = start_pose[:2] + map_from_body(start_pose[2])[:2, :2] @ np.array([x, y])
    return (float(xy[0]), float(xy[1]), float(start_pose[2] + np.radians(degrees)))


def parse_pose(text: str, code: str) -> tuple[float, float, float]:
    """Return x, y [m] and degrees from the text of an option. Raise UsageError with this code for an invalid pose."""
    try:
        x, y, degrees = (float(value) for value in text.split(","))
    except ValueError as error:
        raise UsageError.of(code, value=text) from error
    if not abs(x) + abs(y) + abs(degrees) < float("inf"):
        raise UsageError.of(code, value=text)
    return x, y, degrees


def with_route_name(diagnostic: Diagnostic, route: str) -> Diagnostic:
    """Return a copy of a finding whose command contains the name or the file of the route, quoted for the shell."""
    if NAME not in diagnostic.fix:
        return diagnostic
    names = {NAME: route, f"routes/{NAME}.csv": options.route_path(route)}
    words = [names.get(word, word.replace(NAME, Path(route).stem)) for word in shlex.split(diagnostic.fix)]
    return replace(diagnostic, fix=shell_command(*words))


def apply_edit(
    route: str, verb: str, name: str | None, as_json: bool, edit: "Callable[[Route], Route]"
) -> None:
    """Apply an edit to a route, and store the result, by default as the name of the route and of the command."""
    try:
        result = edit(options.find_route(route))
    except UsageError as error:
        raise UsageError(with_route_name(error.diagnostic, route)) from error
    store_route(result, name or f"{Path(route).stem}-{verb}", as_json)


def store_route(route: "Route", name: str, as_json: bool) -> None:
    """Store a route, and print its figures."""
    from baqueano.routes import examine
    from baqueano.runs.route_file import write_route

    path = options.route_path(name)
    if path.exists():
        print_message(note("cli.route-replaced", path=path))
    write_route(route, path)
    name = path.stem if path.parent == STORED_ROUTES else str(path)
    if print_examined(examine(route), name, as_json).verdict == Verdict.REFUSED:
        print_message(note("cli.route-stored-refused", path=path))
        return
    check, repeat = baqueano_command("route", "check", name), baqueano_command("repeat", name)
    print_message(note("cli.route-stored", path=path, check=check, repeat=repeat))


def print_examined(result: "RouteReport", route: str, as_json: bool) -> "RouteReport":
    """Print the report of a route, and return it; its commands contain the name of the route."""
    result = replace(result, findings=tuple(with_route_name(finding, route) for finding in result.findings))
    print_answer(result, as_json)
    return result


def parse_room(vehicle_file: "VehicleFile", room: str | None, start: str | None) -> "Room | None":
    """Return the room of `--room` and `--start`; None without `--room`. Raise UsageError for an invalid room."""
    if room is None:
        if start is not None:
            raise UsageError.of("cli.start-without-room")
        return None
    import numpy as np

    from baqueano.routes.room import vehicle_room

    x, y, degrees = parse_pose(start or "0,0,0", "cli.start-unreadable")
    return vehicle_room(vehicle_file, room, start=(x, y, float(np.radians(degrees))))


def read_point_route(path: Path, speed_m_s: float, *, closed: bool | None) -> "Route":
    """Return the route through the points of a file, and print the unused columns. Raise FileError without x or y."""
    import numpy as np

    from baqueano.routes import through_points
    from baqueano.routes.path import MAX_END_GAP_M
    from baqueano.runs.route_file import column_advice
    from baqueano.runs.tables.table import read_table

    if not path.is_file():
        raise FileError.of("cli.points-absent", path=path)
    with column_advice(XY[0]):
        table = read_table(path, {})
        names = next((xy for xy in XY if set(xy) <= set(table.columns)), None)
        if names is None:
            raise FileError.of("route.columns", path=path, value=", ".join(table.columns))
        xy = np.column_stack([table.numbers(name) for name in names])
    if unused_columns := [name for name in table.columns if name not in names]:
        figures = {"speed_m_s": speed_m_s, "folder": STORED_ROUTES}
        print_message(note("route.columns-unused", names=", ".join(unused_columns), **figures))
    ends_m = float(np.hypot(*(xy[-1] - xy[0])))
    is_closed = closed if closed is not None else len(xy) > 3 and ends_m < MAX_END_GAP_M
    return through_points(xy, speed_m_s, closed=is_closed)
