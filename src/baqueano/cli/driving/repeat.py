"""Define `baqueano repeat`: drive a taught route again."""

import click

from baqueano.cli import numbers, options
from baqueano.cli.driving.drive_options import DriveOptions, drive_options
from baqueano.cli.driving.route import (
    check_drivable,
    fastest_route,
    parse_room,
    repetition_start,
    room_option,
    start_option,
)
from baqueano.cli.driving.targets import announce_rest, print_fault_detections
from baqueano.cli.next_command import advise_to_fit
from baqueano.cli.page import live
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.terminal import print_answer, print_message, real_time_display, show_time_progress
from baqueano.diagnostics import note
from baqueano.messages.printable import baqueano_command


@click.command(help="Drive the taught ROUTE again, for N laps or for ever.")
@click.argument("route")
@options.vehicle
@options.robot
@click.option(
    "--laps",
    type=numbers.count_or_none,
    default=1,
    show_default=True,
    help="Number of laps; 0: until Ctrl-C, in a simulation in real time.",
)
@room_option
@start_option
@click.option(
    "--force", is_flag=True, help="Drive the route even if it is too fast for the vehicle, or has gaps."
)
@click.option(
    "--faster",
    is_flag=True,
    help="Drive as fast as the identified vehicle can, instead of at the taught speed.",
)
@click.option(
    "--from",
    "stand",
    metavar="X,Y,DEG",
    help=(
        "Pose of the vehicle relative to the start of the route [m, m, degrees]; the vehicle first drives to "
        "the route."
    ),
)
@click.option(
    "--lead-in/--no-lead-in",
    default=True,
    show_default=True,
    help=(
        "Drive a path onto the route first, if the vehicle is not at its start, and after a pause in which it was "
        "moved. Without this path, a vehicle that was moved drives back to the place of the pause."
    ),
)
@click.option("--return", "way_back", is_flag=True, help="Afterwards drive back to the start of the route.")
@click.option(
    "--caution/--no-caution",
    default=True,
    show_default=True,
    help="Slow down, and stop, if a sensor is degraded or the position is uncertain.",
)
@click.option(
    "--patience",
    "patience_s",
    type=numbers.seconds,
    default=20.0,
    show_default=True,
    help="Time after which the drive of a stuck vehicle is ended [s].",
)
@click.option(
    "--time-limit",
    "time_limit_s",
    type=numbers.seconds,
    help=(
        "Time after which a drive ends if its guide does not end it [s]; default: ten times the planned time plus 60 s."
    ),
)
@options.estimator
@click.option(
    "--controller", metavar="FILE:CLASS", help="Controller that replaces the controller of the vehicle file."
)
@click.option("--guide", metavar="FILE:CLASS", help="Guide that replaces the guide of the vehicle file.")
@options.rest
@options.seed
@options.shake
@options.backend
@options.runs_folder
@options.out
@report_options
@live.page
@options.as_json
@drive_options
def command(
    route: str, drive: DriveOptions, laps: int, room: str | None, start: str | None, force: bool, faster: bool,
    stand: str | None, lead_in: bool, way_back: bool, caution: bool, patience_s: float, time_limit_s: float | None,
    estimator: str | None, controller: str | None, guide: str | None, rest_s: float | None, report: ReportFiles,
    as_json: bool,
) -> None:  # fmt: skip
    from baqueano.compare import compare
    from baqueano.drive.mission import Mission
    from baqueano.drive.safety.precautions import Precautions
    from baqueano.guides import Repeat

    vehicle_file = drive.load_vehicle()
    options.advise_to_measure(vehicle_file, drive.robot)
    taught_route = options.find_route(route)
    if faster:
        taught_route = fastest_route(taught_route, route, vehicle_file, backend=drive.backend)
    walled_room = parse_room(vehicle_file, room, start)
    check_drivable(taught_route, route, vehicle_file, walled_room, drive.robot, force, drive.backend)
    precautions = Precautions(
        check=True,
        force=force,
        room=walled_room,
        lead_in=lead_in,
        way_back=way_back,
        caution=caution,
        patience_s=patience_s,
        time_limit_s=time_limit_s,
    )
    own_kinds = {"estimator": estimator, "controller": controller, "guide": guide}
    own_kinds = {role: options.block_kind(vehicle_file, role, kind) for role, kind in own_kinds.items()}
    mission = Mission(
        "repeat", route=taught_route, laps=laps, blocks={role: k for role, k in own_kinds.items() if k is not None},
        start=repetition_start(taught_route, stand), rest_s=rest_s, precautions=precautions.to_json(),
    )  # fmt: skip
    with drive.open(vehicle_file) as target:
        path = drive.run_path("repeat")
        duration_s = announce_rest(mission, vehicle_file) + Repeat.along(taught_route, laps).duration_s
        if laps == 0:
            print_message(note("cli.until-ctrl-c"))
        with show_time_progress(note("cli.repeat"), laps and duration_s) as progress:
            is_paced = laps == 0 and drive.kind == "simulated" and not drive.show_page
            run = target.drive(
                mission, vehicle_file, path, real_time_display(progress) if is_paced else progress
            )
    print_message(note("cli.run", path=path))
    print_fault_detections(run, vehicle_file, drive.shake)
    comparison = compare(run)
    print_answer(comparison, as_json, table=comparison.short_table(), laps=comparison.laps())
    if not as_json:
        print_message(note("cli.all-rows", fix=baqueano_command("compare", path)))
    vehicle_options = options.vehicle_and_runs_options(vehicle_file, drive.folder)
    advise_to_fit(comparison, [run], drive.folder, vehicle_options)
    report.write_table(comparison)
    if report:
        from baqueano.report.run_report import run_page

        report.write(lambda: run_page(run))
    options.raise_stop(run, path)
