"""Define `baqueano serve`: open the page of a vehicle in a browser."""

from functools import partial
from pathlib import Path

import click

from baqueano.cli import numbers, options
from baqueano.cli.page import options as page_options
from baqueano.cli.terminal import print_message
from baqueano.contracts.names import STORED_ROUTES
from baqueano.errors import UsageError

GARAGE = "small"  # if there is no vehicle file


@click.command(help="Open the page of a simulated vehicle, of the vehicle at HOST, or of a recorded RUN.")
@click.argument("run", required=False)
@click.option(
    "--vehicle",
    metavar="FILE|NAME",
    help="Vehicle to simulate, or the file of the robot. Default: vehicle.toml, else small.",
)
@click.option(
    "--robot", metavar="HOST", help=("Vehicle to show: HOST by ssh, here, or the socket of its service.")
)
@click.option("--pace", type=numbers.pace, default=1.0, help="Simulated seconds per real second.")
@options.seed
@options.runs_folder
@page_options.server_options
def command(
    run: str | None, vehicle: str | None, robot: str | None, pace: float, seed: int | None, folder: str, port: int,
    share: bool, address: str, browser: bool,
) -> None:  # fmt: skip
    given_options = [name for name, value in (("--vehicle", vehicle), ("--robot", robot)) if value]
    if run is not None and given_options:
        raise UsageError.of("web.one-of", names=["RUN", *given_options])
    serve_options = page_options.serve_options(folder, port, share, address, browser)
    from baqueano.web.lab.local_files import LocalFiles
    from baqueano.web.run import show_runs, show_vehicle
    from baqueano.web.service import connect, start_simulated

    vehicle_name = vehicle or (str(options.DEFAULT_FILE) if options.DEFAULT_FILE.exists() else GARAGE)
    if run is not None:
        page_options.run(show_runs((run,), serve_options, print_message))
    elif robot is not None and robot != "simulated":
        local_files = LocalFiles(robot, vehicle_name, STORED_ROUTES, Path(folder))
        page_options.run(show_vehicle(partial(connect, robot), serve_options, print_message, local_files))
    else:
        service_options = ("--pace", str(pace), "--seed", str(seed or 0), "--routes", str(STORED_ROUTES))
        start = partial(start_simulated, vehicle_name, Path(folder), *service_options)
        page_options.run(show_vehicle(start, serve_options, print_message, vehicle=vehicle_name))
