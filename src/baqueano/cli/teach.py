"""baqueano teach."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import click

from baqueano.cli import options
from baqueano.cli.terminal import clocked, talk

SHAPES = ("sinuous-circle", "circle", "eight", "rectangle")


@click.command(help="Drive a path once and store it as ROUTE (a CSV file).")
@click.argument("route")
@options.vehicle
@options.robot
@click.option(
    "--driver", default="sinuous-circle", show_default=True, metavar="SHAPE|keys|FILE",
    help=f"Who drives: a shape ({', '.join(SHAPES)}), a stored route, or you with the keys.",
)  # fmt: skip
@click.option("--speed", "speed_m_s", default=0.25, show_default=True, help="Along a shape [m/s].")
@click.option("--size", "size_m", default=1.0, show_default=True, help="Radius of a circle, half length of an eight [m].")
@options.seed
@options.backend
@options.runs_folder
@options.out
def command(
    route: str, vehicle: str | None, settings: tuple[str, ...], robot: str, driver: str, speed_m_s: float,
    size_m: float, seed: int, backend: str, folder: str, out: Path | None,
) -> None:  # fmt: skip
    from baqueano.drive import stop_of, teach
    from baqueano.errors import SafetyStop
    from baqueano.runs.route_file import write_route

    file = options.load_vehicle(vehicle, settings)
    truth = options.load_truth(robot, file)
    path = options.run_path(out, folder, "teach")
    told = {"truth": truth, "seed": seed, "backend": backend, "path": path}
    if driver == "keys":
        taught = by_keys(file, told)
    else:
        asked = shape_or_route(driver, speed_m_s, size_m)
        with clocked("teach", float(asked.t_s[-1])) as seen:
            taught = teach(file, asked, closed=asked.closed, eta=asked.eta[0], progress=seen, **told)
    if (stopped := stop_of(taught.run)) and driver != "keys":  # there q ends the drive
        raise SafetyStop(f"the vehicle was stopped: {stopped} What was recorded until then is in {path}.")
    written = write_route(taught.route, route_path(route))
    talk(f"run: {path}")
    click.echo(f"route: {written} ({len(taught.route.t_s)} poses, {taught.route.t_s[-1]:.1f} s)")
    talk(f"next: baqueano repeat {route}")


def by_keys(file: Any, told: dict[str, Any]) -> Any:
    """The keyboard drives in real time until q; the route is the path driven."""
    from baqueano.clock import wall
    from baqueano.drive import teach
    from baqueano.drive.keys import Keyboard
    from baqueano.worlds import Simulated

    truth = told.pop("truth")
    with Keyboard(file.command.limit) as keyboard:
        talk("Drive with the arrow keys or w a s d; space stops; q ends the lesson.")
        world = Simulated(truth.vehicle, truth.sensors, truth.rate_hz, told["seed"], backend=told["backend"])
        return teach(file, keyboard, world=world, ticking=from_zero(wall(file.rate_hz)), live=True, **told)


def from_zero(clock: Iterable[int]) -> Iterator[int]:
    """The same ticks in the time of a simulated world, which begins at 0."""
    start = None
    for t_ns in clock:
        start = t_ns if start is None else start
        yield t_ns - start


def shape_or_route(driver: str, speed_m_s: float, size_m: float) -> Any:
    """A shape by its name, or a stored route."""
    from baqueano.guides import shapes
    from baqueano.runs.route_file import read_route

    match driver:
        case "sinuous-circle":
            return shapes.sinuous_circle(size_m, 0.1 * size_m, 6, speed_m_s)
        case "circle":
            return shapes.circle(size_m, speed_m_s)
        case "eight":
            return shapes.eight(size_m, speed_m_s)
        case "rectangle":
            return shapes.rectangle(2 * size_m, size_m, 0.2 * size_m, speed_m_s)
        case _:
            return read_route(route_path(driver))


def route_path(name: str) -> Path:
    """`lab` is routes/lab.csv; anything with an ending is a path."""
    return Path(name) if Path(name).suffix else Path("routes") / f"{name}.csv"
