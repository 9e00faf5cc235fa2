"""baqueano repeat."""

from pathlib import Path

import click

from baqueano.cli import numbers, options
from baqueano.cli.driving.route import drivable, room_option, start_option, walls
from baqueano.cli.driving.targets import placed, say_ledger
from baqueano.cli.page import live
from baqueano.cli.terminal import answer, clocked, talk
from baqueano.diagnostics import note


@click.command(help="Drive the taught ROUTE again, for N laps or for ever.")
@click.argument("route")
@options.vehicle
@options.robot
@click.option(
    "--laps", type=numbers.count_or_none, default=1, show_default=True, help="0: for ever, until Ctrl-C."
)
@room_option
@start_option
@click.option("--anyway", is_flag=True, help="Also a route that is faster than the vehicle.")
@click.option("--estimator", metavar="FILE:CLASS", help="An estimator of your own instead of the file's.")
@click.option("--controller", metavar="FILE:CLASS", help="A controller of your own instead of the file's.")
@click.option("--guide", metavar="FILE:CLASS", help="A guide of your own instead of the file's.")
@options.seed
@options.shake
@options.backend
@options.runs_folder
@options.out
@options.page
@live.page
@options.as_json
def command(
    route: str, vehicle: str | None, settings: tuple[str, ...], robot: str, laps: int, room: str | None,
    start: str | None, anyway: bool, estimator: str | None, controller: str | None, guide: str | None,
    seed: int, shake: tuple[str, ...],
    backend: str, folder: str, out: Path | None, page: Path | None, shown: bool, pace: float,
    as_json: bool,
) -> None:  # fmt: skip
    from baqueano.compare import compare
    from baqueano.drive.mission import Mission

    file = options.load_vehicle(vehicle, settings)
    options.advise_to_measure(file, robot)
    taught = options.find_route(route)
    drivable(taught, route, file, walls(file, room, start), robot, anyway, backend)
    own = {"estimator": estimator, "controller": controller, "guide": guide}
    own = {room: options.own_block(file, room, kind) for room, kind in own.items()}
    what = Mission(
        "repeat", route=taught, laps=laps, blocks={room: k for room, k in own.items() if k is not None}
    )
    with (
        live.live_page(shown, robot, file, folder, pace) as watching,
        placed(robot, file, seed, backend, page=watching, shake=shake) as place,
    ):
        path = options.run_path(out, folder, "repeat")
        with clocked(note("cli.repeat"), laps * float(taught.t_s[-1])) as seen:
            run = place.drive(what, file, path, seen)
    talk(note("cli.run", path=path))
    say_ledger(run, file, shake)
    compared = compare(run)
    answer(compared, as_json)
    options.advise_to_fit(compared, [run], options.naming(file, folder), folder)
    if page is not None:
        from baqueano.report.of_run import page_of_run

        talk(note("cli.report", page=page_of_run(run).save(page)))
    options.ended(run, path)
