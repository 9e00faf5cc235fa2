"""Define `baqueano teach`: drive a path once and store it as a route."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from baqueano.cli import options
from baqueano.cli.driving.drive_options import DriveOptions, drive_options
from baqueano.cli.driving.manual_drive import (
    drive_manually,
    drive_on_page,
    finish_manual_drive,
    hold_option,
    lap_scale,
    mark_scales,
    pad_option,
)
from baqueano.cli.driving.targets import announce_rest
from baqueano.cli.page import live
from baqueano.cli.terminal import print_answer, print_message, show_time_progress
from baqueano.contracts.names import SHAPE_NAMES
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict, nearest, note
from baqueano.errors import AnswerNo, UsageError
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.guides.route import Route


@click.command(help="Drive a path once and store it as ROUTE (a CSV file).")
@click.argument("route")
@options.vehicle
@options.robot
@click.option(
    "--driver", default="sinuous-circle", show_default=True, metavar="SHAPE|keys|FILE",
    help=f"Driver of the vehicle: a shape ({', '.join(SHAPE_NAMES)}), a stored route, or a person with the keys.",
)  # fmt: skip
@pad_option
@hold_option
@options.speed_and_size
@click.option(
    "--closed",
    is_flag=True,
    help="You drive a lap back to its start, with the same heading; the lap then gives the scale of the gyro.",
)
@click.option("--update", is_flag=True, help="Write the scale from the lap into the vehicle file.")
@options.rest
@options.seed
@options.backend
@options.runs_folder
@options.out
@live.page
@options.as_json
@drive_options
def command(
    route: str, drive: DriveOptions, driver: str, pad: str | None, hold: bool, speed_m_s: float, size_m: float,
    closed: bool, update: bool, rest_s: float | None, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.drive import replay, run_route
    from baqueano.drive.mission import Mission
    from baqueano.runs.route_file import check_ending, write_route

    check_ending(options.route_path(route))
    _check_driver(driver, pad is not None or not hold or closed or update)
    if drive.show_page:
        options.refuse_together("--page", "pad")
    vehicle_file = drive.load_vehicle()
    options.advise_to_measure(vehicle_file, drive.robot)
    if driver == "keys":
        path = drive.run_path("teach")
        make_drive = drive_on_page if drive.show_page else partial(drive_manually, pad=pad)
        run, is_closed = make_drive("teach", vehicle_file, drive, path, hold=hold), closed
    else:
        target_route = shape_or_route(driver, speed_m_s, size_m, valid_names=("keys",))
        with drive.open(vehicle_file) as target:
            path = drive.run_path("teach")
            mission = Mission("teach", route=target_route, rest_s=rest_s)
            duration_s = announce_rest(mission, vehicle_file) + float(target_route.t_s[-1])
            with show_time_progress(note("cli.teach"), duration_s) as progress:
                run = target.drive(mission, vehicle_file, path, progress, eta=target_route.eta[0])
        is_closed = target_route.closed
    print_message(note("cli.run", path=path))
    finish_manual_drive(run, path, drive.robot) if driver == "keys" else options.raise_stop(run, path)
    text, values = "", {}
    if driver == "keys":
        text, values = (lap_scale if closed else mark_scales)(run, vehicle_file)
        run = replay(run, vehicle_file.with_values(values)) if closed and values else run
    vehicle_options = options.vehicle_and_runs_options(vehicle_file)
    try:
        taught_route = run_route(run, closed=is_closed)
    except AnswerNo as error:
        if driver not in SHAPE_NAMES:
            raise
        slow_drive = baqueano_command("teach", route, "--driver", driver, "--speed", "0.2", *vehicle_options)
        figures = {"shape": driver, "speed_m_s": speed_m_s, "cause": error.diagnostic}
        raise AnswerNo.of("cli.not-followed", slow_drive, **figures) from None
    route_path = options.route_path(route)
    if route_path.exists():
        print_message(note("cli.route-replaced", path=route_path))
    print_answer(LessonResult(taught_route, write_route(taught_route, route_path), path), as_json)
    if text:
        print_message(text)
    if values and update:
        options.save_update(vehicle_file.with_values(values), update)
    tune = baqueano_command("tune", "--route", route, *vehicle_options, "--update")
    print_message(note("cli.taught", repeat=baqueano_command("repeat", route, *vehicle_options), tune=tune))


def _check_driver(driver: str, has_hand_options: bool) -> None:
    """Raise UsageError for an option that does not belong to this driver."""
    if driver != "keys" and has_hand_options:
        raise UsageError.of("cli.hand-options", "--driver keys", driver=driver)
    if driver not in SHAPE_NAMES:
        options.refuse_together(f"--driver {driver}", "speed_m_s", "size_m")
    if driver == "keys":
        options.refuse_together("--driver keys", "rest_s")


def shape_or_route(name: str, speed_m_s: float, size_m: float, valid_names: tuple[str, ...] = ()) -> Any:
    """Return a shape by its name, or a stored route.

    Raise UsageError for an unknown name. `valid_names`: further names that the option accepts.
    """
    from baqueano.guides.shapes import shape
    from baqueano.runs.route_file import stored_routes

    if name in SHAPE_NAMES:
        return shape(name, size_m, speed_m_s)
    if "." in name or options.route_path(name).is_file():
        return options.find_route(name)
    suggestion = nearest(name, [*SHAPE_NAMES, *valid_names, *stored_routes()])
    raise UsageError.of("cli.driver-unknown", value=name, suggestion=suggestion)


@dataclass(frozen=True)
class LessonResult:
    """The result of teaching a route."""

    route: "Route"
    path: Path
    run: Path
    verdict: str = Verdict.USABLE

    def rows(self) -> list[TableRow]:
        """Return one row: paths of route and run, number of poses, duration, and True if the route is closed."""
        return [
            {"route": str(self.path), "run": str(self.run), "poses": len(self.route.t_s),
             "duration_s": float(self.route.t_s[-1]), "closed": bool(self.route.closed)}
        ]  # fmt: skip

    def table(self) -> str:
        """Return the row as a sentence."""
        shape_word = _("closed") if self.route.closed else _("open")
        poses, duration_s = len(self.route.t_s), float(self.route.t_s[-1])
        return _(
            "route: {route} ({poses} poses, {duration_s:.1f} s, {closed})",
            route=self.path, poses=poses, duration_s=duration_s, closed=shape_word,
        )  # fmt: skip
