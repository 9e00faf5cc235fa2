"""Define `baqueano forecast`: predict the uncertainty of the position along a route."""

import click

from baqueano.cli import numbers, options
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.terminal import print_answer, show_activity
from baqueano.diagnostics import note


@click.command(help="Predict, before a drive of ROUTE, the uncertainty of the position, lap by lap.")
@click.argument("route")
@options.vehicle
@click.option(
    "--laps", type=numbers.count, default=1, show_default=True, help=("Number of laps of a closed route.")
)
@options.rest
@options.backend
@report_options
@options.as_json
def command(
    route: str, vehicle: str | None, settings: tuple[str, ...], laps: int, rest_s: float | None, backend: str,
    report: ReportFiles, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.compare.corridor_forecast import forecast_corridor

    vehicle_file = options.load_vehicle(vehicle, settings)
    options.advise_to_measure(vehicle_file)
    taught_route = options.find_route(route)
    with show_activity(note("cli.driving-ahead", laps=laps)):
        corridor = forecast_corridor(vehicle_file, taught_route, laps, backend, rest_s)
    print_answer(corridor, as_json)
    report.write_page(corridor)
