"""baqueano teach."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import answer, clocked, talk

SHAPES = ("sinuous-circle", "circle", "eight", "rectangle")


@click.command(help="Drive a path once and store it as ROUTE (a CSV file).")
@click.argument("route")
@options.vehicle
@options.robot
@click.option(
    "--driver", default="sinuous-circle", show_default=True, metavar="SHAPE|keys|FILE",
    help=f"Who drives: a shape ({', '.join(SHAPES)}), a stored route, or you with the keys.",
)  # fmt: skip
@click.option(
    "--speed", "speed_m_s", type=numbers.speed, default=0.25, show_default=True, help="Along a shape [m/s]."
)
@click.option(
    "--size",
    "size_m",
    type=numbers.length,
    default=1.0,
    show_default=True,
    help="Radius of a circle, half length of an eight [m].",
)
@options.seed
@options.backend
@options.runs_folder
@options.out
@options.as_json
def command(
    route: str, vehicle: str | None, settings: tuple[str, ...], robot: str, driver: str, speed_m_s: float,
    size_m: float, seed: int, backend: str, folder: str, out: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    from baqueano.drive import teach
    from baqueano.runs.route_file import write_route

    file = options.load_vehicle(vehicle, settings)
    truth = options.load_truth(robot, file)
    told = {"truth": truth, "seed": seed, "backend": backend}
    if driver == "keys":
        path = options.run_path(out, folder, "teach")
        taught = by_keys(file, told | {"path": path})
    else:
        asked = shape_or_route(driver, speed_m_s, size_m)
        path = options.run_path(out, folder, "teach")
        with clocked("teach", float(asked.t_s[-1])) as seen:
            taught = teach(
                file, asked, closed=asked.closed, eta=asked.eta[0], progress=seen, path=path, **told
            )
    talk(f"run: {path}")
    if driver != "keys":  # there q ends the drive
        options.ended(taught.run, path)
    answer(Stored(taught.route, write_route(taught.route, options.route_path(route)), path), as_json)
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
            return options.find_route(driver)


@dataclass(frozen=True)
class Stored:
    """What a lesson leaves."""

    route: Any
    path: Path
    run: Path
    verdict: str = "USABLE"

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"route": str(self.path), "run": str(self.run), "poses": len(self.route.t_s),
             "duration_s": float(self.route.t_s[-1]), "closed": bool(self.route.closed)}
        ]  # fmt: skip

    def table(self) -> str:
        closed = "closed" if self.route.closed else "open"
        return f"route: {self.path} ({len(self.route.t_s)} poses, {self.route.t_s[-1]:.1f} s, {closed})"
